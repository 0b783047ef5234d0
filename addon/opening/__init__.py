# SPDX-License-Identifier: GPL-3.0-or-later
"""Files into Blender: avatars, heads and meshes as objects of the scene."""

from __future__ import annotations

from . import controls, drop, load_motion, menu, open_file, panel

PARTS = (controls, open_file, load_motion, panel, drop, menu)
