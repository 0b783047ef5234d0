"""Bad input to every command: one clear line that names the culprit, exit 2, nothing half-written, nothing lost."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.gaussian_avatars import write_flame_param
from sacha_core.interchange.splat_ply import write_bound_ply
from sacha_core.npz import read_npz, write_npz

resource = pytest.importorskip("resource", reason="limits on file size need POSIX")


@contextlib.contextmanager
def full_disk(n_bytes: int) -> Iterator[None]:
    """Let no file grow beyond `n_bytes`: the kernel refuses the write as it does on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def ply(tmp_path: Path) -> Path:
    path = tmp_path / "a.ply"
    write_bound_ply(path, initial_gaussians(synthetic_head("small").n_faces, np.random.default_rng(0)))
    return path


def changed_ply(path: Path, property_name: str, row: int, value: float) -> None:
    """Overwrite one number of a float32 PLY."""
    data = bytearray(path.read_bytes())
    start = data.index(b"end_header\n") + len(b"end_header\n")
    names = [line.split()[-1] for line in data[:start].decode().splitlines() if line.startswith("property")]
    at = start + 4 * (row * len(names) + names.index(property_name))
    data[at : at + 4] = np.float32(value).tobytes()
    path.write_bytes(data)


def write_rig(path: Path, vertices: np.ndarray, head: HeadModel) -> Path:
    """Write a rig with three blend shapes."""
    names = np.array(["jawOpen", "mouthSmile", "browUp"])
    deltas = np.moveaxis(head.exprdirs[:, :, :3], 2, 0)
    write_npz(path, {"verts": vertices, "faces": head.faces, "arkit_names": names, "arkit_deltas": deltas})
    return path


@pytest.mark.parametrize(
    "arguments",
    [
        ("inspect", "nowhere.sacha"),
        ("decode", "nowhere.sacha", "--ply", "out.ply"),
        ("render", "nowhere.sacha", "-o", "out.png"),
        ("encode", "nowhere", "-o", "out.sacha"),
        ("encode", "--ply", "nowhere.ply", "--head", "synthetic:small", "-o", "out.sacha"),
        ("convert-head", "nowhere.npz", "-o", "out.npz"),
        ("train", "nowhere", "-o", "out"),
        ("evaluate", "nowhere.sacha", "nowhere"),
        ("doctor", "nowhere"),
    ],
)
def test_a_missing_file_is_named(
    refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "nowhere" in refused(*arguments)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("keep", [0.0, 0.001, 0.3, 0.9, 0.9999])
def test_a_truncated_file_is_refused(refused, sacha_file: Path, tmp_path: Path, keep: float) -> None:
    data = sacha_file.read_bytes()
    cut = tmp_path / "cut.sacha"
    cut.write_bytes(data[: int(keep * len(data))])
    for arguments in (
        ("inspect", cut),
        ("decode", cut, "--ply", tmp_path / "b.ply"),
        ("render", cut, "-o", tmp_path / "b.png"),
    ):
        assert "cut.sacha" in refused(*arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["cut.sacha"]


def test_every_flipped_bit_is_noticed(call, sacha_file: Path, tmp_path: Path) -> None:
    data = sacha_file.read_bytes()
    flipped = tmp_path / "flipped.sacha"
    rng = np.random.default_rng(1)
    for at in {0, 8, len(data) - 1, *rng.integers(0, len(data), 40).tolist()}:
        wrong = bytearray(data)
        wrong[at] ^= 1 << int(rng.integers(8))
        flipped.write_bytes(wrong)
        outcome = call("decode", flipped, "--ply", tmp_path / "b.ply")
        assert outcome.status == 2, at
        assert outcome.err.startswith(f"sacha decode: {flipped}: ")
        assert outcome.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["flipped.sacha"]


def test_a_capture_with_a_missing_image(refused, capture: Path, tmp_path: Path) -> None:
    root = tmp_path / "capture"
    shutil.copytree(capture, root)
    image = sorted(root.glob("*EMO-1*/images/*.png"))[3]
    image.unlink()
    (tmp_path / "a.sacha").touch()
    for arguments in (
        ("doctor", root),
        ("train", root, "-o", tmp_path / "m"),
        ("evaluate", tmp_path / "a.sacha", root),
    ):
        assert image.name in refused(*arguments)
    assert not (tmp_path / "m").exists()


def test_a_capture_with_a_broken_image(refused, capture: Path, tmp_path: Path) -> None:
    """The header is sound, so only decoding finds it."""
    root = tmp_path / "capture"
    shutil.copytree(capture, root)
    image = min(root.glob("*EMO-1*/images/*.png"))
    image.write_bytes(image.read_bytes()[:300])
    assert image.name in refused("doctor", root)


@pytest.mark.parametrize("name", ["expr", "jaw_pose", "translation", "shape"])
def test_a_capture_with_parameters_that_are_not_finite(refused, capture: Path, tmp_path: Path, name: str) -> None:
    root = tmp_path / "capture"
    shutil.copytree(capture, root)
    path = sorted(root.glob("*FREE*/flame_param/*.npz"))[1]
    arrays = read_npz(path)
    arrays[name] = np.full_like(arrays[name], np.nan)
    write_npz(path, arrays)
    line = refused("train", root, "-o", tmp_path / "m")
    assert str(path.name) in line
    assert "finite" in line
    assert not (tmp_path / "m").exists()


def test_a_ply_of_another_kind(refused, ply: Path, tmp_path: Path) -> None:
    ply.write_bytes(ply.read_bytes().replace(b"property float binding_0\n", b"property float binding_X\n"))
    line = refused("encode", "--ply", ply, "--head", "synthetic:small", "-o", tmp_path / "a.sacha")
    assert "a.ply" in line
    assert "binding_0" in line
    assert not (tmp_path / "a.sacha").exists()


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("binding_0", 100_000, "triangle 100000"),
        ("binding_0", -1, "-1"),
        ("binding_0", 1.5, "1.5"),
        ("x", np.nan, "finite"),
        ("scale_1", np.inf, "finite"),
    ],
)
def test_a_ply_with_an_impossible_number(
    refused, ply: Path, tmp_path: Path, name: str, value: float, said: str
) -> None:
    changed_ply(ply, name, 7, value)
    line = refused("encode", "--ply", ply, "--head", "synthetic:small", "-o", tmp_path / "a.sacha")
    for part in ("a.ply", "7", said):
        assert part in line
    assert not (tmp_path / "a.sacha").exists()


