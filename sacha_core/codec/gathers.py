"""Whether sums over neighbours run compiled: where Numba is loaded anyway and there are enough of them to pay for loading their code.

Source: own.
"""

from __future__ import annotations

import sys
from types import ModuleType

__all__ = ["compiled_gathers"]

KERNELS = "sacha_core.codec.kernels.gathers"
COMPILED_FROM = 20_000  # Gaussians: below this, NumPy is done before the code comes from its cache
COMPILED_FROM_LOADED = 500


def compiled_gathers(n_gaussians: int) -> ModuleType | None:
    """Give the compiled loops for an avatar of so many Gaussians; None stands for NumPy."""
    loaded = KERNELS in sys.modules
    if sys.modules.get("numba") is None or n_gaussians < (COMPILED_FROM_LOADED if loaded else COMPILED_FROM):
        return None
    from sacha_core.codec.kernels import gathers  # noqa: PLC0415  # Numba only where it is loaded

    return gathers
