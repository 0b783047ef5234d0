"""Which images are judged. Oracle: counting."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.motion import Motion
from sacha_core.evaluate.splits import FRAMES, novel_expression_views, novel_view_views, spread
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.camera import Camera

CAMERA = Camera.look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3), 8, 8, 10.0)


def view(timestep: int, camera_index: int) -> View:
    return View(timestep, camera_index, CAMERA, Path(f"{timestep}_{camera_index}.png"), None)


def key(one: View) -> tuple[int, int]:
    return one.timestep, one.camera_index


@given(n_timesteps=st.integers(1, 40), n_cameras=st.integers(1, 5), limit=st.integers(1, 60), seed=st.integers(0, 99))
def test_spread_is_even_ordered_and_independent_of_the_order_given(
    n_timesteps: int, n_cameras: int, limit: int, seed: int
) -> None:
    grid = [view(t, c) for t in range(n_timesteps) for c in range(n_cameras)]
    shuffled = [grid[row] for row in np.random.default_rng(seed).permutation(len(grid))]
    chosen = spread(shuffled, limit)
    assert len(chosen) == min(limit, len(grid))
    assert chosen == spread(grid, limit)
    rows = [grid.index(one) for one in chosen]
    assert rows == sorted(set(rows))
    if len(chosen) > 1:
        assert (rows[0], rows[-1]) == (0, len(grid) - 1)
        ideal = (len(grid) - 1) / (len(chosen) - 1)
        assert all(abs(gap - ideal) <= 1 for gap in np.diff(rows))


def test_no_views_give_no_views() -> None:
    assert spread((), 5) == ()


@pytest.fixture
def capture() -> Capture:
    train = tuple(view(t, c) for t in range(150) for c in range(16) if c != 8)
    val = tuple(view(t, 8) for t in range(150))
    test = tuple(view(t, c) for t in range(150, 180) for c in range(16))
    return Capture(Path("nowhere"), None, None, Motion.rest(0, 0, 180), train, val, test)


def test_the_papers_hundred_of_each(capture: Capture) -> None:
    seen, unseen = novel_view_views(capture), novel_expression_views(capture)
    assert len(seen) == len(unseen) == FRAMES == 100
    assert {one.camera_index for one in seen} == {8}
    assert [one.timestep for one in seen] == np.linspace(0, 149, 100).round().astype(int).tolist()
    assert min(one.timestep for one in unseen) == 150
    assert {one.camera_index for one in unseen} == set(range(16))
    assert not {key(one) for one in (*seen, *unseen)} & {key(one) for one in capture.train}
