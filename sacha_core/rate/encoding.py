"""Encoding by rendering: who is not worth its bits goes, bits go where errors show, and colours make up for what is lost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec.encoder import Recolour, encode_traced, price_of_a_bit
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.levels import Level, level_named
from sacha_core.codec.template import Template, template_of
from sacha_core.flame.model import HeadModel
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.curvature import importance_of
from sacha_core.rate.leaving_out import Leaving
from sacha_core.rate.recolouring import Pictures, Recolouring
from sacha_core.rate.stances import measuring_stances
from sacha_core.rate.visibility import PRUNING_BITS, grounds_for

__all__ = ["Encoded", "Prepared", "RenderingEncoder", "encode_by_rendering"]


@dataclass(frozen=True)
class Encoded:
    """A file and what became of the avatar.

    Args:
        data: the bytes of the file.
        level: that it was made at.
        rows: (m,) which of the avatar's Gaussians each decoded one is.
    """

    data: bytes
    level: Level
    rows: Int[np.ndarray, " m"]


@dataclass(frozen=True)
class Prepared:
    """What is to be encoded.

    Args:
        avatar: without the Gaussians that are left out.
        level: that they were left out for.
        rows: (m,) which of the avatar's Gaussians are left.
        importance: of these.
    """

    avatar: Avatar
    level: Level
    rows: Int[np.ndarray, " m"]
    importance: GaussianImportance


class RenderingEncoder:
    """Encodes one avatar at any number of levels; poses and views are set up once.

    Args:
        avatar: what to compress.
        head: the head that it is bound to.
        embed_head: add the head itself to the files.
        pruning_bits: a Gaussian goes that changes pictures by less than so many bits are worth, or makes up too little of them
            (`covering`); 0 keeps all that shows.
        seed: of what is measured by chance.
        factors: (n,) how many times as much a squared difference counts where each Gaussian shows; None for once everywhere.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """

    def __init__(
        self,
        avatar: Avatar,
        head: HeadModel,
        embed_head: bool = False,
        pruning_bits: float = PRUNING_BITS,
        seed: int = 0,
        factors: Float[np.ndarray, " n"] | None = None,
    ) -> None:
        avatar.gaussians.validate(head.n_faces)
        self._avatar, self.head, self._embed, self._seed = avatar, head, embed_head, seed
        self.pruning_bits, self._rasteriser = pruning_bits, Rasteriser()
        self._factors = factors
        self._measured: tuple[Leaving, GaussianImportance] | None = None

    def prepare(self, level: int | Level) -> Prepared:
        """Leave out what is not worth its bits at a level."""
        chosen = level if isinstance(level, Level) else level_named(level)
        leaving, importance = self._measure()
        gaussians = self._avatar.gaussians
        price = price_of_a_bit(gaussians, self._template, chosen, importance)
        return self.prepare_rows(chosen, leaving.rows(price, self.pruning_bits, self._rasteriser, self._factors))

    def prepare_rows(self, level: int | Level, rows: Int[np.ndarray, " m"]) -> Prepared:
        """Leave out all but some of the Gaussians, whoever chose them."""
        chosen = level if isinstance(level, Level) else level_named(level)
        _, importance = self._measure()
        left = replace(self._avatar, gaussians=self._avatar.gaussians.select(rows))
        worth = importance.select(rows)
        return Prepared(left, chosen, rows, worth if self._factors is None else worth.weighted(self._factors[rows]))

    def encode(self, level: int | Level) -> Encoded:
        """Encode at a level.

        Raises:
            FormatError: the avatar is not finite, or has values beyond what the format holds.
            HeadError: `head` is not the one that the avatar names.
        """
        return self.encode_prepared(self.prepare(level))

    def encode_prepared(self, left: Prepared, drop_invisible: bool = True) -> Encoded:
        """Encode what is left, with colours that make up for what the file loses.

        Raises:
            FormatError, HeadError: as `encode`.
        """
        data, order = encode_traced(
            left.avatar,
            left.level,
            head=self.head,
            embed_head=self._embed,
            drop_invisible=drop_invisible,
            importance=left.importance,
            recolour=self._recolour(left.rows),
            template=self._template,
        )
        return Encoded(data, left.level, left.rows[order])

    @cached_property
    def _template(self) -> Template:
        return template_of(self.head.v_template, self.head.faces)

    def _recolour(self, rows: Int[np.ndarray, " m"]) -> Recolour:
        """Give what chooses colours for some of the Gaussians, by the views that decide who goes."""
        leaving, importance = self._measure()
        fit, worth = Recolouring(leaving.pictures, self._rasteriser), importance.sh_dc[rows].mean(axis=1)
        return lambda decoded, order: fit(decoded, worth[order])

    def _measure(self) -> tuple[Leaving, GaussianImportance]:
        """Give what decides who goes, and what numbers are worth while all Gaussians are there."""
        if self._measured is None:
            stances = measuring_stances(self._avatar, self.head)
            importance = importance_of(self._avatar, self.head, self._seed, self._rasteriser, stances)
            gaussians, grounds = self._avatar.gaussians, grounds_for(self._avatar, self.head, stances)
            pictures = Pictures(gaussians, grounds.own)
            self._measured = Leaving.of(gaussians, grounds, pictures, self._rasteriser), importance
        return self._measured


def encode_by_rendering(
    avatar: Avatar,
    level: int | Level = 2,
    *,
    head: HeadModel,
    embed_head: bool = False,
    pruning_bits: float = PRUNING_BITS,
    seed: int = 0,
) -> bytes:
    """Compress an avatar as `sacha_core.encode` does, smaller at the same quality, in a few seconds.

    A fifth to a third smaller where many Gaussians hardly show, a twentieth where training has removed those already.

    Args:
        avatar: what to compress; pictures of its own motion count, or of stock expressions where it has none.
        level: 1 (smallest) to 4 (best), or a `Level` of one's own.
        head: the head model that it is bound to.
        embed_head: add the head model itself to the file.
        pruning_bits: a Gaussian goes that changes pictures by less than so many bits are worth, or makes up too little of them
            (`covering`); 0 keeps all that shows.
        seed: of what is measured by chance; the same seed gives the same bytes.

    Raises:
        FormatError, HeadError, OptionError: as `sacha_core.encode` does.
        GeometryError: a frame of the motion makes a triangle degenerate.
    """
    return RenderingEncoder(avatar, head, embed_head, pruning_bits, seed).encode(level).data
