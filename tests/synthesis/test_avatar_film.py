"""Filming an avatar. Oracle: `render_avatar` of the same avatar at the parameters and through the cameras that the dataset gives back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.errors import DatasetError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.rig import rig_from_arrays
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture, View, read_capture
from sacha_core.interchange.capture_writer import CaptureWriter
from sacha_core.raster.scene import Picture as Drawn
from sacha_core.raster.scene import render_avatar
from sacha_core.synthesis.arkit_face import ARKIT_SHAPES
from sacha_core.synthesis.avatar_film import Sitter, film_avatar, plan_avatar_takes
from sacha_core.synthesis.cameras import FRONT_CAMERA
from sacha_core.synthesis.film import Picture
from sacha_core.synthesis.options import SynthOptions

OPTIONS = SynthOptions(
    train=("EMO-1", "EXP-5"),
    train_timesteps=2,
    test_timesteps=2,
    cameras=(2, 8, 11),
    width=60,
    height=88,
    supersample=1,
)
ROUNDING = 0.5 / 255  # of a value to its byte
# A camera goes through the JSON's focal angle and matrix in float64 and the kernels take it as float32: the last bit may fall otherwise.
DRAWN = 2e-5


@pytest.fixture(scope="module")
def sitter() -> Sitter:
    """Give a rig with ARKit's shapes, painted by chance, as large as life but far from the origin."""
    mesh = synthetic_head("small")
    deltas = np.random.default_rng(0).normal(0, 5e-4, (52, mesh.n_vertices, 3)).astype(np.float32)
    away = np.array([0.2, 1.6, -0.1], np.float32)
    arrays = {
        "verts": mesh.v_template + away,
        "faces": mesh.faces,
        "arkit_deltas": deltas,
        "arkit_names": np.array(ARKIT_SHAPES),
    }
    head = rig_from_arrays(arrays, "rig")
    return Sitter(painted(head), head)


