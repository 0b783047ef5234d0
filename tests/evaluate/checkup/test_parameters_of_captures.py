"""Is a parameter noticed that no head has? Oracle: one is put into a sound motion, and must be the one that is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.motion import Motion
from sacha_core.evaluate.checkup.heads import judge_head, kept_heads
from sacha_core.evaluate.checkup.parameters import judge_parameters
from sacha_core.evaluate.checkup.silhouette import coarse_mask
from sacha_core.evaluate.coverage import foreground
from sacha_core.flame.head_file import save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.open import open_head
from sacha_core.flame.synthetic import synthetic_head

N_FRAMES = 30


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


@pytest.fixture
def motion(head: HeadModel) -> Motion:
    rng = np.random.default_rng(3)
    rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], N_FRAMES)
    small = {name: rng.normal(0, 0.05, getattr(rest, name).shape).astype(np.float32) for name in ("neck", "jaw")}
    return replace(rest, expression=rng.normal(0, 1, rest.expression.shape).astype(np.float32), **small)


def changed(motion: Motion, name: str, row: int, value: float) -> Motion:
    values = getattr(motion, name).copy()
    values[row, 0] = value
    return replace(motion, **{name: values})


def test_a_sound_motion_gives_no_finding(motion: Motion, head: HeadModel) -> None:
    assert not judge_parameters(motion, head)


@pytest.mark.parametrize(
    ("name", "value"),
    [("rotation", 2.5), ("neck", 1.5), ("jaw", 1.6), ("eyes", 2.0), ("expression", 20.0), ("translation", 900.0)],
)
def test_a_value_out_of_range_is_named_with_its_timestep(
    motion: Motion, head: HeadModel, name: str, value: float
) -> None:
    found = judge_parameters(changed(motion, name, 7, value), head)
    assert found
    assert all(finding.severity == "warning" and name in finding.what for finding in found)
    assert any("timestep 7" in finding.what for finding in found)


def test_one_timestep_that_jumps_is_an_outlier(motion: Motion, head: HeadModel) -> None:
    (finding,) = judge_parameters(changed(motion, "translation", 11, 0.4), head)
    assert "translation[0] is 0.4 at timestep 11" in finding.what


def test_wrong_units_of_offsets_and_shape(motion: Motion, head: HeadModel) -> None:
    offsets = np.zeros((head.n_vertices, 3), np.float32)
    offsets[4] = 3.0
    (finding,) = judge_parameters(replace(motion, static_offset=offsets), head)
    assert "static_offset moves a vertex by 5196 mm" in finding.what
    shape = motion.shape.copy()
    shape[0] = 40
    (finding,) = judge_parameters(replace(motion, shape=shape), head)
    assert "shape reaches 40" in finding.what


def test_a_head_of_other_sizes_is_an_error(motion: Motion, head: HeadModel) -> None:
    wide = np.pad(motion.expression, ((0, 0), (0, 3)), constant_values=0.5)
    (finding,) = judge_parameters(replace(motion, expression=wide), head)
    assert (finding.severity, finding.about) == ("error", "head")
    assert f"uses component {wide.shape[1] - 1}" in finding.what
    unused = np.pad(motion.expression, ((0, 0), (0, 3)))  # components that are zero everywhere cost nothing
    assert not judge_parameters(replace(motion, expression=unused), head)
    offsets = np.zeros((head.n_vertices + 1, 3), np.float32)
    (finding,) = judge_parameters(replace(motion, static_offset=offsets), head)
    assert (finding.severity, finding.about) == ("error", "head")


def test_a_head_that_never_moves_its_face(motion: Motion, head: HeadModel) -> None:
    (finding,) = judge_parameters(
        replace(motion, expression=np.zeros_like(motion.expression), jaw=np.zeros_like(motion.jaw)), head
    )
    assert f"the same at all {N_FRAMES} timesteps" in finding.what


def test_the_head_that_a_capture_was_tracked_with_is_found(framed, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As between FLAME 2020 and 2023: the same sizes, other shapes."""
    template = framed.head.v_template * np.float32([1.15, 1.0, 0.9])
    wrong = replace(framed.head, name="another", v_template=template)
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path))
    save_head(framed.head, tmp_path / "kept.npz")
    (tmp_path / "damaged.npz").write_bytes(b"no head")
    views = (*framed.capture.train, *framed.capture.test)
    masks = [coarse_mask(foreground(framed.capture, view)) for view in views]
    others = kept_heads(wrong)
    (finding,) = judge_head(framed.motion, wrong, others, views, masks)
    assert finding.about == "head"
    assert f"tracked with {framed.head.name!r}" in finding.what
    assert finding.remedy.endswith(f"try --head {tmp_path / 'kept.npz'}")
    assert open_head(tmp_path / "kept.npz").reference == framed.head.reference
    assert not judge_head(framed.motion, framed.head, {tmp_path / "wrong.npz": wrong}, views, masks)
    assert kept_heads(framed.head) == {}