def test_a_ply_without_its_head(refused, ply: Path, tmp_path: Path) -> None:
    assert "--head" in refused("encode", "--ply", ply, "-o", tmp_path / "a.sacha")
    assert "--head" in refused("render", ply, "-o", tmp_path / "a.png")


def test_a_head_named_to_a_check_of_the_installation(refused) -> None:
    assert "DATASET" in refused("doctor", "--head", "synthetic")


def test_a_motion_of_no_frames(refused, ply: Path, tmp_path: Path) -> None:
    head = synthetic_head("small")
    motion = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], 2).frames(slice(0, 0))
    write_flame_param(tmp_path / "m.npz", motion)
    line = refused("encode", "--ply", ply, "--head", "synthetic:small", "--motion", tmp_path / "m.npz", "-o", "a.sacha")
    assert "m.npz holds a motion of no frames" in line


def test_a_motion_that_the_head_cannot_make(refused, ply: Path, tmp_path: Path) -> None:
    head = synthetic_head("small")
    motion = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2] + 3, 2)
    motion.expression[1, -1] = 0.5
    write_flame_param(tmp_path / "m.npz", motion)
    for arguments in (("encode", "--ply", ply, "-o", tmp_path / "a.sacha"), ("render", ply, "-o", tmp_path / "a.png")):
        line = refused(*arguments, "--head", "synthetic:small", "--motion", tmp_path / "m.npz")
        assert "m.npz" in line
        assert "expression" in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.ply", "m.npz"]


def test_a_rig_with_a_degenerate_triangle(refused, ply: Path, tmp_path: Path) -> None:
    head = synthetic_head("small")
    vertices = head.v_template.copy()
    first, second, _ = head.faces[5]
    vertices[first] = vertices[second]
    rig = write_rig(tmp_path / "rig.npz", vertices, head)
    for arguments in (
        ("encode", "--ply", ply, "--head", rig, "-o", tmp_path / "a.sacha"),
        ("render", ply, "--head", rig, "-o", tmp_path / "a.png"),
        ("convert-head", rig, "-o", tmp_path / "head.npz"),
    ):
        line = refused(*arguments)
        assert "area" in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.ply", "rig.npz"]


