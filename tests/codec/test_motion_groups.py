"""Oracle: the whole decode, of which every group must be a part to the bit; and a count of what is decoded."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from golden_streams import FOLDER
from synthetic_avatars import random_avatar, random_motion

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode, encode, motion, open_stream
from sacha_core.codec.container import Section, pack_sections, parse_sections
from sacha_core.codec.motion import MotionHead, read_motion_head
from sacha_core.codec.motion_writer import packed_length
from sacha_core.errors import FormatError

GROUP, N_FRAMES = 8, 23
EXTRA = bytes([1] * 8)  # more than a decoder looks ahead


def assert_same(left: object, right: object) -> None:
    for field in fields(left):
        ours, theirs = getattr(left, field.name), getattr(right, field.name)
        if isinstance(theirs, np.ndarray):
            assert (ours.dtype, ours.tobytes()) == (theirs.dtype, theirs.tobytes()), field.name
        else:
            assert ours == theirs, field.name


@pytest.fixture(scope="module")
def stream() -> bytes:
    return encode(random_avatar(3, n_frames=N_FRAMES), 3, group_frames=GROUP)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.sacha")), ids=lambda path: path.stem)
def test_groups_of_published_files_make_up_the_whole(path):
    whole, opened = decode(path), open_stream(path)
    assert_same(opened.gaussians, whole.gaussians)
    assert (opened.head, opened.scheme) == (whole.head, whole.scheme)
    if whole.motion is None:
        assert opened.motion is None
        return
    assert len(opened.motion) == len(whole.motion)
    assert opened.motion.frame_rate == whole.motion.frame_rate
    assert_same(opened.motion.all(), whole.motion)
    assert_same(opened.motion.still(), whole.motion.frames(slice(0)))
    starts = range(0, len(whole.motion), opened.motion.group_frames)
    for number, start in reversed(list(enumerate(starts))):
        expected = whole.motion.frames(slice(start, start + opened.motion.group_frames))
        assert_same(opened.motion.group(number), expected)


@pytest.mark.parametrize("level", [1, 2, 3, 4])
def test_any_group_decodes_alone(level):
    data = encode(random_avatar(3, n_frames=N_FRAMES), level, group_frames=GROUP)
    whole = decode(data).motion
    assert_same(open_stream(data).motion.group(2), whole.frames(slice(2 * GROUP, None)))


@pytest.mark.parametrize("number", [-1, 3])
def test_groups_that_do_not_exist(stream, number):
    with pytest.raises(IndexError, match="there are 3"):
        open_stream(stream).motion.group(number)


def test_opening_decodes_no_frame_and_a_group_no_other(stream, monkeypatch):
    decoded = []
    plain = motion.decode_frames
    monkeypatch.setattr(
        motion, "decode_frames", lambda data, n_frames, *rest: decoded.append(n_frames) or plain(data, n_frames, *rest)
    )
    opened = open_stream(stream)
    assert decoded == []
    opened.motion.group(1)
    assert decoded == [GROUP]
    decode(stream)
    assert decoded == [GROUP, GROUP, GROUP, GROUP - 1]


def with_motion_section(data: bytes, change: Callable[[bytearray, int, MotionHead], None]) -> tuple[bytes, int]:
    """Seal a file anew after a change of its motion; the change is told where the groups begin. Gives where that is in the file, too."""
    sections = parse_sections(data)[1]
    section = sections["Motion"]
    reader = section.reader()
    head = read_motion_head(reader, N_FRAMES, 20)
    body, groups_at = bytearray(section.data), len(section.data) - reader.left
    change(body, groups_at, head)
    changed = [Section(s.name, bytes(body) if s.name == "Motion" else s.data) for s in sections.values()]
    return pack_sections(changed), section.offset + groups_at


def add_bytes(body: bytearray, groups_at: int, head: MotionHead) -> None:
    """Make group 1 longer; lengths are below 128 * 128 bytes, so each is two bytes of seven bits."""
    start, n_bytes = head.groups[1]
    body[groups_at + start + n_bytes : groups_at + start + n_bytes] = EXTRA
    for number, length in ((1, n_bytes + len(EXTRA)),):
        entry_at = groups_at - sum(len(packed_length(size)) for _, size in head.groups[number:])
        assert body[entry_at : entry_at + 2] == packed_length(n_bytes)
        body[entry_at : entry_at + 2] = packed_length(length)


def test_damage_is_found_in_its_group_alone(stream):
    data, groups_at = with_motion_section(stream, add_bytes)
    opened, whole = open_stream(data).motion, decode(stream).motion
    assert_same(opened.group(0), whole.frames(slice(0, GROUP)))
    assert_same(opened.group(2), whole.frames(slice(2 * GROUP, None)))
    for decoder in (lambda: opened.group(1), lambda: decode(data)):
        with pytest.raises(FormatError, match=r"motion group 1: .* bytes of the group are left over") as caught:
            decoder()
        assert groups_at < caught.value.offset < len(data)
        assert str(caught.value).count("at byte") == 1


def test_values_that_no_head_has_are_refused_with_their_group():
    """Numbers of steps that are fine, times a step that is fine, are not: more than 2^29 of more than a metre."""
    far = replace(random_motion(N_FRAMES), translation=np.zeros((N_FRAMES, 3), np.float32))
    far.translation[GROUP + 2] = 2e4
    data = encode(Avatar(random_avatar(3).gaussians, random_avatar(3).head, far), 4, group_frames=GROUP)

    def coarser(body: bytearray, _: int, head: MotionHead) -> None:
        struct.pack_into("<d", body, 10, head.model.unit * 2.0**16)

    data, _ = with_motion_section(data, coarser)
    opened = open_stream(data).motion
    opened.group(0)
    for decoder in (lambda: opened.group(1), lambda: decode(data)):
        with pytest.raises(
            FormatError, match=r"motion group 1: motion parameter translation is .* at row 2, expected at most"
        ):
            decoder()
