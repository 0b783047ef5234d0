"""Performances of heads with ARKit's names, with nameless components, with one joint and with five."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.rig import rig_from_arrays
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.synthesis.acting import act
from sacha_core.synthesis.arkit_acting import arkit_weights, head_turns_rad
from sacha_core.synthesis.arkit_face import ARKIT_SHAPES, CHARACTERS, COLUMN, MOODS, is_arkit, weights_of
from sacha_core.synthesis.sequences import SCRIPTS, perform

FPS = 30
MINUTE_S = 60.0
TIME_S = np.arange(int(MINUTE_S * FPS)) / FPS


@pytest.fixture(scope="module")
def flame_like() -> HeadModel:
    """Give a head with five joints and 41 components that have no names."""
    return replace(synthetic_head("small"), name="somebody", expression_names=())


@pytest.fixture(scope="module")
def rig(flame_like: HeadModel) -> HeadModel:
    """Give a rig of one joint whose shapes bear ARKit's names, in an order of their own, and one that is not ARKit's."""
    deltas = np.random.default_rng(0).normal(0, 1e-3, (21, flame_like.n_vertices, 3)).astype(np.float32)
    names = [*ARKIT_SHAPES[40:20:-1], "hairWind"]
    arrays = {
        "verts": flame_like.v_template,
        "faces": flame_like.faces,
        "arkit_deltas": deltas,
        "arkit_names": np.array(names),
    }
    return rig_from_arrays(arrays, "rig")


def test_apple_has_52_shapes_of_which_every_mood_is_made() -> None:
    assert len(ARKIT_SHAPES) == len({*ARKIT_SHAPES}) == 52
    for amounts in MOODS.values():
        row = weights_of(amounts)  # raises where there is no such shape
        assert row.min() >= 0
        assert row.max() <= 1
        assert np.count_nonzero(row) >= len(amounts)
    assert {mood for character in CHARACTERS.values() for mood in character.moods} <= MOODS.keys()
    assert CHARACTERS.keys() == SCRIPTS.keys(), "the same sequences for any head"


@pytest.mark.parametrize("name", CHARACTERS)
@pytest.mark.parametrize("seed", [0, 7])
class TestArkitWeights:
    def test_are_weights(self, name: str, seed: int) -> None:
        weights = arkit_weights(name, TIME_S, MINUTE_S, seed)
        assert weights.shape == (len(TIME_S), 52)
        assert weights.min() >= 0
        assert weights.max() <= 1

    def test_are_smooth(self, name: str, seed: int) -> None:
        """An eye jumps and a lid falls within two or three frames; everything else takes longer."""
        change = np.abs(np.diff(arkit_weights(name, TIME_S, MINUTE_S, seed), axis=0)).max(axis=0)
        quick = np.array([shape.startswith(("eyeBlink", "eyeLook", "eyeWide")) for shape in ARKIT_SHAPES])
        assert change[~quick].max() < 0.45  # from a stressed vowel to a consonant in 0.09 s
        assert change[quick].max() < 0.9

    def test_make_sense_together(self, name: str, seed: int) -> None:
        weights = arkit_weights(name, TIME_S, MINUTE_S, seed)
        of = {shape: weights[:, column] for shape, column in COLUMN.items()}
        assert (of["mouthClose"] <= of["jawOpen"]).all()
        assert of["jawOpen"].max() < 0.75
        for side in ("Left", "Right"):
            assert (
                np.minimum(of[f"eyeLookUp{side}"], of[f"eyeLookDown{side}"]).max() < 0.21
            )  # sadness looks down a little
            assert np.minimum(of[f"eyeLookIn{side}"], of[f"eyeLookOut{side}"]).max() == 0
            assert (of[f"eyeWide{side}"] <= 1 - of[f"eyeBlink{side}"] + 1e-9).all()
        assert np.array_equal(of["eyeLookOutLeft"], of["eyeLookInRight"]), "both eyes look the same way"

    def test_blinks_are_there(self, name: str, seed: int) -> None:
        lids = arkit_weights(name, TIME_S, MINUTE_S, seed)[:, [COLUMN["eyeBlinkLeft"], COLUMN["eyeBlinkRight"]]]
        shut = (lids > 0.6).all(axis=1)
        times = np.count_nonzero(np.diff(np.concatenate([[0], shut.astype(int)])) == 1)
        assert 9 <= times <= 20  # one may be hidden by lids that a mood has closed


def test_every_sequence_has_its_character() -> None:
    def mean(name: str, *shapes: str) -> float:
        return float(arkit_weights(name, TIME_S, MINUTE_S, 0)[:, [COLUMN[shape] for shape in shapes]].mean())

    smiles = {name: mean(name, "mouthSmileLeft", "mouthSmileRight") for name in CHARACTERS}
    assert max(smiles, key=smiles.__getitem__) == "EMO-1"
    frowns = {name: mean(name, "mouthFrownLeft", "browInnerUp") for name in CHARACTERS}
    assert max(frowns, key=frowns.__getitem__) == "EMO-2"
    yaw = {name: np.abs(head_turns_rad(name, TIME_S, MINUTE_S, 0)[:, 1]).max() for name in CHARACTERS}
    assert max(yaw, key=yaw.__getitem__) == "EXP-5"
    assert np.radians(20) < yaw["EXP-5"] < np.radians(35)
    jaw = arkit_weights("EXP-2", TIME_S, MINUTE_S, 0)[:, COLUMN["jawOpen"]]
    openings = np.count_nonzero((jaw[1:-1] > jaw[:-2]) & (jaw[1:-1] > jaw[2:]) & (jaw[1:-1] > 0.08))
    assert 1.5 < openings / MINUTE_S < 5, "syllables a second"


def test_weights_go_to_the_shapes_of_their_names(rig: HeadModel) -> None:
    motion = act(rig, "FREE", 24, seed=3)
    motion.validate()
    duration_s = 24 / motion.frame_rate
    weights = arkit_weights("FREE", (np.arange(24) + 0.5) / motion.frame_rate, duration_s, 3)
    for column, name in enumerate(rig.expression_names[:-1]):
        assert np.array_equal(motion.expression[:, column], weights[:, COLUMN[name]].astype(np.float32))
    assert not motion.expression[:, -1].any(), "what has no meaning stays still"
    assert not motion.neck.any(), "the only joint turns all"
    assert np.abs(motion.translation.mean(axis=0)).max() < 1e-6


def test_a_neck_takes_its_share(flame_like: HeadModel, rig: HeadModel) -> None:
    alone, shared = act(rig, "EXP-5", 10, 0), act(flame_like, "EXP-5", 10, 0)
    assert np.allclose(shared.rotation + shared.neck, alone.rotation, atol=1e-6)
    assert 0.5 < np.linalg.norm(shared.neck) / np.linalg.norm(alone.rotation) < 0.8


def test_nameless_components_move_little_and_smoothly(flame_like: HeadModel) -> None:
    motion = act(flame_like, "EMO-1", 200, 0)
    assert motion.expression.shape == (200, 41)
    assert np.abs(motion.expression).max() <= 1
    assert (motion.expression.std(axis=0) > 0).all()
    moved = np.einsum("vce,te->tvc", flame_like.exprdirs, motion.expression)
    furthest = np.linalg.norm(moved, axis=2).max(axis=1)
    assert 0.001 < furthest.mean() < 0.02, "metres; a face, not a mask and not a monster"
    assert np.abs(np.diff(motion.expression, axis=0)).max() < 0.3
    assert motion.jaw.min() >= 0
    assert np.array_equal(motion.eyes[:, :3], motion.eyes[:, 3:])


def test_the_synthetic_head_performs_its_own_scripts() -> None:
    head = synthetic_head("small")
    assert np.array_equal(act(head, "EXP-3", 9, 2).expression, perform(head, "EXP-3", 9, 2).expression)


def test_seeds_and_names_decide(rig: HeadModel) -> None:
    again = [act(rig, "EMO-1", 7, 5).expression for _ in range(2)]
    assert np.array_equal(*again)
    others = [act(rig, "EMO-1", 7, 6).expression, act(rig, "EMO-2", 7, 5).expression]
    assert not any(np.array_equal(again[0], other) for other in others)


def test_heads_without_expressions_and_single_moments(rig: HeadModel) -> None:
    stiff = replace(rig, exprdirs=rig.exprdirs[:, :, :0], expression_names=())
    assert act(stiff, "FREE", 1, 0).expression.shape == (1, 0)
    assert not is_arkit(())
    assert not is_arkit(("smile", "frown", "jawOpen"))


def test_unknown_sequence(rig: HeadModel) -> None:
    with pytest.raises(OptionError, match="no sequence 'EMO-9'; there are EMO-1"):
        act(rig, "EMO-9", 3, 0)
