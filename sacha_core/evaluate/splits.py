"""Which images an avatar is judged on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sacha_core.interchange.capture import Capture, View

__all__ = ["FRAMES", "novel_expression_views", "novel_view_views", "spread"]

FRAMES = 100  # how many images the paper judges for each setting


def novel_view_views(capture: Capture, limit: int = FRAMES) -> tuple[View, ...]:
    """Give views of the held-out camera at training timesteps: expressions seen in training, from where nobody stood.

    Args:
        capture: the capture that was trained on.
        limit: at most so many, spread evenly over time.

    Source: SACHA, experiments; GaussianAvatars' validation split.
    """
    return spread(capture.val, limit)


def novel_expression_views(capture: Capture, limit: int = FRAMES) -> tuple[View, ...]:
    """Give views of held-out timesteps by all cameras: self-reenactment.

    Args:
        capture: the capture that was trained on.
        limit: at most so many, drawn evenly from the grid of timesteps and cameras.

    Source: SACHA, experiments; GaussianAvatars' test split.
    """
    return spread(capture.test, limit)


def spread(views: Sequence[View], limit: int) -> tuple[View, ...]:
    """Give at most `limit` of the views, evenly spaced in order of timestep, then camera; the first and the last are among them."""
    ordered = sorted(views, key=lambda view: (view.timestep, view.camera_index))
    if len(ordered) <= limit:
        return tuple(ordered)
    return tuple(ordered[row] for row in np.linspace(0, len(ordered) - 1, limit).round().astype(int))
