"""Finding the level for a size or a quality: against functions whose answer is known, and on a small avatar."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.codec import decode, encode, inspect
from sacha_core.codec.levels import MAX_QUALITY, MIN_QUALITY, Level, level_at
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.rate import target
from sacha_core.rate.encoding import Encoded, RenderingEncoder
from sacha_core.rate.judging import Judge
from sacha_core.rate.target import encode_to_psnr, encode_to_size, parse_size, search


@pytest.fixture(scope="module")
def avatar(head: HeadModel) -> Avatar:
    rng = np.random.default_rng(0)
    gaussians = initial_gaussians(head.n_faces, rng, 0)
    gaussians.opacity_logit[:] = rng.normal(2, 1, len(gaussians))
    for name, spread in (("position", 0.1), ("log_scale", 0.4), ("quaternion", 0.3), ("sh_dc", 0.5)):
        value = getattr(gaussians, name)
        value += rng.normal(0, spread, value.shape).astype(np.float32)
    return Avatar(gaussians, head.reference)


@given(st.floats(-0.9, 5.9), st.floats(0.2, 3), st.sampled_from([-0.01, 0.05]))
def test_a_rising_curve_is_met_on_the_right_side(place: float, bend: float, tolerance: float) -> None:
    """Oracle: the curve itself, which is neither straight nor of the slope that was said."""

    def measure(quality: float) -> float:
        return 3 * quality + bend * math.sin(quality)

    target = measure(place)
    tried = search(measure, target, 5.0, tolerance)
    side = math.copysign(1, tolerance)
    best = min(side * (found - target) for found in tried.values() if side * (found - target) >= 0)
    assert best <= max(abs(tolerance), 6 * 0.01)  # a bracket of 0.01 levels, at the steepest


def test_a_search_that_is_cut_short_reaches_its_target_all_the_same() -> None:
    """Oracle: a curve half as steep as was said, of which one look tells nothing."""
    tried = search(lambda quality: 2.5 * quality, 6.0, 5.0, 0.05, 1.0, 1)
    assert list(tried) == [1.0, 1.0 + 3 * 3.5 / 5.0 + 0.01]
    assert max(tried.values()) > 6.0


def test_a_dent_in_the_curve_is_stepped_over_where_chance_is_known_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: a curve that is flat just below the target for as long as all trials last."""

    class Files:
        head = None

        def encode(self, level: Level) -> Encoded:
            return Encoded(repr(level.quality).encode(), level, np.zeros(0, np.int64))

    class Dented:
        def quick(self, quality: float) -> float:
            return min(5 * quality, 9.95) if quality < 2.14 else 5 * quality

        full = quick

    monkeypatch.setattr(target, "decode", lambda data, **_: SimpleNamespace(gaussians=float(data)))
    with pytest.raises(OptionError, match="out of reach"):
        encode_to_psnr(Files(), Dented(), 10.0, start=1.98, n_trials=3)  # type: ignore[arg-type]  # stand-ins
    found = encode_to_psnr(Files(), Dented(), 10.0, start=1.98, n_trials=3, grain_db=0.4)  # type: ignore[arg-type]  # stand-ins
    assert 2.14 <= found.encoded.level.quality < 2.3


@pytest.mark.parametrize("wanted", [-100.0, 100.0])
def test_what_is_out_of_reach_ends_at_the_range(wanted: float) -> None:
    tried = search(lambda quality: quality, wanted, 1.0, 0.05)
    assert (min(tried) if wanted < 0 else max(tried)) == (MIN_QUALITY if wanted < 0 else MAX_QUALITY)
    assert len(tried) < 5


@pytest.mark.parametrize(
    ("text", "n_bytes"), [("300KB", 300_000), ("0.3 mb", 300_000), ("250KiB", 256_000), ("1234", 1234), (".5kB", 500)]
)
def test_sizes_are_read(text: str, n_bytes: int) -> None:
    assert parse_size(text) == n_bytes


@pytest.mark.parametrize("text", ["", "KB", "-3KB", "3 GB", "1e3", "0", "nan"])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(OptionError, match="a size of"):
        parse_size(text)


def test_a_size_is_kept_and_a_better_file_would_not_fit(avatar: Avatar, head: HeadModel) -> None:
    encoder = RenderingEncoder(avatar, head)
    wanted = 3500
    found = encode_to_size(encoder, wanted)
    assert 0.93 * wanted <= len(found.encoded.data) <= wanted
    assert len(decode(found.encoded.data, head=head).gaussians) == len(found.encoded.rows)
    assert inspect(found.encoded.data).level == round(found.encoded.level.quality, 2)
    with pytest.raises(OptionError, match=r"300 bytes is out of reach; the smallest of this avatar takes [0-9,]+$"):
        encode_to_size(encoder, 300)
    roomy = encode_to_size(encoder, 10**7)
    assert roomy.encoded.level.quality == inspect(roomy.encoded.data).level == MAX_QUALITY


def test_a_quality_is_reached_and_not_by_much_more(avatar: Avatar, head: HeadModel) -> None:
    """Oracle: the judge's measure over all views of what comes out of the decoder."""
    encoder, judge = RenderingEncoder(avatar, head), Judge(avatar, head)
    found = encode_to_psnr(encoder, judge, 38.0)
    reached = judge.full(decode(found.encoded.data, head=head).gaussians)
    assert found.psnr_db == reached
    assert 38.0 <= reached < 38.6
    assert len(found.encoded.data) < len(encode(avatar, level_at(found.encoded.level.quality + 1), head=head))
    with pytest.raises(OptionError, match=r"150 dB are out of reach; the best file of this avatar has [0-9.]+ dB"):
        encode_to_psnr(encoder, judge, 150)


def test_an_avatar_without_gaussians_is_as_near_as_can_be(avatar: Avatar, head: HeadModel) -> None:
    nothing = replace(avatar, gaussians=avatar.gaussians.select(np.arange(0)))
    found = encode_to_psnr(RenderingEncoder(nothing, head), Judge(nothing, head), 38.0)
    assert found.psnr_db == 120
    assert found.encoded.level.quality == MIN_QUALITY