def painted(head: HeadModel) -> Gaussians:
    rng = np.random.default_rng(1)
    gaussians = initial_gaussians(head.n_faces, rng, sh_degree=1)
    n = len(gaussians)
    return replace(
        gaussians,
        opacity_logit=rng.normal(3, 1, n).astype(np.float32),
        log_scale=gaussians.log_scale - 0.7,
        sh_dc=rng.normal(0, 1, (n, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.1, (n, 3, 3)).astype(np.float32),
    )


def capture_of(root: Path, sitter: Sitter, options: SynthOptions, motion: Motion | None = None) -> Capture:
    writer = CaptureWriter(root, "somebody", sitter.head.reference, origin=sitter.origin(options))
    sequences = []
    for take in plan_avatar_takes(sitter, options, motion):
        sequence = writer.sequence(take.name, take.tracked, take.cameras)
        for shot in film_avatar(sitter, take, options):
            sequence.add(shot.timestep, shot.camera_index, shot.camera, shot.image, shot.mask)
        sequence.finish()
        sequences.append(sequence)
    return read_capture(writer.finish(sequences[:-1], sequences[-1:]))


@pytest.fixture(scope="module")
def capture(sitter: Sitter, tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return capture_of(tmp_path_factory.mktemp("plain"), sitter, OPTIONS)


def drawn(sitter: Sitter, capture: Capture, view: View, factor: int = 1) -> Drawn:
    """Draw what the dataset says was before the camera."""
    frames = triangle_frames(Poser(sitter.head, capture.motion)(view.timestep), sitter.head.faces)
    camera = view.camera.resized(view.camera.width * factor, view.camera.height * factor)
    return render_avatar(sitter.gaussians, frames, camera)


def stored_mask(view: View) -> np.ndarray:
    assert view.mask_path is not None
    return np.asarray(Image.open(view.mask_path)).astype(float) / 255


def views(capture: Capture) -> tuple[View, ...]:
    return (*capture.train, *capture.val, *capture.test)


def test_images_are_the_avatar_at_the_written_parameters(sitter: Sitter, capture: Capture) -> None:
    for view in views(capture):
        picture = drawn(sitter, capture, view)
        stored = capture.image(view).astype(float) / 255
        assert np.abs(stored - np.clip(picture.colour, 0, 1)).max() <= ROUNDING + DRAWN
        assert np.abs(stored_mask(view) - picture.alpha).max() <= ROUNDING + DRAWN


def test_supersampling_averages_finer_pictures(sitter: Sitter, tmp_path: Path) -> None:
    options = replace(OPTIONS, train=("EMO-1",), train_timesteps=1, test_timesteps=1, cameras=(8, 11), supersample=3)
    fine = capture_of(tmp_path, sitter, options)
    for view in views(fine):
        picture = drawn(sitter, fine, view, factor=3)
        for stored, samples in (
            (fine.image(view).astype(float) / 255, np.clip(picture.colour, 0, 1)),
            (stored_mask(view)[..., None], picture.alpha[..., None]),
        ):
            expected = np.stack([samples[i::3, j::3] for i in range(3) for j in range(3)]).mean(
                axis=0, dtype=np.float64
            )
            assert np.abs(stored - expected).max() <= ROUNDING + DRAWN


def test_splits_and_the_place_of_each_sequence(capture: Capture) -> None:
    assert {v.camera_index for v in capture.train} == {2, 11}
    assert {v.camera_index for v in capture.val} == {FRONT_CAMERA}
    assert {v.camera_index for v in capture.test} == {2, 8, 11}
    assert {v.timestep for v in capture.train} == {v.timestep for v in capture.val} == {0, 1, 2, 3}
    assert {v.timestep for v in capture.test} == {4, 5}
    origins = {tuple(v.camera.centre.round(6)) for v in views(capture) if v.camera_index == FRONT_CAMERA}
    assert len(origins) == 3, "each sequence has its own origin"


def test_the_head_fills_the_picture_and_is_in_it(sitter: Sitter) -> None:
    """For heads of any size: in metres, as a doll, and in centimetres."""
    for size in (1.0, 0.2, 100.0):
        head = replace(sitter.head, v_template=sitter.head.v_template * np.float32(size))
        cameras = Sitter(sitter.gaussians, head).framing(60, 88).rig(60, 88)
        frames = triangle_frames(head.v_template, head.faces)
        rows, columns = [], []
        for camera in cameras:
            mask = render_avatar(sitter.gaussians, frames, camera).alpha > 0.5
            border = np.concatenate([mask[0], *mask[:44, [0, -1]].T])
            assert not border.any(), "the upper half is in the picture; the shoulders need not be"
            _, y, z = camera.rotation @ head.v_template.T.astype(float) + camera.translation[:, None]
            v = camera.fy * y / z + camera.cy
            assert v.min() > 0
            assert v.max() < 88, "down to the neck cut"
            rows.append((v.max() - np.argmax(mask.any(axis=1))) / 88)
            columns.append(2 * np.abs(np.flatnonzero(mask[:53].any(axis=0)) + 0.5 - 30).max() / 60)
        assert max(max(rows) / 0.88, max(columns) / 0.9) > 0.93, "as large as fits"
        assert min(rows) > 0.6


def test_turning_left_turns_left(sitter: Sitter) -> None:
    """The nose of a head that turns to the subject's left moves to the right in the picture of the front camera."""
    take = plan_avatar_takes(sitter, replace(OPTIONS, train=("EXP-5",), train_timesteps=12))[0]
    nose = int(np.argmax(sitter.head.v_template[:, 2]))
    poser, camera = Poser(sitter.head, take.truth), take.cameras[FRONT_CAMERA]
    x = [(camera.rotation @ poser(t)[nose] + camera.translation)[0] for t in range(12)]
    assert np.corrcoef(x, take.truth.rotation[:, 1])[0, 1] > 0.8  # tilting moves it too


def shots(sitter: Sitter, options: SynthOptions, motion: Motion | None = None) -> list[Picture]:
    return [shot for take in plan_avatar_takes(sitter, options, motion) for shot in film_avatar(sitter, take, options)]


def test_seeds_decide(sitter: Sitter) -> None:
    options = replace(
        OPTIONS, train=("EMO-1",), train_timesteps=1, test_timesteps=1, cameras=(8, 2), width=30, height=44
    )
    first, again = shots(sitter, options), shots(sitter, options)
    other = shots(sitter, replace(options, seed=1))
    assert all(
        np.array_equal(a.image, b.image) and np.array_equal(a.mask, b.mask) for a, b in zip(first, again, strict=True)
    )
    assert not any(np.array_equal(a.image, b.image) for a, b in zip(first, other, strict=True))


def test_noise_is_on_paper_only(sitter: Sitter) -> None:
    noisy = replace(OPTIONS, expression_noise=0.1, pose_noise_rad=0.01, translation_noise_m=0.001)
    for clean, take in zip(plan_avatar_takes(sitter, OPTIONS), plan_avatar_takes(sitter, noisy), strict=True):
        assert np.array_equal(clean.truth.expression, take.truth.expression)
        assert np.array_equal(clean.tracked.expression, clean.truth.expression)
        assert 0.05 < (take.tracked.expression - take.truth.expression).std() < 0.15
        assert (take.tracked.translation != take.truth.translation).all()


def test_a_motion_is_cut_into_the_sequences(sitter: Sitter, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    motion = replace(Motion.rest(0, 52, 9, 30.0), expression=rng.uniform(0, 1, (9, 52)).astype(np.float32))
    options = replace(OPTIONS, train=("a", "b.1"), test="c", train_timesteps=1, test_timesteps=2, cameras=(8, 11))
    made = capture_of(tmp_path, sitter, options, motion)
    assert np.array_equal(made.motion.expression, motion.expression[[1, 4, 6, 8]])
    view = made.test[-1]
    stored = made.image(view).astype(float) / 255
    assert np.abs(stored - np.clip(drawn(sitter, made, view).colour, 0, 1)).max() <= ROUNDING + DRAWN


def test_the_person_is_the_avatar_s_own() -> None:
    head = synthetic_head("small")
    identity = replace(
        Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2]),
        shape=np.linspace(-1, 1, head.shapedirs.shape[2]).astype(np.float32),
        static_offset=np.full((head.n_vertices, 3), 0.001, np.float32),
    )
    sitter = Sitter(painted(head), head, identity)
    other = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], 30)
    for motion in (None, other):
        for take in plan_avatar_takes(sitter, OPTIONS, motion):
            assert np.array_equal(take.truth.shape, identity.shape)
            assert np.array_equal(take.tracked.static_offset, identity.static_offset)


