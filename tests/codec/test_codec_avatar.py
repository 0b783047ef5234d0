"""Whole avatars through the codec."""

from __future__ import annotations

import sys
from dataclasses import replace
from subprocess import run

import numpy as np
import pytest
from synthetic_avatars import HEAD, random_avatar, random_gaussians, random_motion, small_head

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode, embedded_head, encode, inspect
from sacha_core.codec.levels import LEVELS
from sacha_core.errors import FormatError, HeadError, OptionError

LEVEL_NUMBERS = [1, 2, 3, 4]
FLOAT32_ROUNDING = 1e-6  # a decoded motion value is one float64 product, rounded once
VISIBLE_LOGIT = -5.538  # of an opacity of 1/255
SURELY_VISIBLE_LOGIT = -4.9  # half a step of level 4 above that


@pytest.mark.parametrize("n", [0, 1, 2, 700])
@pytest.mark.parametrize("level", LEVEL_NUMBERS)
def test_file_decodes_to_a_valid_avatar_of_the_same_make(n, level):
    avatar = random_avatar(n, seed=n)
    data = encode(avatar, level, drop_invisible=False)
    back = decode(data)
    back.gaussians.validate(avatar.head.n_faces)
    assert back.head == avatar.head
    assert back.scheme == avatar.scheme
    assert np.array_equal(np.sort(avatar.gaussians.binding), back.gaussians.binding)
    assert back.gaussians.sh_rest.shape == avatar.gaussians.sh_rest.shape
    assert back.motion is not None
    assert len(back.motion) == len(avatar.motion)
    assert encode(avatar, level, drop_invisible=False) == data


@pytest.mark.parametrize("n_harmonics", [0, 3, 8, 15])
def test_harmonics_of_every_degree(n_harmonics):
    avatar = random_avatar(50, n_harmonics=n_harmonics)
    assert decode(encode(avatar)).gaussians.sh_rest.shape[1] == n_harmonics


def test_decoding_again_what_was_decoded_changes_little_and_never_drifts():
    """Metamorphic: a second generation may move by a step, no Gaussian may get lost."""
    first = decode(encode(random_avatar(300), 3))
    second = decode(encode(first, 3))
    assert np.array_equal(first.gaussians.binding, second.gaussians.binding)
    assert np.array_equal(first.gaussians.opacity_logit, second.gaussians.opacity_logit)


def rows(avatar: Avatar) -> np.ndarray:
    """Every Gaussian as one row of numbers, sorted: the multiset."""
    g = avatar.gaussians
    table = np.concatenate(
        [g.binding[:, None], g.opacity_logit[:, None], g.log_scale, g.quaternion, g.position, g.sh_dc], axis=1
    )
    return table[np.lexsort(table.T)]


@pytest.mark.parametrize("level", [1, 4])
def test_order_of_the_gaussians_does_not_matter(level):
    """Gaussians that coincide in a triangle included: the file is a multiset, to the byte."""
    gaussians = random_gaussians(200, n_harmonics=3)
    doubled = gaussians.select(np.concatenate([np.arange(200), np.arange(0, 200, 3), np.arange(0, 200, 3)]))
    shuffled = doubled.select(np.random.default_rng(1).permutation(len(doubled)))
    assert encode(Avatar(doubled, HEAD), level) == encode(Avatar(shuffled, HEAD), level)
    back = decode(encode(Avatar(doubled, HEAD), level, drop_invisible=False))
    assert np.array_equal(np.bincount(back.gaussians.binding), np.bincount(doubled.binding))


def test_all_on_one_triangle():
    gaussians = replace(random_gaussians(3000, n_harmonics=0), binding=np.full(3000, 77, np.int32))
    back = decode(encode(Avatar(gaussians, HEAD), drop_invisible=False))
    assert (back.gaussians.binding == 77).all()
    assert len(back.gaussians) == 3000


def test_all_exactly_alike():
    """Compresses to almost nothing; the file is padded so that its size answers for what it holds."""
    gaussians = random_gaussians(1, n_harmonics=15).select(np.zeros(20_000, np.int64))
    data = encode(Avatar(gaussians, HEAD), drop_invisible=False)
    assert len(decode(data).gaussians) == 20_000
    assert "padding" in [section.name for section in inspect(data).sections]


