"""`sacha assemble`: footage of another program as a capture. Oracles: the arrays that the footage was made of, and a naive compositing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.avatar.motion import Motion
from sacha_core.flame.head_file import save_head
from sacha_core.flame.posing import person_template, pose_many
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.capture import Capture, read_capture
from sacha_core.interchange.gaussian_avatars import write_flame_param
from sacha_core.raster.camera import Camera

N_FRAMES, WIDTH, HEIGHT = 3, 20, 30
POSE_TOLERANCE = 1e-9  # matrices go through JSON in full precision
ROUNDING = 1.0  # of 255: 8 bits are composited in integers here and in floating point there
PLACES = [(0.6, 0.1, 0.8), (0.05, 0.0, 1.0), (-0.7, -0.1, 0.7)]  # camera 1 stands in front of the face


@pytest.fixture(scope="module")
def head():
    return synthetic_head("small")


@pytest.fixture
def motion(head) -> Motion:
    rng = np.random.default_rng(3)
    rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], N_FRAMES)
    shape = rng.normal(0, 1, rest.shape.shape).astype(np.float32)
    expression = rng.normal(0, 0.5, rest.expression.shape).astype(np.float32)
    neck = rng.normal(0, 0.1, rest.neck.shape).astype(np.float32)
    return replace(rest, shape=shape, expression=expression, neck=neck, frame_rate=30.0)


def cameras() -> list[Camera]:
    """Three cameras, the principal point not in the middle."""
    return [
        replace(Camera.look_at(np.array(place), np.zeros(3), WIDTH, HEIGHT, 60.0), cx=9.25, cy=16.5) for place in PLACES
    ]


@pytest.fixture
def footage(head, motion: Motion, tmp_path: Path) -> Path:
    """Footage of random pictures, as the Blender add-on leaves it; the head's file lies beside it."""
    folder = tmp_path / "footage"
    folder.mkdir()
    save_head(head, tmp_path / "head.npz")
    rng = np.random.default_rng(4)
    views = []
    for timestep in range(N_FRAMES):
        for index, camera in enumerate(cameras()):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = camera.rotation, camera.translation
            k = [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]
            name = f"{timestep:05d}_{index:02d}.png"
            pixels = rng.integers(0, 256, (HEIGHT, WIDTH, 4), np.uint8)
            Image.fromarray(pixels).save(folder / name)
            views.append(
                {
                    "timestep": timestep,
                    "camera_index": index,
                    "width": WIDTH,
                    "height": HEIGHT,
                    "K": k,
                    "world_to_camera": pose.tolist(),
                    "file": name,
                }
            )
    told = {"subject": "an na", "take": "TAKE_1", "origin": {"renderer": "none"}, "views": views, "checked": [0, 2]}
    (folder / "footage.json").write_text(json.dumps(told))
    write_flame_param(folder / "flame_param.npz", motion)
    np.save(folder / "posed.npy", pose_many(head, motion)[[0, 2]])
    np.save(folder / "unposed.npy", person_template(head, motion)[0])
    return folder


def change(footage: Path, **entries: object) -> None:
    path = footage / "footage.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | entries))


@pytest.fixture
def assembled(done, footage: Path, tmp_path: Path) -> Capture:
    report = done("assemble", footage, "--source", tmp_path / "head.npz", "-o", tmp_path / "data").report
    return read_capture(report["capture"])


def test_a_capture_has_what_the_footage_has(assembled: Capture, footage: Path, motion: Motion, head, tmp_path) -> None:
    assert assembled.root == tmp_path / "data" / "an-na_TAKE-1_rendered"
    assert assembled.head == head.reference
    assert assembled.head_path.resolve() == tmp_path / "data" / "head.npz"
    for name in ("shape", "static_offset", "expression", "neck", "jaw", "eyes", "rotation", "translation"):
        assert np.array_equal(getattr(assembled.motion, name), getattr(motion, name)), name
    assert assembled.motion.frame_rate == motion.frame_rate
    views = [*assembled.train, *assembled.val, *assembled.test]
    assert len(views) == N_FRAMES * len(PLACES)
    assert {view.camera_index for view in assembled.val} == {1}  # the one in front
    for view in views:
        truth = cameras()[view.camera_index]
        for name in ("fx", "fy", "cx", "cy", "rotation", "translation"):
            np.testing.assert_allclose(getattr(view.camera, name), getattr(truth, name), atol=POSE_TOLERANCE)
        pixels = np.asarray(Image.open(footage / f"{view.timestep:05d}_{view.camera_index:02d}.png")).astype(float)
        alpha = pixels[..., 3:] / 255
        assert np.abs(assembled.image(view) - (alpha * pixels[..., :3] + (1 - alpha) * 255)).max() <= ROUNDING
        assert np.array_equal(np.asarray(Image.open(view.mask_path)), pixels[..., 3])


