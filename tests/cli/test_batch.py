"""`sacha batch`: each file is the one that `sacha encode` or `sacha decode` writes by itself; what fails stops nothing else."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def folder(model: Path, sacha_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a model, a .sacha file, a broken one, and things that are no avatars."""
    place = tmp_path_factory.mktemp("avatars")
    shutil.copytree(model, place / "anna")
    shutil.copyfile(sacha_file, place / "ben.sacha")
    (place / "carl.sacha").write_bytes(os.urandom(200))
    (place / "notes.txt").write_text("not an avatar")
    (place / "empty").mkdir()
    return place


def test_every_avatar_is_encoded_as_by_itself_and_the_broken_one_is_named(call, done, folder: Path, tmp_path) -> None:
    found = call(
        "batch", "encode", folder, "-o", tmp_path / "out", "--level", 3, "--no-rendering", "--progress", "none"
    )
    assert found.status == 1  # done, but not all of it
    assert found.report["broken"] == ["carl.sacha"]
    assert [Path(file["file"]).name for file in found.report["files"]] == ["anna.sacha", "ben.sacha", "carl.sacha"]
    for source, name in (("anna", "anna"), ("ben.sacha", "ben")):
        done("encode", folder / source, "-o", tmp_path / "alone.sacha", "--level", 3, "--no-rendering")
        assert (tmp_path / "out" / f"{name}.sacha").read_bytes() == (tmp_path / "alone.sacha").read_bytes()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["anna.sacha", "ben.sacha"]
    assert "carl.sacha" in found.out


def test_every_file_is_decoded_as_by_itself_with_its_motion(call, done, folder: Path, tmp_path: Path) -> None:
    found = call("batch", "decode", folder, "-o", tmp_path / "out", "--progress", "none")
    assert found.report["broken"] == ["carl.sacha"]
    done("decode", folder / "ben.sacha", "--ply", tmp_path / "a.ply", "--motion", tmp_path / "a.npz")
    for suffix in ("ply", "npz"):
        assert (tmp_path / "out" / f"ben.{suffix}").read_bytes() == (tmp_path / f"a.{suffix}").read_bytes()


def test_what_is_done_already_can_be_kept(done, model: Path, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    shutil.copytree(model, tmp_path / "in" / "anna")
    given = ("batch", "encode", tmp_path / "in", "-o", tmp_path / "out", "--no-rendering", "--progress", "none")
    done(*given)
    target = tmp_path / "out" / "anna.sacha"
    target.write_bytes(b"marked")
    later = target.stat().st_mtime + 10
    os.utime(target, (later, later))
    assert done(*given, "--keep").report["files"][0]["note"] == "done already"
    assert target.read_bytes() == b"marked"
    for path in (tmp_path / "in" / "anna").rglob("*.ply"):
        os.utime(path, (later + 10, later + 10))  # the avatar is newer than its file
    done(*given, "--keep")
    assert target.read_bytes() != b"marked"


def test_two_that_would_be_one_file_and_one_that_would_be_its_own_are_refused(
    refused, sacha_file: Path, tmp_path
) -> None:
    shutil.copyfile(sacha_file, tmp_path / "anna.sacha")
    assert "written over itself" in refused("batch", "encode", tmp_path, "-o", tmp_path)
    (tmp_path / "anna.ply").write_text("ply")
    line = refused("batch", "encode", tmp_path, "-o", tmp_path / "out")
    assert "anna.ply and anna.sacha would both be written to" in line


def test_an_empty_folder_says_what_was_expected(refused, tmp_path: Path) -> None:
    assert "holds nothing to decode; expected .sacha files" in refused("batch", "decode", tmp_path, "-o", tmp_path)
    assert "expected model folders, .ply or .sacha files" in refused("batch", "encode", tmp_path, "-o", tmp_path)
