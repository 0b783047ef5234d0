"""Frames fitted each by itself: a scene in the world through a head that is none, and what is kept from call to call."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plyfile import PlyData
from scipy.spatial import cKDTree

from sacha_core.animation.posed import PosedHead
from sacha_core.errors import DatasetError, FormatError, OptionError
from sacha_core.flame.posing import Poser, joint_vectors
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.splat_ply import read_world_ply
from sacha_core.perception.psnr import psnr
from sacha_core.raster.camera import Camera
from sacha_core.raster.scene import render_avatar
from sacha_core.train import framewise
from sacha_core.train.framewise import BYTES_PER_GAUSSIAN, fit_frames, frame_ply
from sacha_core.train.options import TrainOptions
from sacha_core.train.static import (
    NEAREST_M,
    TRIANGLES,
    WORLD_FRAMES,
    _spacing,
    first_gaussians,
    into_world,
    static_options,
    still_capture,
    still_motion,
    world_head,
)

OPTIONS = TrainOptions(threads=1, sh_degree=1, device="cpu")
ITERATIONS = 100
LEARNED = 1.0  # dB on the views that were trained on; measured 2.4 in so short a fit
FLOAT32 = 4e-7  # rounding of a few sums of numbers near 1


@pytest.fixture(scope="module")
def judged(tiny):
    """Give the tiny capture with a held-out camera: the last of the six."""
    held = tuple(view for view in tiny.capture.train if view.camera_index == 5)
    rest = tuple(view for view in tiny.capture.train if view.camera_index != 5)
    return replace(tiny.capture, train=rest, val=held)


@pytest.fixture(scope="module")
def fitted(tiny, judged, tmp_path_factory: pytest.TempPathFactory):
    """Give two frames fitted for a while, and where they lie."""
    out: Path = tmp_path_factory.mktemp("frames")
    return out, fit_frames(judged, tiny.head, [0, 1], ITERATIONS, out, OPTIONS)


@given(st.tuples(*[st.floats(-3, 3, width=32)] * 3))
def test_local_units_of_the_world_head_are_metres_of_the_world(origin) -> None:
    head, motion = world_head(), still_motion(np.array(origin))
    head.validate()
    posed = PosedHead(head, motion).pose(motion.expression[0], joint_vectors(motion, 0), motion.translation[0])
    for frames in (posed.frames, triangle_frames(Poser(head, motion)(0), head.faces)):
        assert np.abs(frames.rotation - np.eye(3)).max() <= FLOAT32
        assert np.abs(frames.scale - 1).max() <= 2 * FLOAT32
        assert np.abs(frames.origin - np.array(origin)).max() <= FLOAT32 * max(1, *np.abs(origin))


def test_what_hangs_on_the_world_head_is_seen_where_it_is_exported(tiny) -> None:
    """Drawn through the head's frames, and drawn in the world after export: the same picture."""
    rng, n, origin = np.random.default_rng(0), 40, np.array([0.02, 1.6, -0.03], np.float32)
    start = first_gaussians(tiny.head.v_template, tiny.head, tiny.capture, tiny.capture.train[:6], OPTIONS)
    local = start.select(np.arange(n))
    local = replace(
        local, position=rng.normal(0, 0.05, (n, 3)).astype(np.float32), opacity_logit=np.full(n, 1, np.float32)
    )
    head, camera = world_head(), Camera.look_at(origin + np.array([0.1, 0.1, 0.6]), origin, 48, 48, 90.0)
    frames = triangle_frames(Poser(head, still_motion(origin))(0), head.faces)
    one = render_avatar(local, frames, camera).colour
    other = render_avatar(into_world(local, origin), WORLD_FRAMES, camera).colour
    assert one.min() < 0.9
    assert np.abs(one - other).max() < 1e-3


def test_first_points_lie_on_what_the_cameras_see_in_its_colours(tiny) -> None:
    views = tiny.capture.train[:1]
    start = first_gaussians(tiny.head.v_template, tiny.head, tiny.capture, views, OPTIONS)
    everywhere = first_gaussians(tiny.head.v_template, tiny.head, tiny.capture, tiny.capture.train[:6], OPTIONS)
    centre = views[0].camera.centre
    assert 10 < len(start) < len(everywhere) <= tiny.head.n_faces
    assert (start.position @ centre > 0).all()  # of a ball, one camera sees the near side only
    assert np.linalg.norm(start.position, axis=1).max() < 0.1  # its radius
    distance = cKDTree(everywhere.position.astype(np.float64)).query(everywhere.position.astype(np.float64), 4)[0][
        :, 1:
    ]
    assert np.exp(everywhere.log_scale[:, 0]) == pytest.approx(np.sqrt(np.mean(distance**2, axis=1)), rel=1e-4)
    colours = everywhere.sh_dc * 0.28209479177387814 + 0.5
    assert -0.01 < colours.min() < colours.max() < 1.01
    assert everywhere.binding.max() < TRIANGLES
    assert (np.diff(everywhere.binding) >= 0).all()


def test_points_that_coincide_or_are_alone_have_a_size() -> None:
    assert _spacing(np.zeros((5, 3))).tolist() == [NEAREST_M] * 5
    assert _spacing(np.ones((1, 3))).tolist() == [NEAREST_M]
    assert _spacing(np.array([[0.0, 0, 0], [0.3, 0, 0]])) == pytest.approx([0.3, 0.3])
    assert _spacing(np.zeros((0, 3))).shape == (0,)


