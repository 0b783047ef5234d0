"""`sacha scene`: what is laid out, against the functions that the rest of the engine uses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.cli.common import HeadSource
from sacha_core.cli.scene import open_scene
from sacha_core.codec import encode
from sacha_core.codec.levels import LEVELS
from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.head_file import save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.splat_ply import write_bound_ply
from sacha_core.regions.labels import label_triangles, region_counts
from sacha_core.regions.scheme import PAPER
from sacha_core.scene.contents import Scene
from sacha_core.scene.folder import write_scene

ONE_COMPONENT = 0.5  # how far the person of the tests goes along the first identity direction
FLOAT32_M = 1e-7  # rounding of a posed coordinate of some decimetres
SHAPE_STEP = LEVELS[4].shape_step  # the codec rounds identity coefficients to multiples of it: off by half at most


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


@pytest.fixture(scope="module")
def avatar(head: HeadModel) -> Avatar:
    """Gaussians on every third triangle, triangle i carrying i of them up to 5, of a person who is not the mean."""
    binding = np.concatenate([np.full(min(face, 5), face) for face in range(0, head.n_faces, 3)]).astype(np.int32)
    gaussians = initial_gaussians(head.n_faces, np.random.default_rng(0)).select(binding)
    motion = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], n_frames=2)
    shape = np.zeros_like(motion.shape)
    shape[0] = ONE_COMPONENT
    return Avatar(gaussians, head.reference, replace(motion, shape=shape))


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines))
    return path


def test_an_avatar_is_laid_out_on_its_persons_neutral_head(tmp_path: Path, head: HeadModel, avatar: Avatar) -> None:
    path = tmp_path / "a.sacha"
    path.write_bytes(encode(avatar, level=4, head=head))
    scene = open_scene(path, HeadSource())
    count = np.bincount(avatar.gaussians.binding, minlength=head.n_faces)
    labels = label_triangles(head)
    assert (scene.kind, scene.name, scene.head) == ("avatar", "a", head.name)
    assert np.array_equal(scene.faces, head.faces)
    assert np.array_equal(scene.views["count"].values, count)
    assert np.array_equal(scene.views["region"].values, labels)
    assert [line["label"] for line in scene.views["region"].legend] == list(PAPER.regions)
    assert scene.regions is not None
    assert scene.regions.gaussians.tolist() == region_counts(labels, avatar.gaussians.binding).tolist()
    moved = head.v_template + ONE_COMPONENT * head.shapedirs[:, :, 0]
    assert np.abs(scene.vertices - moved).max() <= SHAPE_STEP / 2 * np.abs(head.shapedirs).sum(axis=2).max() + FLOAT32_M


def test_a_ply_of_gaussians_is_told_from_a_mesh_by_its_header(tmp_path: Path, head: HeadModel, avatar: Avatar) -> None:
    path = tmp_path / "a.ply"
    write_bound_ply(path, avatar.gaussians)
    save_head(head, tmp_path / "head.npz")
    scene = open_scene(path, HeadSource(head=str(tmp_path / "head.npz")))
    assert scene.kind == "avatar"
    assert scene.views["count"].values.sum() == len(avatar.gaussians)
    with pytest.raises(HeadError):
        open_scene(path, HeadSource())


def test_a_head_has_regions_and_no_counts(tmp_path: Path, head: HeadModel) -> None:
    save_head(head, tmp_path / "head.npz")
    scene = open_scene(tmp_path / "head.npz", HeadSource())
    assert scene.kind == "head"
    assert list(scene.views) == ["region"]
    assert scene.uv is not None
    assert np.array_equal(scene.uv, head.uv[head.uv_faces])


def test_a_head_without_masks_is_shown_with_a_note_instead_of_regions(tmp_path: Path, head: HeadModel) -> None:
    save_head(replace(head, masks={}), tmp_path / "bare.npz")
    scene = open_scene(tmp_path / "bare.npz", HeadSource())
    assert not scene.views
    assert len(scene.notes) == 1
    assert "no vertex mask" in scene.notes[0]


def test_a_mesh_without_teeth_has_the_regions_of_its_triangles(tmp_path: Path, head: HeadModel) -> None:
    save_head(head, tmp_path / "head.npz")
    n_skin = head.n_faces - head.n_teeth_faces
    assert head.n_teeth_faces > 0
    path = write_obj(tmp_path / "skin.obj", head.v_template, head.faces[:n_skin])
    scene = open_scene(path, HeadSource(head=str(tmp_path / "head.npz")))
    assert scene.kind == "mesh"
    assert np.array_equal(scene.views["region"].values, label_triangles(head)[:n_skin])
    assert scene.uv is not None
    assert np.array_equal(scene.uv, head.uv[head.uv_faces[:n_skin]])
    shorter = write_obj(tmp_path / "shorter.obj", head.v_template, head.faces[: n_skin - 1])
    with pytest.raises(HeadError, match="does not have those of head"):
        open_scene(shorter, HeadSource(head=str(tmp_path / "head.npz")))


def test_a_mesh_of_other_triangles_is_refused(tmp_path: Path, head: HeadModel) -> None:
    save_head(head, tmp_path / "head.npz")
    path = write_obj(tmp_path / "turned.obj", head.v_template, np.roll(head.faces, 1, axis=0))
    with pytest.raises(HeadError, match="in its order"):
        open_scene(path, HeadSource(head=str(tmp_path / "head.npz")))


def test_a_mesh_alone_is_shown_with_a_note(tmp_path: Path, head: HeadModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "none"))  # else a head of these triangles may be known by now
    scene = open_scene(write_obj(tmp_path / "mesh.obj", head.v_template, head.faces), HeadSource())
    assert not scene.views
    assert "name that head" in scene.notes[0]


def test_the_folder_says_all_and_is_whole(tmp_path: Path, head: HeadModel) -> None:
    save_head(head, tmp_path / "head.npz")
    scene = open_scene(tmp_path / "head.npz", HeadSource())
    write_scene(scene, tmp_path / "scene")
    told = json.loads((tmp_path / "scene" / "scene.json").read_text())
    assert told["views"]["region"]["legend"] == scene.views["region"].legend
    kinds = {
        "vertices": "<f4",
        "faces": "<i4",
        "uv": "<f4",
        "region": "<i4",
        "region_level": "<i4",
        "palettes_region": "<f4",
    }
    written = {path.stem: np.load(path).dtype.str for path in (tmp_path / "scene").glob("*.npy")}
    assert kinds.items() <= written.items()
    assert np.array_equal(np.load(tmp_path / "scene" / "region.npy"), scene.views["region"].values)


def test_a_folder_that_could_not_be_finished_has_no_scene_json(
    tmp_path: Path, head: HeadModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    save_head(head, tmp_path / "head.npz")
    scene: Scene = open_scene(tmp_path / "head.npz", HeadSource())
    monkeypatch.setattr(np, "save", full)
    with pytest.raises(OSError, match="No space left"):
        write_scene(scene, tmp_path / "scene")
    assert not list((tmp_path / "scene").iterdir())


def test_bytes_that_are_no_avatar_are_refused(tmp_path: Path) -> None:
    (tmp_path / "noise.sacha").write_bytes(b"noise" * 99)
    with pytest.raises(FormatError):
        open_scene(tmp_path / "noise.sacha", HeadSource())