def test_extreme_values():
    gaussians = random_gaussians(40, n_harmonics=3)
    tiny = np.float32(1e-44)
    gaussians.opacity_logit[:4] = [3e38, -3e38, tiny, -tiny]
    gaussians.log_scale[:3] = [[-3e38, 0, 1], [3e38, tiny, -90], [-23, -23, -23]]
    gaussians.quaternion[:3] = [[0, 0, 0, 0], [tiny, 0, 0, 0], [3e38, 3e38, -3e38, 3e38]]
    gaussians.position[:2] = [[80, -80, 32_768], [tiny, 0, -tiny]]
    for level in LEVEL_NUMBERS:
        back = decode(encode(Avatar(gaussians, HEAD), level, drop_invisible=False))
        back.gaussians.validate(HEAD.n_faces)
        assert len(back.gaussians) == 40


@pytest.mark.parametrize("name", ["position", "sh_dc", "sh_rest"])
def test_values_beyond_the_format_are_refused(name):
    gaussians = random_gaussians(40)
    getattr(gaussians, name)[7] = 1e9
    with pytest.raises(FormatError, match=f"{name} of Gaussian 7 is 1e\\+09"):
        encode(Avatar(gaussians, HEAD), drop_invisible=False)


def test_messages_count_rows_as_the_caller_does():
    """Whether or not Gaussians before the offender are left out; one that is left out itself offends nobody."""
    gaussians = random_gaussians(40)
    gaussians.opacity_logit[:6] = -20
    gaussians.opacity_logit[6:] = 0
    gaussians.position[[3, 10]] = 1e9
    with pytest.raises(FormatError, match="position of Gaussian 10 "):
        encode(Avatar(gaussians, HEAD))
    with pytest.raises(FormatError, match="position of Gaussian 3 "):
        encode(Avatar(gaussians, HEAD), drop_invisible=False)


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[31m", "a\x9b", "\ud800"])
def test_names_that_no_decoder_takes_are_refused(name):
    avatar = random_avatar(3)
    with pytest.raises(FormatError, match="control characters"):
        encode(replace(avatar, scheme=name))


def test_names_of_any_script_come_back():
    name = "t\u00eate\u00a0\u982d\U0001f642"
    assert decode(encode(replace(random_avatar(3), scheme=name))).scheme == name


def test_higher_levels_are_larger_and_closer():
    avatar = random_avatar(900, n_harmonics=15)
    sizes, errors = [], []
    for level in LEVEL_NUMBERS:
        data = encode(avatar, level, drop_invisible=False)
        back = decode(data).gaussians
        sizes.append(len(data))
        colour = np.sort(back.sh_dc[:, 0]) - np.sort(avatar.gaussians.sh_dc[:, 0])
        position = np.sort(back.position[:, 0]) - np.sort(avatar.gaussians.position[:, 0])
        errors.append((np.abs(colour).mean(), np.abs(position).mean()))
    assert sizes == sorted(sizes)
    assert len(set(sizes)) == 4
    assert (np.diff(np.array(errors), axis=0) < 0).all()


def test_what_no_renderer_draws_is_left_out_unless_asked_for():
    avatar = random_avatar(500)
    visible = int((avatar.gaussians.opacity_logit >= VISIBLE_LOGIT).sum())
    surely = int((avatar.gaussians.opacity_logit >= SURELY_VISIBLE_LOGIT).sum())
    kept = decode(encode(avatar, 4)).gaussians
    assert surely <= len(kept) <= visible < 500
    assert (kept.opacity_logit >= VISIBLE_LOGIT).all()
    assert len(decode(encode(avatar, drop_invisible=False)).gaussians) == 500


@pytest.mark.parametrize("level", LEVEL_NUMBERS)
def test_motion_stays_within_a_step_and_what_is_said_once_within_half(level):
    """Residuals may be rounded towards 0 by up to 0.9 of a step, and a step be up to 19 % larger than asked for."""
    avatar = random_avatar(5, n_frames=60)
    back = decode(encode(avatar, level, group_frames=25)).motion
    chosen = LEVELS[level]
    steps = {"expression": chosen.expression_step, "translation": chosen.translation_step, "shape": chosen.shape_step}
    steps["static_offset"] = chosen.offset_step
    assert back is not None
    assert back.frame_rate == avatar.motion.frame_rate
    for name in ("shape", "static_offset", "expression", "rotation", "neck", "jaw", "eyes", "translation"):
        share = 0.5 if name in ("shape", "static_offset") else 0.9 * 1.19
        error = np.abs(getattr(back, name) - getattr(avatar.motion, name)).max()
        assert error <= steps.get(name, chosen.angle_step_rad) * (share + FLOAT32_ROUNDING) + 4 * FLOAT32_ROUNDING


def test_what_was_encoded_with_the_head_needs_it():
    head = small_head()
    avatar = random_avatar(400, n_harmonics=0, head=head)
    data = encode(avatar, head=head)
    assert inspect(data).needs_head
    assert not inspect(encode(avatar)).needs_head
    assert decode(data, head=head).head == head.reference


def test_missing_head_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path))
    head = small_head()
    data = encode(random_avatar(20, head=head), head=head)
    with pytest.raises(HeadError, match="bumpy"):
        decode(data)


