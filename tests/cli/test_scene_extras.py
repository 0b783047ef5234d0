"""What may be named besides an avatar: what it is compared with, its scores, regions of one's own; and what does not belong to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.cli.common import HeadSource
from sacha_core.cli.scene import Extras, open_scene
from sacha_core.codec import encode, inspect
from sacha_core.density.events import Calibration
from sacha_core.density.scores_file import Scores, write_scores
from sacha_core.errors import HeadError, OptionError, TopologyError
from sacha_core.flame.head_file import save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import PAPER
from sacha_core.regions.scheme_file import write_scheme_file

ROUNDING = 1e-6  # values are float32


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, head: HeadModel) -> Path:
    """Two avatars of a head, a.sacha of twice as many Gaussians on even triangles as b.sacha; scores of a; a head."""
    folder = tmp_path_factory.mktemp("extras")
    made = initial_gaussians(head.n_faces, np.random.default_rng(0), 0)
    for name, faces in (("a", np.repeat(np.arange(0, head.n_faces, 2), 2)), ("b", np.arange(0, head.n_faces, 2))):
        (folder / f"{name}.sacha").write_bytes(encode(Avatar(made.select(faces), head.reference, None), 2, head=head))
    save_head(head, folder / "head.npz")
    return folder


def scores_of(head: HeadModel) -> Scores:
    gaussians = initial_gaussians(head.n_faces, np.random.default_rng(1), 0)
    learned = replace(gaussians, sensitivity_logit=np.zeros(head.n_faces, np.float32))
    r = len(PAPER.regions)
    none, counts, numbers = (None,) * r, (0,) * r, tuple(float(place + 1) for place in range(r))
    event = Calibration(1, counts, counts, none, none, none, None, None, None, numbers, numbers, numbers, "plain")
    return Scores(learned, np.ones(head.n_faces), head.n_faces, PAPER.name, (event,))


def test_a_comparison_is_here_less_there(folder: Path, head: HeadModel) -> None:
    scene = open_scene(folder / "a.sacha", HeadSource(), Extras(compare=folder / "b.sacha"))
    assert scene.views["count_change"].values.tolist() == [1 - face % 2 for face in range(head.n_faces)]
    assert scene.regions is not None
    assert scene.regions.bytes_change is not None
    sizes = [inspect(folder / f"{name}.sacha").gaussian_bytes for name in "ab"]
    assert scene.regions.bytes_change.sum() == sizes[0] - sizes[1]
    assert scene.views["bytes"].values.sum() == pytest.approx(sizes[0], rel=ROUNDING)
    same = open_scene(folder / "a.sacha", HeadSource(), Extras(compare=folder / "a.sacha"))
    for name, view in same.views.items():
        if name.endswith("_change"):
            assert not np.nan_to_num(view.values).any(), name


def test_scores_are_named_or_lie_beside_the_avatar(folder: Path, head: HeadModel, tmp_path: Path) -> None:
    write_scores(tmp_path / "elsewhere.npz", scores_of(head))
    told = {"sensitivity", "modulator", "threshold", "ratio"}
    assert not told & open_scene(folder / "a.sacha", HeadSource()).views.keys()
    named = open_scene(folder / "a.sacha", HeadSource(), Extras(scores=tmp_path / "elsewhere.npz"))
    assert told <= named.views.keys()
    (tmp_path / "a.sacha").write_bytes((folder / "a.sacha").read_bytes())
    write_scores(tmp_path / "a.scores.npz", scores_of(head))
    assert told <= open_scene(tmp_path / "a.sacha", HeadSource()).views.keys()


def test_scores_of_another_head_are_refused_where_they_are_named_and_else_let_be(
    folder: Path, head: HeadModel, tmp_path: Path
) -> None:
    (tmp_path / "a.sacha").write_bytes((folder / "a.sacha").read_bytes())
    write_scores(tmp_path / "a.scores.npz", replace(scores_of(head), n_faces=head.n_faces + 1))
    assert "threshold" not in open_scene(tmp_path / "a.sacha", HeadSource()).views
    with pytest.raises(TopologyError, match=f"of a head of {head.n_faces + 1} triangles"):
        open_scene(tmp_path / "a.sacha", HeadSource(), Extras(scores=tmp_path / "a.scores.npz"))


def test_avatars_of_other_triangles_are_not_compared(folder: Path, head: HeadModel, tmp_path: Path) -> None:
    turned = replace(head, name="turned", faces=np.roll(head.faces, 1, axis=1))
    save_head(turned, tmp_path / "turned.npz")
    gaussians = initial_gaussians(head.n_faces, np.random.default_rng(0), 0)
    other = encode(Avatar(gaussians, turned.reference, None), 2, head=turned, embed_head=True)
    (tmp_path / "other.sacha").write_bytes(other)
    with pytest.raises(TopologyError, match="only avatars of one head can be compared"):
        open_scene(folder / "a.sacha", HeadSource(), Extras(compare=tmp_path / "other.sacha"))


def test_regions_of_ones_own_take_the_place_of_the_avatars(folder: Path, head: HeadModel, tmp_path: Path) -> None:
    labels = (np.arange(head.n_faces) < head.n_faces // 2).astype(np.uint8)
    write_scheme_file(
        tmp_path / "halves.scheme.npz", Partition("halves", ("back", "front"), ((1, 2, 3), (9, 8, 7)), labels)
    )
    for name in ("a.sacha", "head.npz"):
        scene = open_scene(folder / name, HeadSource(), Extras(scheme=tmp_path / "halves.scheme.npz"))
        assert scene.regions is not None
        assert (scene.regions.scheme, scene.regions.names) == ("halves", ("back", "front"))
        assert np.array_equal(scene.views["region"].values, labels)


def test_only_avatars_have_scores_and_comparisons(folder: Path) -> None:
    for extras in (Extras(compare=folder / "b.sacha"), Extras(scores=folder / "b.scores.npz")):
        with pytest.raises(OptionError, match="is no avatar"):
            open_scene(folder / "head.npz", HeadSource(), extras)


def test_a_head_named_wrongly_is_refused(folder: Path, head: HeadModel, tmp_path: Path) -> None:
    save_head(replace(head, name="wider", v_template=head.v_template * np.float32(1.1)), tmp_path / "wider.npz")
    with pytest.raises(HeadError):
        open_scene(folder / "a.sacha", HeadSource(head=str(tmp_path / "wider.npz")), Extras(compare=folder / "b.sacha"))
