"""The archive keeps every bit: what comes back is what was given, in its order."""

from __future__ import annotations

import lzma
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from synthetic_avatars import HEAD, random_avatar, random_gaussians, small_head

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode, embedded_head, encode, encode_archive, encode_paper, inspect
from sacha_core.codec.archive_encoder import difference
from sacha_core.codec.lossless import decode_exactly, encode_exactly
from sacha_core.codec.reading import ByteReader
from sacha_core.errors import FormatError

FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)


def assert_same_bits(given: Avatar, back: Avatar) -> None:
    for part in ("gaussians", "motion"):
        ours, theirs = getattr(given, part), getattr(back, part)
        assert (ours is None) == (theirs is None)
        for field in fields(ours) if ours is not None else ():
            a, b = getattr(ours, field.name), getattr(theirs, field.name)
            if isinstance(a, np.ndarray):
                assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), field.name
            else:
                assert a == b


@pytest.mark.parametrize("n", [0, 1, 2, 3, 300])
@pytest.mark.parametrize("n_harmonics", [0, 3, 8, 15])
def test_every_bit_comes_back(n, n_harmonics):
    avatar = random_avatar(n, n_frames=n // 10, n_harmonics=n_harmonics, seed=n)
    data = encode_archive(avatar)
    assert_same_bits(avatar, decode(data))
    assert encode_archive(avatar) == data


def test_sensitivity_and_embedded_head_are_kept():
    head = small_head()
    avatar = random_avatar(50, n_frames=3, head=head)
    logits = np.random.default_rng(1).normal(size=50).astype(np.float32)
    avatar = replace(avatar, gaussians=replace(avatar.gaussians, sensitivity_logit=logits))
    data = encode_archive(avatar, head=head, embed_head=True)
    assert_same_bits(avatar, decode(data))
    inside = embedded_head(data)
    assert inside is not None
    assert inside.reference == head.reference


def test_negative_zeros_denormals_and_largest_numbers_are_kept():
    gaussians = random_gaussians(40, n_harmonics=3)
    odd = np.array([-0.0, 0.0, 1e-45, -1e-45, 3.4028235e38, -3.4028235e38, 1.1754944e-38, 1.0], np.float32)
    for name in ("position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "sh_rest"):
        values = getattr(gaussians, name)
        values.reshape(-1)[::3] = np.resize(odd, len(values.reshape(-1)[::3]))
    avatar = Avatar(gaussians, HEAD)
    assert_same_bits(avatar, decode(encode_archive(avatar)))


@given(arrays.arrays(np.float32, st.tuples(st.integers(0, 40), st.integers(1, 5)), elements=FINITE), st.integers(1, 4))
@settings(max_examples=150, deadline=None)
def test_any_finite_numbers_come_back(values, n_groups):
    coded = encode_exactly(values, n_groups)
    assert decode_exactly(ByteReader(coded, "numbers"), *values.shape).tobytes() == values.tobytes()


def test_smaller_than_xz_and_than_xz_of_byte_planes():
    """Oracle: liblzma. Numbers with noise in their low bits, as training leaves them."""
    avatar = Avatar(random_gaussians(3000, seed=4), HEAD)
    g = avatar.gaussians
    parts = (g.position, g.log_scale, g.quaternion, g.opacity_logit[:, None], g.sh_dc, g.sh_rest.reshape(3000, -1))
    table = np.concatenate([*parts, g.binding[:, None].astype(np.float32)], axis=1)
    planes = np.ascontiguousarray(table.T).view(np.uint8).reshape(-1, 4).T
    size = len(encode_archive(avatar))
    assert size < len(lzma.compress(table.tobytes(), preset=9))
    assert size < len(lzma.compress(planes.tobytes(), preset=9))


def test_inspection_tells_the_profile():
    found = inspect(encode_archive(random_avatar(20, n_frames=4)))
    assert (found.profile, found.level, found.n_frames, found.frame_rate, found.n_groups) == ("archive", 0, 4, 25.0, 1)


def test_numbers_beyond_float32_are_refused():
    gaussians = replace(random_gaussians(5), position=np.full((5, 3), 0.1))
    with pytest.raises(FormatError, match="position is not of float32"):
        encode_archive(Avatar(gaussians, HEAD))


def test_a_name_too_long_for_the_format_is_refused():
    with pytest.raises(FormatError, match="head or scheme"):
        encode_archive(replace(random_avatar(3), scheme="x" * 300))


def test_first_difference_is_named():
    avatar = random_avatar(5)
    turned = avatar.gaussians.quaternion.copy()
    turned[3, 2] = np.nextafter(turned[3, 2], np.float32(9))
    other: Gaussians = replace(avatar.gaussians, quaternion=turned)
    assert difference(avatar, avatar) == ""
    assert difference(avatar, replace(avatar, gaussians=other)) == "quaternion"


def test_what_was_decoded_before_keeps_its_bits_too():
    avatar = decode(encode(random_avatar(200, seed=8), 3))
    assert_same_bits(avatar, decode(encode_archive(avatar)))


def test_smaller_than_xz_where_numbers_repeat():
    """Oracle: liblzma, which finds what was quantised before; its own strength."""
    avatar = decode(encode_paper(random_avatar(3000, 0, 3, seed=4), 1))
    g = avatar.gaussians
    parts = (g.position, g.log_scale, g.quaternion, g.opacity_logit[:, None], g.sh_dc, g.sh_rest.reshape(len(g), -1))
    table = np.concatenate([*parts, g.binding[:, None].astype(np.float32)], axis=1)
    assert len(encode_archive(avatar)) < len(lzma.compress(table.tobytes(), preset=9))


@given(st.lists(st.sampled_from([0.0, -0.0, 1.5, -1.5, 3.0e38, -1e-45, 7.25]), min_size=2, max_size=60))
@settings(max_examples=60, deadline=None)
def test_few_different_numbers_come_back(numbers):
    values = np.array(numbers, np.float32)[:, None]
    assert decode_exactly(ByteReader(encode_exactly(values, 1), "numbers"), *values.shape).tobytes() == values.tobytes()
