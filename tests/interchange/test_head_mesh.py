"""Meshes of a head: every vertex and triangle in the file's own order, and one clear line for whatever is no mesh."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.errors import FormatError
from sacha_core.interchange.head_mesh import read_head_mesh

SEAM = """# two triangles that share an edge, cut in texture space; vertex 5 is used by none
mtllib skin.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 9 9 9
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vt 0.5 0.5
f 1/1 2/2 3/3
f 1/5 3/3 4/4
"""


def write(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_texture_seams_split_no_vertex_and_unused_vertices_stay(tmp_path: Path) -> None:
    mesh = read_head_mesh(write(tmp_path, "seam.obj", SEAM))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [9, 9, 9]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float32, np.int32)


def test_polygons_are_cut_into_fans_and_negative_indices_count_backwards(tmp_path: Path) -> None:
    corners = "".join(f"v {i} {i * i} 0\n" for i in range(5))
    fan = read_head_mesh(write(tmp_path, "fan.obj", corners + "f 1//1 2//2 3//3 4//4 5//5\n"))
    assert fan.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    backwards = read_head_mesh(write(tmp_path, "back.obj", corners + "f -5 -4 -3 -2 -1\n"))
    assert np.array_equal(backwards.faces, fan.faces)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_of_a_foreign_writer_keeps_order(tmp_path: Path, encoding: str) -> None:
    rng = np.random.default_rng(3)
    vertices = rng.normal(size=(30, 3)).astype(np.float32)
    faces = rng.permuted(np.tile(np.arange(29), (12, 1)), axis=1)[:, :3]  # vertex 29 is used by none
    path = tmp_path / "head.ply"
    path.write_bytes(
        trimesh.exchange.ply.export_ply(trimesh.Trimesh(vertices, faces, process=False), encoding=encoding)
    )
    mesh = read_head_mesh(path)
    assert np.array_equal(mesh.faces, faces)
    assert np.allclose(
        mesh.vertices, vertices, rtol=0, atol=0 if encoding == "binary" else 1e-7
    )  # eight decimals as text


POINTS = (
    "ply\nformat ascii 1.0\nelement vertex 1\n"
    + "".join(f"property float {axis}\n" for axis in "xyz")
    + "end_header\n1 2 3\n"
)

BROKEN = {
    "no triangle.obj": ("v 1 2 3\n", "holds no triangles"),
    "empty.obj": ("", "holds no triangles"),
    "word.obj": ("v 1 two 3\n", "line 1 of word.obj"),
    "short.obj": ("v 1 2\n", "line 1 of short.obj"),
    "zero.obj": ("v 1 2 3\nf 0 1 1\n", "line 2 of zero.obj"),
    "huge.obj": ("v 1 2 3\nf 1 1 99999999999999999999\n", "line 2 of huge.obj"),
    "nan.obj": ("v 1 2 3\nv nan 0 0\nf 1 2 1\n", "vertex 1 of nan.obj is not finite"),
    "outside.obj": ("v 1 2 3\nf 1 1 2\n", "triangle 0 of outside.obj uses vertex 1; it has vertices 0 to 0"),
    "behind.obj": ("v 1 2 3\nf 1 1 -2\n", "triangle 0 of behind.obj uses vertex -1"),
    "bytes.obj": (b"\xff\xfe\x00f \xff\n", "holds no triangles"),
    "empty.ply": ("", "empty.ply is no PLY mesh"),
    "text.ply": ("hello", "text.ply is no PLY mesh"),
    "points.ply": (POINTS, "holds no triangles"),
    "head.stl": ("solid", "expected .obj or .ply"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_mesh_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    content, said = BROKEN[name]
    with pytest.raises(FormatError) as error:
        read_head_mesh(write(tmp_path, name, content))
    assert said in str(error.value)
    assert name in str(error.value)


def test_a_missing_file_stays_a_missing_file(tmp_path: Path) -> None:
    for name in ("none.obj", "none.ply"):
        with pytest.raises(FileNotFoundError):
            read_head_mesh(tmp_path / name)


def binary_ply() -> bytes:
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return header.encode() + struct.pack("<9f", *range(9)) + struct.pack("<B3i", 3, 0, 1, 2)


@given(cut=st.integers(0, len(binary_ply())), place=st.integers(0, len(binary_ply()) - 1), value=st.integers(0, 255))
def test_damaged_ply_either_reads_as_a_mesh_or_is_refused(
    tmp_path_factory: pytest.TempPathFactory, cut: int, place: int, value: int
) -> None:
    damaged = bytearray(binary_ply())
    damaged[place] = value
    path = write(tmp_path_factory.getbasetemp(), "damaged.ply", bytes(damaged[:cut]))
    try:
        mesh = read_head_mesh(path)
    except FormatError:
        return
    assert len(mesh.faces)
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    assert np.isfinite(mesh.vertices).all()