def test_the_rules_are_those_of_3dgs_and_not_of_an_avatar() -> None:
    options = static_options(2000, OPTIONS)
    assert (options.losses.sensitivity, options.losses.position, options.losses.scale) == (0, 0, 0)
    assert (options.rates.position, options.rates.log_scale, options.rates.opacity_logit) == (1.6e-4, 0.005, 0.05)
    assert (options.density.threshold, options.density.guard_faint, options.density.by_region) == (2e-4, False, False)
    assert (options.fine_tune, options.pruning.scope, options.schedule.calibrations) == (False, "none", ())
    events = [i for i in range(1, 2001) if options.schedule.densifies(i)]
    assert events == list(range(150, 1000, 50))
    assert (options.threads, options.sh_degree) == (1, 1)
    for iterations in (20, 30, 7000):
        static_options(iterations)  # makes sense


def test_each_frame_is_a_plain_splat_ply_that_shows_the_frame(tiny, judged, fitted) -> None:
    out, results = fitted
    for timestep, result in zip((0, 1), results, strict=True):
        path = frame_ply(out, timestep)
        table = PlyData.read(path)["vertex"].data
        assert len(table.dtype.names) == 62
        assert table.dtype.itemsize == BYTES_PER_GAUSSIAN
        assert len(table) == result.n
        assert result.bytes == 248 * result.n
        assert result.timestep == timestep
        assert sorted(p.name for p in path.parent.iterdir()) == ["held_out.png", "point_cloud.ply", "result.json"]
    gaussians = read_world_ply(frame_ply(out, 0))
    assert psnr_of(gaussians, judged, judged.val[0]) == pytest.approx(results[0].psnr, abs=1e-3)
    learned = [view for view in judged.train if view.timestep == 0]
    first = first_gaussians(tiny.head.v_template, tiny.head, judged, learned, OPTIONS)
    before, after = (
        np.mean([psnr_of(g, judged, view) for view in learned]) for g in (into_world(first, np.zeros(3)), gaussians)
    )
    assert after > before + LEARNED


def psnr_of(gaussians, capture, view) -> float:
    drawn = render_avatar(gaussians, WORLD_FRAMES, view.camera).colour
    return psnr(drawn, capture.image(view))


def test_finished_frames_are_kept_and_unfinished_ones_are_done_again_to_the_bit(
    tiny, judged, fitted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, results = fitted
    before = frame_ply(out, 1).read_bytes()
    (out / "frame_0001" / "result.json").unlink()  # as where it was interrupted before its end
    (out / "frame_0001" / "training").mkdir()
    fits = []
    fit = framewise._fit
    monkeypatch.setattr(framewise, "_fit", lambda *a: fits.append(a[2]) or fit(*a))
    again = fit_frames(judged, tiny.head, [0, 1], ITERATIONS, out, replace(OPTIONS, threads=2))
    assert fits == [1]
    assert [replace(r, training_seconds=0) for r in again] == [replace(r, training_seconds=0) for r in results]
    assert frame_ply(out, 1).read_bytes() == before


def test_frames_of_other_options_or_another_capture_are_not_mixed(tiny, judged, fitted) -> None:
    out, _ = fitted
    with pytest.raises(OptionError, match=r"another options.schedule.iterations \(100, not 101\)"):
        fit_frames(judged, tiny.head, [0], ITERATIONS + 1, out, OPTIONS)
    with pytest.raises(OptionError, match=r"another capture\.views"):
        fit_frames(replace(judged, train=judged.train[1:]), tiny.head, [0], ITERATIONS, out, OPTIONS)


def test_a_damaged_result_is_named(tiny, judged, fitted, tmp_path: Path) -> None:
    out, _ = fitted
    for text in ("", "[]", "{}", json.dumps({"settings": {}, "timestep": 0})):
        folder = tmp_path / "frame_0000"
        folder.mkdir(exist_ok=True)
        (folder / "point_cloud.ply").write_bytes(frame_ply(out, 0).read_bytes())
        (folder / "result.json").write_text(text)
        with pytest.raises(FormatError, match="not the result of a frame"):
            fit_frames(judged, tiny.head, [0], ITERATIONS, tmp_path, OPTIONS)


def test_a_frame_needs_something_to_learn_from_and_to_be_judged_by(tiny, judged, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="timestep 7 has no training view; timesteps 0 to 1"):
        fit_frames(judged, tiny.head, [0, 7], ITERATIONS, tmp_path, OPTIONS)
    with pytest.raises(DatasetError, match="no view of a held-out camera; none has"):
        fit_frames(tiny.capture, tiny.head, [0], ITERATIONS, tmp_path, OPTIONS)
    away = replace(tiny.head, v_template=tiny.head.v_template + np.float32(50))
    still = replace(judged, head=None)
    with pytest.raises(DatasetError, match="shows anything of the tracked mesh"):
        fit_frames(still, away, [0], ITERATIONS, tmp_path, OPTIONS)
    assert not list(tmp_path.iterdir())


def test_one_timestep_is_a_capture_of_its_own(judged) -> None:
    still = still_capture(judged, 1, np.zeros(3))
    assert len(still.train) == 5
    assert {view.timestep for view in (*still.train, *still.val)} == {0}
    assert [view.image_path for view in still.val] == [view.image_path for view in judged.val if view.timestep == 1]
