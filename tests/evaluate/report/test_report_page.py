"""A whole report: one page with everything inside, tables for programs, and nothing that breaks it."""

from __future__ import annotations

import base64
import csv
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fabricated import fabricated, fabricated_results

from sacha_core.errors import OptionError
from sacha_core.evaluate.report import ReportPaths, write_report
from sacha_core.evaluate.report.entry import Entry, Seeds
from sacha_core.evaluate.report.pair_grids import tally
from sacha_core.evaluate.report.targets import Outcome, Verdict

VOID = {"meta", "img", "br", "link"}


class Outline(HTMLParser):
    """Follows a page's elements; oracle: the standard library's parser."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []
        self.tags: set[str] = set()
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.sources += [value or "" for name, value in attrs if name in {"src", "href"}]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def outline(paths: ReportPaths) -> Outline:
    found = Outline()
    found.feed(paths.html.read_text(encoding="utf-8"))
    assert found.open == []
    return found


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> ReportPaths:
    results = fabricated_results(("one",), ("default", "default-seen", "rad-gp-pis", "sacha"))
    return write_report(results, tmp_path_factory.mktemp("report"), conditions={"Machine": "a < b & c"})


def test_the_page_holds_every_figure_and_fetches_nothing(paths: ReportPaths) -> None:
    page = outline(paths)
    figures = [source for source in page.sources if source.startswith("data:image/")]
    assert len(figures) == len(paths.figures) >= 3
    for source in figures:
        data = base64.b64decode(source.partition(",")[2], validate=True)
        assert data.startswith((b"\x89PNG", b"<?xml"))
    assert all(source.startswith(("data:image/", "#")) for source in page.sources)
    assert "script" not in page.tags
    assert "url(" not in paths.html.read_text(encoding="utf-8")
    assert "a < b & c" in page.text


def test_the_markdown_names_every_figure_that_was_written(paths: ReportPaths) -> None:
    text = paths.markdown.read_text(encoding="utf-8")
    named = re.findall(r"\]\(<(.+?)>\)", text)
    assert [paths.markdown.parent / name for name in named] == list(paths.figures)
    assert all(figure.read_bytes().startswith(b"\x89PNG") for figure in paths.figures)


def test_csv_and_json_hold_the_same_figures(paths: ReportPaths) -> None:
    with paths.csv.open(newline="", encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    record = json.loads(paths.json.read_text(encoding="utf-8"))
    assert len(lines) == len(record["entries"])
    for line, entry in zip(lines, record["entries"], strict=True):
        assert line["quantity"] == entry["quantity"]
        assert line["mean"] == ("" if entry["mean"] is None else repr(entry["mean"]))
        seeds = dict(pair.split("=") for pair in line["by_seed"].split(";") if pair)
        assert {seed: float(value) for seed, value in seeds.items()} == entry["by_seed"]
    assert record["conditions"]["Machine"] == "a < b & c"
    assert {target["verdict"] for target in record["targets"]} <= {"held", "not held", "not decided"}


def test_the_same_results_give_the_same_files(paths: ReportPaths, tmp_path: Path) -> None:
    results = fabricated_results(("one",), ("default", "default-seen", "rad-gp-pis", "sacha"))
    again = write_report(results, tmp_path, conditions={"Machine": "a < b & c"})
    for name in ("html", "markdown", "csv", "json"):
        assert getattr(again, name).read_bytes() == getattr(paths, name).read_bytes(), name


@pytest.mark.parametrize(
    "results",
    [
        pytest.param(fabricated_results(("one",), ("sacha",), seeds=1), id="one run"),
        pytest.param(fabricated_results(("one",), levels=(0,), seeds=2), id="nothing coded"),
        pytest.param(fabricated_results(("one",), levels=(0, 2), seeds=2), id="one level"),
        pytest.param(fabricated_results(("one",), levels=(), seeds=2), id="nothing judged"),
        pytest.param(fabricated_results(("one",), flip=False, seeds=2), id="no FLIP"),
        pytest.param(fabricated_results(("one",), ("a new one", "default"), seeds=2), id="unknown variant"),
        pytest.param(
            (fabricated("one", "sacha", 0, (0, 1, 2)), fabricated("one", "default", 1), fabricated("two", "rad", 7, (0, 4))),
            id="nothing matches",
        ),
    ],
)  # fmt: skip
def test_what_is_missing_is_said_and_breaks_nothing(results: tuple, tmp_path: Path) -> None:
    page = outline(write_report(results, tmp_path))
    assert "nan" not in re.sub(r"[a-z]*nan[a-z]+|[a-z]+nan", "", page.text.lower())
    if len({result.seed for result in results if result.dataset == "one"}) == 1:
        assert "one seed only" in page.text


def test_missing_seeds_are_named(tmp_path: Path) -> None:
    results = [result for result in fabricated_results(("one",)) if (result.variant, result.seed) != ("sacha", 1)]
    text = outline(write_report(results, tmp_path)).text
    assert "sacha has no run with seed 1." in text
    assert "2 of 3 (no 1)" in text


def test_names_cannot_break_out_of_the_page(tmp_path: Path) -> None:
    wicked = '<script>alert("1")</script>|*`'
    results = [
        replace(result, dataset=wicked, variant=wicked if result.variant == "sacha" else result.variant)
        for result in fabricated_results(("one",), seeds=1)
    ]
    paths = write_report(results, tmp_path, conditions={wicked: wicked})
    page = outline(paths)
    assert "script" not in page.tags
    assert wicked in page.text
    assert all(figure.parent == tmp_path / "figures" for figure in paths.figures)
    assert "<script>" not in paths.markdown.read_text(encoding="utf-8").replace("\\<", "")


def test_one_target_missed_is_enough_to_miss_all() -> None:
    def outcome(verdict: Verdict) -> Outcome:
        return Outcome("", Entry("", "", "sacha", "", "", Seeds({})), verdict, "")

    assert tally([outcome("held")] * 2) == "held\n2 held"
    assert tally([outcome("held"), outcome("not decided")]) == "not decided\n1 held, 1 not decided"
    assert tally([outcome("held"), outcome("not held"), outcome("not decided")]).startswith("not held")


def test_no_results_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="no results"):
        write_report([], tmp_path)
    assert not list(tmp_path.iterdir())
