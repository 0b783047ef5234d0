"""Parts of a scene, from the engine's dataclasses to what the add-on reads."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sacha_core.scene.contents import Scene
from sacha_core.scene.folder import write_scene

READER = Path(__file__).parents[2] / "addon" / "opening" / "scene_folder.py"


@dataclass(frozen=True)
class Hat:
    """Stands for any part."""

    brim: np.ndarray
    band: np.ndarray | None
    feather: np.ndarray | None
    colour: str
    sizes: list[int]
    owner: str | None


@dataclass(frozen=True)
class Dressed(Scene):
    """A scene with a part that scenes do not have."""

    hat: Hat | None = None


def test_the_add_on_reads_back_each_part_that_is_there(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("scene_folder", READER)
    reader = importlib.util.module_from_spec(spec)
    sys.modules["scene_folder"] = reader  # dataclasses look their module up
    spec.loader.exec_module(reader)
    rng = np.random.default_rng(3)
    hat = Hat(rng.random((4, 3)), rng.integers(0, 9, 5), None, "green", [1, 2], None)
    triangle = (np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    for name, worn in (("bare", None), ("dressed", hat)):
        write_scene(Dressed("x", "mesh", "", *triangle, None, {}, [], [], hat=worn), tmp_path / name)
    assert reader.read_scene_folder(tmp_path / "bare").parts == {}
    part = reader.read_scene_folder(tmp_path / "dressed").parts["hat"]
    assert set(part.arrays) == {"brim", "band"}
    assert np.array_equal(part.arrays["brim"], hat.brim)
    assert np.array_equal(part.arrays["band"], hat.band)
    assert part.values == {"colour": "green", "sizes": [1, 2]}
