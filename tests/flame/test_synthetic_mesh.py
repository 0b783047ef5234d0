"""The synthetic head at rest: a sound mesh, symmetric, unwrapped, with joints and regions where they belong, and the same everywhere."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from sacha_core.errors import OptionError
from sacha_core.flame.model import JOINTS, HeadModel
from sacha_core.flame.synthetic import EXPRESSIONS, IDENTITY, head_parts, synthetic_head
from sacha_core.flame.synthetic import head as head_module
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER

N_FACES = {"full": (9000, 10500), "small": (300, 700)}  # FLAME with teeth has 10144; "a few hundred"
N_COLUMNS = {"full": 60, "small": 12}
MASKS = {
    *("face", "neck", "scalp", "boundary", "forehead", "eye_region", "nose", "lips"),
    *(f"{side}_{part}" for side in ("left", "right") for part in ("eyeball", "ear", "eye_region")),
}
UV_PROBES = 1500  # points of the texture; 12 cells a side would be told apart
ROUNDING_M = 2.0**-20  # the head is rounded to this
# Golden: these heads are named by files, so they may change only with a line in CHANGELOG.
DIGESTS = {
    "full": "e412af6fa36c716da2c61f81f2c3ac7f1eec92022f9080f619cea47bb6615a42",
    "small": "d25dec970e598f4ad3f1c4e7a77b6bd40cb69e6f5cbe830ac7431a45b1dbb123",
}


def faces_of(head: HeadModel, vertices: np.ndarray) -> np.ndarray:
    return head.faces[np.isin(head.faces, vertices).all(axis=1)]


def open_edges(faces: np.ndarray) -> list[tuple[int, int]]:
    """Directed edges without their opposite; every directed edge may occur once only."""
    edges = Counter((int(t[i]), int(t[(i + 1) % 3])) for t in faces for i in range(3))
    assert max(edges.values()) == 1, "two triangles run along one edge in the same direction"
    return [(a, b) for a, b in edges if (b, a) not in edges]


def closed_skin(head: HeadModel, parts: dict[str, np.ndarray]) -> np.ndarray:
    """The skin with a fan over the bottom of the neck."""
    faces = faces_of(head, parts["skin"])
    rim = open_edges(faces)
    return np.concatenate([faces, [(b, a, rim[0][0]) for a, b in rim if rim[0][0] not in (a, b)]])


def winding_number(vertices: np.ndarray, faces: np.ndarray, point: np.ndarray) -> float:
    """How often a closed surface encloses a point: sum of solid angles, van Oosterom and Strackee 1983."""
    a, b, c = np.moveaxis(vertices[faces].astype(np.float64) - point, 1, 0)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    along = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(2 * np.arctan2((a * np.cross(b, c)).sum(1), along).sum() / (4 * np.pi))


def test_counts_shapes_and_types(head: HeadModel, size: str) -> None:
    v, j = head.n_vertices, len(JOINTS)
    assert N_FACES[size][0] <= head.n_faces <= N_FACES[size][1]
    assert head.name == f"synthetic-{size}-0"
    assert head.expression_names == EXPRESSIONS
    assert head.shapedirs.shape == (v, 3, len(IDENTITY))
    assert head.exprdirs.shape == (v, 3, len(EXPRESSIONS))
    assert len(IDENTITY) >= 20
    assert len(EXPRESSIONS) >= 30
    assert head.J_regressor.shape == (j, v)
    assert head.weights.shape == (v, j)
    assert head.parents.tolist() == [-1, 0, 1, 1, 1]
    assert head.posedirs is not None
    assert head.posedirs.shape == (v, 3, 9 * (j - 1))
    assert np.unique(head.faces).tolist() == list(range(v))
    arrays = (head.v_template, head.shapedirs, head.exprdirs, head.J_regressor, head.weights, head.posedirs, head.uv)
    assert all(a is not None and a.dtype == np.float32 and np.isfinite(a).all() for a in arrays)


def test_skin_is_one_sheet_open_only_below_and_the_other_parts_are_closed(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    # Theorem: the Euler characteristic of a disc is 1, of a sphere 2.
    for name, euler in (("skin", 1), ("left_eyeball", 2), ("right_eyeball", 2), ("upper_teeth", 2), ("lower_teeth", 2)):
        faces = faces_of(head, parts[name])
        rim = open_edges(faces)
        n_edges = (3 * len(faces) + len(rim)) // 2
        assert len(parts[name]) - n_edges + len(faces) == euler, name
        assert len(rim) == (N_COLUMNS[size] if name == "skin" else 0), name
    bottom = np.array([a for a, _ in open_edges(faces_of(head, parts["skin"]))])
    assert set(bottom) <= set(head.masks["boundary"].tolist())
    names = ("skin", "left_eyeball", "right_eyeball", "upper_teeth", "lower_teeth")
    assert sum(len(faces_of(head, parts[name])) for name in names) == head.n_faces


def test_triangles_face_outwards(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    surfaces = {
        name: faces_of(head, parts[name]) for name in ("left_eyeball", "right_eyeball", "upper_teeth", "lower_teeth")
    }
    surfaces["skin"] = closed_skin(head, parts)
    for name, faces in surfaces.items():
        a, b, c = np.moveaxis(head.v_template[faces].astype(np.float64), 1, 0)
        assert (a * np.cross(b, c)).sum() / 6 > 0, (
            name
        )  # the divergence theorem: the enclosed volume, if normals point out


def test_teeth_are_the_last_triangles(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    teeth = np.concatenate([parts["upper_teeth"], parts["lower_teeth"]])
    assert np.isin(head.faces[-head.n_teeth_faces :], teeth).all()
    assert not np.isin(head.faces[: -head.n_teeth_faces], teeth).any()


def test_left_and_right_are_mirror_images(head: HeadModel, mirrored: np.ndarray) -> None:
    np.testing.assert_array_equal(head.v_template[mirrored] * [-1, 1, 1], head.v_template)
    swapped = [0, 1, 2, 4, 3]
    np.testing.assert_array_equal(head.weights[mirrored][:, swapped], head.weights)
    for name, mask in head.masks.items():
        other = name.replace("left", "r#").replace("right", "left").replace("r#", "right")
        np.testing.assert_array_equal(np.sort(mirrored[mask]), head.masks[other], name)


def test_weights_and_regressor_rows_sum_to_one(head: HeadModel) -> None:
    assert (head.weights >= 0).all()
    np.testing.assert_array_equal(
        head.weights.sum(axis=1, dtype=np.float64), 1.0
    )  # multiples of 2^-20: the sum is exact
    np.testing.assert_array_equal(head.J_regressor.sum(axis=1, dtype=np.float64), 1.0)


def test_joints_lie_inside(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    joints = dict(zip(JOINTS, head.J_regressor.astype(np.float64) @ head.v_template, strict=True))
    skin = closed_skin(head, parts)
    for name in ("root", "neck", "jaw"):
        assert joints[name][0] == pytest.approx(0.0, abs=ROUNDING_M)
        assert winding_number(head.v_template, skin, joints[name]) == pytest.approx(1.0, abs=1e-6)
    for side in ("left", "right"):
        ball = parts[f"{side}_eyeball"]
        distance = np.linalg.norm(head.v_template[ball] - joints[f"{side}_eye"], axis=1)
        assert np.ptp(distance) < 4 * ROUNDING_M  # the joint is the centre of the sphere
        assert (joints[f"{side}_eye"][0] > 0) == (side == "left")


def test_masks_have_the_official_names_and_nesting(head: HeadModel) -> None:
    assert set(head.masks) == MASKS
    members = {name: set(mask.tolist()) for name, mask in head.masks.items()}
    assert all(members.values())
    for inner in ("forehead", "eye_region", "left_eye_region", "right_eye_region", "lips"):
        assert members[inner] <= members["face"], inner
    assert members["nose"] & members["face"]
    assert not members["left_ear"] & members["face"]
    assert members["neck"] & members["boundary"]


def test_every_region_has_triangles(head: HeadModel) -> None:
    counts = np.bincount(label_triangles(head), minlength=len(PAPER.regions))
    assert counts.sum() == head.n_faces
    assert (counts > 0).all(), dict(zip(PAPER.regions, counts.tolist(), strict=True))


def test_texture_triangles_do_not_overlap(head: HeadModel) -> None:
    assert head.uv is not None
    assert head.uv_faces is not None
    corners = head.uv[head.uv_faces].astype(np.float64)
    assert corners.min() >= 0
    assert corners.max() <= 1
    edge_1, edge_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = edge_1[:, 0] * edge_2[:, 1] - edge_1[:, 1] * edge_2[:, 0]
    assert (np.abs(area) > ROUNDING_M**2).all()
    hits = np.zeros(UV_PROBES, int)
    for i, point in enumerate(np.random.default_rng(0).random((UV_PROBES, 2))):
        away = point - corners[:, 0]
        s = (away[:, 0] * edge_2[:, 1] - away[:, 1] * edge_2[:, 0]) / area
        t = (edge_1[:, 0] * away[:, 1] - edge_1[:, 1] * away[:, 0]) / area
        hits[i] = ((s > 0) & (t > 0) & (s + t < 1)).sum()
    assert hits.max() == 1
    assert hits.mean() > 0.7  # and the texture is put to use


def test_texture_follows_the_mesh(head: HeadModel) -> None:
    # Two texture points of one vertex may differ across a seam, but a texture point belongs to one vertex only.
    assert head.uv_faces is not None
    owners: dict[int, int] = {}
    for texture, vertex in zip(head.uv_faces.ravel().tolist(), head.faces.ravel().tolist(), strict=True):
        assert owners.setdefault(texture, vertex) == vertex


def test_same_head_again(size: str) -> None:
    first = synthetic_head(size, seed=3)
    head_module._anatomy.cache_clear()
    second = synthetic_head(size, seed=3)
    assert first.reference == second.reference
    assert synthetic_head(size).reference.sha256 == DIGESTS[size]


def test_another_seed_is_another_person_on_the_same_mesh(size: str) -> None:
    one, other = synthetic_head(size, seed=1), synthetic_head(size, seed=2)
    assert one.reference.sha256 != other.reference.sha256
    np.testing.assert_array_equal(one.faces, other.faces)
    apart = np.linalg.norm(one.v_template - other.v_template, axis=1)
    assert 0.002 < apart.max() < 0.04  # people differ by millimetres, not by heads


@pytest.mark.parametrize(("size_name", "seed"), [("huge", 0), ("full", -1), ("full", 2**64)])
def test_refuses_what_it_cannot_make(size_name: str, seed: int) -> None:
    with pytest.raises(OptionError, match=str(size_name if size_name == "huge" else seed)):
        synthetic_head(size_name, seed)
