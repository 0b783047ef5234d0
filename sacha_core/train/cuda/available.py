"""Whether this machine can train on CUDA, and what it lacks if not. Imports torch only where it is worth it."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import shutil

__all__ = ["available", "missing"]

SUPPORTED = ((1, 5), (1, 6))  # gsplat's releases whose functions take what we give
INSTALL = "pip install 'sacha[cuda]'"
TORCH = "https://pytorch.org/get-started says how to install torch for your GPU"


def available() -> bool:
    """Tell whether training can run on a CUDA device here."""
    return missing() is None


def missing() -> str | None:
    """Say in a line what keeps training from running on a CUDA device, and what to install; None where nothing does.

    Where gsplat is not installed, torch is not imported to find out more.
    """
    for package in ("gsplat", "torch"):
        if importlib.util.find_spec(package) is None:
            return f"{package} is not installed: {INSTALL}"
    release = importlib.metadata.version("gsplat")
    if tuple(int(part) for part in release.split(".")[:2]) not in SUPPORTED:
        known = " or ".join(f"{major}.{minor}" for major, minor in SUPPORTED)
        return f"gsplat {release} is installed, expected {known}: {INSTALL}"
    torch = importlib.import_module("torch")
    if torch.version.cuda is None:
        return f"torch {torch.__version__} was built without CUDA; {TORCH}"
    if not torch.cuda.is_available():
        return f"torch {torch.__version__} sees no CUDA device: it wants an NVIDIA GPU and its driver"
    if importlib.util.find_spec("gsplat.csrc") is None and _compiler() is None:
        return (
            f"gsplat {release} brings no compiled kernels and there is no nvcc to compile them: install the CUDA toolkit,"
            " or a wheel from https://docs.gsplat.studio/whl"
        )
    return None


def _compiler() -> str | None:
    """Give the folder of the CUDA toolkit, or where nvcc lies; None where there is none."""
    home: str | None = importlib.import_module("torch.utils.cpp_extension").CUDA_HOME
    return home or shutil.which("nvcc")
