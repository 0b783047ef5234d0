"""Whatever a user names becomes the head that it is, or one clear line; the shelf gives back what it was given."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from sacha_core.errors import FormatError, GeometryError, HeadError
from sacha_core.flame.head_file import load_head, save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.open import open_head
from sacha_core.flame.rig import read_rig
from sacha_core.flame.shelf import find_head, remember, shelf_folder
from sacha_core.interchange.splat_ply import read_bound_ply

NAMES = np.array(["jawOpen", "smile"])


def rig_arrays(v: int = 30, n_faces: int = 20, **changes: object) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    made = {
        "verts": rng.normal(size=(v, 3)),
        "faces": np.array([rng.choice(v, 3, replace=False) for _ in range(n_faces)]),
        "arkit_deltas": rng.normal(size=(2, v, 3)),
        "arkit_names": NAMES,
        "verts_subdiv": np.zeros((7, 3)),
    }
    return {name: array for name, array in (made | changes).items() if array is not None}


def flame_pickle(path: Path) -> Path:
    """A pickle of FLAME's counts and random numbers, half precision to be small."""
    rng = np.random.default_rng(0)
    v = 5023
    weights = np.zeros((v, 5))
    weights[np.arange(v), rng.integers(5, size=v)] = 1
    content = {
        "v_template": rng.normal(size=(v, 3)),
        "f": (rng.integers(v - 2, size=(9976, 1)) + np.arange(3)).astype(np.uint32),
        "shapedirs": rng.normal(size=(v, 3, 302)).astype(np.float16),
        "posedirs": rng.normal(size=(v, 3, 36)).astype(np.float16),
        "J_regressor": csc_matrix(np.eye(5, v)),
        "kintree_table": np.array([[2**32 - 1, 0, 1, 1, 1], np.arange(5)], np.int64),
        "weights": weights,
    }
    path.write_bytes(pickle.dumps(content, 2))
    return path


@pytest.fixture
def shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "shelf"))
    return tmp_path / "shelf"


def test_head_models(random_head: HeadModel, tmp_path: Path) -> None:
    save_head(random_head, tmp_path / "a.npz")
    assert open_head(tmp_path / "a.npz").reference == random_head.reference
    assert open_head(str(tmp_path / "a.npz")).name == "random"


def test_rigs(tmp_path: Path) -> None:
    arrays = rig_arrays()
    np.savez(tmp_path / "rig.npz", **arrays)
    head = open_head(tmp_path / "rig.npz")
    assert head.reference == read_rig(tmp_path / "rig.npz").reference
    assert (head.name, head.expression_names, head.shapedirs.shape) == ("rig", ("jawOpen", "smile"), (30, 3, 0))
    np.testing.assert_allclose(head.exprdirs[:, :, 1], arrays["arkit_deltas"][1].astype(np.float32))
    low = arrays["verts"][:, 1] <= np.ptp(arrays["verts"][:, 1]) / 10 + arrays["verts"][:, 1].min()
    np.testing.assert_allclose(head.J_regressor @ head.v_template, arrays["verts"][low].mean(axis=0)[None], atol=1e-6)
    assert (head.weights == 1).all()


def test_a_rigs_root_is_the_centre_of_its_neck_where_it_has_one(tmp_path: Path) -> None:
    arrays = rig_arrays(mask_neck=np.array([3, 4, 4, 9]))
    np.savez(tmp_path / "rig.npz", **arrays)
    head = open_head(tmp_path / "rig.npz")
    np.testing.assert_allclose(
        head.J_regressor @ head.v_template, arrays["verts"][[3, 4, 9]].mean(axis=0)[None], atol=1e-6
    )


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"faces": np.array([[0, 1, 2], [3, 3, 4]])}, GeometryError, "triangle 1 has zero area"),
        ({"faces": np.array([[0, 1, 30]])}, HeadError, "faces of head 'rig' has index 30"),
        ({"faces": None}, FormatError, "holds neither a head model .* nor a rig .* it holds verts, arkit_deltas"),
        ({"faces": np.zeros((0, 3), int)}, HeadError, "at least one triangle"),
        ({"verts": np.zeros((30, 2))}, FormatError, r"verts of rig 'rig' has shape \(30, 2\)"),
        ({"verts": np.zeros((0, 3))}, FormatError, "arkit_deltas of rig 'rig' has shape"),
        ({"verts": np.full((30, 3), np.nan)}, HeadError, "v_template of head 'rig' is not finite"),
        ({"arkit_deltas": np.zeros((2, 29, 3))}, FormatError, "arkit_deltas of rig 'rig' has shape"),
        ({"arkit_deltas": np.full((2, 30, 3), np.inf)}, HeadError, "exprdirs of head 'rig' is not finite|zero"),
        ({"arkit_names": np.array(["a"])}, HeadError, "has 1 different names of expressions, but directions for 2"),
        (
            {"arkit_names": np.array(["a", "a"])},
            HeadError,
            "has 1 different names of expressions, but directions for 2",
        ),
        ({"mask_neck": np.array([99])}, HeadError, "mask 'neck' of head 'rig' has index 99"),
    ],
)
def test_wrong_rigs_are_named(tmp_path: Path, changes: dict[str, object], error: type[Exception], message: str) -> None:
    np.savez(tmp_path / "rig.npz", **rig_arrays(**changes))
    with pytest.raises(error, match=rf"rig\.npz: .*{message}|rig\.npz: {message}"):
        open_head(tmp_path / "rig.npz")


