"""The machine that figures were measured on, as far as it tells."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any

__all__ = ["describe", "sentence", "speed_sentence"]

PACKAGES = ("numpy", "numba", "torch", "gsplat")
CPUINFO = Path("/proc/cpuinfo")
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")


def describe() -> dict[str, Any]:
    """Give processor, cores, caches, memory, system, versions, and how busy the machine is as the measuring begins."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": processor(),
        "cores": cores,
        "caches": caches(),
        "memory_gib": memory_gib(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "load_at_start": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    }


def sentence(machine: dict[str, Any]) -> str:
    """Say the same in a line."""
    caches = ", ".join(f"{name} {size}" for name, size in (machine.get("caches") or {}).items())
    memory = f", {machine['memory_gib']} GiB" if machine.get("memory_gib") else ""
    packages = ", ".join(f"{name} {machine[name]}" for name in PACKAGES if machine.get(name))
    load = machine.get("load_at_start")
    return (
        f"{machine['processor']}, {machine['cores']} cores" + (f" ({caches})" if caches else "") + memory
        + f"; {machine['system']}; Python {machine['python']}, {packages}"
        + (f"; load average {load} at the start" if load is not None else "")
    )  # fmt: skip


def speed_sentence(machine: dict[str, Any]) -> str:
    """Say how fast the machine was while a bench ran (`sacha_core.bench.reference`); nothing where that was not recorded."""
    speed = machine.get("reference")
    if not speed:
        return ""
    parts = " and ".join(
        f"{speed[f'{part}_ms']:.2f} ms ({speed[f'{part}_low_ms']:.2f} to {speed[f'{part}_high_ms']:.2f}) of {what}"
        for part, what in (("compute", "arithmetic"), ("memory", "copying"))
    )
    return f"Speed of the machine meanwhile: the reference took {parts}."


def processor() -> str:
    """Give the processor's name, and what a compiler calls its kind where that is known."""
    name = platform.processor() or platform.machine()
    if CPUINFO.is_file():
        named = [line for line in CPUINFO.read_text(errors="replace").splitlines() if line.startswith("model name")]
        name = named[0].partition(":")[2].strip() if named else name
    try:
        from llvmlite.binding import get_host_cpu_name  # noqa: PLC0415 (slow to import, and not everywhere)
    except ImportError:
        return name
    return f"{name} ({get_host_cpu_name()})"


def caches() -> dict[str, str]:
    """Give the sizes of the first core's caches by level, as the system states them; nothing where it does not."""
    found = {}
    for folder in sorted(CACHES.glob("index*")):
        try:
            level, kind, size = ((folder / name).read_text().strip() for name in ("level", "type", "size"))
        except OSError:  # not every system has every file: then the size stays unknown
            continue
        if kind != "Instruction":
            found[f"L{level}"] = size.replace("K", " KiB")
    return found


def memory_gib() -> int | None:
    """Give the size of memory, or None where the system does not tell."""
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError, OSError):  # not on Windows
        return None


def version(package: str) -> str | None:
    """Give the installed version of a package, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
