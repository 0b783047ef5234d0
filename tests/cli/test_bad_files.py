"""Bad files of every format that people bring: one clear line that names the file, exit 2, no side effect, no memory taken for a claim."""

from __future__ import annotations

import io
import os
import pickle
import struct
import subprocess
import sys
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.head_file import save_head
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.gaussian_avatars import write_flame_param
from sacha_core.interchange.splat_ply import read_bound_ply, write_bound_ply, write_world_ply

MOST_MEMORY = 64 << 20  # bytes; the files have a few kilobytes and claim terabytes
SMALL_HEAD = ("--head", "synthetic:small")


class RunsACommand:
    """What an attacker pickles: a call of the system's shell."""

    def __init__(self, victim: Path) -> None:
        self.victim = victim

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, (f"touch {self.victim}",)


def bomb(member: str) -> bytes:
    """Give a zip archive of a few kilobytes whose member unpacks to sixteen megabytes, and claims as an array to have petabytes."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": (1 << 48, 3)})
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{member}.npy", header.getvalue() + bytes(16 << 20))
    return stream.getvalue()


def object_array(victim: Path) -> bytes:
    """Give an .npz whose array is a pickle that runs a command."""
    held = np.empty((), object)
    held[()] = RunsACommand(victim)
    stream = io.BytesIO()
    np.savez(stream, weights=held, v_template=held, expr=held, lips=held, verts=held)
    return stream.getvalue()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Give a sound file of each format."""
    folder, head, rng = tmp_path_factory.mktemp("good"), synthetic_head("small"), np.random.default_rng(0)
    gaussians, motion = initial_gaussians(head.n_faces, rng, 0), Motion.rest(0, head.exprdirs.shape[2], 2)
    write_bound_ply(folder / "bound.ply", gaussians)
    write_world_ply(folder / "scene.ply", gaussians)
    save_head(head, folder / "head.npz")
    write_flame_param(folder / "motion.npz", motion)
    np.savez(folder / "masks.npz", **head.masks)
    content = {"v_template": head.v_template, "f": head.faces, "shapedirs": np.zeros((head.n_vertices, 3, 301))}
    content |= {"J_regressor": head.J_regressor, "kintree_table": np.zeros((2, 5), int), "weights": head.weights}
    (folder / "flame.pkl").write_bytes(pickle.dumps(content, 2))
    rows = [f"v {x} {y} {z}" for x, y, z in head.v_template] + ["f {} {} {}".format(*face + 1) for face in head.faces]
    (folder / "mesh.obj").write_text("\n".join(rows))
    return {path.name: path for path in folder.iterdir()}


DOORS: dict[str, Callable[[Path, Path], tuple[object, ...]]] = {
    "bound.ply": lambda file, out: ("encode", "--ply", file, *SMALL_HEAD, "-o", out / "a.sacha"),
    "scene.ply": lambda file, out: ("bind", file, *SMALL_HEAD, "-o", out / "b.ply"),
    "head.npz": lambda file, out: ("convert-head", file, "-o", out / "h.npz"),
    "flame.pkl": lambda file, out: ("convert-head", file, "-o", out / "h.npz"),
    "masks.npz": lambda file, out: ("convert-head", "synthetic", "--masks", file, "-o", out / "h.npz"),
    "motion.npz": lambda file, out: ("bind", out.parent / "scene.ply", *SMALL_HEAD, "--motion", file, "-o", out / "b.ply"),
    "mesh.obj": lambda file, out: ("scene", file, *SMALL_HEAD, "--out", out / "scene"),
}  # fmt: skip


def spoilt(data: bytes, kind: str, victim: Path) -> bytes:
    """Give a file of a format spoilt in one way."""
    if kind.startswith("cut"):
        return data[: int(len(data) * float(kind.split()[1]))]
    if kind == "text":
        return b"Dear reader,\nthis is no avatar.\n" * 40
    if kind == "zeros":
        return bytes(4000)
    if kind == "a pickle that runs a command":
        return pickle.dumps({"v_template": RunsACommand(victim), "lips": RunsACommand(victim)}, 2)
    if kind == "an npz that runs a command":
        return object_array(victim)
    if kind == "a zip bomb":
        return bomb("v_template")
    assert kind == "noise"
    return np.random.default_rng(0).bytes(5000)


KINDS = (
    "cut 0", "cut 0.001", "cut 0.5", "cut 0.999", "text", "zeros", "noise", "a zip bomb", "a pickle that runs a command",
    "an npz that runs a command",
)  # fmt: skip