def test_an_avatar_whose_head_nobody_has(
    done, refused, ply: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A head that was used is remembered; where it is forgotten, the line says which one is needed."""
    head = synthetic_head("small")
    rig = write_rig(tmp_path / "rig.npz", head.v_template * np.float32(1.01), head)
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "heads"))
    alone, whole = tmp_path / "a.sacha", tmp_path / "whole.sacha"
    assert done("encode", "--ply", ply, "--head", rig, "-o", alone).report["bytes"]["head"] == 0
    assert done("encode", "--ply", ply, "--head", rig, "-o", whole, "--embed-head").report["bytes"]["head"] > 0
    size = ("--width", 32, "--height", 48)
    done("render", alone, "-o", tmp_path / "known.png", *size)
    shutil.rmtree(tmp_path / "heads")
    line = refused("render", alone, "-o", tmp_path / "unknown.png")
    assert "--head" in line
    assert "'rig'" in line
    assert "'rig'" in refused("decode", alone, "--ply", tmp_path / "b.ply")
    done("decode", alone, "--ply", tmp_path / "b.ply", "--head", rig)
    shutil.rmtree(tmp_path / "heads")
    done("render", whole, "-o", tmp_path / "embedded.png", *size)
    assert (tmp_path / "embedded.png").read_bytes() == (tmp_path / "known.png").read_bytes()
    done("render", alone, "-o", tmp_path / "again.png", *size)  # that was remembered, too


def test_a_head_folder_that_cannot_be_written_stops_nothing(
    call, ply: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = synthetic_head("small")
    rig = write_rig(tmp_path / "rig.npz", head.v_template * np.float32(1.01), head)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "file" / "heads"))
    for arguments, written in (
        (("encode", "--ply", ply), "a.sacha"),
        (("render", ply, "--width", 32, "--height", 48), "a.png"),
    ):
        outcome = call(*arguments, "--head", rig, "-o", tmp_path / written)
        assert outcome.status == 0
        assert outcome.err.startswith("warning: head 'rig' is not kept for later: ")
        assert str(tmp_path / "file") in outcome.err
        assert outcome.err.count("\n") == 1
        assert (tmp_path / written).stat().st_size > 0


def test_an_avatar_judged_on_a_capture_of_another_length(refused, done, model: Path, tmp_path: Path) -> None:
    done(
        *("synth", tmp_path / "other", "--head", "synthetic:small", "--width", 32, "--height", 47, "--cameras", 5, 8),
        *("--timesteps", 8, "--test-timesteps", 1, "--sequences", "EXP-2", "--supersample", 1),
    )
    assert "5 frames" in refused("evaluate", model, tmp_path / "other")


FULL = 400  # bytes: less than anything that these commands write


def test_a_full_disk_leaves_nothing_and_loses_nothing(call, sacha_file: Path, model: Path, tmp_path: Path) -> None:
    precious = {}
    for name in ("a.sacha", "a.ply", "a.png", "a.mp4", "head.npz", "m.npz"):
        precious[tmp_path / name] = f"what {name} held".encode()
        (tmp_path / name).write_bytes(precious[tmp_path / name])
    for arguments in (
        ("encode", model, "-o", tmp_path / "a.sacha"),
        ("decode", sacha_file, "--ply", tmp_path / "a.ply"),
        ("decode", sacha_file, "--motion", tmp_path / "m.npz"),
        ("render", sacha_file, "-o", tmp_path / "a.png"),
        ("render", sacha_file, "--video", tmp_path / "a.mp4"),
        ("convert-head", "synthetic:small", "-o", tmp_path / "head.npz"),
    ):
        with full_disk(FULL):
            outcome = call(*arguments)
        assert outcome.status == 2, arguments
        assert outcome.err.count("\n") == 1, outcome.err
        assert "large" in outcome.err, outcome.err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == precious


def test_synth_and_train_on_a_full_disk(call, done, capture: Path, tmp_path: Path) -> None:
    """What was made before the disk was full stays, and counts when there is room again."""
    options = ("--head", "synthetic:small", "--width", 32, "--height", 47, "--cameras", 5, 8, "--timesteps", 2)
    options += ("--test-timesteps", 1, "--sequences", "EXP-2", "--supersample", 1)
    with full_disk(FULL):
        outcome = call("synth", tmp_path / "new", *options)
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert not list(tmp_path.rglob(".*"))
    done("synth", tmp_path / "new", *options)
    with full_disk(3000):
        outcome = call("train", capture, "-o", tmp_path / "m", "--iterations", 5)
    assert (outcome.status, outcome.err.count("\n")) == (2, 1), outcome.err
    assert not list((tmp_path / "m").rglob(".*"))
    done("train", capture, "-o", tmp_path / "m", "--iterations", 5)


def test_a_place_where_nothing_can_be_written(
    refused, sacha_file: Path, model: Path, capture: Path, tmp_path: Path
) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("no folder")
    for arguments in (
        ("encode", model, "-o", blocker / "a.sacha"),
        ("decode", sacha_file, "--ply", blocker / "a.ply"),
        ("render", sacha_file, "-o", blocker / "a.png"),
        ("train", capture, "-o", blocker / "m"),
    ):
        refused(*arguments)
    assert blocker.read_text() == "no folder"
