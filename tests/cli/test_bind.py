"""Free splats become an avatar: oracle is the avatar whose frame they were."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.animation.splat_binding import subdivided
from sacha_core.animation.standing import Standing
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.codec import decode
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.splat_ply import read_bound_ply, write_world_ply

SH_0 = 0.28209479177387814
PLACE_ERROR_M = 1e-6  # float32 in the world, there and back
HEAD = ("--head", "synthetic:small")


@pytest.fixture(scope="module")
def frame_2(done, sacha_file: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Give a frame of the avatar as free splats, turned over and in centimetres, and the motion that it is of."""
    folder = tmp_path_factory.mktemp("free")
    done("export", sacha_file, "--frames", 2, "--y-down", "--enlarge", 100, "-o", folder / "a.ply")
    done("decode", sacha_file, "--motion", folder / "motion.npz")
    return folder / "a.ply", folder / "motion.npz"


def test_a_posed_scene_is_bound_and_moves_with_the_head(done, sacha_file: Path, frame_2, tmp_path: Path) -> None:
    scene, motion = frame_2
    right = ("--y-down", "--scale", 0.01, "--motion", motion, "--frame", 2)
    report = done("bind", scene, *HEAD, *right, "-o", tmp_path / "b.ply").report
    avatar, head = decode(sacha_file, head=synthetic_head("small")), synthetic_head("small")
    bound = read_bound_ply(tmp_path / "b.ply", head.n_faces)
    assert report["n_gaussians"] == len(bound) == len(avatar.gaussians)
    there, back = (Standing(one, head, avatar.motion)(2) for one in (avatar.gaussians, bound))
    np.testing.assert_allclose(back.position, there.position, atol=PLACE_ERROR_M)
    assert report["distance_m"]["1"] < 0.1
    video = done("render", tmp_path / "b.ply", *HEAD, "--motion", motion, "--frame", 0, "-o", tmp_path / "b.png")
    assert video.status == 0


def test_what_is_far_is_told_and_can_be_left_out(done, refused, frame_2, tmp_path: Path) -> None:
    scene, motion = frame_2
    right = (*HEAD, "--scale", 0.01, "--y-down", "--motion", motion, "--frame", 2, "-o", tmp_path / "b.ply")
    kept = done("bind", scene, *right, "--far", 0.001)
    assert kept.report["n_far"] == sum(kept.report["far_by_region"].values()) > 0
    assert f"{kept.report['n_far']:,} of {kept.report['n_gaussians']:,}, over 1 mm" in kept.out
    dropped = done("bind", scene, *right, "--far", 0.001, "--drop-far").report
    assert dropped["n_gaussians"] == kept.report["n_gaussians"] - kept.report["n_far"]
    assert dropped["n_dropped"] == kept.report["n_far"]
    wrong = done("bind", scene, *HEAD, "-o", tmp_path / "w.ply")
    assert "Most are: is the scene in metres" in wrong.out
    assert "all " in refused("bind", scene, *HEAD, "--drop-far", "-o", tmp_path / "n.ply")
    assert not (tmp_path / "n.ply").exists()


@pytest.mark.parametrize("kind", ["auto", "lam-offsets"])
def test_splats_on_the_subdivided_head(done, tmp_path: Path, kind: str) -> None:
    """As LAM writes them: in the order of the subdivided mesh, its offset.ply with plain colours."""
    head, rng = synthetic_head("small"), np.random.default_rng(0)
    mesh = subdivided(head)
    n = len(mesh.binding)
    offset = rng.normal(size=(n, 3), scale=0.05).astype(np.float32)  # so far that the nearest triangle is another
    colour = rng.random((n, 3)).astype(np.float32)
    points = mesh.points(head.v_template) + offset
    lam = kind == "lam-offsets"
    splats = replace(initial_gaussians(n, rng, 0), position=offset if lam else points.astype(np.float32), sh_dc=colour)
    write_world_ply(tmp_path / "offset.ply", splats, 0)
    report = done("bind", tmp_path / "offset.ply", "--to", kind, *HEAD, "-o", tmp_path / "b.ply").report
    assert report["bound_to"] == "subdivided"
    bound = read_bound_ply(tmp_path / "b.ply", head.n_faces)
    np.testing.assert_array_equal(bound.binding, mesh.binding)
    np.testing.assert_allclose(Standing(bound, head, None)(0).position, points, atol=PLACE_ERROR_M)
    shown = bound.sh_dc * SH_0 + 0.5 if lam else bound.sh_dc
    np.testing.assert_allclose(shown, colour, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "expected --head HEAD"),
        ((*HEAD, "--to", "subdivided"), "once subdivided, has"),
        ((*HEAD, "--frame", 3), "expected --motion FILE beside it"),
        ((*HEAD, "--far", "nan"), "--far is nan"),
        ((*HEAD, "--scale", 0), "--scale is 0"),
    ],
)
def test_what_makes_no_sense_is_refused(refused, frame_2, tmp_path: Path, arguments, said: str) -> None:
    assert said in refused("bind", frame_2[0], *arguments, "-o", tmp_path / "b.ply")
    assert not list(tmp_path.iterdir())


def test_what_is_bound_already_is_no_scene(done, refused, frame_2, tmp_path: Path) -> None:
    """Its places are in units of triangles: read as metres they would lie all about the head."""
    bound = tmp_path / "bound.ply"
    done("bind", frame_2[0], *HEAD, "-o", bound)
    assert "bound to the triangles of a head already" in refused("bind", bound, *HEAD, "-o", tmp_path / "b.ply")
    assert not (tmp_path / "b.ply").exists()


def test_wrong_scenes_are_refused_in_one_line(refused, frame_2, tmp_path: Path) -> None:
    data, wrong = frame_2[0].read_bytes(), tmp_path / "wrong.ply"
    empty = (
        data.partition(b"end_header\n")[0].replace(b"element vertex ", b"element vertex 0\ncomment ") + b"end_header\n"
    )
    for content, said in (
        (data[:-7], "but the file has"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n",
            "PLY format 'ascii' is not read",
        ),
        (data.replace(b"element vertex ", b"element vertex 99999999"), "but the file has"),
        (
            b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\nend_header\n",
            "a compressed PLY",
        ),
        (b"PK\3\4 no ply", "wrong.ply"),
        (b"", "wrong.ply"),
        (empty, "holds no Gaussians"),
    ):
        wrong.write_bytes(content)
        assert said in refused("bind", wrong, *HEAD, "-o", tmp_path / "b.ply"), content[:20]
    assert [path.name for path in tmp_path.iterdir()] == ["wrong.ply"]
