"""What lies in an ablation's folder already, and whether it is what the plan wants."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from sacha_core.errors import FormatError
from sacha_core.evaluate.ablation.plan import PlannedRun
from sacha_core.evaluate.ablation.result import RESULT, RunResult, read_result
from sacha_core.files import write_aside
from sacha_core.train.checkpoint import ELSEWHERE, flat

__all__ = ["difference", "read_results", "record_plan", "standing"]

PLAN = "plan.json"


def record_plan(run: PlannedRun, data: dict[str, Any]) -> None:
    """Write down what a run is about to be, before it begins.

    Args:
        run: the run.
        data: fingerprint of capture and head.

    Raises:
        OSError: the file cannot be written.
    """
    text = json.dumps({"options": run.options.record(), "judging": asdict(run.judging), "data": data}, indent=2)
    with write_aside(run.folder / PLAN) as aside:
        aside.write_text(text + "\n", encoding="utf-8")


def standing(run: PlannedRun) -> Literal["to do", "to judge", "done"]:
    """Tell how far a run is that differs in nothing that training depends on."""
    if not run.result.is_file():
        return "to do"
    return "done" if _recorded(run).get("judging") == _plain(asdict(run.judging)) else "to judge"


def difference(run: PlannedRun, data: dict[str, Any]) -> str | None:
    """Say in what the run that lies in a run's folder is another one; None where it is the same, or there is none.

    Raises:
        FormatError: its record is damaged.
    """
    recorded = _recorded(run)
    if not recorded:
        return None
    if recorded.get("data") != _plain(data):
        return "capture or head"
    theirs, ours = flat(recorded.get("options", {})), flat(_plain(run.options.record()))
    for name in ours | theirs:
        if name in ELSEWHERE or name.split(".", maxsplit=1)[0] in ELSEWHERE:
            continue
        if theirs.get(name, ...) != ours.get(name, ...):
            return f"{name} ({theirs.get(name, 'none')} there, {ours.get(name, 'none')} now)"
    return None


def read_results(out: Path) -> tuple[RunResult, ...]:
    """Read all results below an ablation's folder, by capture, seed and variant.

    Raises:
        FormatError: one of them is damaged.
        OSError: one cannot be read.
    """
    return tuple(read_result(path) for path in sorted(out.glob(f"*/seed-*/*/{RESULT}")))


def _recorded(run: PlannedRun) -> dict[str, Any]:
    path = run.folder / PLAN
    if not path.is_file():
        return {}
    try:
        record = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path} is not JSON: {error}") from error
    if not isinstance(record, dict):
        raise FormatError(f"{path} is not an object, expected the plan of a run")
    return record


def _plain(record: dict[str, Any]) -> dict[str, Any]:
    """Give a record as JSON gives it back."""
    plain: dict[str, Any] = json.loads(json.dumps(record))
    return plain
