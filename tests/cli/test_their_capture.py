"""A NeRSemble union and a single sequence as VHAP exports them, written here from its description and not by our writer.

Oracles: the cameras, parameters and pixels that were written; a pinhole projection by hand.
"""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.sparse import csc_matrix

from sacha_core.flame.head_file import load_head
from sacha_core.flame.open import open_head
from sacha_core.interchange.capture import read_capture
from sacha_core.interchange.gaussian_avatars import read_model

V, F, TEETH = 5023, 9976, 120
WIDTH, HEIGHT = 55, 80
SUFFIX = "v16_DS2-0.5x_lmkSTAR_teethV3_SMOOTH_offsetS_whiteBg_maskBelowLine"
SERIALS = {0: "221501007", 5: "222200037", 8: "222200047"}
POSE_TOLERANCE = 1e-12
FRONT = 8


@pytest.fixture(scope="module")
def flame(done, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a head converted from a pickle of FLAME's sizes, a ball of triangles, with masks that leave no vertex out."""
    folder, rng = tmp_path_factory.mktemp("flame"), np.random.default_rng(0)
    places = rng.normal(size=(V, 3))
    places *= 0.1 / np.linalg.norm(places, axis=1, keepdims=True)
    weights = np.zeros((V, 5))
    weights[:, 1] = 1
    content = {
        "v_template": places,
        "f": (rng.integers(V - 2, size=(F, 1)) + np.arange(3)).astype(np.uint32),
        "shapedirs": rng.normal(size=(V, 3, 400), scale=1e-4).astype(np.float32),
        "posedirs": np.zeros((V, 3, 36), np.float32),
        "J_regressor": csc_matrix(np.full((5, V), 1 / V)),
        "kintree_table": np.array([[2**32 - 1, 0, 1, 1, 1], np.arange(5)], np.int64),
        "weights": weights,
    }
    (folder / "flame2023.pkl").write_bytes(pickle.dumps(content, 2))
    names = ("face", "neck", "scalp", "boundary", "right_eyeball", "left_eyeball", "right_ear", "left_ear", "forehead")
    names += ("eye_region", "nose", "lips", "right_eye_region", "left_eye_region")
    masks = dict(zip(names, np.array_split(rng.permutation(V), len(names)), strict=True))
    (folder / "FLAME_masks.pkl").write_bytes(pickle.dumps(masks, 2))
    given = ("--masks", folder / "FLAME_masks.pkl")
    report = done("convert-head", folder / "flame2023.pkl", *given, "-o", folder / "flame.npz").report
    assert (report["n_vertices"], report["n_faces"], report["n_shape"], report["n_expression"]) == (
        5143,
        10144,
        300,
        100,
    )
    assert load_head(folder / "flame.npz").reference == open_head(folder / "flame2023.pkl").reference
    return folder / "flame.npz"


def to_world(sequence: int, camera: int) -> np.ndarray:
    """Give camera to world as VHAP has it: x right, y up, z backward; another pose in each sequence."""
    angle = (camera - FRONT) / 6
    turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = turn @ [0, 0, 1] + [0.002 * sequence, 0.001, 0]
    return matrix


def parameters(sequence: int, moment: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng([sequence, moment])

    def draw(scale: float, *shape: int) -> np.ndarray:
        return rng.normal(size=shape, scale=scale).astype(np.float32)

    person = np.random.default_rng(77)
    return {
        "translation": draw(0.001, 1, 3), "rotation": draw(0.05, 1, 3), "neck_pose": draw(0.05, 1, 3),
        "jaw_pose": draw(0.1, 1, 3).astype(np.float64), "eyes_pose": draw(0.1, 1, 6), "expr": draw(0.5, 1, 100),
        "shape": person.normal(size=300).astype(np.float32),
        "static_offset": person.normal(size=(1, V, 3), scale=1e-4).astype(np.float32),
    }  # fmt: skip


def write_sequence(
    root: Path, number: int, name: str, n_moments: int, masks: bool, mode: str
) -> list[dict[str, object]]:
    """Write one exported sequence; give the frames of its transforms."""
    folder = root / f"074_{name}_{SUFFIX}"
    for part in ("images", "flame_param", *(["fg_masks"] if masks else [])):
        (folder / part).mkdir(parents=True)
    frames = []
    for moment in range(n_moments):
        np.savez(folder / f"flame_param/{moment:05d}.npz", **parameters(number, moment))
        for camera, serial in SERIALS.items():
            stem = f"{moment:05d}_{camera:02d}"
            pixels = np.full((HEIGHT, WIDTH, 3 if mode == "RGB" else 4), 255, np.uint8)
            pixels[20:60, 15:40, :3] = 40 * moment + 5 * camera
            Image.fromarray(pixels).save(folder / f"images/{stem}.png")
            if masks:
                Image.fromarray(np.full((HEIGHT, WIDTH), 255, np.uint8)).save(folder / f"fg_masks/{stem}.png")
            focal = 110.0 + camera
            intrinsics = {"cx": 26.25, "cy": 41.5, "fl_x": focal, "fl_y": focal, "h": HEIGHT, "w": WIDTH}
            intrinsics |= {
                "camera_angle_x": 2 * math.atan(WIDTH / 2 / focal),
                "camera_angle_y": 2 * math.atan(HEIGHT / 2 / focal),
            }
            frames.append({
                "timestep_index": moment, "timestep_index_original": 7 * moment, "timestep_id": f"frame_{7 * moment:05d}",
                "camera_index": camera, "camera_id": serial, **intrinsics, "transform_matrix": to_world(number, camera).tolist(),
                "file_path": f"images/{stem}.png", "fg_mask_path": f"fg_masks/{stem}.png",
                "flame_param_path": f"flame_param/{moment:05d}.npz",
            })  # fmt: skip
    canonical = {key: np.zeros_like(value) for key, value in parameters(number, 0).items()}
    canonical["jaw_pose"] = np.array([[0.3, 0, 0]])
    np.savez(folder / "canonical_flame_param.npz", **canonical)
    for split, chosen in (
        ("", frames),
        ("_train", frames[: -len(SERIALS)]),
        ("_val", frames[2:3]),
        ("_test", frames[-len(SERIALS) :]),
    ):
        write_json(folder / f"transforms{split}.json", chosen)
    return frames


def write_json(path: Path, frames: list[dict[str, object]]) -> None:
    last = {key: frames[-1][key] for key in ("cx", "cy", "fl_x", "fl_y", "h", "w", "camera_angle_x", "camera_angle_y")}
    moments = sorted({frame["timestep_index"] for frame in frames})
    cameras = sorted({frame["camera_index"] for frame in frames})
    path.write_text(json.dumps({**last, "timestep_indices": moments, "camera_indices": cameras, "frames": frames}))


@pytest.fixture(scope="module")
def union(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a union of two training sequences, one of them without masks, and a test sequence of RGBA images."""
    root = tmp_path_factory.mktemp("nersemble")
    kinds = (("EMO-1", 3, True, "RGB"), ("EXP-2", 2, False, "RGB"), ("FREE", 2, True, "RGBA"))
    written = [write_sequence(root, number, *kind) for number, kind in enumerate(kinds)]
    folder = root / f"UNION10_074_EMO1234EXP234589_{SUFFIX}"
    folder.mkdir()
    first, splits = 0, {"train": [], "val": [], "test": []}
    for number, ((name, n_moments, _, _), frames) in enumerate(zip(kinds, written, strict=True)):
        for frame in frames:
            moved = {
                key: value for key, value in frame.items() if key not in {"timestep_index_original", "timestep_id"}
            }
            moved["timestep_index"] = first + int(frame["timestep_index"])
            for key in ("file_path", "fg_mask_path", "flame_param_path"):
                moved[key] = f"../074_{name}_{SUFFIX}/{frame[key]}"
            moved["file_path"] = str(moved["file_path"]).removesuffix(".png")  # appended by whoever reads it
            splits["test" if number == 2 else "val" if frame["camera_index"] == FRONT else "train"].append(moved)
        first += n_moments
    for split, frames in splits.items():
        write_json(folder / f"transforms_{split}.json", frames)
    source = root / f"074_EMO-1_{SUFFIX}" / "canonical_flame_param.npz"
    (folder / "canonical_flame_param.npz").write_bytes(source.read_bytes())
    return folder


def test_a_union_is_read_as_it_was_exported(union: Path) -> None:
    capture = read_capture(union)
    assert (len(capture.train), len(capture.val), len(capture.test)) == (10, 5, 6)
    assert capture.head is None
    moments = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0), (2, 1)]
    for name, key in (
        ("expression", "expr"),
        ("jaw", "jaw_pose"),
        ("eyes", "eyes_pose"),
        ("translation", "translation"),
    ):
        expected = np.concatenate([parameters(*moment)[key] for moment in moments]).astype(np.float32)
        np.testing.assert_array_equal(getattr(capture.motion, name), expected)
    offset = capture.motion.static_offset  # of a head without teeth: theirs get zeros, as GaussianAvatars pads
    assert offset.shape == (V + TEETH, 3)
    np.testing.assert_array_equal(offset[:V], parameters(0, 0)["static_offset"][0])
    assert not offset[V:].any()
    assert {view.timestep for view in capture.train if view.mask_path is None} == {3, 4}
    for view in (*capture.train, *capture.val, *capture.test):
        sequence, moment = moments[view.timestep]
        point = np.array([0.02, -0.03, 0.05])
        seen = np.linalg.inv(to_world(sequence, view.camera_index)) @ [*point, 1]  # y up, z backward
        focal = 110.0 + view.camera_index
        pixel = (26.25 + focal * seen[0] / -seen[2], 41.5 - focal * seen[1] / -seen[2])
        x, y, z = view.camera.rotation @ point + view.camera.translation
        camera = view.camera
        ours = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy)
        np.testing.assert_allclose(ours, pixel, atol=1e-9)
        image = capture.image(view)
        assert image.shape == (HEIGHT, WIDTH, 3)
        assert (image[30, 30] == 40 * moment + 5 * view.camera_index).all()
        assert (image[0, 0] == 255).all()


def test_a_sequence_alone_is_a_capture(union: Path) -> None:
    capture = read_capture(union.parent / f"074_EMO-1_{SUFFIX}")
    assert (len(capture.train), len(capture.val), len(capture.test)) == (6, 1, 3)
    np.testing.assert_array_equal(capture.motion.expression[2], parameters(0, 2)["expr"][0])


@pytest.mark.slow
def test_one_camera_is_enough(done, flame: Path, tmp_path: Path) -> None:
    """A video of oneself: nothing is held out, neither a camera nor an expression."""
    frames = write_sequence(tmp_path, 0, "FREE", 3, masks=True, mode="RGB")
    folder = tmp_path / f"074_FREE_{SUFFIX}"
    write_json(folder / "transforms_train.json", [frame for frame in frames if frame["camera_index"] == FRONT])
    for split in ("val", "test"):
        (folder / f"transforms_{split}.json").write_text(json.dumps({"frames": []}))
    (folder / "transforms.json").write_bytes((folder / "transforms_train.json").read_bytes())
    report = done("train", folder, "--head", flame, "-o", tmp_path / "m", "--iterations", 3, "--sh-degree", 0).report
    assert report["n_gaussians"] > 0


@pytest.mark.slow
def test_training_wants_but_the_path_and_the_head(done, union: Path, flame: Path, tmp_path: Path) -> None:
    """And what it writes has GaussianAvatars' own sizes."""
    model = tmp_path / "model"
    done("train", union, "--head", flame, "-o", model, "--iterations", 3, "--sh-degree", 0)
    gaussians, motion = read_model(model)
    assert len(gaussians) > 0
    assert gaussians.binding.max() < F + 168
    place = next(model.rglob("flame_param.npz"))
    with np.load(place) as arrays:
        assert arrays["static_offset"].shape == (1, V + TEETH, 3)
        assert arrays["dynamic_offset"].shape == (len(motion), V + TEETH, 3)
        assert arrays["shape"].shape == (300,)
    assert (model / "cfg_args").read_text().startswith("Namespace(")
    (model / "head.json").unlink()  # as a model of theirs comes
    file = tmp_path / "a.sacha"
    report = done("encode", model, "--head", flame, "--no-rendering", "-o", file).report
    assert report["n_frames"] == len(motion)
