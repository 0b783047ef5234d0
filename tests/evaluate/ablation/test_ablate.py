"""Whole ablations of a tiny capture: what is shared is done once, what is done is kept, and figures are those of the single steps."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.codec import decode
from sacha_core.errors import DatasetError, OptionError
from sacha_core.evaluate.ablation import work
from sacha_core.evaluate.ablation.ablate import ablate
from sacha_core.evaluate.ablation.datasets import keep_dataset, known_datasets
from sacha_core.evaluate.ablation.ledger import read_results
from sacha_core.evaluate.ablation.plan import Judging, PlannedRun, planned_runs, shared_warm_ups
from sacha_core.evaluate.ablation.result import RunResult, read_result
from sacha_core.evaluate.ablation.variants import variant_options
from sacha_core.evaluate.executors.jobs import Job, Outcome, Unsettled, attempt
from sacha_core.evaluate.executors.local import LocalProcesses
from sacha_core.evaluate.views import evaluate_avatar
from sacha_core.interchange.gaussian_avatars import read_model
from sacha_core.progress import Report
from sacha_core.train.loop import train

JUDGING = Judging((1, 4), 3, ("psnr", "ssim"))
ITERATIONS = 40


class InTurn:
    """Does jobs here, one after the other."""

    threads = 1

    def run(self, jobs: Sequence[Job], report: Report) -> Iterator[Outcome]:
        unsettled = Unsettled(jobs)
        while unsettled:
            job = unsettled.take()
            assert job is not None
            yield from unsettled.settle(attempt(job, report))


def plan(
    subject, out: Path, *names: str, seeds: int = 1, judging: Judging = JUDGING, settings: Sequence[str] = ()
) -> tuple[PlannedRun, ...]:
    dataset = keep_dataset(out, subject.capture.root, subject.capture, subject.head)
    return planned_runs(out, [dataset], variant_options(names, ITERATIONS, settings), seeds, judging)


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Note which stages are done."""
    done: list[str] = []
    for name in ("train_warm_up", "train", "judge"):
        real = getattr(work, name)

        def noted(*arguments, _real=real, _name=name, **options):
            done.append(_name)
            return _real(*arguments, **options)

        monkeypatch.setattr(work, name, noted)
    return done


def timeless(result: RunResult) -> RunResult:
    points = tuple(replace(point, encode_s=0.0, decode_s=0.0) for point in result.points)
    return replace(result, training_seconds=0.0, points=points)


def contents(folder: Path) -> dict[str, bytes]:
    """Give what runs left that a clock has no part in."""
    kept = [
        *folder.rglob("*.ply"),
        *folder.rglob("*.sacha"),
        *folder.rglob("events.jsonl"),
        *folder.rglob("flame_param.npz"),
    ]
    return {str(path.relative_to(folder)): path.read_bytes() for path in kept if "warm-up" not in str(path)}


