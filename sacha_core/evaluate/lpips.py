"""LPIPS: distance of images in the features of a network that was trained to recognise things.

The networks' weights are other people's; nothing here downloads them. They are used where the user has them.
"""

from __future__ import annotations

import importlib.util
import os
import pickle
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any

from sacha_core.errors import FormatError
from sacha_core.perception.flip import unit_float32
from sacha_core.perception.psnr import Image

__all__ = ["FOLDER", "NETWORKS", "LpipsNetwork", "missing", "open_network", "weights_file"]

FOLDER = (
    "SACHA_LPIPS_WEIGHTS"  # environment variable: a folder with the files, beside the places where torch keeps them
)
NETWORKS = {"vgg": "vgg16-397923af.pth", "alex": "alexnet-owt-7be5be79.pth"}  # as torchvision names them
SOURCE = "https://download.pytorch.org/models"
PACKAGES = ("torch", "torchvision", "lpips")


def weights_file(network: str) -> Path | None:
    """Find the weights of a network of `NETWORKS`: in the folder that `SACHA_LPIPS_WEIGHTS` names, else where torch keeps them."""
    return next((path for folder in folders() if (path := folder / NETWORKS[network]).is_file()), None)


def folders() -> tuple[Path, ...]:
    """Give the folders that weights are looked for in; the last is where torch itself would put them."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    torch_home = Path(os.environ.get("TORCH_HOME") or cache / "torch").expanduser()
    own = os.environ.get(FOLDER)
    return (*([Path(own).expanduser()] if own else []), torch_home / "hub" / "checkpoints")


def missing(network: str) -> str | None:
    """Say what LPIPS with a network of `NETWORKS` needs that is not here, and how to get it; None where it can be measured."""
    lacking = [package for package in PACKAGES if importlib.util.find_spec(package) is None]
    if lacking:
        return f"LPIPS needs {' and '.join(lacking)}: python -m pip install {' '.join(lacking)}"
    if weights_file(network) is None:
        name = NETWORKS[network]
        return (
            f"LPIPS ({network}) needs the file {name}: get it from {SOURCE}/{name} and put it into {folders()[-1]}, "
            f"or into a folder that {FOLDER} names"
        )
    return misfit()


def misfit() -> str | None:
    """Say why the packages, which are there, cannot be used, as where torch is built for the CPU and torchvision is not."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import lpips  # noqa: F401, PLC0415
        except (ImportError, RuntimeError, OSError) as error:
            return f"LPIPS needs a torchvision that fits the installed torch: {' '.join(str(error).split())}"
    return None


class LpipsNetwork:
    """Compares images in the features of one network; the mean over pixels, weighted by layer as people judged.

    Args:
        network: of `NETWORKS`.
        weights: the file with the network's own weights; those of the layers come with the package.

    Raises:
        FormatError: the file does not hold this network's weights.

    Source: Zhang et al., The unreasonable effectiveness of deep features as a perceptual metric, 2018; version 0.1, by the authors'
        package.
    """

    def __init__(self, network: str, weights: Path) -> None:
        import lpips  # noqa: PLC0415 - only where LPIPS is asked for
        import torch  # noqa: PLC0415

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the package calls torchvision by an older convention
            self._model: Any = lpips.LPIPS(net=network, pnet_rand=True, verbose=False)
        self._torch = torch
        backbone = self._model.net
        try:
            stored = torch.load(weights, map_location="cpu", weights_only=True)
            own = {name: stored[f"features.{name.split('.', 1)[1]}"] for name in backbone.state_dict()}
            backbone.load_state_dict(own)
        except (OSError, KeyError, TypeError, ValueError, RuntimeError, pickle.UnpicklingError, EOFError) as error:
            raise FormatError(f"{weights} does not hold the weights of {network}: {error}") from error

    def __call__(self, drawn: Image, truth: Image) -> float:
        """Give the distance, 0 for equal images.

        Args:
            drawn: (h, w, 3) sRGB, float in [0, 1] (clamped if beyond), or uint8.
            truth: (h, w, 3), likewise.
        """
        torch = self._torch
        pair = [torch.from_numpy(unit_float32(image).transpose(2, 0, 1)[None].copy()) for image in (drawn, truth)]
        with torch.inference_mode():
            return float(self._model(*pair, normalize=True))


@lru_cache(maxsize=len(NETWORKS))
def network_of(network: str, weights: Path) -> LpipsNetwork:
    """Read a network once."""
    return LpipsNetwork(network, weights)


def open_network(network: str) -> LpipsNetwork | None:
    """Give a network of `NETWORKS`, read once; None where `missing` says why.

    Raises:
        FormatError: its file is broken.
    """
    file = weights_file(network)
    return None if file is None or missing(network) else network_of(network, file)
