"""Hard cases, each with what must happen and code that looks whether it does."""

from sacha_core.bench.stability.report import TITLE, measure

__all__ = ["TITLE", "measure"]
