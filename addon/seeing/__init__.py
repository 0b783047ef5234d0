# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the Gaussians went: numbers of triangles and regions as colours, legends and tables."""

from __future__ import annotations

from . import compare, panel, selecting, shown, table

PARTS = (shown, selecting, table, compare, panel)
