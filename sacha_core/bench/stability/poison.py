"""Gradients that somebody changes on their way from the rasteriser to Adam."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from itertools import pairwise
from typing import Any
from unittest.mock import patch

import numpy as np

from sacha_core.raster.kernels.project_backward import project_backward
from sacha_core.raster.rasteriser import Frame, HalfWay
from sacha_core.raster.splats import SplatGradients
from sacha_core.train import gradients
from sacha_core.train.gradients import GaussianGradients
from sacha_core.train.kernels.go_back import go_back

__all__ = ["spoiled_gradients"]

WRITTEN = len(fields(SplatGradients))  # arrays that `project_backward` writes, its last arguments


@contextmanager
def spoiled_gradients(spoil: Callable[[Frame, SplatGradients], None]) -> Iterator[None]:
    """Call `spoil` with what each view's gradients are by the splats, before training on the CPU makes anything of them."""
    healthy = GaussianGradients.add_view

    def add_view(self: GaussianGradients, frame: Frame, half_way: HalfWay, *rest: Any) -> None:
        for start, stop in pairwise(half_way.chunks):
            project_backward(start, stop, half_way.scratch[0], *half_way.arguments)
        spoil(frame, half_way.slopes)
        with patch.object(gradients, "go_back", go_back_projected):
            healthy(self, frame, half_way, *rest)

    with patch.object(GaussianGradients, "add_view", add_view):
        yield


def go_back_projected(turns: Any, n: int, scratch: Any, projecting: Any, *rest: Any) -> None:
    """Do what `go_back` does with gradients that are there already: what it projects itself goes elsewhere."""
    elsewhere = (*projecting[:-WRITTEN], *map(np.empty_like, projecting[-WRITTEN:]))
    go_back(turns, n, scratch, elsewhere, *rest)
