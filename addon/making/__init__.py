# SPDX-License-Identifier: GPL-3.0-or-later
"""Files out of Blender: encoding, decoding, training."""

from __future__ import annotations

from . import decode_avatar, encode_avatar, known_runs, panel, settings, train_avatar, training_panel

PARTS = (settings, encode_avatar, decode_avatar, train_avatar, known_runs, panel, training_panel)
