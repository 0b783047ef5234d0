"""Published files decode to the same bits for ever."""

from __future__ import annotations

import json

import pytest
from golden_streams import DIGESTS, FOLDER, STREAMS, digests_of

PUBLISHED = json.loads(DIGESTS.read_text())


def test_every_stream_is_listed():
    assert {path.stem for path in FOLDER.glob("*.sacha")} == set(PUBLISHED) == set(STREAMS)


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_stream_decodes_to_the_same_bits(name):
    assert digests_of((FOLDER / f"{name}.sacha").read_bytes()) == PUBLISHED[name]
