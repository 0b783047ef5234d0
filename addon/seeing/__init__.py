# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the Gaussians went: numbers of triangles and regions as colours, legends and tables."""

from __future__ import annotations

from . import panel, shown

PARTS = (shown, panel)
