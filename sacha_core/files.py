"""Writing files so that a reader never sees half of one."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["write_aside"]


@contextmanager
def write_aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside `path`; move it into place on success, remove it on failure.

    The temporary file has the suffix of `path`, since writers of images and videos choose their format by it.

    Args:
        path: where the finished file shall lie; its folder is made if missing.

    Yields:
        A path in the same folder (hence the same file system), to be written by the caller.

    Raises:
        OSError: the folder cannot be made, the disk is full, or the move failed; the error names a file, and `path` is as it was.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{target.stem}.", suffix=target.suffix, dir=target.parent)
    os.close(handle)
    aside = Path(name)
    try:
        yield aside
        aside.chmod(0o644)
        aside.replace(target)
    except OSError as error:
        if error.filename is None:  # as where a write finds the disk full
            error.filename = os.fspath(target)
        raise
    finally:
        aside.unlink(missing_ok=True)
