"""The machine's description."""

from __future__ import annotations

import os
import platform

import numpy as np

from sacha_core.bench import machine


def test_a_description_names_what_figures_depend_on() -> None:
    found = machine.describe()
    assert found["processor"]
    assert 1 <= found["cores"] <= (os.cpu_count() or 1)
    assert found["python"] == platform.python_version()
    assert found["numpy"] == np.__version__
    text = machine.sentence(found)
    assert all(str(found[name]) in text for name in ("processor", "python", "numpy"))


def test_what_a_system_does_not_tell_is_left_out(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(machine, "CPUINFO", tmp_path / "none")
    monkeypatch.setattr(machine, "CACHES", tmp_path / "none")
    monkeypatch.delattr(os, "getloadavg", raising=False)
    monkeypatch.delattr(os, "sysconf", raising=False)
    found = machine.describe()
    assert (found["caches"], found["memory_gib"], found["load_at_start"]) == ({}, None, None)
    assert "load" not in machine.sentence(found)
    assert "GiB" not in machine.sentence(found)


def test_caches_are_read_without_those_of_instructions(monkeypatch, tmp_path) -> None:
    for k, (level, kind, size) in enumerate(
        (("1", "Data", "32K"), ("1", "Instruction", "64K"), ("2", "Unified", "1024K"))
    ):
        folder = tmp_path / f"index{k}"
        folder.mkdir()
        for name, text in (("level", level), ("type", kind), ("size", size)):
            (folder / name).write_text(f"{text}\n")
    (tmp_path / "index3").mkdir()  # a system that tells nothing of it
    monkeypatch.setattr(machine, "CACHES", tmp_path)
    assert machine.caches() == {"L1": "32 KiB", "L2": "1024 KiB"}
