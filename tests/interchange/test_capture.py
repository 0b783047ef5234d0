"""The capture layout: what is written is what is read, the splits are NeRSemble's, and whatever is broken is named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.avatar.motion import Motion
from sacha_core.errors import DatasetError
from sacha_core.flame.model import HeadReference
from sacha_core.interchange.capture import Capture, read_capture
from sacha_core.interchange.capture_writer import CaptureWriter
from sacha_core.raster.camera import Camera

POSE_TOLERANCE = 1e-12  # a translation goes through the camera's centre and back: a few float64 roundings of about 1 m
WIDTH, HEIGHT = 12, 18
N_CAMERAS, VALIDATION = 3, 1
TIMESTEPS = {"EMO-1": 2, "EMO-3": 3, "FREE": 2}
HEAD = HeadReference("ball", "ab" * 32, 7, 5)


def camera_at(index: int, sequence: int) -> Camera:
    """Another pose and other intrinsics for every camera of every sequence."""
    angle = 0.4 * (index - 1) + 0.05 * sequence
    eye = np.array([np.sin(angle), 0.1 * index, np.cos(angle)])
    camera = Camera.look_at(eye, np.array([0.0, 0.02, 0.0]), WIDTH, HEIGHT, 20.0 + index)
    return Camera(WIDTH, HEIGHT, camera.fx, camera.fy + 0.5, 5.5, 8.75, camera.rotation, camera.translation)


def image_of(sequence: int, timestep: int, index: int) -> np.ndarray:
    return np.random.default_rng([sequence, timestep, index]).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def motion_of(sequence: int, n: int) -> Motion:
    rng = np.random.default_rng(sequence)
    draw = lambda *shape: rng.normal(size=shape).astype(np.float32)  # noqa: E731
    person = np.random.default_rng(99)
    return Motion(
        person.normal(size=4).astype(np.float32),
        person.normal(size=(7, 3)).astype(np.float32),
        draw(n, 6),
        draw(n, 3),
        draw(n, 3),
        draw(n, 3),
        draw(n, 6),
        draw(n, 3),
    )


def write_capture(root: Path, head: HeadReference | None = HEAD) -> Path:
    writer = CaptureWriter(root, "ann", head, validation_camera=VALIDATION, origin={"seed": 1})
    sequences = []
    for s, (name, n) in enumerate(TIMESTEPS.items()):
        sequence = writer.sequence(name, motion_of(s, n), range(N_CAMERAS))
        for t in range(n):
            for c in range(N_CAMERAS):
                mask = image_of(s, t, c)[..., 0]
                sequence.add(t, c, camera_at(c, s), image_of(s, t, c), mask)
        sequence.finish()
        sequences.append(sequence)
    return writer.finish(sequences[:2], sequences[2:])


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_capture(tmp_path_factory.mktemp("capture")).parent


@pytest.fixture(scope="module")
def capture(written: Path) -> Capture:
    return read_capture(written)  # finds the one union folder


@pytest.fixture
def copy(written: Path, tmp_path: Path) -> Path:
    """A copy of the capture that a test may break: its union folder."""
    shutil.copytree(written, tmp_path / "capture")
    return next((tmp_path / "capture").glob("UNION*"))


def sequence_and_moment(timestep: int) -> tuple[int, int]:
    """From a union's timestep to the sequence and the timestep within it, counted out by hand."""
    return [(0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1)][timestep]


def test_folders_are_named_as_nersembles(written: Path) -> None:
    names = sorted(path.name for path in written.iterdir())
    assert names == [
        "UNION3_ann_EMO13FREE_v16_whiteBg",
        "ann_EMO-1_v16_whiteBg",
        "ann_EMO-3_v16_whiteBg",
        "ann_FREE_v16_whiteBg",
    ]
    union = written / names[0]
    assert (union / "sequences_trainval.txt").read_text().split() == names[1:3]
    assert (union / "sequences_test.txt").read_text().split() == names[3:]
    assert sorted(path.name for path in union.iterdir()) == [
        "canonical_flame_param.npz",
        "head.json",
        "sequences_test.txt",
        "sequences_trainval.txt",
        "transforms_test.json",
        "transforms_train.json",
        "transforms_val.json",
    ]
    canonical = np.load(union / "canonical_flame_param.npz")
    assert np.allclose(canonical["jaw_pose"], [[0.3, 0, 0]])
    assert not canonical["expr"].any()
    assert np.array_equal(canonical["shape"], motion_of(0, 1).shape)


