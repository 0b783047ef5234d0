# SPDX-License-Identifier: GPL-3.0-or-later
"""Files out of Blender: encoding, decoding, training."""

from __future__ import annotations

from . import decode_avatar, encode_avatar, panel, settings

PARTS = (settings, encode_avatar, decode_avatar, panel)
