"""Things made from others: made anew where a source is another object, even an equal one, and only then."""

from __future__ import annotations

import gc

import numpy as np

from sacha_core.parallel.kept import Kept, KeptOfEach


def test_what_was_made_holds_as_long_as_its_sources_are_the_same_objects() -> None:
    made: list[int] = []
    kept: Kept[int] = Kept()

    def make() -> int:
        made.append(len(made))
        return made[-1]

    a, b = np.zeros(3), np.zeros(3)
    assert [kept.of(make, a, b), kept.of(make, a, b), kept.of(make, b, a), kept.of(make, b), kept.of(make, b)] == [
        0, 0, 1, 2, 2,
    ]  # fmt: skip
    a[:] = 1
    assert kept.of(make, b) == 2
    assert kept.of(make, b.copy()) == 3


def test_sources_stay_alive_so_that_no_other_takes_their_identity() -> None:
    kept: Kept[int] = Kept()
    first = kept.of(lambda: 1, object())
    gc.collect()
    assert first == 1
    assert kept.of(lambda: 2, object()) == 2


def test_nothing_made_from_nothing_is_made_once() -> None:
    kept: Kept[object] = Kept()
    assert kept.of(object) is kept.of(object)


def test_what_was_made_of_each_comes_again_until_there_are_too_many() -> None:
    made: list[int] = []
    kept: KeptOfEach[int] = KeptOfEach(2)

    def make() -> int:
        made.append(len(made))
        return made[-1]

    a, b, c = np.zeros(3), np.zeros(3), np.zeros(3)
    assert [kept.of(make, source) for source in (a, b, a, b, c, c, a)] == [0, 1, 0, 1, 2, 2, 3]


def test_each_stays_alive_so_that_no_other_takes_its_identity() -> None:
    kept: KeptOfEach[int] = KeptOfEach(100)
    assert [kept.of(lambda k=k: k, object()) for k in range(100)] == list(range(100))
