"""Being asked to stop: the first SIGTERM is kept for a good moment, the second one is not. Oracle: signals that were really sent."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from sacha_core.cli.stopping import stopping_gently


class EndedError(Exception):
    """Stands for what SIGTERM did before."""


@pytest.fixture
def before():
    def end(*_: object) -> None:
        raise EndedError

    old = signal.signal(signal.SIGTERM, end)
    yield end
    signal.signal(signal.SIGTERM, old)


def test_the_first_only_asks_and_the_second_ends(before) -> None:
    with stopping_gently() as asked:
        assert not asked()
        os.kill(os.getpid(), signal.SIGTERM)
        assert asked()
        with pytest.raises(EndedError):
            os.kill(os.getpid(), signal.SIGTERM)


def test_afterwards_it_is_as_it_was(before) -> None:
    with stopping_gently():
        pass
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_thread_can_use_it_without_hearing_anything() -> None:
    heard = []

    def work() -> None:
        with stopping_gently() as asked:
            heard.append(asked())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert heard == [False]
