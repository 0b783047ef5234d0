# SPDX-License-Identifier: GPL-3.0-or-later
"""What went wrong, in a sentence that says what to do, and everything that somebody who helps would ask for."""

from __future__ import annotations

from . import diagnostics, dismiss, panel

PARTS = (dismiss, diagnostics, panel)
