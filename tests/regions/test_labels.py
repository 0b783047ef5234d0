"""Oracles: figures counted on FLAME's own masks; small meshes labelled by hand; laws of symmetry and relabelling."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from skimage.color import rgb2lab

from sacha_core.errors import HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.regions.labels import label_triangles, region_counts
from sacha_core.regions.scheme import PAPER, SCHEMES, WIDE_EYES, RegionScheme, find_scheme

MASKS = tuple(name for names in PAPER.masks.values() for name in names)
TELLABLE = 20  # CIE76 distance that is plain at a glance; 2.3 is just noticeable


def make_head(faces: list[tuple[int, int, int]], masks: dict[str, list[int]], n_teeth_faces: int = 0) -> HeadModel:
    v = 1 + max(max(face) for face in faces)
    return HeadModel(
        name="strip",
        v_template=np.random.default_rng(0).normal(size=(v, 3)).astype(np.float32),
        faces=np.array(faces, np.int32),
        shapedirs=np.zeros((v, 3, 0), np.float32),
        exprdirs=np.zeros((v, 3, 0), np.float32),
        J_regressor=np.full((1, v), 1 / v, np.float32),
        weights=np.ones((v, 1), np.float32),
        parents=np.array([-1], np.int32),
        masks={name: np.array(masks.get(name, []), np.int32) for name in MASKS},
        n_teeth_faces=n_teeth_faces,
    )


def names(head: HeadModel, scheme: RegionScheme = PAPER) -> list[str]:
    return [scheme.regions[label] for label in label_triangles(head, scheme)]


def test_majority_of_the_corners() -> None:
    head = make_head([(0, 1, 2), (1, 3, 2), (2, 3, 4)], {"scalp": [0, 1], "neck": [2], "nose": [3, 4]})
    assert names(head) == ["scalp", "nose", "nose"]  # the second has three different corners


def test_three_different_corners_follow_the_strongest() -> None:
    assert names(make_head([(0, 1, 2)], {"scalp": [0], "lips": [1], "boundary": [2]})) == ["mouth"]


@pytest.mark.parametrize(
    ("claims", "winner"),
    [
        (("left_eye_region", "nose", "face"), "eyes"),
        (("lips", "face", "nose"), "mouth"),
        (("nose", "left_ear"), "nose"),
        (("right_ear", "boundary"), "ears"),
        (("boundary", "neck", "scalp"), "boundary"),
        (("neck", "face", "scalp"), "neck"),
        (("forehead", "scalp"), "face"),
        (("eye_region", "scalp"), "face"),
        (("scalp",), "scalp"),
    ],
)
def test_priority_where_masks_overlap(claims: tuple[str, ...], winner: str) -> None:
    assert names(make_head([(0, 1, 2)], {claim: [0, 1, 2] for claim in claims})) == [winner]


def test_uncovered_vertices_take_the_strongest_region_that_their_component_touches() -> None:
    chain = [(i, i + 1, i + 2) for i in range(10)]  # 0 is lips, 11 is scalp, 1 to 10 are uncovered
    assert names(make_head(chain, {"lips": [0], "scalp": [11]})) == ["mouth"] * 10


def test_two_uncovered_components_are_apart() -> None:
    faces = [(0, 1, 2), (1, 2, 3), (3, 4, 5), (5, 6, 7), (6, 7, 8)]
    assert names(make_head(faces, {"left_ear": [0], "neck": [3, 4, 5], "face": [8]})) == [
        "ears",
        "ears",
        "neck",
        "neck",
        "neck",
    ]


def test_teeth_are_mouth_without_any_mask() -> None:
    assert names(make_head([(0, 1, 2), (3, 4, 5)], {"scalp": [0, 1, 2]}, n_teeth_faces=1)) == ["scalp", "mouth"]


def test_parts_without_any_mask_are_refused() -> None:
    with pytest.raises(
        HeadError, match="triangle 1 of head 'strip' and 1 others hang together with no vertex of any mask"
    ):
        names(make_head([(0, 1, 2), (3, 4, 5), (4, 5, 6)], {"scalp": [0, 1, 2]}))


def test_a_head_without_masks_says_how_to_give_them() -> None:
    head = make_head([(0, 1, 2)], {"scalp": [0, 1, 2]})
    del head.masks["lips"], head.masks["nose"]
    with pytest.raises(HeadError, match=r"no vertex mask lips, nose; .*FLAME_masks\.pkl"):
        names(head)


def test_renumbering_triangles_renumbers_labels() -> None:
    head = make_head(
        [(i, i + 1, i + 2) for i in range(30)], {"lips": [0, 4, 9], "scalp": [20, 31], "neck": [12, 13, 14, 25]}
    )
    order = np.random.default_rng(0).permutation(30)
    np.testing.assert_array_equal(label_triangles(replace(head, faces=head.faces[order])), label_triangles(head)[order])


def test_counts_sum_to_the_gaussians_of_each_region() -> None:
    labels = np.array([0, 7, 7, 2], np.uint8)
    np.testing.assert_array_equal(region_counts(labels, np.array([0, 1, 2, 2, 2, 3])), [1, 0, 1, 0, 0, 0, 0, 4])
    assert region_counts(labels, np.zeros(0, np.int32)).tolist() == [0] * 8


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("scheme", "expected"),
    [
        (
            PAPER,
            {
                "eyes": 3564,
                "mouth": 600,
                "nose": 756,
                "ears": 2382,
                "boundary": 198,
                "neck": 402,
                "face": 1362,
                "scalp": 712,
            },
        ),
        (
            WIDE_EYES,
            {
                "eyes": 3922,
                "mouth": 600,
                "nose": 750,
                "ears": 2382,
                "boundary": 198,
                "neck": 402,
                "face": 1010,
                "scalp": 712,
            },
        ),
    ],
    ids=["paper", "wide eyes"],
)
def test_flames_own_masks(real_data: Path, scheme: RegionScheme, expected: dict[str, int]) -> None:
    with np.load(real_data / "flame2023_subset_50_50.npz") as flame, np.load(real_data / "FLAME_masks.npz") as masks:
        template, faces, official = flame["v_template"], flame["faces"], dict(masks)
    blank = make_head([(0, 1, 5022)], {})
    head = replace(blank, v_template=template, faces=faces, masks=official)
    labels = label_triangles(head, scheme)
    assert labels.dtype == np.uint8
    assert dict(zip(scheme.regions, np.bincount(labels).tolist(), strict=True)) == expected
    assert len(set(official["lips"].tolist())) == 250  # the file lists 254: four twice


def test_schemes_are_found_by_name_and_complete() -> None:
    for name, scheme in SCHEMES.items():
        assert find_scheme(name) is scheme
        assert set(scheme.priority) == set(scheme.regions) == set(scheme.masks)
        assert len(scheme.colours) == len(scheme.regions) == len(set(scheme.regions))
        assert scheme.teeth in scheme.regions
    assert PAPER.regions == ("mouth", "eyes", "nose", "ears", "boundary", "scalp", "neck", "face")
    assert PAPER.label("face") == 7
    with pytest.raises(OptionError, match="no region scheme 'papr'; there are paper, wide-eyes"):
        find_scheme("papr")
    with pytest.raises(OptionError, match="no region 'hair'"):
        PAPER.label("hair")


# Linear-RGB projections onto what dichromats see: Vienot, Brettel and Mollon 1999
DICHROMATS = {
    "all cones": np.eye(3),
    "protanope": np.array([[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]]),
    "deuteranope": np.array([[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]]),
}


@pytest.mark.parametrize("viewer", DICHROMATS)
def test_colours_can_be_told_apart(viewer: str) -> None:
    srgb = np.array(PAPER.colours) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4) @ DICHROMATS[viewer].T
    seen = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.clip(linear, 1e-9, None) ** (1 / 2.4) - 0.055)
    lab = rgb2lab(np.clip(seen, 0, 1))
    distance = np.linalg.norm(lab[:, None] - lab[None], axis=-1) + 1e9 * np.eye(len(lab))
    assert distance.min() > TELLABLE, distance.min()
