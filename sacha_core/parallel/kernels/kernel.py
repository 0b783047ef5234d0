"""Compiling kernels, and keeping their machine code for the next process.

Numba's own cache has three faults here. It does not see that a file changed which a kernel imports from, so old code goes on running. It
numbers the code of each signature and lists the numbers elsewhere, so two processes that compile for different types at once may each run
the other's code. And it lists a number before the code is there, so that a process killed in between leaves older code under a new name.

Here the name of a file says all that the code in it was made from: the sources, the signature, the processor, the compiler. So a file is
right or it is not there; whoever writes it writes the same, whole or not at all. It lies where Numba would put it: in `__pycache__` beside
the source, in the user's cache where that is read-only, or in NUMBA_CACHE_DIR.

A kernel that other kernels call is kept with each of them once more, compiled in their surroundings, and a process runs whichever copy it
met first: its own where it compiled, the caller's where it did not. With `fastmath` the two may round differently, so such a kernel
takes `forceinline=True`.

Source: own.
"""

from __future__ import annotations

import contextlib
import pickle
import sys
import time
from functools import partial
from hashlib import sha256
from pathlib import Path

import llvmlite
import numba
from numba import njit
from numba.core import config
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps

from sacha_core.files import write_aside
from sacha_core.parallel.kernels.sources import sources_changed, sources_key

__all__ = ["kernel"]

COMPILER = (
    numba.__version__, llvmlite.__version__, sys.implementation.cache_tag,
    config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE, config.BOUNDSCHECK, config.USING_SVML,
    sources_key(Path(__file__)),
)  # fmt: skip
OLD_S = 7 * 86400.0  # code of other sources is kept for so long, for whoever goes back to them


def kernel(function=None, **options):
    """Compile a function, without Python's lock, when it is first called for some types; decorates with options or without.

    Args:
        function: to be compiled.
        options: of `numba.njit`.
    """
    if function is None:
        return partial(kernel, **options)
    compiled = njit(nogil=True, **options)(function)
    if isinstance(compiled, Dispatcher):  # and not the function itself, as with NUMBA_DISABLE_JIT
        with contextlib.suppress(
            RuntimeError, OSError
        ):  # nowhere to write, or no source: compiled anew by each process
            compiled._cache = KernelCache(function)
    return compiled


class KernelCache(FunctionCache):
    """What Numba asks for the code of a kernel before it compiles, and gives it afterwards."""

    def __init__(self, function):
        super().__init__(function)
        code = function.__code__
        self._cache_file = CodeFiles(
            Path(self.cache_path), f"{Path(code.co_filename).stem}.{code.co_name}", Path(code.co_filename)
        )

    def save_overload(self, sig, data):
        """Keep the code; go on without where that is not possible."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


class CodeFiles:
    """The files of a kernel's code, one for each signature, processor, compiler and state of the sources.

    Args:
        folder: where they lie.
        name: they begin with.
        source: file that defines the kernel.
    """

    def __init__(self, folder: Path, name: str, source: Path):
        self._folder, self._name, self._source = folder, name, source
        self._sources = sources_key(source)

    def load(self, key):
        """Give what was kept under a key; None where nothing is, or it is damaged."""
        try:
            whole = self._path(key).read_bytes()
        except OSError:
            return None
        digest, content = whole[:32], whole[32:]
        if sha256(content).digest() != digest:
            return None
        kept, data = pickle.loads(content)  # noqa: S301 - Python runs what lies in `__pycache__` anyway
        return data if kept == repr(key) else None

    def save(self, key, data):
        """Keep something under a key, unless sources changed under the running process: who knows which ones it had read?"""
        if sources_changed(self._source):
            return
        content = dumps((repr(key), data))
        with write_aside(self._path(key)) as aside:
            aside.write_bytes(sha256(content).digest() + content)
        self._drop_old()

    def _path(self, key) -> Path:
        """Give the file for a key: signature, processor, and digests of the function's own code."""
        made_from = sha256(repr((self._sources, COMPILER, key)).encode()).hexdigest()
        return self._folder / f"{self._name}-{self._sources[:12]}-{made_from[:24]}.nbc"

    def _drop_old(self):
        """Remove code of other sources that nobody made lately."""
        for path in self._folder.glob(f"{self._name}-*.nbc"):
            other = not path.name.startswith(f"{self._name}-{self._sources[:12]}-")
            with contextlib.suppress(OSError):  # somebody else may have removed it
                if other and path.stat().st_mtime < time.time() - OLD_S:
                    path.unlink()
