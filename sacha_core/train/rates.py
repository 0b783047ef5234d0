"""How fast each parameter is learnt at each iteration."""

from __future__ import annotations

import math

from sacha_core.flame.posing import TURNS
from sacha_core.train.options import LearningRates, Schedule
from sacha_core.train.state import ROWS

__all__ = ["learning_rates", "position_rate"]


def learning_rates(rates: LearningRates, schedule: Schedule, iteration: int, extent: float) -> dict[str, float]:
    """Give the learning rate of every attribute and motion parameter.

    Args:
        rates: of the run.
        schedule: likewise.
        iteration: which one, counted from 1.
        extent: of the scene, metres.
    """
    position = position_rate(rates.position, rates.position_last, iteration, schedule.position_decay)
    return {
        "position": position * extent,
        **{name: getattr(rates, name) for name in ROWS if name != "position"},
        **dict.fromkeys(TURNS, rates.pose),
        "translation": rates.translation,
        "expression": rates.expression,
    }


def position_rate(first: float, last: float, iteration: int, over: int) -> float:
    """Give the learning rate that falls log-linearly from `first` to `last` over so many iterations."""
    done = min(iteration / over, 1.0)
    return math.exp(math.log(first) * (1 - done) + math.log(last) * done)
