"""Hostile files: whatever the bytes, a valid avatar or one of our errors, soon and in little memory."""

from __future__ import annotations

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from synthetic_avatars import random_avatar, small_head

from sacha_core.codec import decode, embedded_head, encode, inspect
from sacha_core.codec.container import ENTRY_BYTES, PREFIX_BYTES, Section, pack_sections, parse_sections
from sacha_core.codec.header import Header
from sacha_core.errors import FormatError, HeadError

MEMORY_LIMIT = 64 << 20  # bytes; the files are a few KB, the free budget of 65,536 numbers takes a few MB
NAMES = (
    "Header",
    "Static",
    "Counts",
    "Hidden",
    "Opacity",
    "Scale",
    "Rotation",
    "Position",
    "Colour",
    "Harmonic",
    "Motion",
    "head",
)
ADAPTIVE = ("Static", "Counts", "Motion")  # end in adaptive integers, which read zeros past their end
EXTREMES = (0, 0x7F, 0x80)
FIRST_COUNT = 5  # where the counts begin in the header


@pytest.fixture(scope="module")
def sections() -> list[Section]:
    head = small_head()
    avatar = random_avatar(40, n_frames=6, n_harmonics=3, seed=9, head=head)
    parsed = parse_sections(encode(avatar, 3, head=head, embed_head=True, group_frames=4))[1]
    return list(parsed.values())


def attempt(data: bytes) -> bool:
    """Decode; any exception but ours is a failure. Tell whether it decoded."""
    try:
        avatar = decode(data)
        inspect(data)
        embedded_head(data)
    except (FormatError, HeadError):
        return False
    avatar.gaussians.validate(avatar.head.n_faces)
    if avatar.motion is not None:
        avatar.motion.validate()
    return True


def replaced(sections: list[Section], name: str, data: bytes) -> bytes:
    """Seal a file anew with other bytes in one section: the checksums are right."""
    return pack_sections([Section(s.name, data if s.name == name else s.data) for s in sections])


def test_the_file_itself_decodes(sections):
    assert attempt(pack_sections(sections))
    assert [s.name for s in sections] == ["Header", "Static", *NAMES[2:-2], "Motion", "head"]


@pytest.mark.parametrize("name", NAMES)
def test_resealed_mutations_of_a_section(sections, name):
    body = next(s.data for s in sections if s.name == name)
    rng = np.random.default_rng(NAMES.index(name))
    for _ in range(25):
        changed = bytearray(body)
        for _ in range(rng.integers(1, 4)):
            changed[rng.integers(0, len(body))] = rng.integers(0, 256)
        attempt(replaced(sections, name, bytes(changed)))


@pytest.mark.parametrize("name", NAMES)
def test_resealed_cuts_and_additions_of_a_section(sections, name):
    body = next(s.data for s in sections if s.name == name)
    rng = np.random.default_rng(NAMES.index(name) + 50)
    lengths = [0, 1, len(body) - 1, *rng.integers(0, len(body), 6).tolist()]
    for length in (length for length in lengths if length < len(body)):
        decoded = attempt(replaced(sections, name, body[:length]))
        assert not decoded or name in ADAPTIVE
    assert not attempt(replaced(sections, name, body + b"\1" * 8))
    attempt(replaced(sections, name, rng.integers(0, 256, len(body), dtype=np.uint8).tobytes()))


@pytest.mark.parametrize("name", NAMES)
def test_resealed_extremes_in_the_first_bytes_of_a_section(sections, name):
    """Fixed fields lie in front: counts, lengths, steps, exponents, weights."""
    body = next(s.data for s in sections if s.name == name)
    for at in range(0, min(len(body), 48), 5):
        for value in EXTREMES:
            changed = bytearray(body)
            changed[at] = value
            attempt(replaced(sections, name, bytes(changed)))
        changed = bytearray(body)
        changed[at : at + 4] = b"\xff" * len(changed[at : at + 4])
        attempt(replaced(sections, name, bytes(changed)))


