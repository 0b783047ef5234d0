"""The token coder as FORMAT.md describes it, in plain Python: an oracle that shares nothing with the codec."""

from __future__ import annotations

import math

PRECISION = 24


def weight(grade: int) -> int:
    """Weight of a grade."""
    return 1 if grade == 0 else math.isqrt(1 << (grade + 7))


def cumulative(grades: list[int]) -> list[int]:
    """Left ends of the tokens' intervals, and 2**24."""
    weights = [weight(grade) for grade in grades]
    if len(weights) == 1:
        weights.append(1)
    scale = float((1 << PRECISION) - len(weights)) / float(sum(weights))
    ends, total = [], 0
    for i, one in enumerate(weights):
        ends.append(int(float(total) * scale) + i)
        total += one
    return [*ends, 1 << PRECISION]


class StackDecoder:
    """Reads tokens off a stack of 32-bit words."""

    def __init__(self, words: list[int]) -> None:
        self.words = list(words)
        self.state = 0
        for _ in range(2):
            if self.words:
                self.state = self.state << 32 | self.words.pop()

    def decode(self, ends: list[int]) -> int:
        """Give the next token's place in its table."""
        quantile = self.state & ((1 << PRECISION) - 1)
        symbol = max(i for i, end in enumerate(ends[:-1]) if end <= quantile)
        self.state = (self.state >> PRECISION) * (ends[symbol + 1] - ends[symbol]) + quantile - ends[symbol]
        if self.state < 1 << 32 and self.words:
            self.state = self.state << 32 | self.words.pop()
        return symbol