@pytest.fixture(scope="module")
def finished(subject, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished")
    done = ablate(plan(subject, out, "default", "rad-gp-pis", "ga"), InTurn())
    assert not done.failures
    return out


def test_a_result_holds_what_the_single_steps_give(subject, finished: Path) -> None:
    """Oracle: training throughout, decoding and judging by themselves."""
    run = plan(subject, finished, "rad-gp-pis")[0]
    result = read_result(run.result)
    alone = train(subject.capture, subject.head, replace(run.options, threads=1), finished / "alone")
    gaussians, motion = read_model(run.model)
    for name in ("position", "opacity_logit", "sh_rest", "binding"):
        np.testing.assert_array_equal(getattr(gaussians, name), getattr(alone.gaussians, name))
    assert (result.n, result.iterations, result.seed) == (len(gaussians), ITERATIONS, 0)
    assert result.empty_faces == subject.head.n_faces - len(set(gaussians.binding.tolist()))
    assert sum(region.n for region in result.regions.values()) == result.n
    assert sum(region.n_visible for region in result.regions.values()) == result.n_visible
    assert sum(region.n_before or 0 for region in result.regions.values()) > result.n
    assert [point.level for point in result.points] == [0, 1, 4]
    for point in result.points:
        file = run.folder / f"level-{point.level}.sacha"
        avatar = decode(file, head=subject.head) if point.level else None
        shown = (gaussians, motion) if avatar is None else (avatar.gaussians, avatar.motion)
        found = evaluate_avatar(shown[0], subject.head, subject.capture, shown[1], limit=3)
        assert point.novel_view.psnr == found.novel_view.psnr
        assert point.novel_expression.ssim == found.novel_expression.ssim
        assert point.novel_view.n_images == 3
        assert point.bytes.total == (file.stat().st_size if point.level else 252 * point.n + point.bytes.motion)
        assert point.bytes.total == point.bytes.gaussians + point.bytes.motion
        assert point.n == len(shown[0])


def test_variants_that_part_at_its_end_share_a_warm_up(subject, tmp_path: Path) -> None:
    """Oracle: by hand: GaussianAvatars' own threshold is another from the first iteration on."""
    runs = plan(subject, tmp_path, "default", "ga", "rad", "sacha", seeds=2)
    shared = shared_warm_ups(runs)
    assert {run.variant for run in shared} == {"default", "rad", "sacha"}
    assert len({warm_up.folder for warm_up in shared.values()}) == 2
    assert all(warm_up.folder.parent == run.seed_folder for run, warm_up in shared.items())


def test_a_warm_up_is_trained_once_and_what_is_done_is_kept(subject, stages: list[str], tmp_path: Path) -> None:
    """Oracle: the list of stages."""
    runs = plan(subject, tmp_path, "default", "rad", "sacha")
    assert ablate(runs[:2], InTurn()).kept == 0
    assert stages == ["train_warm_up", *["train", "judge"] * 2]
    stages.clear()
    done = ablate(runs, InTurn())
    assert done.kept == 2
    assert stages == ["train", "judge"]
    assert done.results == read_results(tmp_path)
    assert (tmp_path / runs[0].dataset.name / "dataset.json").is_file()
    assert known_datasets(tmp_path) == (runs[0].dataset,)


def test_only_judging_is_done_again_where_only_that_is_another(subject, stages: list[str], finished: Path) -> None:
    """Oracle: the list of stages, and the same model."""
    before = contents(finished)
    done = ablate(plan(subject, finished, "default", "rad-gp-pis", judging=Judging((4,), 2, ("psnr",))), InTurn())
    assert "train_warm_up" not in stages
    assert [point.level for point in done.results[0].points] == [0, 4]
    assert done.results[0].points[0].novel_view.n_images == 2
    again = ablate(plan(subject, finished, "default", "rad-gp-pis", "ga"), InTurn())
    assert again.kept == 1
    assert contents(finished) == before


def test_processes_give_the_same_bytes_as_doing_it_here(subject, finished: Path, tmp_path: Path) -> None:
    """Oracle: the other executor, to the byte."""
    done = ablate(plan(subject, tmp_path, "default", "rad-gp-pis", "ga"), LocalProcesses(2, 1))
    assert not done.failures
    here = ablate(plan(subject, finished, "default", "rad-gp-pis", "ga"), InTurn())
    assert [timeless(result) for result in done.results] == [timeless(result) for result in here.results]
    mine, theirs = contents(tmp_path), contents(finished)
    assert mine == {name: content for name, content in theirs.items() if not name.startswith("alone")}
    assert len(mine) == 3 * 5


def test_other_options_are_refused_or_done_anew(subject, stages: list[str], tmp_path: Path) -> None:
    """Oracle: the message; then which runs were trained again."""
    ablate(plan(subject, tmp_path, "default", "rad"), InTurn())
    changed = plan(subject, tmp_path, "default", "rad", settings=["rad:density.means=visible"])
    with pytest.raises(OptionError) as error:
        ablate(changed, InTurn())
    assert str(error.value) == (
        f"{changed[1].folder} is a run with another density.means (plain there, visible now); choose another folder, "
        "or do such runs anew with --restart"
    )
    stages.clear()
    assert ablate(changed, InTurn(), restart=True).kept == 1
    assert stages == ["train", "judge"]
    assert json.loads((changed[1].model / "options.json").read_text())["density"]["means"] == "visible"


def test_a_run_that_fails_takes_no_other_with_it(subject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the outcomes; then a second attempt that succeeds."""
    real = work.judge

    def failing(run, *arguments) -> None:
        if run.variant == "default":
            raise DatasetError("the disk has gone")
        if run.variant == "rad":
            raise RuntimeError("nobody thought of this")
        real(run, *arguments)

    runs = plan(subject, tmp_path, "default", "rad", "sacha")
    with monkeypatch.context() as patch:
        patch.setattr(work, "judge", failing)
        done = ablate(runs, InTurn())
    assert [result.variant for result in done.results] == ["sacha"]
    assert [outcome.error for outcome in done.failures] == ["the disk has gone", "RuntimeError: nobody thought of this"]
    assert "nobody thought of this" in (runs[1].folder / "failure.txt").read_text()
    again = ablate(runs, InTurn())
    assert (len(again.results), again.kept, again.failures) == (3, 1, ())


def test_a_failed_warm_up_fails_the_runs_that_wait_for_it(
    subject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the outcomes."""

    def failing(*arguments: object) -> None:
        raise DatasetError("no image")

    monkeypatch.setattr(work, "train_warm_up", failing)
    done = ablate(plan(subject, tmp_path, "default", "rad", "ga"), InTurn())
    assert [result.variant for result in done.results] == ["ga"]
    assert [outcome.error for outcome in done.failures] == [
        "no image",
        *[f"not begun, since {done.failures[0].name} failed"] * 2,
    ]


def test_two_captures_of_one_name_are_refused(subject, tmp_path: Path) -> None:
    """Oracle: the message."""
    dataset = keep_dataset(tmp_path, subject.capture.root, subject.capture, subject.head)
    with pytest.raises(OptionError, match="several datasets are called"):
        planned_runs(tmp_path, [dataset, dataset], variant_options(["default"], 40), 1, JUDGING)
    other = tmp_path / "elsewhere" / subject.capture.root.name
    with pytest.raises(DatasetError, match="is of the capture"):
        keep_dataset(tmp_path, other, subject.capture, subject.head)
    with pytest.raises(DatasetError, match="no held-out camera"):
        keep_dataset(tmp_path, subject.capture.root, replace(subject.capture, val=()), subject.head)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"levels": (0,)}, "levels are 0, expected some of 1, 2, 3, 4"),
        ({"levels": (1, 1)}, "levels are 1, 1, expected some of 1, 2, 3, 4"),
        ({"images": 0}, "0 images to judge by were asked for, expected at least 1"),
        ({"metrics": ("psnr", "beauty")}, "metric 'beauty' is unknown; expected some of psnr, ssim, flip, lpips"),
    ],
)
def test_judging_that_cannot_be_is_refused(changes: dict[str, object], line: str) -> None:
    """Oracle: the message."""
    with pytest.raises(OptionError) as error:
        Judging(**changes)
    assert str(error.value) == line
