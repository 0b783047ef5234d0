"""Oracles: the noise that was asked for, and what people do: blink 11 to 18 times a minute, turn and open the mouth within their limits."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from sacha_core.errors import HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import EXPRESSIONS
from sacha_core.flame.synthetic.head import synthetic_head
from sacha_core.synthesis.conversation import TrackingNoise, converse

SILENT = TrackingNoise(0.0, 0.0, 0.0)
MINUTE = 1500  # frames
NAMES = ("expression", "rotation", "neck", "jaw", "eyes", "translation")
SPREAD = 0.05  # of the deviation of 4,500 numbers and more


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


def test_a_seed_gives_the_same_bytes_and_another_one_others(head):
    first, again, other = (converse(head, 50, seed) for seed in (4, 4, 5))
    for field in fields(first):
        value = getattr(first, field.name)
        if isinstance(value, np.ndarray):
            assert value.tobytes() == getattr(again, field.name).tobytes()
    assert not np.array_equal(first.jaw, other.jaw)
    first.validate()


def test_the_tracker_adds_the_noise_that_was_asked_for(head):
    noise = TrackingNoise(0.02, 0.3, 0.001)
    still, noisy = converse(head, MINUTE, 1, noise=SILENT), converse(head, MINUTE, 1, noise=noise)
    expected = {"expression": 0.02, "translation": 0.001}
    for name in NAMES:
        off = getattr(noisy, name) - getattr(still, name)
        assert off.std() == pytest.approx(expected.get(name, np.radians(0.3)), rel=SPREAD)


def test_people_blink_talk_turn_and_look_around(head):
    motion = converse(head, MINUTE, 2, noise=SILENT)
    shut = motion.expression[:, EXPRESSIONS.index("blink_left")] > 0.5
    blinks = np.count_nonzero(np.diff(shut.astype(int)) == 1)
    assert 9 <= blinks <= 20
    assert motion.expression.min() >= 0
    assert motion.expression.max() <= 1
    assert 0.1 < motion.jaw[:, 0].max() < 0.6
    turned = np.degrees(motion.rotation + motion.neck)
    assert np.all(np.abs(turned).max(axis=0) > 3)
    assert np.all(np.abs(turned).max(axis=0) < 30)
    assert 0.003 < np.abs(motion.translation).max() < 0.013
    assert np.abs(np.diff(motion.eyes[:, 1])).max() > np.radians(3)


def test_what_makes_no_sense_is_refused(head):
    with pytest.raises(OptionError, match="at least one"):
        converse(head, 0, 1)
    with pytest.raises(OptionError, match="positive rate"):
        converse(head, 3, 1, frame_rate=0.0)
    with pytest.raises(HeadError, match="components"):
        converse(replace(head, expression_names=()), 3, 1)
