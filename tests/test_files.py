"""Writing aside. Oracle: the file system."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from sacha_core.files import require_writable, require_writable_folder, write_aside

NOBODY = 65534


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


def test_bytes_go_down_a_pipe_that_has_no_name() -> None:
    """What `--json /dev/stdout | jq` needs. Oracle: the pipe's other end."""
    code = "from sacha_core.files import write_aside\nwith write_aside('/dev/stdout') as aside: aside.write_text('new')"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "new"


def told(work: Callable[[], object]) -> tuple[type[OSError], int | None, str]:
    """Give what a system error says."""
    with pytest.raises(OSError) as caught:  # noqa: PT011  (which one it is, is what is compared)
        work()
    return caught.type, caught.value.errno, str(caught.value.filename)


@pytest.fixture
def sealed() -> Iterator[Path]:
    """Give a folder that may only be read, and as root become nobody, for whom permissions hold."""
    folder = Path(tempfile.mkdtemp())
    (folder / "inside").mkdir()
    root = os.geteuid() == 0
    if root and not hasattr(os, "setresuid"):
        pytest.skip("root can become nobody for a while on Linux only")
    if root:
        for path in (folder, folder / "inside"):
            os.chown(path, NOBODY, -1)
        os.setresuid(NOBODY, NOBODY, 0)
    try:
        folder.chmod(0o555)
        yield folder
        folder.chmod(0o755)
    finally:
        if root:
            os.setresuid(0, 0, 0)
        shutil.rmtree(folder)


@pytest.mark.parametrize("place", ["folder", "file/a.txt", "file/b/a.txt", "file/b/c/a.txt"])
def test_what_cannot_be_written_is_told_before_as_it_would_be_after(tmp_path: Path, place: str) -> None:
    """Oracle: what writing says."""
    (tmp_path / "file").write_text("old")
    (tmp_path / "folder").mkdir()
    early = told(lambda: require_writable(tmp_path / place))
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder"]
    assert early == told(lambda: write(tmp_path / place))


@pytest.mark.skipif(os.name != "posix", reason="folders cannot be sealed by permissions here")
@pytest.mark.parametrize("place", ["a.txt", "b/a.txt", "b/c/a.txt"])
def test_a_sealed_folder_is_told_before_as_it_would_be_after(sealed: Path, place: str) -> None:
    """Oracle: what writing says."""
    assert told(lambda: require_writable(sealed / place)) == told(lambda: write(sealed / place))
    require_writable(sealed / "inside" / place)


@pytest.mark.skipif(os.name != "posix", reason="folders cannot be sealed by permissions here")
def test_a_folder_that_nothing_can_be_put_into_is_told(sealed: Path) -> None:
    for folder in (sealed, sealed / "b"):
        assert told(lambda folder=folder: require_writable_folder(folder)) == (
            PermissionError,
            errno.EACCES,
            str(folder),
        )
    require_writable_folder(sealed / "inside" / "b")


def test_a_file_where_a_folder_is_wanted_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    assert told(lambda: require_writable_folder(path)) == (NotADirectoryError, errno.ENOTDIR, str(path))


def test_what_can_be_written_is_let_through_and_nothing_is_made(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    (tmp_path / "b").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "b" / "a.txt")
    before = [path.name for path in tmp_path.rglob("*")], (tmp_path / "a.txt").stat().st_mtime_ns
    places = [tmp_path / name for name in ("a.txt", "b.txt", "c/d/a.txt", "link.txt")]
    for place in (*places, os.devnull):
        require_writable(place)
    for folder in ("b", "c", "c/d"):
        require_writable_folder(tmp_path / folder)
    assert before == ([path.name for path in tmp_path.rglob("*")], (tmp_path / "a.txt").stat().st_mtime_ns)
    for place in places:
        write(place)