def test_origin_tells_avatars_apart(sitter: Sitter) -> None:
    other = Sitter(replace(sitter.gaussians, sh_dc=sitter.gaussians.sh_dc + np.float32(0.1)), sitter.head)
    assert sitter.origin(OPTIONS) == Sitter(sitter.gaussians, sitter.head).origin(OPTIONS)
    assert sitter.origin(OPTIONS) != other.origin(OPTIONS)
    assert sitter.origin(OPTIONS) != sitter.origin(replace(OPTIONS, supersample=2))


def test_nothing_to_film(sitter: Sitter) -> None:
    for gaussians in (
        sitter.gaussians.select(np.arange(0)),
        replace(sitter.gaussians, opacity_logit=np.full(len(sitter.gaussians), -20, np.float32)),
    ):
        with pytest.raises(OptionError, match="nothing to film"):
            plan_avatar_takes(Sitter(gaussians, sitter.head), OPTIONS)


@pytest.mark.parametrize("name", ["EMO_1", "../up", "", "a b"])
def test_names_that_would_break_the_layout(sitter: Sitter, tmp_path: Path, name: str) -> None:
    writer = CaptureWriter(tmp_path, "somebody")
    with pytest.raises(DatasetError, match="expected letters"):
        writer.sequence(name, sitter.at_rest(), (8,))