def test_flame_pickles_get_teeth_and_masks(tmp_path: Path, shelf: Path) -> None:
    path = flame_pickle(tmp_path / "flame.pkl")
    np.savez(tmp_path / "masks.npz", lips=np.arange(9), neck=np.array([5022]))
    head = open_head(path, tmp_path / "masks.npz")
    assert (head.n_vertices, head.n_faces, head.n_teeth_faces) == (5143, 10144, 168)
    assert head.masks["neck"].tolist() == [5022]
    bare = open_head(path, teeth=False)
    assert (bare.n_vertices, bare.n_faces) == (5023, 9976)
    assert find_head(bare.reference, path).n_vertices == 5023
    assert find_head(head.reference, path).reference == head.reference
    np.savez(tmp_path / "masks.npz", lips=np.array([5023]))
    with pytest.raises(HeadError, match="mask 'lips' has vertex 5023, expected 0 to 5022"):
        open_head(path, tmp_path / "masks.npz")


def test_masks_of_another_topology(random_head: HeadModel, tmp_path: Path) -> None:
    save_head(random_head, tmp_path / "a.npz")
    np.savez(tmp_path / "masks.npz", lips=np.arange(9))
    with pytest.raises(HeadError, match="fit heads of FLAME's topology; 'random' has 30 vertices, 40 triangles"):
        open_head(tmp_path / "a.npz", tmp_path / "masks.npz")


def test_what_is_no_head(tmp_path: Path) -> None:
    with pytest.raises(HeadError, match=r"no head '.*nowhere\.npz': give a head model or rig"):
        open_head(tmp_path / "nowhere.npz")
    for content in (b"", b"hello", b"# made by hand\nv 0 0 0\n", b"ply\nformat ascii 1.0\n"):
        (tmp_path / "a.npz").write_bytes(content)
        with pytest.raises(FormatError, match=r"a\.npz: neither an .npz archive .* nor a FLAME pickle"):
            open_head(tmp_path / "a.npz")
    (tmp_path / "a.pkl").write_bytes(b"\x80\x02}")
    with pytest.raises(FormatError, match=r"a\.pkl: damaged pickle \(EOFError"):
        open_head(tmp_path / "a.pkl")
    np.savez(tmp_path / "a.npz", v_template=np.zeros((3, 3)), shapedirs50=np.zeros(3))
    with pytest.raises(FormatError, match=r"a\.npz: head 'a' lacks faces, shapedirs"):
        open_head(tmp_path / "a.npz")


def test_zero_areas_are_found_in_every_kind_of_head(random_head: HeadModel, tmp_path: Path) -> None:
    faces = random_head.faces.copy()
    faces[7, 2] = faces[7, 1]
    save_head(replace(random_head, faces=faces), tmp_path / "a.npz")
    with pytest.raises(GeometryError, match=r"a\.npz: triangle 7 has zero area"):
        open_head(tmp_path / "a.npz")
    content = pickle.loads(flame_pickle(tmp_path / "a.pkl").read_bytes())
    content["f"][9] = 5
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content, 2))
    with pytest.raises(GeometryError, match=r"a\.pkl: triangle 9 has zero area"):
        open_head(tmp_path / "a.pkl")


def test_whole_numbers_make_a_rig_too(tmp_path: Path) -> None:
    made = {
        kind: rig_arrays(verts=np.random.default_rng(0).integers(99, size=(30, 3)).astype(kind))
        for kind in ("i2", "f8")
    }
    for kind, arrays in made.items():
        np.savez(tmp_path / f"{kind}.npz", **arrays)
    assert open_head(tmp_path / "i2.npz").reference.sha256 == open_head(tmp_path / "f8.npz").reference.sha256


