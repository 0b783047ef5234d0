"""Times the rasteriser against a plain one in torch, both in this process, turn by turn; writes JSON.

    python benchmarks/raster.py [--gaussians 50000] [--rounds 30] [--threads 2] [--json raster.json]

Wall time is what a caller waits for; processor time is what the work costs, which another process on the same cores changes less.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from pathlib import Path

import numba
import numpy as np
import torch
from raster_plain import PlainRasteriser
from raster_workload import front_camera, head_shell

from sacha_core.raster.pool import available_threads
from sacha_core.raster.rasteriser import Rasteriser

SIZES = ((550, 802), (275, 401))
BACKGROUND = np.ones(4, np.float32)


def clocked(task) -> tuple[float, float]:
    """Give wall and processor time of a call, milliseconds."""
    wall, busy = time.perf_counter(), time.process_time()
    task()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - busy)


def summary(times: list[tuple[float, float]]) -> dict[str, float]:
    table = np.array(times)
    names = ("wall_median_ms", "wall_min_ms", "busy_median_ms", "busy_min_ms")
    values = (np.median(table[:, 0]), table[:, 0].min(), np.median(table[:, 1]), table[:, 1].min())
    return {name: round(float(value), 3) for name, value in zip(names, values, strict=True)}


def measure(n: int, width: int, height: int, rounds: int, threads: int, plain_rounds: int) -> dict:
    splats, camera = head_shell(n), front_camera(width, height)
    gradient = np.random.default_rng(0).normal(size=(4, height, width)).astype(np.float32)
    fast, plain = Rasteriser(threads), PlainRasteriser()
    forward: list[tuple[float, float]] = []
    both: list[tuple[float, float]] = []
    plain_forward: list[tuple[float, float]] = []
    plain_both: list[tuple[float, float]] = []

    def turn() -> None:
        frame = fast.forward(splats, camera, BACKGROUND)
        fast.backward(frame, gradient)

    turn()  # compiled, and memory touched
    expected = plain.forward(splats, camera, BACKGROUND).detach().numpy() if plain_rounds else None
    frame = fast.forward(splats, camera, BACKGROUND)
    difference = float(np.quantile(np.abs(frame.image - expected), 0.999)) if expected is not None else None
    entries = int(frame.bins.start[-1])
    for k in range(rounds):
        forward.append(clocked(lambda: fast.forward(splats, camera, BACKGROUND)))
        both.append(clocked(turn))
        if k < plain_rounds:
            plain_forward.append(clocked(lambda: plain.forward(splats, camera, BACKGROUND)))
            plain_both.append(clocked(lambda: plain.forward_backward(splats, camera, BACKGROUND, gradient)))
    report = {
        "gaussians": n, "width": width, "height": height, "channels": 4, "tiles_touched": entries,
        "forward": summary(forward), "forward_backward": summary(both),
    }  # fmt: skip
    if plain_rounds:
        report |= {"plain_forward": summary(plain_forward), "plain_forward_backward": summary(plain_both)}
        report["difference_p999"] = difference
        for name in ("forward", "forward_backward"):
            for clock in ("wall_median_ms", "busy_min_ms"):
                report[f"ratio_{name}_{clock[:4]}"] = round(report[f"plain_{name}"][clock] / report[name][clock], 1)
    return report


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gaussians", type=int, default=50_000)
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--plain-rounds", type=int, default=2)
    parser.add_argument("--threads", type=int, default=min(2, available_threads()))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.set_flush_denormal(True)  # kinder to the peer
    report = {
        "machine": {"processor": numba.core.config.CPU_NAME or numba_host(), "system": platform.platform(),
                    "cores": available_threads(), "threads": options.threads, "python": platform.python_version(),
                    "numba": numba.__version__, "torch": torch.__version__},
        "runs": [
            *(measure(options.gaussians, w, h, options.rounds, options.threads, options.plain_rounds) for w, h in SIZES),
            measure(10_000, *SIZES[1], options.rounds, options.threads, 0),
        ],
    }  # fmt: skip
    for run in report["runs"]:
        print(f"{run['gaussians']} Gaussians, {run['width']} x {run['height']}, {run['tiles_touched']} tiles touched")
        for name in ("forward", "forward_backward", "plain_forward", "plain_forward_backward"):
            if name in run:
                times = ", ".join(f"{key} {value}" for key, value in run[name].items())
                print(f"    {name}: {times}")
        print("   ", {key: run[key] for key in run if key.startswith(("ratio", "difference"))})
    if options.json:
        options.json.write_text(json.dumps(report, indent=2) + "\n")


def numba_host() -> str:
    """Give the name by which the compiler knows this processor."""
    from llvmlite.binding import get_host_cpu_name  # noqa: PLC0415

    return str(get_host_cpu_name())


if __name__ == "__main__":
    main()