def test_a_sculpted_person_becomes_personal_offsets(done, footage: Path, head, motion: Motion, tmp_path: Path) -> None:
    """Oracle: the motion with these offsets, posed by the engine."""
    rng = np.random.default_rng(5)
    offset = rng.normal(0, 1e-3, head.v_template.shape).astype(np.float32)
    own = replace(motion, static_offset=offset)
    np.save(footage / "posed.npy", pose_many(head, own)[[0, 2]])
    np.save(footage / "unposed.npy", person_template(head, own)[0])
    report = done("assemble", footage, "--source", tmp_path / "head.npz", "-o", tmp_path / "data").report
    found = read_capture(report["capture"]).motion
    assert np.abs(pose_many(head, found) - pose_many(head, own)).max() < 1e-6


def test_a_head_that_is_elsewhere_is_refused_before_there_are_pictures(call, footage: Path, tmp_path: Path) -> None:
    for picture in footage.glob("*.png"):
        picture.unlink()
    given = ("assemble", footage, "--source", tmp_path / "head.npz", "-o", tmp_path / "data", "--check")
    assert call(*given).status == 0
    posed = np.load(footage / "posed.npy")
    posed[1, 77, 2] += 2e-3
    np.save(footage / "posed.npy", posed)
    found = call(*given)
    assert found.status == 2
    assert "the head at timestep 2 is not where its parameters put it: vertex 77 is 2.00 mm away" in found.err
    assert not (tmp_path / "data").exists()


def test_an_avatar_and_a_mesh_say_which_head_they_have(
    done, call, footage: Path, model: Path, capture: Path, tmp_path: Path
) -> None:
    ply = next(model.rglob("point_cloud.ply"))
    for source in (model, ply, capture):
        done("assemble", footage, "--source", source, "-o", tmp_path / "data", "--check")
    mesh = tmp_path / "head.obj"
    mesh.write_text("")
    found = call("assemble", footage, "--source", mesh, "-o", tmp_path / "data", "--check")
    assert "does not say which head it has: name it with --head HEAD" in found.err
    done("assemble", footage, "--source", mesh, "--head", tmp_path / "head.npz", "-o", tmp_path / "data", "--check")


@pytest.mark.parametrize(
    ("harm", "complaint"),
    [
        (lambda f: (f / "00001_02.png").unlink(), "00001_02.png cannot be decoded"),
        (lambda f: (f / "00001_02.png").write_bytes(b"no picture"), "00001_02.png cannot be decoded"),
        (
            lambda f: Image.new("RGBA", (7, 7)).save(f / "00001_02.png"),
            "is RGBA of 7 by 7 pixels, expected one with alpha",
        ),
        (lambda f: Image.new("RGB", (WIDTH, HEIGHT)).save(f / "00001_02.png"), "is RGB of 20 by 30 pixels"),
        (lambda f: (f / "footage.json").write_text("[]"), "expected footage as the Blender add-on leaves it"),
        (lambda f: change(f, views=[]), "expected one view for each of 3 timesteps and each camera"),
        (lambda f: change(f, views=[{"width": 1e999}]), "expected footage as the Blender add-on leaves it"),
        (lambda f: change(f, checked=[0, 3]), "expected those of timesteps (0, 3)"),
        (lambda f: (f / "posed.npy").write_bytes(b"garbage"), "posed.npy is no array"),
        (lambda f: np.save(f / "unposed.npy", np.full((5, 3), np.nan)), "expected finite vertices"),
        (lambda f: np.save(f / "unposed.npy", np.zeros((5, 3))), "the filmed head has 5 vertices"),
        (lambda f: (f / "flame_param.npz").write_bytes(b"garbage"), "not an .npz archive"),
    ],
)
def test_what_is_incomplete_is_one_line(call, footage: Path, tmp_path: Path, harm, complaint: str) -> None:
    harm(footage)
    found = call("assemble", footage, "--source", tmp_path / "head.npz", "-o", tmp_path / "data")
    assert found.status == 2
    assert complaint in found.err
    assert found.err.count("\n") == 1


def test_one_camera_is_too_few(call, footage: Path, tmp_path: Path) -> None:
    views = json.loads((footage / "footage.json").read_text())["views"]
    change(footage, views=[view for view in views if view["camera_index"] == 1])
    found = call("assemble", footage, "--source", tmp_path / "head.npz", "-o", tmp_path / "data")
    assert "expected at least two: one is held out to judge by" in found.err
