"""What keeps a machine from CUDA, said in a line with what to install."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
from types import SimpleNamespace

import pytest

from sacha_core.train.cuda import available as module


class Machine:
    """What is installed, as the module asks for it; on a fresh one everything is there."""

    def __init__(self) -> None:
        self.packages = {"torch", "gsplat", "gsplat.csrc"}
        self.gsplat = "1.5.3+pt24cu124"
        self.toolkit: str | None = None
        self.cuda: str | None = "12.4"
        self.devices = 1
        self.imported: list[str] = []

    def find_spec(self, name: str) -> object | None:
        return object() if name in self.packages else None

    def import_module(self, name: str) -> object:
        self.imported.append(name)
        if name == "torch":
            cuda = SimpleNamespace(is_available=lambda: self.devices > 0)
            return SimpleNamespace(__version__="2.4", version=SimpleNamespace(cuda=self.cuda), cuda=cuda)
        return SimpleNamespace(CUDA_HOME=self.toolkit)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    """Give a machine where all is well."""
    made = Machine()
    monkeypatch.setattr(importlib.util, "find_spec", made.find_spec)
    monkeypatch.setattr(importlib, "import_module", made.import_module)
    monkeypatch.setattr(importlib.metadata, "version", lambda _: made.gsplat)
    monkeypatch.setattr(module.shutil, "which", lambda _: None)
    return made


def test_all_is_well(machine) -> None:
    assert module.missing() is None
    assert module.available()


@pytest.mark.parametrize(
    ("fault", "value", "words"),
    [
        ("packages", {"torch"}, ("gsplat is not installed", "pip install")),
        ("packages", {"gsplat"}, ("torch is not installed", "pip install")),
        ("gsplat", "1.4.0", ("gsplat 1.4.0", "1.5 or 1.6")),
        ("gsplat", "2.0", ("gsplat 2.0", "1.5 or 1.6")),
        ("cuda", None, ("built without CUDA", "https://pytorch.org")),
        ("devices", 0, ("no CUDA device", "driver")),
        ("packages", {"torch", "gsplat"}, ("no compiled kernels", "nvcc", "https://docs.gsplat.studio")),
    ],
)
def test_each_lack_is_named_with_its_remedy(machine, fault, value, words) -> None:
    setattr(machine, fault, value)
    found = module.missing()
    assert found is not None
    assert "\n" not in found
    assert all(word in found for word in words)
    assert not module.available()


def test_kernels_may_be_compiled_where_the_toolkit_is(machine) -> None:
    machine.packages.remove("gsplat.csrc")
    machine.toolkit = "/usr/local/cuda"
    assert module.available()


def test_torch_is_not_imported_where_gsplat_is_missing(machine) -> None:
    machine.packages.remove("gsplat")
    assert not module.available()
    assert machine.imported == []
