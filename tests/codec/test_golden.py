"""Published files decode to the same bits for ever."""

from __future__ import annotations

import json
import sys

import golden_others
import pytest
from golden_streams import DIGESTS, FOLDER, STREAMS, digests_of

PUBLISHED = json.loads(DIGESTS.read_text())
OTHERS = json.loads(golden_others.DIGESTS.read_text())


def test_every_stream_is_listed():
    assert {path.stem for path in FOLDER.glob("*.sacha")} == set(PUBLISHED) == set(STREAMS)


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_stream_decodes_to_the_same_bits(name):
    assert digests_of((FOLDER / f"{name}.sacha").read_bytes()) == PUBLISHED[name]


def test_every_other_stream_is_listed():
    there = {path.name for path in FOLDER.iterdir()} - {DIGESTS.name, golden_others.DIGESTS.name}
    assert {name for name in there if not name.endswith(".sacha")} == set(OTHERS) == set(golden_others.STREAMS)


@pytest.mark.parametrize("name", sorted(OTHERS))
def test_packets_and_files_of_programs_decode_to_the_same_bits(name):
    if "tool" in name and sys.platform == "win32":
        pytest.skip("the stand-in for the program is a shell script")
    assert golden_others.STREAMS[name][1]((FOLDER / name).read_bytes()) == OTHERS[name]
