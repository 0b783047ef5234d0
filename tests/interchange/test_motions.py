"""Oracles: numpy's own reader and writer; real tracked motion. Round trips are exact, wrong files are named."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.errors import FormatError, HeadError, SachaError
from sacha_core.flame.head_file import save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.arkit_motion import read_arkit_motion
from sacha_core.interchange.gaussian_avatars import (
    model_iterations,
    read_flame_param,
    read_model,
    write_flame_param,
    write_model,
)
from sacha_core.interchange.motion_file import read_motion


def random_motion(n_frames: int = 4, n_vertices: int = 9, frame_rate: float = 25.0) -> Motion:
    rng = np.random.default_rng(0)
    widths = {"expression": 7, "rotation": 3, "neck": 3, "jaw": 3, "eyes": 6, "translation": 3}
    return Motion(
        shape=rng.normal(size=5).astype(np.float32),
        static_offset=rng.normal(size=(n_vertices, 3)).astype(np.float32),
        **{name: rng.normal(size=(n_frames, width)).astype(np.float32) for name, width in widths.items()},
        frame_rate=frame_rate,
    )


def assert_same(a: Motion, b: Motion) -> None:
    for f in fields(Motion):
        np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name))


@pytest.mark.parametrize("dynamic_offset", [True, False])
@pytest.mark.parametrize(
    "motion", [random_motion(), random_motion(1, 0), random_motion(0), random_motion(frame_rate=29.97)]
)
def test_round_trip(tmp_path: Path, motion: Motion, dynamic_offset: bool) -> None:
    write_flame_param(tmp_path / "a.npz", motion, dynamic_offset=dynamic_offset)
    assert_same(read_flame_param(tmp_path / "a.npz"), motion)
    assert_same(read_motion(tmp_path / "a.npz"), motion)


def test_others_find_what_they_expect(tmp_path: Path) -> None:
    motion = random_motion()
    write_flame_param(tmp_path / "a.npz", motion, dynamic_offset=True)
    with np.load(tmp_path / "a.npz") as arrays:
        shapes = {name: arrays[name].shape for name in arrays.files}
        assert {arrays[name].dtype for name in arrays.files} == {np.dtype(np.float32)}
        np.testing.assert_array_equal(arrays["eyes_pose"], motion.eyes)
        assert not arrays["dynamic_offset"].any()
    assert shapes == {
        "shape": (5,), "expr": (4, 7), "rotation": (4, 3), "neck_pose": (4, 3), "jaw_pose": (4, 3), "eyes_pose": (4, 6),
        "translation": (4, 3), "static_offset": (1, 9, 3), "dynamic_offset": (4, 9, 3),
    }  # fmt: skip


def test_unused_dynamic_offsets_cost_next_to_nothing(tmp_path: Path) -> None:
    for name, wanted in (("with", True), ("without", False)):
        write_flame_param(tmp_path / name, random_motion(50, 5143), dynamic_offset=wanted)
    assert (tmp_path / "with").stat().st_size < (tmp_path / "without").stat().st_size + 20_000


def arrays_of(motion: Motion, folder: Path) -> dict[str, np.ndarray]:
    write_flame_param(folder / "source.npz", motion)
    with np.load(folder / "source.npz") as archive:
        return dict(archive)


def test_other_ways_to_write_the_same(tmp_path: Path) -> None:
    motion = random_motion()
    arrays = arrays_of(motion, tmp_path)
    arrays["shape"] = arrays["shape"][None]
    arrays["static_offset"] = arrays["static_offset"][0]
    np.savez_compressed(tmp_path / "a.npz", **{name: array.astype(np.float64) for name, array in arrays.items()})
    assert_same(read_flame_param(tmp_path / "a.npz"), motion)
    del arrays["static_offset"]
    np.savez(tmp_path / "a.npz", **arrays)
    assert read_flame_param(tmp_path / "a.npz").static_offset.shape == (0, 3)


@pytest.mark.wrong_shapes
@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("expr", None, "FLAME parameters lack expr"),
        ("jaw_pose", lambda a: a[:3], "motion parameter jaw has 3 frames, expected 4"),
        ("jaw_pose", lambda a: a[:, :2], r"jaw_pose has shape \(4, 2\), expected \(frames, 3\)"),
        ("eyes_pose", lambda a: a[:, :3], r"eyes_pose has shape \(4, 3\), expected \(frames, 6\)"),
        ("expr", lambda a: a[0], r"expr has shape \(7,\), expected \(frames, components\)"),
        ("translation", lambda a: a * np.nan, "motion parameter translation is not finite at row 0"),
        ("shape", lambda a: a * np.inf, "motion parameter shape is not finite"),
        ("shape", lambda a: a.astype(np.float64) * 1e300, "motion parameter shape is not finite"),
        ("shape", lambda a: np.stack([a, a]), r"shape has shape \(2, 5\), expected \(components,\)"),
        ("rotation", lambda a: a.astype(complex), "rotation is of complex128, expected real numbers"),
        ("static_offset", lambda a: a[..., :2], r"static_offset has shape \(9, 2\), expected \(1, vertices, 3\)"),
        ("frame_rate", lambda _: np.array(0.0), "frame rate 0.0 is not between"),
        ("frame_rate", lambda _: np.array([1.0, 2]), "frame_rate has shape"),
    ],
)
def test_wrong_parameters_are_named(tmp_path: Path, name: str, change, message: str) -> None:
    arrays = arrays_of(random_motion(), tmp_path)
    if change is None:
        del arrays[name]
    else:
        arrays[name] = change(arrays.get(name))
    np.savez(tmp_path / "b.npz", **arrays)
    for read in (read_flame_param, read_motion):
        with pytest.raises(FormatError, match=message if read is read_flame_param else r"b\.npz"):
            read(tmp_path / "b.npz")


def test_models_hold_iterations_and_the_last_is_read(tmp_path: Path) -> None:
    motion = random_motion()
    for iteration, n in ((30, 3), (200, 4), (1000, 5)):
        write_model(tmp_path / "m", iteration, initial_gaussians(n, np.random.default_rng(0)), motion)
    assert list(model_iterations(tmp_path / "m")) == [30, 200, 1000]
    gaussians, back = read_model(tmp_path / "m")
    assert len(gaussians) == 5
    assert back is not None
    assert_same(back, motion)
    assert len(read_model(tmp_path / "m", 200)[0]) == 4
    assert len(read_model(tmp_path / "m/point_cloud/iteration_30")[0]) == 3


def test_models_without_a_motion(tmp_path: Path) -> None:
    folder = write_model(tmp_path, 7, initial_gaussians(2, np.random.default_rng(0)))
    assert folder == tmp_path / "point_cloud" / "iteration_7"
    assert read_model(tmp_path)[1] is None


def test_folders_that_hold_no_model(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"holds no iteration .* there are: none"):
        read_model(tmp_path)
    write_model(tmp_path, 7, initial_gaussians(2, np.random.default_rng(0)))
    with pytest.raises(FormatError, match=r"holds no iteration 8 .* there are: 7"):
        read_model(tmp_path, 8)
    with pytest.raises(FormatError, match="Gaussian 1 is bound to triangle 1; the head has triangles 0 to 0"):
        read_model(tmp_path, n_faces=1)


NAMES = ("jawOpen", "smileLeft", "smileRight")


def save_weights(path: Path, **changes: np.ndarray | None) -> np.ndarray:
    weights = np.random.default_rng(1).random((5, 3)).astype(np.float32)
    arrays = {"weights": weights, "names": np.array(NAMES), "time_s": np.arange(5) / 60} | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return weights


def named_head(*names: str, n: int | None = None) -> HeadModel:
    return HeadModel(
        name="rig",
        v_template=np.zeros((3, 3), np.float32),
        faces=np.array([[0, 1, 2]], np.int32),
        shapedirs=np.zeros((3, 3, 0), np.float32),
        exprdirs=np.zeros((3, 3, n or len(names)), np.float32),
        J_regressor=np.full((1, 3), 1 / 3, np.float32),
        weights=np.ones((3, 1), np.float32),
        parents=np.array([-1], np.int32),
        expression_names=names,
    )


def test_weights_become_the_expression(tmp_path: Path) -> None:
    weights = save_weights(tmp_path / "a.npz")
    for motion in (read_arkit_motion(tmp_path / "a.npz"), read_motion(tmp_path / "a.npz")):
        np.testing.assert_array_equal(motion.expression, weights)
        assert motion.frame_rate == 60
        assert not motion.rotation.any()


def test_weights_follow_the_heads_names(tmp_path: Path) -> None:
    weights = save_weights(tmp_path / "a.npz")
    motion = read_arkit_motion(tmp_path / "a.npz", named_head("smileRight", "browUp", "jawOpen", "smileLeft"))
    np.testing.assert_array_equal(
        motion.expression, np.stack([weights[:, 2], np.zeros(5), weights[:, 0], weights[:, 1]], axis=1)
    )


def test_weights_that_the_head_lacks(tmp_path: Path) -> None:
    weights = save_weights(tmp_path / "a.npz")
    with pytest.raises(HeadError, match=r"a\.npz: head 'rig' has no blend shape 'smileRight', which the motion uses"):
        read_motion(tmp_path / "a.npz", named_head("jawOpen", "smileLeft"))
    weights[:, 2] = 0
    save_weights(tmp_path / "a.npz", weights=weights)
    assert read_motion(tmp_path / "a.npz", named_head("jawOpen", "smileLeft")).expression.shape == (5, 2)


def test_weights_without_names_must_be_as_many(tmp_path: Path) -> None:
    weights = save_weights(tmp_path / "a.npz", names=None)
    np.testing.assert_array_equal(read_motion(tmp_path / "a.npz", named_head(*NAMES)).expression, weights)
    with pytest.raises(HeadError, match="the motion has 3 blend shapes and head 'rig' has 4"):
        read_motion(tmp_path / "a.npz", named_head(n=4))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weights": np.zeros(3)}, r"weights have shape \(3,\)"),
        ({"weights": np.array([["a"]])}, "expected .* real numbers"),
        ({"weights": np.full((5, 3), np.nan)}, "expression is not finite at row 0"),
        ({"names": np.array(["a", "b"])}, "2 different names for 3"),
        ({"names": np.array(["a", "b", "a"])}, "2 different names for 3"),
        ({"time_s": np.arange(4.0)}, "time_s has shape"),
        ({"time_s": np.zeros(5)}, "expected it to ascend"),
        ({"time_s": np.full(5, np.nan)}, "expected it to ascend"),
        ({"time_s": np.arange(5) * 1e9}, "frame rate 0.0 is not between"),
    ],
)
def test_wrong_weights_are_named(tmp_path: Path, changes: dict[str, np.ndarray], message: str) -> None:
    save_weights(tmp_path / "a.npz", **changes)
    for read in (read_arkit_motion, read_motion):
        with pytest.raises(FormatError, match=message):
            read(tmp_path / "a.npz")


def test_a_head_is_no_motion_though_it_has_weights(tmp_path: Path) -> None:
    save_head(synthetic_head("small"), tmp_path / "head.npz")
    with pytest.raises(FormatError, match="is a head, expected a motion"):
        read_motion(tmp_path / "head.npz")


def test_files_that_hold_no_motion(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", b=np.zeros(3))
    with pytest.raises(FormatError, match=r"holds no motion: expected 'expr' .* found b"):
        read_motion(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(b"nonsense")
    for read in (read_motion, read_flame_param, read_arkit_motion):
        with pytest.raises(SachaError, match=r"b\.npz"):
            read(tmp_path / "b.npz")


@pytest.mark.real_data
def test_real_motions(real_data: Path, tmp_path: Path) -> None:
    for name, n_frames in (("motion_a_flame", 180), ("motion_b_flame", 145)):
        motion = read_motion(real_data / f"{name}.npz")
        assert (len(motion), motion.expression.shape[1], len(motion.shape)) == (n_frames, 100, 300)
        write_flame_param(tmp_path / "a.npz", motion)
        assert_same(read_motion(tmp_path / "a.npz"), motion)
    arkit = read_motion(real_data / "motion_arkit_a.npz")
    assert (len(arkit), arkit.expression.shape[1], arkit.frame_rate) == (973, 51, 30)


def test_frames_can_be_picked() -> None:
    motion = random_motion()
    picked = motion.frames(np.array([3, 1]))
    np.testing.assert_array_equal(picked.jaw, motion.jaw[[3, 1]])
    assert_same(
        replace(
            picked,
            **{
                name: getattr(motion, name) for name in ("expression", "rotation", "neck", "jaw", "eyes", "translation")
            },
        ),
        motion,
    )
