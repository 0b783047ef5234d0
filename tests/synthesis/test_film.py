"""Filming the small synthetic head: what is seen is where the parameters say, noise is only on paper, threads change nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.errors import HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser, pose_vertices
from sacha_core.flame.synthetic import EXPRESSIONS, synthetic_head
from sacha_core.interchange.capture import Capture, read_capture
from sacha_core.interchange.capture_writer import CaptureWriter
from sacha_core.progress import Progress
from sacha_core.synthesis.cameras import FRONT_CAMERA, N_CAMERAS, camera_rig
from sacha_core.synthesis.film import Picture, film, plan_takes
from sacha_core.synthesis.options import SynthOptions
from sacha_core.synthesis.renderer import Renderer, srgb_bytes
from sacha_core.synthesis.sequences import SCRIPTS, coefficients, perform
from sacha_core.synthesis.subject import Subject

# A vertex on the outline may have its pixel's samples just beside it; one more pixel for the rounding of both.
OUTLINE_PX = 1.5
FADED_M = 0.011  # the lowest part of the bust fades out, over 10 mm
HAIR_M = 0.03  # how far hair may stand off the head
OPTIONS = SynthOptions(train=("EMO-1",), train_timesteps=2, test_timesteps=2, cameras=(1, 8, 11), width=60, height=88)


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


def shoot(head: HeadModel, options: SynthOptions, threads: int = 1) -> list[list[Picture]]:
    return [list(film(head, take, options, threads=threads)) for take in plan_takes(head, options)]


@pytest.fixture(scope="module")
def pictures(head: HeadModel) -> list[list[Picture]]:
    return shoot(head, OPTIONS)


@pytest.fixture(scope="module")
def capture(head: HeadModel, pictures: list[list[Picture]], tmp_path_factory: pytest.TempPathFactory) -> Capture:
    root = tmp_path_factory.mktemp("film")
    writer = CaptureWriter(root, "synthetic-0", head.reference, origin=OPTIONS.origin(head.reference.sha256))
    sequences = []
    for take, shots in zip(plan_takes(head, OPTIONS), pictures, strict=True):
        sequence = writer.sequence(take.name, take.tracked, take.cameras)
        for shot in shots:
            sequence.add(shot.timestep, shot.camera_index, shot.camera, shot.image, shot.mask)
        sequence.finish()
        sequences.append(sequence)
    return read_capture(writer.finish(sequences[:1], sequences[1:]))


def test_every_camera_takes_every_moment_in_order(pictures: list[list[Picture]]) -> None:
    for shots in pictures:
        assert [(p.timestep, p.camera_index) for p in shots] == [(t, c) for t in range(2) for c in OPTIONS.cameras]
        for p in shots:
            assert p.image.shape == (88, 60, 3)
            assert p.mask.shape == (88, 60)
            assert np.all(p.image[p.mask == 0] == 255), "white where nobody is"
            assert 0.1 < (p.mask > 127).mean() < 0.7
            assert np.ptp(p.image[p.mask == 255].reshape(-1, 3).mean(axis=1)) > 60, "light and shade"
            inside = p.mask[1:-1, 1:-1]
            assert p.mask.max() == 255
            assert inside.sum() == p.mask.sum(), "the subject does not touch the border"


def test_posed_vertices_lie_in_the_masks(head: HeadModel, capture: Capture) -> None:
    """From the JSON's matrix by the convention's own formula, in float64: OpenGL looks along -z, image y points down."""
    rest = pose_vertices(
        head, replace(capture.motion.frames(slice(0, 1)), expression=np.zeros((1, len(EXPRESSIONS)), np.float32)), 0
    )
    solid = rest[:, 1] > rest[:, 1].min() + FADED_M
    poser = Poser(head, capture.motion)
    for split in ("train", "val", "test"):
        for frame in json.loads((capture.root / f"transforms_{split}.json").read_text())["frames"]:
            vertices = poser(frame["timestep_index"])[solid].astype(np.float64)
            local = (np.c_[vertices, np.ones(len(vertices))] @ np.linalg.inv(np.array(frame["transform_matrix"])).T)[
                :, :3
            ]
            u = frame["cx"] + frame["fl_x"] * local[:, 0] / -local[:, 2]
            v = frame["cy"] - frame["fl_y"] * local[:, 1] / -local[:, 2]
            mask = np.asarray(Image.open(capture.root / frame["fg_mask_path"])) > 0
            rows, columns = np.nonzero(mask)
            distance = np.hypot(u[:, None] - columns - 0.5, v[:, None] - rows - 0.5).min(axis=1)
            assert distance.max() < OUTLINE_PX
            # and nothing is far from the head: hair and shirt at most
            spread = np.hypot(columns[:, None] + 0.5 - u, rows[:, None] + 0.5 - v).min(axis=1)
            assert spread.max() < HAIR_M * frame["fl_x"] / 0.9 + 88 * 0.06


def test_the_capture_is_split_as_planned(capture: Capture) -> None:
    assert {v.camera_index for v in capture.train} == {1, 11}
    assert {v.camera_index for v in capture.val} == {FRONT_CAMERA}
    assert {v.timestep for v in capture.test} == {2, 3}
    first, held_out = capture.train[0].camera, capture.test[0].camera
    assert np.array_equal(first.rotation, held_out.rotation)
    assert np.linalg.norm(first.centre - held_out.centre) > 1e-3, "each sequence has its own origin"


def test_threads_change_nothing(head: HeadModel, pictures: list[list[Picture]]) -> None:
    for alone, together in zip(pictures, shoot(head, OPTIONS, threads=3), strict=True):
        for a, b in zip(alone, together, strict=True):
            assert np.array_equal(a.image, b.image)
            assert np.array_equal(a.mask, b.mask)


def test_tracking_noise_is_on_the_parameters_only(head: HeadModel, pictures: list[list[Picture]]) -> None:
    noisy = replace(OPTIONS, expression_noise=0.1, pose_noise_rad=0.01, translation_noise_m=0.001, test_timesteps=2)
    for clean, take in zip(plan_takes(head, OPTIONS), plan_takes(head, noisy), strict=True):
        for name in ("expression", "rotation", "neck", "jaw", "eyes", "translation"):
            assert np.array_equal(getattr(take.truth, name), getattr(clean.truth, name))
            assert np.array_equal(getattr(clean.tracked, name), getattr(clean.truth, name))
        errors = {
            name: getattr(take.tracked, name) - getattr(take.truth, name)
            for name in ("expression", "neck", "translation")
        }
        assert 0.05 < errors["expression"].std() < 0.15
        assert 0.003 < errors["neck"].std() < 0.02
        assert 0.0003 < errors["translation"].std() < 0.002
    for a, b in zip(pictures, shoot(head, noisy), strict=True):
        assert all(np.array_equal(p.image, q.image) for p, q in zip(a, b, strict=True))


def test_seeds_are_other_people(head: HeadModel) -> None:
    vertices = head.v_template
    camera = camera_rig(30, 44)[FRONT_CAMERA]
    images = [Renderer(1).draw(Subject(head, vertices, seed).scene(vertices), camera)[0] for seed in (0, 0, 3)]
    assert np.array_equal(images[0], images[1])
    assert (images[0] != images[2]).mean() > 0.1


def test_progress_counts_pictures(head: HeadModel) -> None:
    seen: list[Progress] = []
    take = plan_takes(head, replace(OPTIONS, cameras=(8, 9), width=20, height=30))[0]
    list(film(head, take, replace(OPTIONS, supersample=1), report=seen.append))
    assert [p.done for p in seen] == [1, 2, 3, 4]
    assert {p.total for p in seen} == {4}


def test_leaving_early_stops_the_filming(head: HeadModel) -> None:
    take = plan_takes(head, OPTIONS)[0]
    shots = film(head, take, OPTIONS, threads=2)
    next(shots)
    shots.close()
    assert len(list(film(head, take, OPTIONS))) == 6


def test_a_head_without_masks_is_refused(head: HeadModel) -> None:
    bald = replace(head, masks={k: v for k, v in head.masks.items() if k != "scalp"})
    with pytest.raises(HeadError, match="no mask scalp"):
        Subject(bald, head.v_template)


def test_srgb_table() -> None:
    table = srgb_bytes()
    assert table[0] == 0
    assert table[-1] == 255
    back = table / 255
    linear = np.where(back <= 0.04045, back / 12.92, ((back + 0.055) / 1.055) ** 2.4)
    slope = np.gradient(linear)
    assert np.abs(linear - np.linspace(0, 1, len(table))).max() < 0.5 / 255 * 2.3 + slope.max()


class TestRig:
    def test_sixteen_different_cameras_face_the_head(self) -> None:
        rig = camera_rig(550, 802)
        assert len(rig) == N_CAMERAS == 16
        centres = np.stack([camera.centre for camera in rig])
        assert np.unique(centres.round(3), axis=0).shape == (16, 3)
        assert (centres[:, 2] > 0.4).all(), "all in front"
        front = rig[FRONT_CAMERA]
        assert abs(front.centre[0]) < 1e-12
        assert np.allclose(front.rotation[2], [0, 0, -1])
        for camera in rig:
            local = camera.rotation @ np.zeros(3) + camera.translation
            assert 0.8 < local[2] < 1.2
            x, y = camera.fx * local[0] / local[2] + camera.cx, camera.fy * local[1] / local[2] + camera.cy
            assert abs(x - 275) < 60
            assert abs(y - 401) < 80

    def test_resolution_only_scales(self) -> None:
        small, large = camera_rig(275, 401)[3], camera_rig(550, 802)[3]
        assert np.array_equal(small.rotation, large.rotation)
        assert small.resized(550, 802).fx == pytest.approx(large.fx)


class TestSequences:
    @pytest.mark.parametrize("name", SCRIPTS)
    def test_scripts_use_movements_that_exist(self, name: str) -> None:
        for pose in SCRIPTS[name]:
            row = coefficients(pose)  # raises where a movement has no component
            assert np.count_nonzero(row) >= len(pose.face)
            assert np.abs(row).max() <= 1.0

    @pytest.mark.parametrize("name", SCRIPTS)
    def test_motion_is_human(self, head: HeadModel, name: str) -> None:
        motion = perform(head, name, 40, seed=3)
        motion.validate()
        assert len(motion) == 40
        turn_deg = np.degrees(motion.rotation + motion.neck)
        assert np.abs(turn_deg).max() < 30
        assert np.abs(turn_deg[:, 1]).max() >= 4 or name == "EXP-2"
        assert (motion.jaw[:, 0] >= 0).all()
        assert motion.jaw[:, 0].max() < 0.35
        assert np.abs(np.degrees(motion.eyes)).max() < 30
        assert np.array_equal(motion.eyes[:, :3], motion.eyes[:, 3:]), "both eyes look the same way"
        assert np.abs(motion.translation.mean(axis=0)).max() < 1e-6
        lids = motion.expression[:, [EXPRESSIONS.index("blink_left"), EXPRESSIONS.index("blink_right")]]
        assert lids.min() >= 0
        assert lids.max() <= 1
        assert np.abs(motion.expression).max() < 1.2

    def test_sequences_and_seeds_differ(self, head: HeadModel) -> None:
        motions = [perform(head, name, 9, seed).expression for name in ("EMO-1", "FREE") for seed in (0, 1)]
        assert all(not np.array_equal(a, b) for i, a in enumerate(motions) for b in motions[:i])

    def test_any_head_can_perform(self, head: HeadModel) -> None:
        other = replace(head, name="rig", exprdirs=head.exprdirs[:, :, :7])
        motion = perform(other, "FREE", 5, 0)
        assert motion.expression.shape == (5, 7)
        assert motion.expression.std() > 0.2

    def test_one_timestep(self, head: HeadModel) -> None:
        assert len(perform(head, "FREE", 1, 0)) == 1

    def test_unknown_script(self, head: HeadModel) -> None:
        with pytest.raises(OptionError, match="no sequence 'EMO-9'"):
            perform(head, "EMO-9", 3, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"train_timesteps": 0}, "train_timesteps is 0, expected 1"),
        ({"width": 4}, "width"),
        ({"supersample": 9}, "supersample"),
        ({"pose_noise_rad": float("nan")}, "pose_noise_rad"),
        ({"expression_noise": -1.0}, "expression_noise"),
        ({"train": ("FREE",)}, "different sequences"),
        ({"train": ()}, "at least one"),
        ({"cameras": (0, 1)}, "expected 8"),
        ({"cameras": (8,)}, "and another"),
        ({"cameras": (8, 8, 1)}, "different ones"),
        ({"cameras": (8, 16)}, "from 0 to 15"),
        ({"seed": -1}, "seed"),
    ],
)
def test_options_that_make_no_sense(change: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        replace(OPTIONS, **change)  # type: ignore[arg-type]


def test_options_are_plain_json(tmp_path: Path) -> None:
    assert (
        SynthOptions(**json.loads(json.dumps(OPTIONS.as_json())) | {"train": ("EMO-1",), "cameras": (1, 8, 11)})
        == OPTIONS
    )