def test_splits(capture: Capture) -> None:
    keys = {
        split: {(v.timestep, v.camera_index) for v in getattr(capture, split)} for split in ("train", "val", "test")
    }
    assert keys["train"] == {(t, c) for t in range(5) for c in (0, 2)}
    assert keys["val"] == {(t, VALIDATION) for t in range(5)}
    assert keys["test"] == {(t, c) for t in (5, 6) for c in range(N_CAMERAS)}
    assert sum(len(getattr(capture, split)) for split in keys) == 7 * N_CAMERAS  # nothing twice


def test_round_trip_is_exact(capture: Capture) -> None:
    expected = [motion_of(s, n) for s, n in enumerate(TIMESTEPS.values())]
    for name in ("expression", "rotation", "neck", "jaw", "eyes", "translation"):
        assert np.array_equal(getattr(capture.motion, name), np.concatenate([getattr(m, name) for m in expected])), name
    assert np.array_equal(capture.motion.shape, expected[0].shape)
    assert np.array_equal(capture.motion.static_offset, expected[0].static_offset)
    assert capture.head == HEAD
    for view in (*capture.train, *capture.val, *capture.test):
        s, t = sequence_and_moment(view.timestep)
        assert np.array_equal(capture.image(view), image_of(s, t, view.camera_index))
        assert view.mask_path is not None
        assert np.array_equal(np.asarray(Image.open(view.mask_path)), image_of(s, t, view.camera_index)[..., 0])
        camera = camera_at(view.camera_index, s)
        assert np.array_equal(view.camera.rotation, camera.rotation)
        assert np.abs(view.camera.translation - camera.translation).max() < POSE_TOLERANCE
        for name in ("width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(view.camera, name) == getattr(camera, name)


def test_a_sequence_is_a_capture_of_its_own(written: Path) -> None:
    alone = read_capture(written / "ann_EMO-3_v16_whiteBg")
    assert len(alone.motion) == 3
    assert {v.timestep for v in alone.train} == {v.timestep for v in alone.val} == {0, 1}
    assert {v.timestep for v in alone.test} == {2}
    document = json.loads((written / "ann_EMO-3_v16_whiteBg" / "transforms.json").read_text())
    assert len(document["frames"]) == 3 * N_CAMERAS
    assert document["timestep_indices"] == [0, 1, 2]
    assert document["camera_indices"] == [0, 1, 2]


def test_matrix_is_opengls_camera_to_world(written: Path, capture: Capture) -> None:
    """By the convention's own words: columns right, up, backward, and the centre."""
    document = json.loads((capture.root / "transforms_train.json").read_text())
    frame, view = document["frames"][0], capture.train[0]
    matrix = np.array(frame["transform_matrix"])
    assert np.allclose(matrix[:3, 3], view.camera.centre)
    assert np.allclose(matrix[:3, 0], view.camera.rotation[0])
    assert np.allclose(matrix[:3, 1], -view.camera.rotation[1])
    assert np.allclose(matrix[:3, 2], -view.camera.rotation[2])
    assert matrix[1, 1] > 0.9  # up is up for a camera that stands upright
    assert matrix[2, 2] > 0.5  # it looks towards -z: backward is +z for a camera in front of the face
    assert frame["camera_angle_x"] == pytest.approx(2 * np.arctan(WIDTH / (2 * view.camera.fx)))


def test_resolutions(capture: Capture) -> None:
    view = capture.train[3]
    stored = capture.image(view).astype(np.float64)
    halved = capture.image(view, WIDTH // 2, HEIGHT // 2)
    boxes = stored.reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean(axis=(1, 3))
    assert np.abs(halved - boxes).max() <= 0.5 + 1e-9  # only the rounding to 8 bits
    assert capture.image(view, 7, 11).shape == (11, 7, 3)
    many = capture.load_images(capture.train, 6, 9, threads=3)
    assert np.array_equal(many, np.stack([capture.image(v, 6, 9) for v in capture.train]))


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P"])
def test_transparent_is_white(copy: Path, mode: str) -> None:
    view = read_capture(copy).train[0]
    pixels = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    pixels[: HEIGHT // 2] = (90, 90, 90, 255)
    picture = Image.fromarray(pixels).convert(mode if mode != "P" else "RGBA")
    if mode == "P":
        picture = picture.quantize(4)
    picture.save(view.image_path)
    image = read_capture(copy).image(view)
    assert np.all(image[: HEIGHT // 2] == 90)
    assert np.all(image[HEIGHT // 2 :] == 255)


def test_masks_may_be_missing(copy: Path) -> None:
    shutil.rmtree(copy.parent / "ann_EMO-1_v16_whiteBg" / "fg_masks")
    capture = read_capture(copy)
    assert all((view.mask_path is None) == (view.timestep < 2) for view in capture.train)


def test_float64_parameters_become_float32(copy: Path) -> None:
    path = copy.parent / "ann_EMO-1_v16_whiteBg" / "flame_param" / "00001.npz"
    arrays = {key: value.astype(np.float64) for key, value in np.load(path).items()}
    np.savez(path, **arrays)
    motion = read_capture(copy).motion
    assert motion.expression.dtype == motion.jaw.dtype == np.float32
    assert np.array_equal(motion.jaw[1], motion_of(0, 2).jaw[1])


def test_a_folder_of_another_maker_has_no_head(tmp_path: Path) -> None:
    assert read_capture(write_capture(tmp_path, head=None)).head is None


def test_intrinsics_may_stand_at_the_top(copy: Path, capture: Capture) -> None:
    """NeRF's own files give one viewing angle for all frames and nothing else."""
    path = copy / "transforms_val.json"
    document = json.loads(path.read_text())
    for frame in document["frames"]:
        for key in ("cx", "cy", "fl_x", "fl_y", "h", "w", "camera_angle_x", "camera_angle_y"):
            del frame[key]
    for key in ("cx", "cy", "fl_x", "fl_y", "camera_angle_y"):
        del document[key]
    path.write_text(json.dumps(document))
    camera = read_capture(copy).val[0].camera
    assert camera.fx == camera.fy == pytest.approx(capture.val[0].camera.fx)
    assert (camera.cx, camera.cy) == (WIDTH / 2, HEIGHT / 2)


def edit(path: Path, change: Callable[[dict], object]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def edit_frame(key: str, value: object) -> Callable[[Path], Path]:
    def corrupt(union: Path) -> Path:
        path = union / "transforms_train.json"
        edit(path, lambda document: document["frames"][3].__setitem__(key, value))
        return path

    return corrupt


def edit_parameters(key: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], Path]:
    def corrupt(union: Path) -> Path:
        path = union.parent / "ann_EMO-3_v16_whiteBg" / "flame_param" / "00001.npz"
        arrays = dict(np.load(path))
        arrays[key] = change(arrays[key])
        np.savez(path, **arrays)
        return path

    return corrupt


def in_sequence(relative: str, change: Callable[[Path], object]) -> Callable[[Path], Path]:
    def corrupt(union: Path) -> Path:
        path = union.parent / "ann_FREE_v16_whiteBg" / relative
        change(path)
        return path

    return corrupt


def in_union(name: str, change: Callable[[Path], object]) -> Callable[[Path], Path]:
    def corrupt(union: Path) -> Path:
        change(union / name)
        return union / name

    return corrupt


def sheared(matrix: float) -> list[list[float]]:
    return [[1, matrix, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]


CORRUPTIONS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "image missing": (in_sequence("images/00001_02.png", Path.unlink), "does not exist"),
    "image of another size": (
        in_sequence("images/00001_02.png", lambda p: Image.new("RGB", (WIDTH + 1, HEIGHT)).save(p)),
        f"{WIDTH + 1} by {HEIGHT} pixels, its frame says {WIDTH} by {HEIGHT}",
    ),
    "image is text": (in_sequence("images/00001_02.png", lambda p: p.write_text("no")), "not an image"),
    "mask of another size": (in_sequence("fg_masks/00000_00.png", lambda p: Image.new("L", (3, 4)).save(p)), "3 by 4"),
    "parameters missing": (in_sequence("flame_param/00000.npz", Path.unlink), "do not exist"),
    "parameters are text": (in_sequence("flame_param/00000.npz", lambda p: p.write_text("no")), "param"),
    "parameters cut": (in_sequence("flame_param/00000.npz", lambda p: p.write_bytes(p.read_bytes()[:300])), "param"),
    "parameter not a number": (edit_parameters("expr", lambda a: a * np.nan), "finite"),
    "parameter infinite": (edit_parameters("translation", lambda a: a + np.inf), "finite"),
    "expression of another length": (
        edit_parameters("expr", lambda a: a[:, :-1]),
        r"\(1, 5\), at timestep 0 it is \(1, 6\)",
    ),
    "shape of another length": (edit_parameters("shape", lambda a: a[:2]), "shape has shape"),
    "offsets of another head": (edit_parameters("static_offset", lambda a: a[:, :4]), "static_offset has shape"),
    "two frames in a moment": (edit_parameters("jaw_pose", lambda a: np.repeat(a, 2, 0)), "param"),
    "not JSON": (in_union("transforms_val.json", lambda p: p.write_text('{"frames": [')), "not JSON"),
    "not text": (in_union("transforms_val.json", lambda p: p.write_bytes(b"\xff\xfe\x00")), "not JSON"),
    "a list": (in_union("transforms_val.json", lambda p: p.write_text("[]")), 'no list "frames"'),
    "frame is a number": (
        in_union("transforms_val.json", lambda p: edit(p, lambda d: d["frames"].append(3))),
        "expected an object",
    ),
    "split missing": (in_union("transforms_val.json", Path.unlink), "does not exist"),
    "train empty": (
        in_union("transforms_train.json", lambda p: edit(p, lambda d: d["frames"].clear())),
        "has no frames",
    ),
    "test empty": (in_union("transforms_test.json", lambda p: edit(p, lambda d: d["frames"].clear())), "has no frames"),
    "matrix sheared": (
        edit_frame("transform_matrix", sheared(0.01)),
        "frame 3: transform_matrix is not a rigid motion",
    ),
    "matrix mirrored": (edit_frame("transform_matrix", np.diag([-1, 1, 1, 1]).tolist()), "not a rigid motion"),
    "matrix projective": (edit_frame("transform_matrix", np.diag([1, 1, 1, 2]).tolist()), "not a rigid motion"),
    "matrix ragged": (edit_frame("transform_matrix", [[1, 2], [3]]), "4 by 4"),
    "matrix missing": (edit_frame("transform_matrix", None), "4 by 4"),
    "focal zero": (edit_frame("fl_x", 0), "frame 3: focal length fl_x is 0"),
    "focal negative": (edit_frame("fl_y", -30), "focal length fl_y"),
    "focal huge": (edit_frame("fl_x", 1e9), "focal length fl_x"),
    "focal text": (edit_frame("fl_x", "wide"), "fl_x is 'wide', expected a finite number"),
    "focal not a number": (edit_frame("fl_x", float("nan")), "expected a finite number"),
    "principal far away": (edit_frame("cx", 1e4), "principal point cx"),
    "width zero": (edit_frame("w", 0), "image of 0 by"),
    "width huge": (edit_frame("w", 1 << 40), "w is"),
    "height broken": (edit_frame("h", 3.5), "h is 3.5, expected a whole number"),
    "timestep negative": (edit_frame("timestep_index", -1), "timestep_index is -1"),
    "path missing": (edit_frame("file_path", None), "file_path is None, expected a path"),
    "two sets of parameters": (
        edit_frame("flame_param_path", "flame_param/99999.npz"),
        "timestep 1 has two parameter files",
    ),
    "path to nothing": (edit_frame("file_path", "images/99999"), "does not exist"),
    "head.json without a hash": (
        in_union("head.json", lambda p: p.write_text('{"name": "x"}')),
        "expected name, sha256",
    ),
}


@pytest.mark.wrong_shapes
@pytest.mark.parametrize("name", CORRUPTIONS)
def test_corruption_is_named(copy: Path, name: str) -> None:
    corrupt, message = CORRUPTIONS[name]
    broken = corrupt(copy)
    with pytest.raises(DatasetError, match=message) as caught:
        read_capture(copy)
    named = {"path to nothing": "99999.png", "two sets of parameters": "99999.npz"}.get(name, broken.name)
    assert named in str(caught.value), "the message names the file"


def test_a_gap_in_time_is_named(copy: Path) -> None:
    for split in ("train", "val"):
        edit(
            copy / f"transforms_{split}.json",
            lambda d: d["frames"].__setitem__(slice(None), [f for f in d["frames"] if f["timestep_index"] != 3]),
        )
    with pytest.raises(DatasetError, match="no frame has timestep_index 3"):
        read_capture(copy)


def test_a_truncated_image_is_named_when_decoded(copy: Path) -> None:
    view = read_capture(copy).train[0]
    view.image_path.write_bytes(view.image_path.read_bytes()[:-200])
    with pytest.raises(DatasetError, match=view.image_path.name):
        read_capture(copy).image(view)


def test_no_capture_at_all(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"no transforms_train\.json"):
        read_capture(tmp_path)
    with pytest.raises(DatasetError, match="not a folder"):
        read_capture(tmp_path / "nowhere")


def test_a_complete_sequence_is_kept_only_if_made_from_the_same(written: Path) -> None:
    writer = CaptureWriter(written, "ann", HEAD, validation_camera=VALIDATION, origin={"seed": 1})
    assert writer.sequence("EMO-1", motion_of(0, 2), range(N_CAMERAS)).is_complete()
    assert not writer.sequence("EMO-1", motion_of(1, 2), range(N_CAMERAS)).is_complete()
    assert not writer.sequence("EMO-1", motion_of(0, 2), range(N_CAMERAS + 1)).is_complete()
    assert not writer.sequence("EXP-9", motion_of(0, 2), range(N_CAMERAS)).is_complete()
    other = CaptureWriter(written, "ann", HEAD, validation_camera=VALIDATION, origin={"seed": 2})
    assert not other.sequence("EMO-1", motion_of(0, 2), range(N_CAMERAS)).is_complete()


def test_an_interrupted_sequence_is_incomplete(copy: Path) -> None:
    writer = CaptureWriter(copy.parent, "ann", HEAD, validation_camera=VALIDATION, origin={"seed": 1})
    sequence = writer.sequence("EMO-1", motion_of(0, 2), range(N_CAMERAS))
    sequence.add(0, 0, camera_at(0, 0), image_of(0, 0, 0), image_of(0, 0, 0)[..., 0])
    assert not sequence.is_complete()
    with pytest.raises(DatasetError, match="timestep 0, camera 1 was not added"):
        sequence.finish()


def test_writer_refuses_what_it_could_not_read(tmp_path: Path) -> None:
    writer = CaptureWriter(tmp_path, "ann")
    sequence = writer.sequence("EMO-1", motion_of(0, 2), range(N_CAMERAS))
    image = image_of(0, 0, 0)
    with pytest.raises(DatasetError, match=r"image \(18, 12, 3\) and mask \(18, 11\)"):
        sequence.add(0, 0, camera_at(0, 0), image, image[:, 1:, 0])
    with pytest.raises(DatasetError, match="no timestep 2, camera 0"):
        sequence.add(2, 0, camera_at(0, 0), image, image[..., 0])
    with pytest.raises(DatasetError, match="subject 'a_b'"):
        CaptureWriter(tmp_path, "a_b")
