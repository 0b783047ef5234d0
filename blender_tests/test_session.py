"""What must be seen: one sitting from opening an avatar to the file that leaves, from the installed zip."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest
from conftest import ENGINE, Material
from session import Sitting, play

SHARE_OF_SIZE = 0.55  # what the budget leaves of the avatar's file
SMALL_ERROR = 0.25  # mean brightness of a picture in which 1 is what is painted brightest
NEARLY_ALL = 0.85  # of the size asked for is used: Gaussians come in thousands of bits, quality in steps
FEWEST_VIEWS = {"region", "count", "density", "opacity"}  # what every avatar has


@pytest.fixture(scope="module")
def sitting(installed: str, material: Material, tmp_path_factory: pytest.TempPathFactory) -> Sitting:
    """Play it once, in an empty scene."""
    folder = tmp_path_factory.mktemp("sitting")
    source = shutil.copy(material.folder / "avatar.sacha", folder)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.preferences.addons[installed].preferences.engine_python = ENGINE
    played = play(Sitting(Path(source), folder, Path(source).stat().st_size * SHARE_OF_SIZE / 1000))
    print({step: round(seconds, 2) for step, seconds in played.seconds.items()})  # noqa: T201
    return played


def test_every_view_shows_something_of_its_own(sitting: Sitting) -> None:
    views = {name: picture for name, picture in sitting.pictures.items() if picture.dtype == np.uint8}
    assert set(views) >= FEWEST_VIEWS
    outline = views["region"][..., 3] > 0
    assert 0.2 < outline.mean() < 0.9
    for name, picture in views.items():
        assert np.array_equal(picture[..., 3] > 0, outline), name  # the head stands still
        assert len(np.unique(picture[outline], axis=0)) > 3, name
    different = {picture.tobytes() for name, picture in views.items() if " by region" not in name and name != "steered"}
    assert len(different) >= len(FEWEST_VIEWS)


def test_the_favoured_region_keeps_more_at_the_same_size(sitting: Sitting) -> None:
    neutral, weighted = sitting.told["neutral"], sitting.told["weighted"]
    assert weighted["gaussians"][sitting.favoured] > neutral["gaussians"][sitting.favoured]
    others = [sum(told["spent"].values()) - told["spent"][sitting.favoured] for told in (neutral, weighted)]
    assert others[1] < others[0]  # somebody pays, in Gaussians or in how finely they are coded
    assert weighted["spent"][sitting.favoured] > neutral["spent"][sitting.favoured]
    for told in (neutral, weighted):
        assert NEARLY_ALL * sitting.target_kb * 1000 < told["n_bytes"] <= sitting.target_kb * 1000


def test_the_preview_is_a_picture_of_the_head_and_the_error_is_small(sitting: Sitting) -> None:
    preview, error = sitting.pictures["preview"], sitting.pictures["error"]
    assert preview.shape == error.shape
    assert preview[..., :3].std() > 0.05
    assert error.shape[:2] == (sitting.size, sitting.size)
    assert 0 < error[..., :3].mean() < SMALL_ERROR


def test_a_saved_file_keeps_everything(sitting: Sitting) -> None:
    after = sitting.told["after reload"]
    assert after == sitting.told["before reload"]
    assert after["weight"] == sitting.weight
    assert after["source"].endswith("weighted.sacha")
    assert after["gaussians"] == sitting.told["weighted"]["gaussians"]
    assert after["keys"] > 1


def test_what_leaves_is_smaller_and_comes_back(sitting: Sitting) -> None:
    assert 0 < sitting.told["encoded bytes"] < sitting.told["weighted"]["n_bytes"]
    # the lowest level leaves out what hardly shows
    assert 0 < sitting.told["decoded"] <= sum(sitting.told["weighted"]["gaussians"].values())
