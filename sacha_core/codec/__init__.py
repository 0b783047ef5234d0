"""The codec: an avatar and its motion as one `.sacha` file; FORMAT.md is the specification."""

from __future__ import annotations

from sacha_core.codec.archive_encoder import encode_archive
from sacha_core.codec.decoder import AvatarStream, decode, embedded_head, open_stream
from sacha_core.codec.encoder import encode
from sacha_core.codec.inspection import Inspection, SectionSize, inspect
from sacha_core.codec.paper_encoder import encode_paper
from sacha_core.codec.receiving import Decoder, Received
from sacha_core.codec.sending import Encoder, packets_of

__all__ = [
    "AvatarStream",
    "Decoder",
    "Encoder",
    "Inspection",
    "Received",
    "SectionSize",
    "decode",
    "embedded_head",
    "encode",
    "encode_archive",
    "encode_paper",
    "inspect",
    "open_stream",
    "packets_of",
]
