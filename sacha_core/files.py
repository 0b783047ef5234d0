"""Writing files so that a reader never sees half of one."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["require_writable", "require_writable_folder", "write_aside"]


@contextmanager
def write_aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside `path`; move it into place on success, remove it on failure.

    The temporary file has the suffix of `path`, since writers of images and videos choose their format by it. A link stays one: the file
    that it leads to is replaced. A device or a pipe, which nothing may replace, is sent the finished bytes. A new file has the
    permissions that the umask leaves; one that replaces another keeps that one's, and is the owner's alone while it is written.

    Args:
        path: where the finished file shall lie; its folder is made if missing.

    Yields:
        A path in the same folder (hence the same file system), to be written by the caller.

    Raises:
        OSError: the folder cannot be made, the disk is full, or the move failed; the error names a file, and `path` is as it was.
    """
    target = _target(path)
    mode = target.stat().st_mode & 0o777 if target.is_file() else None
    moved = mode is not None or not target.exists()
    folder = _made(target.parent) if moved else Path(tempfile.gettempdir())
    aside = folder / f".{target.stem}.{os.urandom(6).hex()}{target.suffix}"
    new = moved and mode is None
    try:  # the umask is the system's to apply: asking for it would set it for all threads
        os.close(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666 if new else 0o600))
    except OSError as error:
        error.filename = os.fspath(path)  # not the temporary one, of which the user knows nothing
        raise
    try:
        yield aside
        if moved:
            if (
                mode is not None and os.name == "posix"
            ):  # elsewhere it only says whether the file may be replaced at all
                aside.chmod(mode)
            aside.replace(target)
        else:
            with aside.open("rb") as whole, target.open("wb") as sink:
                shutil.copyfileobj(whole, sink)
    except OSError as error:
        if error.filename is None and error.errno is not None:  # as where a write finds the disk full
            error.filename = os.fspath(path)
        raise
    finally:
        aside.unlink(missing_ok=True)


def require_writable(path: str | os.PathLike[str]) -> None:
    """Check, before the work that goes into a file, that `write_aside` could write it; nothing is made or changed.

    Args:
        path: where the file shall lie; neither it nor its folder need exist.

    Raises:
        OSError: what `write_aside` would raise in the end, with the same name of a file.
    """
    target = _target(path)
    if target.exists() and not target.is_file():
        _require_access(target, os.W_OK, os.fspath(path))
    else:
        _require_room(target.parent, os.fspath(path))


def require_writable_folder(folder: str | os.PathLike[str]) -> None:
    """Check, before the work that goes into a folder, that it is there or could be made, and may be written to; nothing is made.

    Raises:
        OSError: they cannot; the error names what is in the way, or the folder.
    """
    target = Path(os.path.realpath(folder))
    if target.exists() and not target.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), os.fspath(folder))
    _require_room(target, os.fspath(folder))


def _target(path: str | os.PathLike[str]) -> Path:
    """Give the file that a path leads to, which must not be a folder."""
    target = Path(os.path.realpath(path))
    if not target.exists() and Path(path).exists():  # /dev/stdout, which leads to a pipe without a name
        target = Path(path)
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    return target


def _require_room(folder: Path, named: str) -> None:
    """Check that files can be put into a folder once it is made; `named` is what an error calls it if it is there."""
    there = folder
    while not there.exists():
        there, named = there.parent, os.fspath(there)
    if not there.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), os.fspath(folder))
    _require_access(there, os.W_OK | os.X_OK, named)


def _require_access(place: Path, wanted: int, named: str) -> None:
    """Check that a file or folder may be used so by this process."""
    if not os.access(place, wanted):
        sealed = hasattr(os, "statvfs") and os.statvfs(place).f_flag & os.ST_RDONLY
        code = errno.EROFS if sealed else errno.EACCES
        raise OSError(code, os.strerror(code), named)


def _made(folder: Path) -> Path:
    """Make a folder if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:  # what lies there is a file
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), os.fspath(folder)) from error
    return folder
