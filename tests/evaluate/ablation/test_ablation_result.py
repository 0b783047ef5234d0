"""Results of an ablation: through a file and back, and every wrong one refused by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from fabricated import fabricated, fabricated_results, write_results

from sacha_core.errors import FormatError
from sacha_core.evaluate.ablation.result import RunResult, read_result, write_result


def test_results_come_back_from_their_files(tmp_path: Path) -> None:
    """Oracle: what was written."""
    results = fabricated_results()
    write_results(tmp_path, results)
    found = [read_result(path) for path in tmp_path.glob("*/seed-*/*/result.json")]
    assert len(found) == len(results) == 18
    assert {(r.dataset, r.variant, r.seed): r for r in found} == {(r.dataset, r.variant, r.seed): r for r in results}
    assert found[0].point(2) is found[0].points[2]
    assert found[0].point(7) is None


def changed(path: str, value: Any) -> dict[str, Any]:
    """Give a good record with one value replaced; `...` removes it."""
    record = json.loads(json.dumps(fabricated("one", "sacha", 0).to_json()))
    inner: Any = record
    *outer, last = path.split("/")
    for name in outer:
        inner = inner[int(name) if isinstance(inner, list) else name]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return dict(record)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("n", ..., "result has no field n"),
        ("more", 1, "result has a field more, which is unknown"),
        ("n", 1.5, "result.n is 1.5, expected a whole number"),
        ("n", True, "result.n is True, expected a whole number"),
        ("variant", 3, "result.variant is 3, expected a text"),
        ("points", {}, "result.points is {}, expected a list"),
        ("regions", [], "result.regions is [], expected an object"),
        ("points/1/novel_view/psnr", None, "result.points[1].novel_view.psnr is None, expected a finite number"),
        ("points/1/bytes", 3, "result.points[1].bytes is 3, expected an object"),
        ("regions/mouth/ratio", float("nan"), "result.regions.mouth.ratio is nan, expected a finite number"),
        ("dataset", "x" * 0, None),
        ("points/0/novel_view/flip", None, None),
    ],
)
def test_a_wrong_record_is_refused_by_the_name_of_its_field(path: str, value: Any, line: str | None) -> None:
    """Oracle: the message."""
    record = changed(path, value)
    if line is None:
        assert RunResult.from_json(record).to_json() == {**record, "points": tuple(record["points"])}
        return
    with pytest.raises(FormatError) as error:
        RunResult.from_json(record)
    assert str(error.value) == line


@pytest.mark.parametrize("content", ["", "{", "[" * 100_000, "[]", "nonsense"])
def test_what_is_no_result_is_refused_by_the_name_of_its_file(tmp_path: Path, content: str) -> None:
    """Oracle: the error's kind, and the file in its message."""
    path = tmp_path / "result.json"
    path.write_text(content)
    with pytest.raises(FormatError, match=str(path)):
        read_result(path)


def test_writing_a_number_that_is_none_leaves_the_old_file(tmp_path: Path) -> None:
    """Oracle: the file as it was."""
    path = tmp_path / "result.json"
    good = fabricated("one", "sacha", 0)
    write_result(path, good)
    bad = RunResult(**{**vars(good), "training_seconds": float("nan")})
    with pytest.raises(ValueError, match="JSON compliant"):
        write_result(path, bad)
    assert read_result(path) == good
