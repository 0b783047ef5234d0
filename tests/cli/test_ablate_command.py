"""`sacha ablate` from the shell: interrupted anywhere, it goes on; what it cannot do, it says in one line."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

PLAN = (
    *(
        "--variants",
        "default",
        "rad-gp-pis",
        "--iterations",
        "40",
        "--seeds",
        "1",
        "--levels",
        "1,3",
        "--judge-images",
        "3",
    ),
    *("--metrics", "psnr", "--set", "sh_degree=1", "--jobs", "2"),
)
PATIENCE_S = 600.0  # on a machine with much else to do


def results_of(out: Path) -> list[dict[str, Any]]:
    """Give all results without what a clock had a part in."""
    found = [json.loads(path.read_text()) for path in sorted(out.glob("*/seed-*/*/result.json"))]
    for result in found:
        del result["training_seconds"]
        for point in result["points"]:
            del point["encode_s"], point["decode_s"]
    return found


def files_of(out: Path) -> dict[str, bytes]:
    """Give models and coded avatars."""
    kept = [path for ending in ("*.ply", "*.sacha", "events.jsonl") for path in out.rglob(ending)]
    return {str(path.relative_to(out)): path.read_bytes() for path in kept if "warm-up" not in str(path)}


@pytest.fixture(scope="module")
def whole(done, capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give an ablation that nobody interrupted."""
    out = tmp_path_factory.mktemp("whole")
    outcome = done("ablate", capture, "-o", out, *PLAN)
    assert "rad-gp-pis" in outcome.out
    assert (out / "report" / "report.html").stat().st_size > 10_000
    assert Path(outcome.report["report"]) == out / "report" / "report.html"
    assert [result["variant"] for result in outcome.report["results"]] == ["default", "rad-gp-pis"]
    return out


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills by POSIX signals")
@pytest.mark.parametrize("seen", ["default/plan.json", "default/level-1.sacha"])
def test_a_killed_ablation_goes_on_to_the_same_bytes(
    done, capture: Path, whole: Path, tmp_path: Path, seen: str
) -> None:
    """Oracle: the ablation that nobody interrupted, to the byte."""
    command = [
        sys.executable,
        "-m",
        "sacha_core",
        "ablate",
        str(capture),
        "-o",
        str(tmp_path),
        *PLAN,
        "--progress",
        "none",
    ]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        until = time.monotonic() + PATIENCE_S
        while not any(tmp_path.glob(f"*/seed-0/{seen}")):
            assert process.poll() is None, "it ended before it could be killed"
            assert time.monotonic() < until
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
    assert len(results_of(tmp_path)) < 2
    done("ablate", capture, "-o", tmp_path, *PLAN)
    assert results_of(tmp_path) == results_of(whole)
    assert files_of(tmp_path) == files_of(whole)


def test_what_is_done_is_kept_and_reported_again(done, capture: Path, whole: Path) -> None:
    """Oracle: the files, which stay as they are."""
    times = {path: path.stat().st_mtime_ns for path in whole.rglob("result.json")}
    outcome = done("ablate", capture, "-o", whole, *PLAN)
    assert "kept         2 results" in outcome.out
    assert done("ablate", "-o", whole, "--report-only").report["results"] == outcome.report["results"]
    assert {path: path.stat().st_mtime_ns for path in whole.rglob("result.json")} == times


def test_a_run_that_fails_is_told_at_the_end_and_by_the_status(
    call, capture: Path, whole: Path, tmp_path: Path
) -> None:
    """Oracle: the status, and the other run's result."""
    in_the_way = tmp_path / capture.name / "seed-0" / "rad"
    in_the_way.parent.mkdir(parents=True)
    in_the_way.write_text("a file where a folder should be")
    plan = ("--variants", "rad", "default", *PLAN[3:])
    outcome = call("ablate", capture, "-o", tmp_path, *plan)
    assert outcome.status == 1
    assert [result["variant"] for result in outcome.report["results"]] == ["default"]
    assert len(outcome.report["broken"]) == 1
    assert "failed       " in outcome.out
    assert results_of(tmp_path) == results_of(whole)[:1]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--variants", "nonsense"], "variant 'nonsense' is unknown"),
        (["--levels", "0-4"], "levels are 0, 1, 2, 3, 4, expected some of 1, 2, 3, 4"),
        (["--levels", "best"], "--levels is 'best', expected such as 1-4 or 1,3"),
        (["--seeds", "0"], "0 seeds were asked for, expected at least 1"),
        (["--iterations", "0"], "iterations is 0, expected at least 1"),
        (["--jobs", "0"], "0 processes were asked for, expected 1 or more"),
        (["--ray", "auto", "--jobs", "2"], "--jobs is for this machine"),
        (["--metrics", "beauty"], "beauty"),
    ],
)
def test_what_makes_no_sense_is_refused(
    refused, capture: Path, tmp_path: Path, arguments: list[str], line: str
) -> None:
    """Oracle: the message."""
    assert line in refused("ablate", capture, "-o", tmp_path / "out", *arguments)
    assert not list(tmp_path.glob("out/*/seed-*"))


def test_nothing_to_do_is_refused(refused, tmp_path: Path) -> None:
    """Oracle: the message."""
    assert "there is no dataset to train, expected at least one" in refused("ablate", "-o", tmp_path)
    assert "nowhere" in refused("ablate", tmp_path / "nowhere", "-o", tmp_path)
    assert "holds no results" in refused("ablate", "-o", tmp_path, "--report-only")
