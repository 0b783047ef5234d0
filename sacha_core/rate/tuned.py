"""Encoding with fitting: fewer Gaussians that look like all of them did, whose numbers make up for one another's rounding.

Source: own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode, inspect
from sacha_core.codec.levels import Level, level_at
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Report, silent
from sacha_core.rate.capture_error import capture_error
from sacha_core.rate.curvature import importance_of
from sacha_core.rate.encoding import Encoded, RenderingEncoder
from sacha_core.rate.fitted_encoder import FittedEncoder
from sacha_core.rate.fitting import Fitting, fit, starting_rates
from sacha_core.rate.goal import Goal, SameQuality, SameSize
from sacha_core.rate.judging import Judge
from sacha_core.rate.making_up import MakingUp, MakingUpOptions
from sacha_core.rate.pictures import own_pictures
from sacha_core.rate.target import (
    DB_PER_LEVEL,
    DB_TOLERANCE,
    LOG_BYTES_PER_LEVEL,
    Reached,
    Trials,
    encode_to_psnr,
    encode_to_size,
    search,
)
from sacha_core.rate.thinning import Outlook, ThinningOptions, thin, thinning_rates
from sacha_core.train.views import Target

__all__ = ["Tuner", "encode_tuned"]

TRIALS = (
    3  # of a search, and one more; each fits anew, and its quality is off what its level promises by 0.1 dB either way
)
GRAIN_DB = 0.4  # so much beyond what was missing is reached in all likelihood
CAPTURE_ITERATIONS = 600  # steps towards the pictures of a capture, before anything is coded


class Tuner:
    """Makes files as `RenderingEncoder` does, of fewer Gaussians that were fitted; never worse ones, for what makes none better is left.

    Args:
        avatar: as in `RenderingEncoder`.
        head: likewise.
        embed_head: likewise.
        steps: pictures that are fitted to in the end, with timesteps of the avatar's motion, as `pictures.CaptureSteps` gives them; None
            for the avatar's own.
        factors: as in `RenderingEncoder`.
        options: of what is fitted while files are made.
        thinning: of leaving out Gaussians.
        report: told about progress.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """

    def __init__(
        self,
        avatar: Avatar,
        head: HeadModel,
        *,
        embed_head: bool = False,
        steps: Sequence[Sequence[Target]] | None = None,
        factors: Float[np.ndarray, " n"] | None = None,
        options: MakingUpOptions | None = None,
        thinning: ThinningOptions | None = None,
        report: Report = silent,
    ) -> None:
        self._avatar, self._head, self._embed, self._factors = avatar, head, embed_head, factors
        self._steps, self._options = steps, options or MakingUpOptions()
        self._thinning, self._report = thinning or ThinningOptions(), report
        self._plain = RenderingEncoder(avatar, head, embed_head, factors=factors)
        self._judge = Judge(avatar, head)

    def at_level(self, level: int | Level) -> Encoded:
        """Give a smaller file that is as good as the plain one of a level, by views that nobody learnt from.

        Fitted to pictures of a capture, it is as good by some of those.
        """
        plain = self._plain.encode(level)
        if not len(plain.rows):
            return plain
        aim = self._quick(plain)
        fitted = self._fitted(plain, SameQuality(aim), plain.level.number)
        best = self._smallest(fitted, aim) if self._steps is None else self._no_larger(fitted, len(plain.data))
        if best is None or len(best.data) > len(plain.data) or self._strays(best, plain):
            return plain
        return best

    def to_size(self, n_bytes: int) -> Reached:
        """Give the best file of at most so many bytes, motion and all included.

        Raises:
            OptionError: even the smallest plain file is larger; the message says how large.
        """
        plain = encode_to_size(self._plain, n_bytes, self._report)
        if not len(plain.encoded.rows):
            return plain
        found = inspect(plain.encoded.data)
        room = max(n_bytes - (found.total_bytes - found.gaussian_bytes), 1)
        fitting = self._fitted(plain.encoded, SameSize(room))
        try:
            fitted = encode_to_size(fitting, n_bytes, self._report, fitting.quality, TRIALS)
        except OptionError:  # so small that fitting, which bits hardly bind, makes it too large
            return plain
        worse = self._quick(fitted.encoded) < self._quick(plain.encoded) if self._steps is None else False
        if worse or self._strays(fitted.encoded, plain.encoded):
            return plain
        return replace(fitted, n_trials=plain.n_trials + fitted.n_trials)

    def to_psnr(self, decibels: float) -> Reached:
        """Give the smallest file that reaches a PSNR against the uncompressed avatar, over all views of the protocol.

        Raises:
            OptionError: even the best plain file does not reach it; the message says how far it comes.
        """
        plain = encode_to_psnr(self._plain, self._judge, decibels, self._report)
        if not len(plain.encoded.rows) or plain.psnr_db is None:
            return plain
        aim = decibels + self._quick(plain.encoded) - plain.psnr_db
        fitted = self._fitted(plain.encoded, SameQuality(aim))
        try:
            found = encode_to_psnr(fitted, self._judge, decibels, self._report, fitted.quality, TRIALS, GRAIN_DB)
        except OptionError:  # too few are left for it: the plain file reaches it
            return plain
        if len(found.encoded.data) >= len(plain.encoded.data):
            return plain
        return replace(found, n_trials=plain.n_trials + found.n_trials)

    def _fitted(self, plain: Encoded, goal: Goal, number: float | None = None) -> FittedEncoder:
        """Leave out what others make up for, and fit these."""
        avatar, head = self._avatar, self._head
        there = replace(avatar, gaussians=avatar.gaussians.select(np.sort(plain.rows)))
        motion, own = own_pictures(avatar, head)
        posed, how = replace(there, motion=motion), self._options
        fitting = Fitting(posed, head, own, threads=how.threads, seed=how.seed)
        outlook = Outlook(avatar, head, self._judge, goal, plain.level.quality)
        factors = None if self._factors is None else self._factors[np.sort(plain.rows)]
        thinned = thin(there, fitting, outlook, head, factors, self._thinning, self._report)
        posed = replace(posed, gaussians=thinned.gaussians)
        if len(thinned.rows) < len(plain.rows):
            fitting = Fitting(posed, head, own, threads=how.threads, seed=how.seed)
            fit(fitting, self._thinning.last_iterations, thinning_rates(), report=self._report)
            posed = replace(posed, gaussians=fitting.gaussians())
        rows = np.sort(plain.rows)[thinned.rows]
        steps: Sequence[Sequence[Target]] = own
        if self._steps is not None:
            steps, posed = self._steps, replace(posed, motion=avatar.motion)
            fitting = Fitting(posed, head, steps, how.loss, how.threads, how.seed)
            fit(fitting, CAPTURE_ITERATIONS, starting_rates(), report=self._report, stage="fit to the capture")
            posed = replace(posed, gaussians=fitting.gaussians())
        importance = importance_of(replace(avatar, gaussians=posed.gaussians), head)
        importance = importance if self._factors is None else importance.weighted(self._factors[rows])
        left, remaining = replace(avatar, gaussians=posed.gaussians), MakingUp(posed, head, steps, how, self._report)
        return FittedEncoder(left, head, self._embed, importance, remaining, rows, thinned.quality, number)

    def _smallest(self, fitted: FittedEncoder, decibels: float) -> Encoded | None:
        """Give the smallest file that reaches a PSNR over the views that are quickly looked at; None where none does."""
        trials = Trials(fitted, self._report, TRIALS)
        tried = search(
            lambda q: self._quick(trials.at(q)), decibels, DB_PER_LEVEL, DB_TOLERANCE, fitted.quality, TRIALS
        )
        reaching = [trials.at(quality) for quality, found in tried.items() if found >= decibels]
        return min(reaching, key=lambda one: len(one.data), default=None)

    def _no_larger(self, fitted: FittedEncoder, n_bytes: int) -> Encoded | None:
        """Give a file at the quality that was fitted for, or a coarser one of so many bytes; None where none is as small."""
        first = fitted.encode(level_at(fitted.quality))
        if len(first.data) <= n_bytes:
            return first
        coarser = fitted.quality - math.log(len(first.data) / n_bytes) / LOG_BYTES_PER_LEVEL
        try:
            return encode_to_size(fitted, n_bytes, self._report, coarser, TRIALS).encoded
        except OptionError:
            return None

    def _quick(self, encoded: Encoded) -> float:
        return self._judge.quick(decode(encoded.data, head=self._head).gaussians)

    def _strays(self, fitted: Encoded, plain: Encoded) -> bool:
        """Tell whether a file is farther from the pictures of a capture than another."""
        if self._steps is None or self._avatar.motion is None:
            return False
        found, known = (
            capture_error(decode(one.data, head=self._head).gaussians, self._avatar.motion, self._head, self._steps)
            for one in (fitted, plain)
        )
        return found > known


def encode_tuned(
    avatar: Avatar,
    level: int | Level = 2,
    *,
    head: HeadModel,
    steps: Sequence[Sequence[Target]] | None = None,
    embed_head: bool = False,
    options: MakingUpOptions | None = None,
    thinning: ThinningOptions | None = None,
    report: Report = silent,
) -> bytes:
    """Compress an avatar as well as `encode_by_rendering` does at a level, in fewer bytes: fewer Gaussians, fitted to make up for rounding.

    Args:
        avatar: what to compress.
        level: 1 (smallest) to 4 (best), or a `Level` of one's own.
        head: the head model that it is bound to.
        steps: pictures to look like in the end, with timesteps of the avatar's motion, as `pictures.CaptureSteps` gives them; None for
            pictures of the avatar itself before compression.
        embed_head: add the head model itself to the file.
        options: how long, how fast and towards what.
        thinning: how Gaussians are left out.
        report: told about progress.

    Raises:
        FormatError, HeadError, OptionError: as `sacha_core.encode` does.
        DatasetError: a picture cannot be decoded.
        GeometryError: a frame of the motion makes a triangle degenerate.
    """
    tuner = Tuner(avatar, head, embed_head=embed_head, steps=steps, options=options, thinning=thinning, report=report)
    return tuner.at_level(level).data