def test_names_are_one_printable_line(random_head: HeadModel, tmp_path: Path) -> None:
    save_head(replace(random_head, name="two\nlines \x1b[31mred"), tmp_path / "a.npz")
    assert open_head(tmp_path / "a.npz").name == "twolines [31mred"


def test_a_user_without_a_home_is_told_of_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("SACHA_HEADS", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    with pytest.raises(HeadError, match="set the environment variable SACHA_HEADS"):
        shelf_folder()


@pytest.mark.parametrize("name", ["synthetic:small", "synthetic-small-0", "synthetic:small:0"])
def test_synthetic_heads_by_name(name: str) -> None:
    assert open_head(name).name == "synthetic-small-0"


def test_names_that_only_look_synthetic(random_head: HeadModel, shelf: Path) -> None:
    with pytest.raises(HeadError, match="no head 'synthetic:huge'"):
        open_head("synthetic:huge")
    named = replace(random_head, name="synthetic-huge-0")
    assert remember(named) is not None
    assert find_head(named.reference).name == "synthetic-huge-0"


def test_the_shelf_gives_back_what_it_was_given(random_head: HeadModel, shelf: Path) -> None:
    assert shelf_folder() == shelf
    with pytest.raises(
        HeadError, match=r"head 'random' \(30 vertices, 40 triangles, SHA-256 .* name it with --head FILE"
    ):
        find_head(random_head.reference)
    path = remember(random_head)
    assert path is not None
    assert path.parent == shelf
    assert find_head(random_head.reference).reference == random_head.reference


def test_the_shelf_keeps_the_copy_with_masks(random_head: HeadModel, shelf: Path) -> None:
    for head in (replace(random_head, masks={}), random_head, replace(random_head, masks={})):
        path = remember(head)
    assert path is not None
    assert load_head(path).masks.keys() == random_head.masks.keys()


def test_explicit_goes_before_embedded_before_shelf(random_head: HeadModel, tmp_path: Path, shelf: Path) -> None:
    remember(replace(random_head, name="shelved"))
    embedded = replace(random_head, name="embedded")
    save_head(replace(random_head, name="explicit"), tmp_path / "a.npz")
    assert find_head(random_head.reference).name == "shelved"
    assert find_head(random_head.reference, None, embedded).name == "embedded"
    assert find_head(random_head.reference, tmp_path / "a.npz", embedded).name == "explicit"


def test_another_head_is_refused(random_head: HeadModel, tmp_path: Path, shelf: Path) -> None:
    other = replace(random_head, v_template=random_head.v_template + 1)
    save_head(other, tmp_path / "a.npz")
    with pytest.raises(HeadError, match=r"a\.npz is not the head that the avatar is bound to: found 'random'"):
        find_head(random_head.reference, tmp_path / "a.npz")
    with pytest.raises(HeadError, match="the head inside the file is not the head"):
        find_head(random_head.reference, None, other)
    save_head(other, shelf / f"{random_head.reference.sha256}.npz")
    with pytest.raises(HeadError, match="is not the head that the avatar is bound to"):
        find_head(random_head.reference)


def test_digests_that_are_paths_lead_nowhere(random_head: HeadModel, shelf: Path) -> None:
    with pytest.raises(HeadError, match="neither in the file nor in"):
        find_head(replace(random_head.reference, sha256="../" * 21 + "a"))


def test_synthetic_heads_need_no_shelf(shelf: Path) -> None:
    head = open_head("synthetic:small")
    assert remember(head) is None
    assert not shelf.exists()
    assert find_head(head.reference).reference == head.reference
    with pytest.raises(HeadError, match="the head that 'synthetic-small-0' names here is not the head"):
        find_head(replace(head.reference, sha256="0" * 64))


@pytest.mark.real_data
def test_a_real_rig(real_data: Path, tmp_path: Path) -> None:
    path = real_data / "avatar_a_rig.npz"
    head = open_head(path, real_data / "FLAME_masks.npz")
    assert (head.n_vertices, head.n_faces, len(head.expression_names)) == (5023, 9976, 51)
    assert head.reference == open_head(path).reference
    read_bound_ply(real_data / "avatar_a_bound.ply", head.n_faces)
    root = (head.J_regressor @ head.v_template)[0]
    assert head.v_template[:, 1].min() < root[1] < head.v_template[:, 1].mean()
    with np.load(path) as arrays:
        broken = dict(arrays)
    broken["faces"] = broken["faces"].copy()
    broken["faces"][777, 2] = broken["faces"][777, 1]
    np.savez(tmp_path / "broken.npz", **broken)
    with pytest.raises(GeometryError, match=r"broken\.npz: triangle 777 has zero area"):
        open_head(tmp_path / "broken.npz")
