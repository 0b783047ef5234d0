"""Writing files so that a reader never sees half of one."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["write_aside"]


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
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
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
            if mode is not None and os.name == "posix":  # elsewhere it only says whether the file may be replaced at all
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


def _made(folder: Path) -> Path:
    """Make a folder if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:  # what lies there is a file
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), os.fspath(folder)) from error
    return folder
