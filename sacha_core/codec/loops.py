"""Whether loops run compiled: where Numba is loaded anyway and there is enough to do to pay for loading their code.

Source: own.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

__all__ = ["compiled_loops"]

KERNELS = "sacha_core.codec.kernels."
COMPILED_FROM = 20_000  # numbers: below this, NumPy is done before the code comes from its cache
COMPILED_FROM_LOADED = 500


def compiled_loops(name: str, amount: int) -> ModuleType | None:
    """Give the compiled loops of that name for an array of so many rows; None stands for NumPy."""
    loaded = sys.modules.get(KERNELS + name)
    if sys.modules.get("numba") is None or amount < (COMPILED_FROM_LOADED if loaded else COMPILED_FROM):
        return None
    return loaded or importlib.import_module(KERNELS + name)  # Numba only where it is loaded
