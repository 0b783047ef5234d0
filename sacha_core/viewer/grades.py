"""The same avatar as it is and as files of each level would give it back, made when it is first looked at."""

from __future__ import annotations

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode, encode
from sacha_core.flame.model import HeadModel

__all__ = ["Grades"]

AS_OPENED = "as opened"
LEVELS = {f"level {level}": level for level in (4, 3, 2, 1)}


class Grades:
    """An avatar's Gaussians by grade.

    Args:
        avatar: as it was opened.
        head: that it is bound to.
    """

    names = (AS_OPENED, *LEVELS)

    def __init__(self, avatar: Avatar, head: HeadModel) -> None:
        self._avatar, self._head = avatar, head
        self._made: dict[str, tuple[Gaussians, int | None]] = {AS_OPENED: (avatar.gaussians, None)}

    def __getitem__(self, name: str) -> tuple[Gaussians, int | None]:
        """Give the Gaussians of a grade, and the bytes of its file without motion and head; None as opened.

        Raises:
            SachaError: the avatar cannot be encoded.
        """
        if name not in self._made:
            still = Avatar(self._avatar.gaussians, self._avatar.head, None, self._avatar.scheme)
            data = encode(still, LEVELS[name], head=self._head)
            self._made[name] = decode(data, head=self._head).gaussians, len(data)
        return self._made[name]
