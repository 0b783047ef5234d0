"""What programs call that show splats and textures. Oracles: the engine's own functions, and the colours that were given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

import sacha_core
from sacha_core.flame.open import open_head
from sacha_core.flame.posing import pose_vertices
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.texture import triangle_map
from sacha_core.scene.colours import linear_colours
from sacha_core.scene.splats import splats_of


def test_splats_stand_in_the_frame_or_on_the_vertices(sacha_file: Path, done, tmp_path: Path) -> None:
    avatar, head = sacha_core.decode(sacha_file), open_head("synthetic:small")
    vertices = pose_vertices(head, avatar.motion, 2)
    expected = splats_of(avatar.gaussians, triangle_frames(vertices, head.faces))
    np.save(tmp_path / "v.npy", vertices)
    for name, pose in {"frame": ("--frame", 2), "mesh": ("--vertices", tmp_path / "v.npy")}.items():
        report = done("splats", sacha_file, "--out", tmp_path / name, *pose).report
        assert report["n_gaussians"] == len(avatar.gaussians)
        assert np.array_equal(np.load(tmp_path / name / "position.npy"), expected.position)


def painted(folder: Path, done, *options: object) -> np.ndarray:
    done("bake", folder, "-o", folder / "map.png", "--size", 256, "--margin", 1, *options)
    return np.asarray(Image.open(folder / "map.png"))


def test_a_texture_has_the_bytes_of_the_colours(done, tmp_path: Path) -> None:
    head = open_head("synthetic:small")
    srgb = np.random.default_rng(4).integers(0, 256, (head.n_faces, 3)).astype(np.uint8)
    np.save(tmp_path / "colours.npy", linear_colours(srgb))
    np.save(tmp_path / "uv.npy", head.uv[head.uv_faces])
    labels = triangle_map(head.uv[head.uv_faces], 256, 1)
    image = painted(tmp_path, done)
    assert np.array_equal(image[labels >= 0, :3], srgb[labels[labels >= 0]])
    assert (image[..., 3] == np.where(labels >= 0, 255, 0)).all()


def test_a_mesh_without_coordinates_gets_some(done, tmp_path: Path) -> None:
    head = open_head("synthetic:small")
    np.save(tmp_path / "colours.npy", np.ones((head.n_faces, 4), np.float32))
    np.save(tmp_path / "vertices.npy", head.v_template)
    np.save(tmp_path / "faces.npy", head.faces)
    image = painted(tmp_path, done)
    uv = np.load(tmp_path / "uv.npy")
    assert uv.shape == (head.n_faces, 3, 2)
    assert (uv.min(), uv.max()) >= (0, 0.5)
    assert np.array_equal(image[..., 3] > 0, triangle_map(uv, 256, 1) >= 0)


def test_arrays_that_do_not_fit_are_one_line(refused, tmp_path: Path) -> None:
    np.save(tmp_path / "colours.npy", np.ones((3, 4), np.float32))
    np.save(tmp_path / "uv.npy", np.zeros((2, 3, 2), np.float32))
    assert "3 colours for 2 triangles" in refused("bake", tmp_path, "-o", tmp_path / "a.png")
    np.save(tmp_path / "uv.npy", np.zeros((3, 2), np.float32))
    assert "uv.npy holds" in refused("bake", tmp_path, "-o", tmp_path / "a.png")
    (tmp_path / "colours.npy").write_bytes(b"nothing")
    assert "is no .npy file" in refused("bake", tmp_path, "-o", tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_splats_leave_as_a_mesh_is_posed(sacha_file: Path, done, refused, tmp_path: Path) -> None:
    avatar, head = sacha_core.decode(sacha_file), open_head("synthetic:small")
    np.save(tmp_path / "v.npy", pose_vertices(head, avatar.motion, 2))
    done("export", sacha_file, "--vertices", tmp_path / "v.npy", "-o", tmp_path / "mesh.ply")
    done("export", sacha_file, "--frames", "2", "-o", tmp_path / "frame.ply")
    assert (tmp_path / "mesh.ply").read_bytes() == (tmp_path / "frame.ply").read_bytes()
    both = ("--vertices", tmp_path / "v.npy", "--frames", "1", "-o", tmp_path / "no.ply")
    assert "both say how the head is posed" in refused("export", sacha_file, *both)
    given = ("--format", "gltf-head", "--vertices", tmp_path / "v.npy", "-o", tmp_path / "no.glb")
    assert "has no use for it" in refused("export", sacha_file, *given)
