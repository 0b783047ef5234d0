"""Oracle: FLAME of the maintained package smplx, on the same model file, full size and made of random numbers.

`SACHA_REQUIRE_SMPLX=1` makes its absence a failure.
"""

from __future__ import annotations

import importlib
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.sparse import csc_matrix

from sacha_core.avatar.motion import Motion
from sacha_core.errors import FormatError
from sacha_core.flame.open import open_head
from sacha_core.flame.posing import pose_vertices

V, F, N_SHAPE, N_EXPRESSION = 5023, 9976, 300, 100
SMPLX_FILE = "FLAME_NEUTRAL.pkl"
VERTEX_ERROR_M = 1e-6  # float32: 436 directions are summed to some centimetres
SUBSET_ERROR_M = 1e-7  # the same without a pose, and a hundred directions
POSES = 6


@pytest.fixture(scope="module")
def smplx() -> Any:
    if os.environ.get("SACHA_REQUIRE_SMPLX") == "1":
        return importlib.import_module("smplx")
    return pytest.importorskip("smplx", reason="smplx is not installed (extra `test`)")


def flame_content(**changes: np.ndarray) -> dict[str, Any]:
    """Give the dictionary of a FLAME model: every term is there, and moves vertices by centimetres."""
    rng = np.random.default_rng(0)
    weights = rng.random((V, 5)) ** 8
    regressor = np.zeros((5, V))
    for row in regressor:
        row[rng.choice(V, 60, replace=False)] = 1 / 60
    return {
        "v_template": rng.normal(size=(V, 3)) / 10,
        "f": (rng.integers(V - 2, size=(F, 1)) + np.arange(3)).astype(np.uint32),
        "shapedirs": rng.normal(size=(V, 3, N_SHAPE + N_EXPRESSION), scale=1e-3),
        "posedirs": rng.normal(size=(V, 3, 36), scale=1e-3),
        "J_regressor": csc_matrix(regressor),
        "kintree_table": np.array([[2**32 - 1, 0, 1, 1, 1], np.arange(5)], np.int64),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "bs_style": "lbs",
    } | changes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a model as its authors lay it out, with the landmark embedding that smplx insists on."""
    place = tmp_path_factory.mktemp("flame")
    (place / SMPLX_FILE).write_bytes(pickle.dumps(flame_content(), 2))
    landmarks = {"lmk_face_idx": np.zeros(51, np.int64), "lmk_b_coords": np.full((51, 3), 1 / 3)}
    (place / "flame_static_embedding.pkl").write_bytes(pickle.dumps(landmarks, 2))
    return place


def random_motion(rng: np.random.Generator) -> Motion:
    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    dynamic = {"expression": normal(POSES, N_EXPRESSION), "rotation": normal(POSES, 3), "neck": normal(POSES, 3) / 2}
    dynamic |= {"jaw": normal(POSES, 3) / 3, "eyes": normal(POSES, 6) / 2, "translation": normal(POSES, 3)}
    return Motion(shape=normal(N_SHAPE), static_offset=np.zeros((0, 3), np.float32), **dynamic)


def posed_by_smplx(smplx: Any, folder: Path, motion: Motion) -> np.ndarray:
    model = smplx.FLAME(
        str(folder), num_betas=N_SHAPE, num_expression_coeffs=N_EXPRESSION, batch_size=len(motion), dtype=torch.float64
    )
    given = {
        "betas": np.repeat(motion.shape[None], len(motion), axis=0),
        "global_orient": motion.rotation,
        "neck_pose": motion.neck,
        "jaw_pose": motion.jaw,
        "leye_pose": motion.eyes[:, :3],
        "reye_pose": motion.eyes[:, 3:],
        "expression": motion.expression,
        "transl": motion.translation,
    }
    with torch.no_grad():
        posed = model(**{name: torch.tensor(array, dtype=torch.float64) for name, array in given.items()})
    return posed.vertices.numpy()


@pytest.mark.slow
def test_vertices_are_those_of_smplx(smplx: Any, folder: Path) -> None:
    motion = random_motion(np.random.default_rng(1))
    expected = posed_by_smplx(smplx, folder, motion)
    head = open_head(folder / SMPLX_FILE, teeth=False)
    assert np.abs(expected[0] - head.v_template).max() > 0.1  # the pose is one
    for frame in range(len(motion)):
        assert np.abs(pose_vertices(head, motion, frame) - expected[frame]).max() < VERTEX_ERROR_M
    with_teeth = open_head(folder / SMPLX_FILE)
    np.testing.assert_array_equal(pose_vertices(with_teeth, motion, 0)[:V], pose_vertices(head, motion, 0))


def as_objects(content: dict[str, Any]) -> dict[str, Any]:
    return content


def as_dense(content: dict[str, Any]) -> dict[str, Any]:
    return content | {"J_regressor": content["J_regressor"].toarray()}


@pytest.mark.slow
@pytest.mark.parametrize("kept", [as_objects, as_dense])
def test_the_same_dictionary_as_npz_is_the_same_head(
    folder: Path, tmp_path: Path, kept: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    content = kept(flame_content())
    if isinstance(content["J_regressor"], csc_matrix):
        held = np.empty((), object)
        held[()] = content["J_regressor"]
        content["J_regressor"] = held
    np.savez(tmp_path / "flame.npz", **content)
    given, read = open_head(folder / SMPLX_FILE), open_head(tmp_path / "flame.npz")
    assert read.reference.sha256 == given.reference.sha256
    assert read.n_teeth_faces == 168


class Runs:
    """Creates a file when a pickle of it is loaded in the ordinary way."""

    def __init__(self, victim: Path) -> None:
        self.victim = victim

    def __reduce__(self) -> Any:
        return exec, (f"open({str(self.victim)!r}, 'w')",)


def test_code_in_an_npz_is_named_and_never_run(tmp_path: Path) -> None:
    held = np.empty((), object)
    held[()] = Runs(tmp_path / "victim")
    arrays = {"v_template": np.zeros((V, 3)), "f": np.zeros((F, 3), int), "J_regressor": held}
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(FormatError, match=r"a\.npz: J_regressor: the pickle asks for .*exec.* nothing was run"):
        open_head(tmp_path / "a.npz")
    del arrays["f"]
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(FormatError, match=r"a\.npz: array 'J_regressor' holds Python objects"):
        open_head(tmp_path / "a.npz")
    assert not (tmp_path / "victim").exists()


@pytest.mark.slow
@pytest.mark.real_data
def test_shape_and_expression_of_flame_2023(smplx: Any, real_data: Path, folder: Path, tmp_path: Path) -> None:
    """FLAME's own first fifty components of each, in a model whose other numbers are zeros."""
    with np.load(real_data / "flame2023_subset_50_50.npz") as subset:
        held = {name: subset[name] for name in subset.files}
    directions = np.zeros((V, 3, N_SHAPE + N_EXPRESSION), np.float32)
    directions[:, :, :50] = held["shapedirs50"]
    directions[:, :, N_SHAPE : N_SHAPE + 50] = held["exprdirs50"]
    changes = {"v_template": held["v_template"], "f": held["faces"].astype(np.uint32), "shapedirs": directions}
    (tmp_path / SMPLX_FILE).write_bytes(pickle.dumps(flame_content(**changes), 2))
    (tmp_path / "flame_static_embedding.pkl").write_bytes((folder / "flame_static_embedding.pkl").read_bytes())
    motion = random_motion(np.random.default_rng(2))
    motion.shape[50:], motion.expression[:, 50:] = 0, 0
    head = open_head(tmp_path / SMPLX_FILE, teeth=False)
    expected = posed_by_smplx(smplx, tmp_path, motion)
    for frame in range(len(motion)):
        assert np.abs(pose_vertices(head, motion, frame) - expected[frame]).max() < VERTEX_ERROR_M
    still = Motion.rest(N_SHAPE, N_EXPRESSION)
    still.shape[:50], still.expression[0, :50] = motion.shape[:50], motion.expression[0, :50]
    by_hand = held["v_template"].astype(np.float64)
    by_hand += held["shapedirs50"].astype(np.float64) @ still.shape[:50]
    by_hand += held["exprdirs50"].astype(np.float64) @ still.expression[0, :50]
    assert np.abs(pose_vertices(head, still, 0) - by_hand).max() < SUBSET_ERROR_M