def test_another_head_is_refused():
    head, other = small_head(), replace(small_head(1), name="other")
    avatar = random_avatar(20, head=head)
    with pytest.raises(HeadError, match="other"):
        encode(avatar, head=other)
    with pytest.raises(HeadError, match="other"):
        decode(encode(avatar, head=head), head=other)
    with pytest.raises(HeadError, match="300 triangles"):
        encode(replace(avatar, head=replace(head.reference, n_faces=300)), head=head)
    with pytest.raises(HeadError, match="other"):
        decode(encode(avatar), head=other)


def test_embedded_head_comes_back_and_suffices(tmp_path, monkeypatch):
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path))
    head = small_head()
    avatar = random_avatar(50, head=head)
    data = encode(avatar, head=head, embed_head=True)
    back = embedded_head(data)
    assert back is not None
    assert back.reference == head.reference
    assert np.array_equal(back.masks["face"], head.masks["face"])
    assert decode(data).head == head.reference
    sizes = inspect(data)
    assert sizes.head_bytes > 0
    assert sizes.gaussian_bytes + sizes.motion_bytes + sizes.head_bytes == sizes.total_bytes == len(data)
    assert embedded_head(encode(avatar, head=head)) is None


def test_options_out_of_range_are_named():
    avatar = random_avatar(3)
    with pytest.raises(OptionError, match="level 5"):
        encode(avatar, 5)
    for wrong in (0, 65536, 1.5, float("nan"), "25", None):
        with pytest.raises(OptionError, match=r"group_frames is .*, expected a whole number from 1 to 65535"):
            encode(avatar, group_frames=wrong)
    with pytest.raises(HeadError, match="embed"):
        encode(avatar, embed_head=True)


def test_inconsistent_motion_is_refused():
    avatar = random_avatar(3)
    with pytest.raises(FormatError, match="vertex offsets"):
        encode(replace(avatar, motion=random_motion(3, n_offsets=7)))
    huge = replace(avatar.motion, translation=np.full((30, 3), 1e9, np.float32))
    with pytest.raises(FormatError, match="2\\*\\*30 steps"):
        encode(replace(avatar, motion=huge))


def test_file_or_bytes(tmp_path):
    data = encode(random_avatar(10))
    path = tmp_path / "a.sacha"
    path.write_bytes(data)
    assert np.array_equal(rows(decode(path)), rows(decode(data)))
    assert inspect(path) == inspect(data)


def test_decoding_imports_neither_torch_nor_numba_nor_trimesh(tmp_path):
    path = tmp_path / "a.sacha"
    path.write_bytes(encode(random_avatar(50)))
    code = (
        "import sys\nfrom sacha_core.codec import decode\n"
        f"decode({str(path)!r})\n"
        "assert not {'torch', 'numba', 'trimesh'} & set(sys.modules), set(sys.modules)\n"
    )
    run([sys.executable, "-c", code], check=True)
