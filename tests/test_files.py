"""Writing aside. Oracle: the file system."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from sacha_core.files import write_aside


def write(path: Path, text: str = "new") -> None:
    with write_aside(path) as aside:
        aside.write_text(text)


def test_a_file_appears_whole_and_alone_in_a_folder_that_is_made(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "c.txt"
    with write_aside(path) as aside:
        assert (aside.parent, aside.suffix) == (path.parent, ".txt")
        aside.write_text("new")
        assert not path.exists()
    assert [child.name for child in path.parent.iterdir()] == ["c.txt"]
    assert path.read_text() == "new"


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail() -> None:
        with write_aside(path) as aside:
            aside.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [child.name for child in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_text() == "old"


def test_a_folder_in_the_way_is_named_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError) as caught, write_aside(tmp_path):
        pytest.fail("the work began")
    assert caught.value.filename == str(tmp_path)


def test_a_file_where_a_folder_should_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    with pytest.raises(NotADirectoryError) as caught:
        write(tmp_path / "a" / "b.txt")
    assert caught.value.filename == str(tmp_path / "a")


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    link = tmp_path / "link.txt"
    link.symlink_to(tmp_path / "there" / "a.txt")
    for text in ("first", "second"):  # leading nowhere yet, then to a file
        write(link, text)
        assert link.is_symlink()
        assert (tmp_path / "there" / "a.txt").read_text() == text


@pytest.mark.skipif(os.name != "posix", reason="permissions are otherwise here")
@pytest.mark.parametrize("umask", [0o000, 0o022, 0o027, 0o077])
def test_a_new_file_has_the_permissions_of_any_other_that_is_made(tmp_path: Path, umask: int) -> None:
    """Oracle: a file that Python itself makes."""
    before = os.umask(umask)
    try:
        (tmp_path / "other.txt").write_text("new")
        write(tmp_path / "a.txt")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "other.txt").stat().st_mode


@pytest.mark.skipif(os.name != "posix", reason="permissions are otherwise here")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664, 0o444, 0o755])
def test_a_file_that_replaces_another_keeps_its_permissions(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(mode)
    with write_aside(path) as aside:
        assert aside.stat().st_mode & 0o777 == 0o600
        aside.write_text("new")
    assert path.stat().st_mode & 0o777 == mode
    assert path.read_text() == "new"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_a_pipe_is_sent_the_bytes_and_stays_one(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    heard: list[str] = []
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text()))
    reader.start()
    write(pipe)
    reader.join(timeout=10)
    assert heard == ["new"]
    assert pipe.is_fifo()
    assert [child.name for child in tmp_path.iterdir()] == ["pipe"]