@pytest.mark.parametrize("name", NAMES[:-1])
def test_missing_section_is_named(sections, name):
    data = pack_sections([s for s in sections if s.name != name])
    with pytest.raises(FormatError, match=f"'{name}' is missing"):
        decode(data)


def test_cuts_at_every_boundary_and_anywhere(sections):
    data = pack_sections(sections)
    starts = [s.offset for s in parse_sections(data)[1].values()]
    anywhere = np.random.default_rng(1).integers(0, len(data), 60).tolist()
    for length in {0, 8, PREFIX_BYTES, PREFIX_BYTES + ENTRY_BYTES, *starts, *anywhere}:
        with pytest.raises(FormatError):
            decode(data[:length])


def test_every_length_field_of_the_table(sections):
    data = pack_sections(sections)
    for row in range(len(sections)):
        for value in (0, 1, 0x7FFFFFFF, 0xFFFFFFFF):
            changed = bytearray(data)
            at = PREFIX_BYTES + row * ENTRY_BYTES + 8
            if changed[at : at + 4] == struct.pack("<I", value):
                continue
            changed[at : at + 4] = struct.pack("<I", value)
            assert not attempt(reseal_table(changed))


def reseal_table(data: bytearray) -> bytes:
    """Give the file with the right checksum of prefix and table."""
    n_sections = struct.unpack_from("<I", data, 12)[0]
    data[PREFIX_BYTES - 4 : PREFIX_BYTES] = bytes(4)
    checksum = zlib.crc32(data[: PREFIX_BYTES + n_sections * ENTRY_BYTES])
    data[PREFIX_BYTES - 4 : PREFIX_BYTES] = struct.pack("<I", checksum)
    return bytes(data)


@pytest.mark.parametrize("seed", range(30))
def test_random_bytes(seed):
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, 256, 300, dtype=np.uint8).tobytes()
    assert not attempt(noise)
    assert not attempt(pack_sections([Section(name, noise[: rng.integers(0, 300)]) for name in NAMES]))


@pytest.mark.parametrize("field", range(7))
@pytest.mark.parametrize("value", [0, 0xFFFF, 0xFFFFFFFF])
def test_header_counts_are_bounded_by_the_file(sections, field, value):
    header = bytearray(sections[0].data)
    struct.pack_into("<I", header, FIRST_COUNT + 4 * field, value)
    tracemalloc.start()
    try:
        attempt(replaced(sections, "Header", bytes(header)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < MEMORY_LIMIT


def test_expression_weights_are_bounded_by_the_file_without_a_frame_too(sections):
    """The base frame is there all the same."""
    header = bytearray(sections[0].data)
    struct.pack_into("<II", header, FIRST_COUNT + 4 * 3, 0, 0xFFFFFFFF)
    data = replaced(sections, "Header", bytes(header))
    for read in (decode, inspect):
        with pytest.raises(FormatError, match="more than"):
            read(data)


def test_head_that_unpacks_to_far_more_than_its_bytes_is_refused(sections):
    body = zlib.compress(bytes(1 << 26), 9)
    bomb = b"\4bomb" + struct.pack("<IHI", 0, 0, 1 << 26) + body
    with pytest.raises(FormatError, match="claim to unpack"):
        embedded_head(replaced(sections, "head", bomb))


def test_unknown_optional_section_is_skipped_and_unknown_needed_one_refused(sections):
    assert attempt(pack_sections([*sections, Section("novelty", b"?")]))
    with pytest.raises(FormatError, match="'Novelty' must be understood"):
        decode(pack_sections([*sections, Section("Novelty", b"?")]))


def test_name_that_steers_a_terminal_is_refused(sections):
    header = Header.unpack(sections[0].reader(), 10**6)
    body = header.pack().replace(header.head.name.encode(), b"\x1b" * len(header.head.name))
    with pytest.raises(FormatError, match="control characters"):
        decode(replaced(sections, "Header", body))
