"""`sacha view` without a browser: it listens, plays, and ends by itself without a word of complaint."""

from __future__ import annotations

from pathlib import Path

import pytest

from sacha_core.viewer.page import Page


def test_it_plays_and_ends_after_its_time(done, sacha_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Warnings are errors here: the library would complain if anything were sent after the end."""
    shown: list[int] = []
    show = Page._show

    def counted(page: Page) -> None:
        shown.append(page._timeline.value)
        show(page)

    monkeypatch.setattr(Page, "_show", counted)
    outcome = done("view", sacha_file, "--no-browser", "--seconds", 2)
    assert outcome.report["address"].startswith("http://localhost:")
    assert len(set(shown)) > 1