@pytest.fixture
def measured() -> Iterator[None]:
    """Hold what happens in a test to a limit of memory."""
    tracemalloc.start()
    yield
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MOST_MEMORY


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("door", DOORS)
@pytest.mark.usefixtures("measured")
def test_every_door_refuses_in_one_line(refused, good: dict[str, Path], tmp_path: Path, door: str, kind: str) -> None:
    victim, out = tmp_path / "victim", tmp_path / "out"
    out.mkdir()
    (tmp_path / "scene.ply").write_bytes(good["scene.ply"].read_bytes())
    file = tmp_path / f"bad{Path(door).suffix}"
    file.write_bytes(spoilt(good[door].read_bytes(), kind, victim))
    line = refused(*DOORS[door](file, out))
    assert (file.name if kind != "cut 0.999" else file.stem) in line
    assert len(line) < 600
    assert not victim.exists()
    assert not list(out.iterdir())
    assert {path.name for path in tmp_path.iterdir()} == {"out", "scene.ply", file.name}


def header_of(data: bytes) -> tuple[bytes, bytes]:
    start, _, body = data.partition(b"end_header\n")
    return start + b"end_header\n", body


@pytest.mark.parametrize("door", ["bound.ply", "scene.ply"])
@pytest.mark.parametrize("count", [b"0x10", b"-1", b"999999999999", b"1000", b"1e3"])
@pytest.mark.usefixtures("measured")
def test_ply_counts_that_are_lies(refused, good, tmp_path: Path, door: str, count: bytes) -> None:
    head, body = header_of(good[door].read_bytes())
    line = next(line for line in head.split(b"\n") if line.startswith(b"element"))
    file, out = tmp_path / "bad.ply", tmp_path / "out"
    out.mkdir()
    file.write_bytes(head.replace(line, b"element vertex " + count) + body)
    assert "bad.ply" in refused(*DOORS[door](file, out))
    assert not list(out.iterdir())


def test_big_endian_ply_is_read_as_it_is(done, good, tmp_path: Path) -> None:
    """Not a bad file: PLY knows both orders. Oracle: the little-endian one."""
    head, body = header_of(good["bound.ply"].read_bytes())
    swapped = np.frombuffer(body, "<f4").astype(">f4").tobytes()
    (tmp_path / "big.ply").write_bytes(head.replace(b"binary_little_endian", b"binary_big_endian") + swapped)
    one, other = read_bound_ply(good["bound.ply"]), read_bound_ply(tmp_path / "big.ply")
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.binding, other.binding)
    (tmp_path / "lie.ply").write_bytes(head.replace(b"binary_little_endian", b"binary_big_endian") + body)
    outcome = done("encode", "--ply", tmp_path / "big.ply", *SMALL_HEAD, "--no-rendering", "-o", tmp_path / "a.sacha")
    assert outcome.report["n_gaussians"] + outcome.report["n_gaussians_left_out"] == len(one)


def test_an_order_of_bytes_that_is_a_lie(refused, good, tmp_path: Path) -> None:
    head, body = header_of(good["bound.ply"].read_bytes())
    (tmp_path / "lie.ply").write_bytes(head.replace(b"binary_little_endian", b"binary_big_endian") + body)
    line = refused("encode", "--ply", tmp_path / "lie.ply", *SMALL_HEAD, "-o", tmp_path / "a.sacha")
    assert "lie.ply" in line
    assert not (tmp_path / "a.sacha").exists()


def test_a_glb_is_no_avatar(refused, done, sacha_file: Path, tmp_path: Path) -> None:
    done("export", sacha_file, "--format", "gltf-splats", "-o", tmp_path / "a.glb")
    assert "a.glb" in refused("inspect", tmp_path / "a.glb")
    assert "a.glb" in refused("convert-head", tmp_path / "a.glb", "-o", tmp_path / "h.npz")


def test_a_refused_pickle_names_the_class_and_loads_nothing(tmp_path: Path) -> None:
    """In a process of its own, whose shell would leave a trace: what is refused is not even imported."""
    victim, file = tmp_path / "victim", tmp_path / "flame.pkl"
    file.write_bytes(pickle.dumps({"v_template": RunsACommand(victim)}, 2))
    program = (sys.executable, "-m", "sacha_core", "convert-head", str(file), "-o", str(tmp_path / "h.npz"))
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "asks for posix.system" in done.stderr.replace("nt.system", "posix.system")
    assert "nothing was run" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not victim.exists()


def test_a_model_folder_that_lies_about_its_arrays(refused, good, tmp_path: Path) -> None:
    place = tmp_path / "model" / "point_cloud" / "iteration_7"
    place.mkdir(parents=True)
    (place / "point_cloud.ply").write_bytes(good["bound.ply"].read_bytes())
    for content in (bomb("expr"), object_array(tmp_path / "victim"), b"PK\3\4", struct.pack("<I", 0)):
        (place / "flame_param.npz").write_bytes(content)
        line = refused("encode", tmp_path / "model", *SMALL_HEAD, "-o", tmp_path / "a.sacha")
        assert "flame_param.npz" in line
    assert not (tmp_path / "victim").exists()
    assert not (tmp_path / "a.sacha").exists()
