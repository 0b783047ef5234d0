# SPDX-License-Identifier: GPL-3.0-or-later
"""Files out of Blender: encoding, decoding, training."""

from __future__ import annotations

from . import (
    add_cameras,
    batch_folder,
    decode_avatar,
    encode_avatar,
    film_head,
    film_panel,
    known_runs,
    panel,
    settings,
    train_avatar,
    training_list,
    training_panel,
)

OPERATORS = (encode_avatar, decode_avatar, batch_folder, add_cameras, film_head, train_avatar, training_list)
PARTS = (settings, *OPERATORS, known_runs, panel, film_panel, training_panel)
