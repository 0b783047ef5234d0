"""The paper profile: what is coded comes back as quantised, each with its own triangle, whichever coder wrote it."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from synthetic_avatars import HEAD, random_avatar, random_gaussians, random_motion
from tool_stand_in import executable

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode, encode_paper, inspect
from sacha_core.codec.paper import coded_rows
from sacha_core.codec.paper_encoder import matched
from sacha_core.codec.paper_map import (
    RATES,
    dead_zone_level,
    from_integers,
    qps_of,
    reconstructed,
    row_order,
    step_of,
    to_integers,
)
from sacha_core.codec.paper_tree import decode_points, encode_points
from sacha_core.codec.reading import ByteReader
from sacha_core.errors import FormatError, OptionError

HALF_A_STEP = {
    "expression": 5e-3 / 2,
    "rotation": 2.5e-4 / 2,
    "translation": 2e-5 / 2,
    "shape": 5e-3 / 2,
    "static_offset": 2e-5 / 2,
}
ROUNDING = 1.001  # of float32 products


def multiset(gaussians: Gaussians) -> Counter[bytes]:
    """Every Gaussian with its triangle, in no order: the oracle that method.md names."""
    g = gaussians
    n = len(g)
    parts = (
        g.position,
        g.log_scale,
        g.quaternion,
        g.opacity_logit[:, None],
        g.sh_dc,
        g.sh_rest.reshape(n, 3 * g.sh_rest.shape[1]),
    )
    table = np.concatenate([*parts, g.binding[:, None].astype(np.float32)], axis=1).astype(np.float32)
    return Counter(row.tobytes() for row in table)


def as_quantised(avatar: Avatar, level: int) -> Gaussians:
    """What the profile makes of an avatar, without any coding."""
    g = avatar.gaussians
    rows, low = to_integers(g)
    decoded = coded_rows(rows, qps_of(level, g.sh_degree), g.sh_rest.shape[1])[0]
    return from_integers(decoded, low, g.binding, g.sh_rest.shape[1])


def crowded(n: int, n_harmonics: int) -> Avatar:
    """Many Gaussians at the same few points, some of them the same in everything but their triangle."""
    g = random_gaussians(n, n_harmonics=n_harmonics, seed=3)
    same = g.select(np.arange(n) % 7)
    mixed = replace(g, position=g.position[np.arange(n) % 5])
    both = {
        name: np.concatenate([getattr(same, name), getattr(mixed, name)])
        for name in vars(g)
        if getattr(g, name) is not None
    }
    both["binding"] = np.random.default_rng(0).integers(0, HEAD.n_faces, 2 * n).astype(np.int32)
    return Avatar(Gaussians(**both), HEAD)


@pytest.mark.parametrize("level", RATES)
@pytest.mark.parametrize("n_harmonics", [0, 3, 8, 15])
def test_round_trip_returns_the_exact_multiset(level, n_harmonics):
    avatar = random_avatar(200, n_frames=5, n_harmonics=n_harmonics, seed=level)
    assert multiset(decode(encode_paper(avatar, level)).gaussians) == multiset(as_quantised(avatar, level))


@pytest.mark.parametrize("level", [1, 4])
def test_ties_keep_their_triangles(level):
    avatar = crowded(60, 3)
    assert multiset(decode(encode_paper(avatar, level)).gaussians) == multiset(as_quantised(avatar, level))


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_gaussians(n):
    avatar = random_avatar(n, n_frames=0, seed=n)
    back = decode(encode_paper(avatar))
    assert multiset(back.gaussians) == multiset(as_quantised(avatar, 2))


def test_steps_double_every_six_and_errors_stay_below_two_thirds_of_one():
    """Oracle: the definition, step = 2^((QP - 4) / 6) units of 12 bits, dead zone 1/3."""
    qps = np.arange(4, 52)
    assert np.abs(step_of(qps) / 256 - 2 ** ((qps - 4) / 6)).max() / 2**8 < 0.004
    values, centre = np.arange(4096)[:, None], np.array([2000])
    for qp in qps:
        off = reconstructed(dead_zone_level(values, centre, np.array([qp])), centre, np.array([qp])) - values
        assert np.abs(off).max() <= 2 / 3 * step_of(np.array([qp]))[0] / 256 + 0.5


@given(arrays.arrays(np.int64, st.tuples(st.integers(0, 30), st.just(3)), elements=st.integers(0, 2**18 - 1)))
@settings(max_examples=60, deadline=None)
def test_points_come_back_sorted(points):
    back = decode_points(ByteReader(encode_points(points), "points"), len(points))
    assert np.array_equal(back, points[np.lexsort(points.T[::-1])])


def test_motion_is_within_half_a_step():
    motion = random_motion(40, seed=2)
    back = decode(encode_paper(Avatar(random_gaussians(10), HEAD, motion))).motion
    assert back is not None
    assert back.frame_rate == motion.frame_rate
    for name, bound in HALF_A_STEP.items():
        assert np.abs(getattr(back, name) - getattr(motion, name)).max() < bound * ROUNDING


def test_positions_beyond_the_grid_are_refused():
    gaussians = random_gaussians(5)
    gaussians.position[2, 1] = 300
    with pytest.raises(FormatError, match="paper profile holds 256"):
        encode_paper(Avatar(gaussians, HEAD))


def test_levels_are_the_four_rate_points():
    with pytest.raises(OptionError, match="levels are 1 to 4"):
        encode_paper(random_avatar(3), 5)


@pytest.fixture(params=["tmc3", "ges-tm"])
def program(request, tmp_path):
    """The stand-in as an executable file, under a name by which it knows which program to be."""
    return executable(tmp_path / request.param)


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")
def test_external_program_codes_and_decodes(program, monkeypatch):
    avatar = crowded(8, 3)
    data = encode_paper(avatar, 4, tmc3=program)
    with pytest.raises(OptionError, match="SACHA_TMC3=PATH"):
        decode(data)
    monkeypatch.setenv("SACHA_TMC3", str(program))
    back = decode(data).gaussians
    assert inspect(data).coder == ("GeS-TM" if "ges" in program.name else "tmc3")
    rows, _ = to_integers(avatar.gaussians)
    theirs, _ = to_integers(back)
    assert np.array_equal(theirs[row_order(theirs)][:, :3], rows[row_order(rows)][:, :3])
    assert sorted(back.binding) == sorted(avatar.gaussians.binding)
    bound = Counter(zip(map(tuple, rows[:, :3].tolist()), avatar.gaussians.binding.tolist(), strict=True))
    assert Counter(zip(map(tuple, theirs[:, :3].tolist()), back.binding.tolist(), strict=True)) == bound


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")
def test_program_that_fails_is_told(tmp_path):
    with pytest.raises(FormatError, match="ended with status 3: out of luck"):
        encode_paper(random_avatar(3), tmc3=executable(tmp_path / "broken"))
    with pytest.raises(OptionError, match="cannot be run"):
        encode_paper(random_avatar(3), tmc3=tmp_path / "missing")


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")
def test_a_program_that_is_not_where_it_was_named_is_told(program, monkeypatch):
    data = encode_paper(crowded(8, 3), 4, tmc3=program)
    monkeypatch.setenv("SACHA_TMC3", str(program.with_name("elsewhere")))
    with pytest.raises(OptionError, match=r"SACHA_TMC3 names .*elsewhere, which is no file"):
        decode(data)


def test_of_several_at_a_point_the_most_alike_are_matched():
    given_rows = np.array([[1, 1, 1, 100], [1, 1, 1, 900], [0, 0, 0, 5], [1, 1, 1, 500]])
    decoded = np.array([[0, 0, 0, 7], [1, 1, 1, 480], [1, 1, 1, 890], [1, 1, 1, 120]])
    assert matched(given_rows, decoded).tolist() == [2, 3, 1, 0]


def test_coder_is_told():
    assert inspect(encode_paper(random_avatar(3))).coder == "own coder"
