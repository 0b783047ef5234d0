"""The container: what it refuses, and that the message says why."""

from __future__ import annotations

import struct

import pytest

from sacha_core.codec.container import ENTRY_BYTES, MAGIC, PREFIX_BYTES, Section, pack_sections, parse_sections
from sacha_core.errors import FormatError

SECTIONS = [Section("Header", b"abc"), Section("Counts", b""), Section("head", b"x" * 100), Section("extra", b"1")]


def test_sections_come_back_with_their_offsets():
    data = pack_sections(SECTIONS)
    version, sections = parse_sections(data)
    assert version == (2, 0)
    assert [(s.name, s.data) for s in sections.values()] == [(s.name, s.data) for s in SECTIONS]
    for section in sections.values():
        assert data[section.offset : section.offset + len(section.data)] == section.data


def test_every_truncation_is_refused():
    data = pack_sections(SECTIONS)
    for length in range(len(data)):
        with pytest.raises(FormatError):
            parse_sections(data[:length])


def test_every_flipped_bit_is_refused():
    data = pack_sections(SECTIONS)
    for at in range(8 * len(data)):
        changed = bytearray(data)
        changed[at // 8] ^= 1 << at % 8
        with pytest.raises(FormatError):
            parse_sections(bytes(changed))


def test_bytes_behind_the_end_are_refused():
    with pytest.raises(FormatError, match="its prefix says"):
        parse_sections(pack_sections(SECTIONS) + b"x")


@pytest.mark.parametrize(("major", "age"), [(1, "older"), (3, "newer")])
def test_another_major_version_is_refused_by_name(major, age):
    data = bytearray(pack_sections(SECTIONS))
    data[8:10] = struct.pack("<H", major)
    with pytest.raises(FormatError, match=rf"version {major}\.0, {age} than this decoder, which reads 2\.x"):
        parse_sections(bytes(data))


def test_another_file_is_told_apart():
    for data in (b"", b"PK\x03\x04", MAGIC[:5], b"SACHA\n\x1a" + bytes(50)):
        with pytest.raises(FormatError, match=r"not a \.sacha file"):
            parse_sections(data)


def test_section_twice_is_refused():
    with pytest.raises(FormatError, match="twice"):
        parse_sections(pack_sections([SECTIONS[0], SECTIONS[0]]))


@pytest.mark.parametrize("name", ["Head er", "h1", ""])
def test_names_are_letters(name):
    with pytest.raises(FormatError, match="ASCII letters"):
        parse_sections(pack_sections([Section(name, b"")]))


def test_offset_of_a_damaged_section_is_told():
    data = bytearray(pack_sections(SECTIONS))
    start = PREFIX_BYTES + len(SECTIONS) * ENTRY_BYTES
    data[start] ^= 1
    with pytest.raises(FormatError, match="'Header'") as caught:
        parse_sections(bytes(data))
    assert caught.value.offset == start
