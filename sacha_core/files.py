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
    that it leads to is replaced. A device or a pipe, which nothing may replace, is sent the finished bytes.

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
    replaced = target.is_file() or not target.exists()
    folder = _made(target.parent) if replaced else Path(tempfile.gettempdir())
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}.", suffix=target.suffix, dir=folder)
    except OSError as error:
        error.filename = os.fspath(path)  # not the temporary one, of which the user knows nothing
        raise
    os.close(handle)
    aside = Path(name)
    try:
        yield aside
        if replaced:
            aside.chmod(0o644)
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
