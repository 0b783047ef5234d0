# SPDX-License-Identifier: GPL-3.0-or-later
"""Files into Blender: avatars, heads and meshes as objects of the scene."""

from __future__ import annotations

from . import controls, drop, menu, open_file

PARTS = (controls, open_file, drop, menu)
