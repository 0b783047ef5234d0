"""How coarsely pictures of attributes are quantised: spread by rendered error, on two kinds of avatars.

Source: own.
"""

from __future__ import annotations

__all__ = ["AWAY", "TABLES", "WHOLE"]

WHOLE, AWAY = "whole", "away"
# how places are coded, with bits or quantisation; then quantisation of opacity, scale, rotation, colour, harmonics
TABLES = {
    "dense": (
        (AWAY, 9, 33, 26, 33, 32, 38), (AWAY, 4, 29, 22, 28, 29, 35), (AWAY, 1, 26, 19, 25, 26, 33), (AWAY, 0, 24, 15, 21, 22, 31),
        (WHOLE, 11, 21, 12, 16, 19, 29), (WHOLE, 11, 17, 9, 13, 15, 26), (WHOLE, 12, 14, 6, 12, 10, 22),
    ),
    "trained": (
        (AWAY, 14, 36, 27, 29, 27, 38), (AWAY, 10, 35, 24, 26, 23, 35), (AWAY, 6, 31, 20, 21, 20, 32), (AWAY, 4, 29, 17, 18, 17, 30),
        (AWAY, 1, 25, 14, 15, 13, 28), (AWAY, 0, 22, 11, 11, 9, 25), (AWAY, 0, 18, 8, 8, 6, 22), (WHOLE, 12, 16, 6, 5, 3, 18),
    ),
}  # fmt: skip
