# SPDX-License-Identifier: GPL-3.0-or-later
"""The budget: which region may keep how many Gaussians, what is painted important, how large the file may be."""

from __future__ import annotations

from . import apply_budget, own_regions, panel, settings

PARTS = (settings, apply_budget, own_regions, panel)
