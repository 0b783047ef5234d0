"""LPIPS where its package and weights are, and what is said where they are not.

Oracles: the paper's formula on torchvision's own network, with weights made of random numbers; without the package, a stand-in with its
interface, which compares by a formula that is known.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch

from sacha_core.errors import FormatError
from sacha_core.evaluate import lpips
from sacha_core.evaluate.views import score_views

FLOAT32_NETWORK = 1e-5  # relative; float32 convolutions, summed in another order
LAYERS = {
    "alex": (1, 4, 7, 9, 11),
    "vgg": (3, 8, 15, 22, 29),
}  # of torchvision's features, after each of which images are compared


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the only folder in which weights are looked for, empty."""
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    monkeypatch.delenv(lpips.FOLDER, raising=False)
    kept = tmp_path / "torch" / "hub" / "checkpoints"
    kept.mkdir(parents=True)
    lpips.network_of.cache_clear()
    return kept


class StandIn(torch.nn.Module):
    """As the package's `LPIPS`, with one convolution; the distance is the mean square of the features' difference."""

    def __init__(self, net: str, pnet_rand: bool, verbose: bool) -> None:
        super().__init__()
        assert net in lpips.NETWORKS
        assert pnet_rand, "nothing may be downloaded"
        assert not verbose
        self.net = torch.nn.Module()
        self.net.slice1 = torch.nn.Sequential()
        self.net.slice1.add_module("0", torch.nn.Conv2d(3, 2, 1))

    def forward(self, a: torch.Tensor, b: torch.Tensor, normalize: bool) -> torch.Tensor:
        assert normalize
        return (self.net.slice1(a) - self.net.slice1(b)).square().mean()


@pytest.fixture
def stand_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put the stand-in where the package would be."""
    package = ModuleType("lpips")
    package.LPIPS = StandIn
    monkeypatch.setitem(sys.modules, "lpips", package)
    monkeypatch.setattr(lpips, "PACKAGES", ("torch",))
    return folder


def write_weights(folder: Path, network: str) -> np.ndarray:
    weight = torch.randn((2, 3, 1, 1), generator=torch.Generator().manual_seed(len(network)))
    torch.save({"features.0.weight": weight, "features.0.bias": torch.zeros(2)}, folder / lpips.NETWORKS[network])
    return weight.numpy()[:, :, 0, 0]


@pytest.mark.parametrize("network", ["vgg", "alex"])
def test_missing_weights_are_said_with_where_to_get_and_put_them(stand_in, network) -> None:
    text = lpips.missing(network)
    name = lpips.NETWORKS[network]
    for part in (name, f"https://download.pytorch.org/models/{name}", str(stand_in), lpips.FOLDER):
        assert part in text
    assert lpips.open_network(network) is None


def test_missing_packages_are_said_with_how_to_install_them(folder, monkeypatch) -> None:
    monkeypatch.setattr(lpips, "PACKAGES", ("torch", "no_such_package_1", "no_such_package_2"))
    command = "python -m pip install no_such_package_1 no_such_package_2"
    assert lpips.missing("vgg") == f"LPIPS needs no_such_package_1 and no_such_package_2: {command}"
    write_weights(folder, "vgg")
    assert lpips.open_network("vgg") is None


def test_the_named_folder_comes_before_torchs(stand_in, tmp_path, monkeypatch) -> None:
    write_weights(stand_in, "alex")
    assert lpips.weights_file("alex") == stand_in / lpips.NETWORKS["alex"]
    own = tmp_path / "own"
    own.mkdir()
    monkeypatch.setenv(lpips.FOLDER, str(own))
    assert lpips.weights_file("alex") == stand_in / lpips.NETWORKS["alex"], "it is not in the named one"
    write_weights(own, "alex")
    assert lpips.weights_file("alex") == own / lpips.NETWORKS["alex"]


def test_figures_are_those_of_the_network_that_is_there(stand_in, subject) -> None:
    weight = write_weights(stand_in, "alex")
    views = subject.capture.val
    found = score_views(
        subject.gaussians, subject.head, subject.motion, subject.capture, views, metrics=("psnr", "lpips")
    )
    assert found.quality.lpips_vgg is None
    assert found.quality.lpips_alex == pytest.approx(np.mean([image.lpips_alex for image in found.images]))
    a, b = (np.random.default_rng(seed).random((5, 7, 3)) for seed in (0, 1))
    network = lpips.open_network("alex")
    assert network(a, b) == pytest.approx(np.mean(((a - b) @ weight.T) ** 2), rel=FLOAT32_NETWORK)
    assert network is lpips.open_network("alex"), "read once"


@pytest.mark.parametrize("content", [b"", b"nonsense", None])
def test_a_file_that_is_something_else_is_named(stand_in, content) -> None:
    file = stand_in / lpips.NETWORKS["vgg"]
    if content is None:
        torch.save({"features.0.weight": torch.zeros(7), "features.0.bias": torch.zeros(2)}, file)
    else:
        file.write_bytes(content)
    with pytest.raises(FormatError, match=file.name):
        lpips.open_network("vgg")


def test_packages_that_do_not_fit_each_other_are_said(folder, tmp_path, monkeypatch) -> None:
    (tmp_path / "lpips.py").write_text("raise RuntimeError('operator torchvision::nms does not exist')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lpips", raising=False)
    monkeypatch.setattr(lpips, "PACKAGES", ("torch", "lpips"))
    write_weights(folder, "alex")
    assert "torchvision that fits the installed torch: operator torchvision::nms" in lpips.missing("alex")
    assert lpips.open_network("alex") is None


def real_package() -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return importlib.import_module("lpips")
        except (ImportError, RuntimeError) as error:
            pytest.skip(f"the package lpips cannot be imported here: {error}")


@pytest.mark.slow
@pytest.mark.parametrize("network", ["alex", "vgg"])
def test_the_packages_figures_are_those_of_the_formula(folder, network) -> None:
    package = real_package()
    models = importlib.import_module("torchvision.models")
    torch.manual_seed(0)
    backbone = {"alex": models.alexnet, "vgg": models.vgg16}[network](weights=None).eval()
    torch.save(backbone.state_dict(), folder / lpips.NETWORKS[network])
    heads = torch.load(Path(package.__file__).parent / f"weights/v0.1/{network}.pth", map_location="cpu")
    rng = np.random.default_rng(0)
    a, b = rng.random((70, 66, 3)), (255 * rng.random((70, 66, 3))).astype(np.uint8)
    expected, states = 0.0, []
    for image in (a, b / 255):
        scaled = (2 * image - 1 - (-0.030, -0.088, -0.188)) / (0.458, 0.448, 0.450)
        states.append(torch.tensor(scaled.transpose(2, 0, 1)[None], dtype=torch.float32))
    with torch.inference_mode():
        for number, layer in enumerate(backbone.features):
            states = [layer(state.clone()) for state in states]
            if number in LAYERS[network]:
                p, q = (state / (state.square().sum(1, keepdim=True).sqrt() + 1e-10) for state in states)
                weights = heads[f"lin{LAYERS[network].index(number)}.model.1.weight"]
                expected += float(((p - q).square() * weights).sum(1).mean())
    measured = lpips.open_network(network)
    assert measured(a, b) == pytest.approx(expected, rel=FLOAT32_NETWORK)
    assert measured(b / 255, b) == 0
