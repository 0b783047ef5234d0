"""Checkpoints come back to the bit, and damaged ones are refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.density.events import OpacityReset
from sacha_core.errors import FormatError
from sacha_core.npz import read_npz, write_npz
from sacha_core.train.checkpoint import Checkpoint, differing, read_checkpoint, require_fit, write_checkpoint
from sacha_core.train.faults import Fault, Faults
from sacha_core.train.presets import scaled
from sacha_core.train.state import initial_state


@pytest.fixture
def path(tmp_path: Path) -> Path:
    state = initial_state(initial_gaussians(7, np.random.default_rng(0)), Motion.rest(0, 2, 3), 8, 3e-4, 0.2)
    state.iteration = 12
    write_checkpoint(tmp_path / "c.npz", Checkpoint(state, scaled(100), (OpacityReset(3, 0.01, 7),), {"views": 4}))
    return tmp_path / "c.npz"


def test_a_checkpoint_comes_back_and_is_written_the_same_again(path: Path) -> None:
    back = read_checkpoint(path)
    assert (back.state.iteration, len(back.state), back.options, back.data) == (12, 7, scaled(100), {"views": 4})
    write_checkpoint(path.with_name("d.npz"), back)
    assert path.read_bytes() == path.with_name("d.npz").read_bytes()


def test_faults_come_back(path: Path) -> None:
    checkpoint = read_checkpoint(path)
    checkpoint.state.faults = Faults().and_one(Fault(3, "position", 5)).and_one(Fault(4, "loss", 0))
    write_checkpoint(path, checkpoint)
    assert read_checkpoint(path).state.faults == Faults(2, Fault(3, "position", 5))


def test_a_checkpoint_of_the_version_before_is_read_as_what_it_was(path: Path) -> None:
    arrays, expected = read_npz(path), read_checkpoint(path)
    header = json.loads(str(arrays["header"]))
    header["version"] = 1
    del header["faults"], header["options"]["device"], header["options"]["cameras_per_step"]
    del header["options"]["density"]["gradient"]
    write_npz(path, arrays | {"header": np.array(json.dumps(header))})
    back = read_checkpoint(path)
    assert back.options == replace(expected.options, device="cpu")
    assert back.state.faults == Faults()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("header", None),
        ("first.sh_dc", None),
        ("header", np.array("[]")),
        ("header", np.array("{")),
        ("header", np.array("[" * 100_000)),
        ("events", np.array("?")),
        ("binding", np.zeros(7, np.int64)),
        ("values.position", np.zeros((6, 3), np.float32)),
        ("second.position", np.zeros((7, 2), np.float32)),
        ("first.opacity_logit", np.zeros(7)),
        ("gradient_sum", np.zeros(3, np.float32)),
        ("values.opacity_logit", np.full(7, np.nan, np.float32)),
        ("second.sh_dc", np.full((7, 3), np.inf, np.float32)),
        ("second.sh_dc", np.full((7, 3), -1e-9, np.float32)),
        ("values.position", np.array(["a", "b"])),
        ("values.position", np.array(np.nan, np.float32)),
        ("binding", np.arange(7, dtype=np.int32)[::-1].copy()),
        ("header", {"faults": {"count": 1}}),
        ("header", {"version": 0}),
        ("header", {"version": 3}),
        ("header", {"iteration": math.inf}),
        ("header", {"iteration": -1}),
        ("header", {"steps": {"gaussians": -1, "motion": 0}}),
    ],
)
def test_damage_is_refused(path: Path, name, value) -> None:
    arrays = {key: array for key, array in read_npz(path).items() if key != name}
    if isinstance(value, dict):
        value = np.array(json.dumps(json.loads(str(read_npz(path)["header"])) | value))
    write_npz(path, arrays | ({} if value is None else {name: value}))
    with pytest.raises(FormatError, match=r"c\.npz"):
        read_checkpoint(path)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("binding", np.full(7, 7, np.int32), "triangle"),
        ("binding", np.full(7, -1, np.int32), "triangle"),
        ("values.sh_rest", np.zeros((7, 3, 3), np.float32), "sh_rest"),
        ("values.expression", np.zeros((3, 3), np.float32), "expression"),
        ("thresholds", np.zeros(7), "thresholds"),
        ("ratios", np.zeros(8, np.float32), "ratios"),
        ("gradient_count", np.zeros(7), "gradient_count"),
        ("gradient_count", np.full(7, -1, np.int32), "gradient_count"),
        ("gradient_sum", np.full(7, np.nan, np.float32), "gradient_sum"),
        ("thresholds", np.full(8, np.nan), "thresholds"),
        ("ratios", np.full(8, 1.1), "ratios"),
    ],
)
def test_what_is_whole_but_of_another_run_is_refused(path: Path, name, value, message) -> None:
    """A checkpoint with a right header whose arrays would take the kernels out of bounds."""
    fresh = initial_state(initial_gaussians(7, np.random.default_rng(1)), Motion.rest(0, 2, 3), 8, 3e-4, 0.2)
    require_fit(path, read_checkpoint(path).state, fresh, 7)
    both = {name.replace("values", kind): value for kind in ("values", "first", "second")}
    write_npz(path, read_npz(path) | both)
    with pytest.raises(FormatError, match=rf"c\.npz: .*{message}"):
        require_fit(path, read_checkpoint(path).state, fresh, 7)


def test_a_difference_is_named_and_what_changes_nothing_is_none() -> None:
    a = scaled(6000, "default")
    assert differing(a, replace(a, threads=3, checkpoint_every=9, image_cache_bytes=1)) is None
    assert differing(a, replace(a, losses=replace(a.losses, ssim=0.3))) == "losses.ssim (0.2 and 0.3)"
    for name in ("rad", "rad-gp-lgs", "default-gp-pis", "paper", "sacha"):
        assert differing(a, scaled(6000, name)) is not None
        assert differing(a, scaled(6000, name), until_warm_up=True) is None
    assert differing(a, scaled(6000, "ga"), until_warm_up=True) is not None
    sooner = replace(a, schedule=replace(a.schedule, densify_until=a.schedule.warm_up - 1))
    assert "densify_until" in (differing(a, sooner, until_warm_up=True) or "")
