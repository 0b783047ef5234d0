"""The scores file, `NAME.scores.npz`: what choosing another budget later needs."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.events import Event, dump_events, parse_events
from sacha_core.errors import FormatError
from sacha_core.npz import read_npz, write_npz

__all__ = ["BlendingSums", "Scores", "read_scores", "write_scores"]

VERSION = 1
WIDTHS: dict[str, tuple[int | None, ...]] = {
    "position": (3,),
    "log_scale": (3,),
    "quaternion": (4,),
    "opacity_logit": (),
    "sh_dc": (3,),
    "sh_rest": (None, 3),
    "binding": (),
    "sensitivity_logit": (),
    "score": (),
}
SUMS = ("weight", "sensitive_weight")  # there or not, both together with `n_views`


@dataclass(frozen=True)
class BlendingSums:
    """What views showed of each of n Gaussians: all that a score needs of them, so that another can be made without drawing again.

    Args:
        weight: (n,) blending weight summed over the pixels of all views, in pixels.
        sensitive_weight: (n,) the same sum with each pixel times its reference sensitivity.
        n_views: how many views.
    """

    weight: Float[np.ndarray, " n"]
    sensitive_weight: Float[np.ndarray, " n"]
    n_views: int

    def visible(self, least_pixels: float) -> Bool[np.ndarray, " n"]:
        """Tell which Gaussians have more blending weight than so many pixels a view."""
        visible: np.ndarray = self.weight > least_pixels * self.n_views
        return visible


@dataclass(frozen=True)
class Scores:
    """Every Gaussian before the last prune, with what it was worth.

    Args:
        gaussians: n Gaussians with their sensitivity.
        score: (n,) importance, not negative.
        n_faces: triangles of the head that they are bound to.
        scheme: name of the region scheme.
        events: everything that density control did.
        sums: what the scores were made of; None in a file that does not say.
    """

    gaussians: Gaussians
    score: Float[np.ndarray, " n"]
    n_faces: int
    scheme: str
    events: tuple[Event, ...] = ()
    sums: BlendingSums | None = None


def write_scores(path: str | os.PathLike[str], scores: Scores) -> None:
    """Write a scores file.

    Raises:
        OSError: it cannot be written.
    """
    arrays = {f.name: getattr(scores.gaussians, f.name) for f in fields(scores.gaussians)}
    if arrays["sensitivity_logit"] is None:
        raise ValueError("a scores file holds sensitivities, and these Gaussians have none")
    text = {"scheme": np.array(scores.scheme), "events": np.array(dump_events(scores.events))}
    header = {"version": np.array(VERSION, np.int32), "n_faces": np.array(scores.n_faces, np.int32)}
    write_npz(path, {**header, **text, **arrays, "score": scores.score, **_sum_arrays(scores.sums)})


def read_scores(path: str | os.PathLike[str]) -> Scores:
    """Read and check a scores file.

    Raises:
        FormatError: it is damaged or not a scores file; the message says what was wrong and what was expected.
        OSError: it cannot be read.
    """
    arrays = read_npz(path)
    expected = {"version", "n_faces", "scheme", "events", *WIDTHS}
    if missing := sorted(expected - arrays.keys()):
        raise FormatError(f"{path}: not a scores file: {missing[0]!r} is missing")
    if (version := _integer(path, arrays, "version")) != VERSION:
        raise FormatError(f"{path}: scores file version {version}, expected {VERSION}")
    n = arrays["binding"].size
    for name, width in WIDTHS.items():
        _check_shape(path, name, arrays[name], (n, *width))
    score = arrays["score"].astype(np.float64, copy=False)
    if n and not (np.isfinite(score).all() and score.min() >= 0):
        raise FormatError(f"{path}: a score is negative or not finite; expected numbers from 0")
    attributes = {name: arrays[name] for name in WIDTHS if name != "score"}
    attributes["binding"] = attributes["binding"].astype(np.int32, copy=False)
    gaussians = Gaussians(**attributes)
    n_faces = _integer(path, arrays, "n_faces")
    try:
        gaussians.validate(n_faces)
        events = parse_events(_text(path, arrays, "events"))
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error
    return Scores(gaussians, score, n_faces, _text(path, arrays, "scheme"), events, _sums(path, arrays, n))


def _sum_arrays(sums: BlendingSums | None) -> dict[str, np.ndarray]:
    if sums is None:
        return {}
    return {**{name: getattr(sums, name) for name in SUMS}, "n_views": np.array(sums.n_views, np.int32)}


def _sums(path: str | os.PathLike[str], arrays: dict[str, np.ndarray], n: int) -> BlendingSums | None:
    names = (*SUMS, "n_views")
    held = [name for name in names if name in arrays]
    if not held:
        return None
    if len(held) < len(names):
        raise FormatError(f"{path}: of {', '.join(names)} it has only {', '.join(held)}; expected all or none")
    for name in SUMS:
        _check_shape(path, name, arrays[name], (n,))
        if not ((arrays[name] >= 0) & np.isfinite(arrays[name])).all():
            raise FormatError(f"{path}: a {name} is negative or not finite; expected numbers from 0")
    n_views = _integer(path, arrays, "n_views")
    if n_views < 0:
        raise FormatError(f"{path}: n_views is {n_views}, expected 0 or more")
    weight, sensitive = (arrays[name].astype(np.float64, copy=False) for name in SUMS)
    return BlendingSums(weight, sensitive, n_views)


def _check_shape(path: str | os.PathLike[str], name: str, array: np.ndarray, shape: tuple[int | None, ...]) -> None:
    fits = array.ndim == len(shape) and all(want in (None, have) for have, want in zip(array.shape, shape, strict=True))
    kind = np.integer if name == "binding" else np.floating
    if not fits or not np.issubdtype(array.dtype, kind):
        wanted = f"({', '.join('k' if size is None else str(size) for size in shape)}) {kind.__name__}"
        raise FormatError(f"{path}: {name} is {array.shape} of {array.dtype}, expected {wanted}")


def _integer(path: str | os.PathLike[str], arrays: dict[str, np.ndarray], name: str) -> int:
    if arrays[name].shape != () or not np.issubdtype(arrays[name].dtype, np.integer):
        raise FormatError(f"{path}: {name} is not one integer")
    return int(arrays[name])


def _text(path: str | os.PathLike[str], arrays: dict[str, np.ndarray], name: str) -> str:
    if arrays[name].shape != () or arrays[name].dtype.kind != "U":
        raise FormatError(f"{path}: {name} is not one text")
    return str(arrays[name])
