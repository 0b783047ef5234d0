"""What `sacha bench codec` is given: avatars as they are, splats bound to the head that is named, or left where they stand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.animation.standing import Standing
from sacha_core.bench.scenes import made_avatar
from sacha_core.cli.codec_subjects import Sources, subjects_of
from sacha_core.cli.common import HeadSource
from sacha_core.errors import OptionError
from sacha_core.interchange.splat_ply import is_bound_ply, write_bound_ply, write_world_ply
from sacha_core.train.framewise import read_frames

AVATAR, HEAD = made_avatar(300, 0, 2)
AT_REST = Standing(AVATAR.gaussians, HEAD, None)(0)
ROUNDED_M = 1e-5  # there and back through float32 triangle units


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    write_world_ply(tmp_path / "scene.ply", AT_REST, 0)
    return tmp_path / "scene.ply"


def sources(path: Path, head: str | None = None, motion: Path | None = None, truth: bool = False) -> Sources:
    return Sources((path,), HeadSource(head=head), motion, truth)


def test_splats_on_a_head_are_bound_where_they_stand_and_move_in_stock_expressions(scene: Path) -> None:
    """Oracle: the head at rest gives every splat its place back."""
    (subject,) = subjects_of(sources(scene, "synthetic"))
    assert subject.bound
    back = Standing(subject.avatar.gaussians, subject.head, None)(0)
    assert np.abs(back.position - AT_REST.position).max() < ROUNDED_M
    assert subject.avatar.motion is not None
    assert len(subject.avatar.motion) > 10
    assert "was bound to head" in subject.note
    assert "in stock expressions, for want of --motion FILE" in subject.note


def test_splats_without_a_head_stay_in_the_world(scene: Path) -> None:
    (subject,) = subjects_of(sources(scene))
    assert not subject.bound
    assert subject.avatar.motion is None


def test_an_avatar_without_a_motion_moves_in_stock_expressions(tmp_path: Path) -> None:
    write_bound_ply(tmp_path / "bound.ply", AVATAR.gaussians, 0)
    assert is_bound_ply(tmp_path / "bound.ply")
    (subject,) = subjects_of(sources(tmp_path / "bound.ply", "synthetic"))
    assert subject.bound
    assert subject.avatar.motion is not None
    assert subject.note == "bound.ply brings no motion; it is posed in stock expressions, for want of --motion FILE."


def test_splats_that_stand_elsewhere_are_not_bound(tmp_path: Path) -> None:
    write_world_ply(tmp_path / "room.ply", replace(AT_REST, position=AT_REST.position + np.float32(1)), 0)
    with pytest.raises(
        OptionError, match=r"300 of 300 Gaussians are over 50 mm from the head at rest; bind them with `sacha bind`"
    ):
        subjects_of(sources(tmp_path / "room.ply", "synthetic"))


def test_what_belongs_to_avatars_is_refused_for_splats_alone(scene: Path) -> None:
    with pytest.raises(OptionError, match="--motion belongs to an avatar"):
        subjects_of(sources(scene, motion=Path("m.npz")))
    with pytest.raises(OptionError, match="--dataset belongs to an avatar"):
        subjects_of(sources(scene, truth=True))


def test_frames_are_read_by_their_timesteps(tmp_path: Path) -> None:
    for step in (12, 3):
        (tmp_path / f"frame_{step:04d}").mkdir()
        write_world_ply(tmp_path / f"frame_{step:04d}" / "point_cloud.ply", AT_REST.select(np.arange(step)), 0)
    (tmp_path / "frame_0020").mkdir()  # interrupted before its end
    assert {step: len(splats) for step, splats in read_frames(tmp_path).items()} == {3: 3, 12: 12}
