"""The CUDA device that is measured."""

from __future__ import annotations

import torch

from sacha_core.bench.trial import Trial
from sacha_core.train.cuda.engine import CudaEngine

__all__ = ["CudaDevice"]


class CudaDevice:
    """The first one."""

    @property
    def name(self) -> str:
        """What it is called, and what drives it."""
        return f"{torch.cuda.get_device_name()}, CUDA {torch.version.cuda}, torch {torch.__version__}"

    def open(self, trial: Trial, graphs: bool = False) -> CudaEngine:
        """Make an engine on it; `graphs` says whether stages are launched as recorded graphs."""
        return CudaEngine(trial.head, trial.motion, trial.options, graphs=graphs)

    def forget_peak(self) -> None:
        """Begin to watch memory anew."""
        torch.cuda.reset_peak_memory_stats()

    def peak_bytes(self) -> int:
        """Give the most memory in use since then, that of other engines which live included."""
        return torch.cuda.max_memory_allocated()
