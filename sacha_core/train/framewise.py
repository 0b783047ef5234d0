"""The frame-by-frame baseline: for each timestep a static 3D Gaussian Splatting of its own, with no head between them."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import DatasetError, FormatError, OptionError
from sacha_core.files import write_aside
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.interchange.capture import Capture, View
from sacha_core.interchange.splat_ply import read_world_ply, write_world_ply
from sacha_core.perception.psnr import psnr
from sacha_core.perception.ssim import ssim
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.train.checkpoint import flat
from sacha_core.train.loop import Run
from sacha_core.train.options import TrainOptions
from sacha_core.train.scene import fingerprint
from sacha_core.train.state import initial_state
from sacha_core.train.static import (
    WORLD_FRAMES,
    first_gaussians,
    into_world,
    static_options,
    still_capture,
    world_head,
)

__all__ = ["BYTES_PER_GAUSSIAN", "FrameResult", "fit_frames", "frame_ply", "read_frames"]

BYTES_PER_GAUSSIAN = 248  # 62 float32: a record of 3D Gaussian Splatting at degree 3
RESULT, TRAINING = "result.json", "training"


@dataclass(frozen=True)
class FrameResult:
    """One timestep, fitted by itself.

    Args:
        timestep: of the capture.
        n: Gaussians.
        n_first: that it started from.
        bytes: of the Gaussians uncompressed, 248 each.
        psnr: of the held-out camera, decibels; the mean where several are held out.
        ssim: likewise.
        training_seconds: of the fit alone, without looking at the result.
    """

    timestep: int
    n: int
    n_first: int
    bytes: int
    psnr: float
    ssim: float
    training_seconds: float


def fit_frames(
    capture: Capture,
    head: HeadModel,
    timesteps: Sequence[int],
    iterations: int,
    out: str | os.PathLike[str],
    options: TrainOptions | None = None,
    report: Report = silent,
) -> list[FrameResult]:
    """Fit a static 3D Gaussian Splatting to each of some timesteps; those that `out` has already are kept.

    Each goes to `out/frame_TTTT`: `point_cloud.ply` in the layout of 3D Gaussian Splatting, in the world, `result.json`, and
    `held_out.png`, with the image of the held-out camera at the left and the fit at the right. What differs from Inria's schedule, see
    `static_options`.

    Args:
        capture: images and cameras; the tracked mesh tells where the first Gaussians lie, and nothing else.
        head: of the capture.
        timesteps: which ones; each with training views and a view of a held-out camera.
        iterations: of each fit.
        out: folder of the results.
        options: seed, size of the images, degree of the harmonics, device and threads.
        report: told about progress.

    Returns:
        Results in the order of `timesteps`.

    Raises:
        DatasetError: a timestep has no views, an image cannot be decoded, or nothing of the mesh is in view.
        OptionError: `out` holds frames of another capture or with other options.
        FormatError: a result there is damaged.
        OSError: `out` cannot be written.

    Source: SACHA, experiments: the baselines that code each frame on its own.
    """
    chosen = static_options(iterations, options)
    settings = {"options": plain(chosen), "capture": fingerprint(capture, head)}
    for timestep in timesteps:
        require_views(capture, timestep)
    results = []
    for done, timestep in enumerate(timesteps):
        folder = Path(out) / f"frame_{timestep:04d}"
        found = kept(folder, settings)
        if found is None:
            found = _fit(capture, head, timestep, chosen, folder, _of_all(report, done, len(timesteps)))
            with write_aside(folder / RESULT) as aside:
                aside.write_text(json.dumps({**asdict(found), "settings": settings}, indent=2) + "\n", encoding="utf-8")
        results.append(found)
        report(Progress("frames", done + 1, len(timesteps), {"PSNR": found.psnr, "gaussians": float(found.n)}))
    return results


def frame_ply(out: Path, timestep: int) -> Path:
    """Give where the Gaussians of a timestep lie."""
    return out / f"frame_{timestep:04d}" / "point_cloud.ply"


def read_frames(out: str | os.PathLike[str]) -> dict[int, Gaussians]:
    """Give the Gaussians of every timestep that a folder holds, in the world.

    Raises:
        FormatError: it holds none, or one is damaged.
        OSError: the folder or a file cannot be read.
    """
    folders = sorted(path for path in Path(out).iterdir() if re.fullmatch("frame_[0-9]{4,9}", path.name))
    steps = [int(path.name.removeprefix("frame_")) for path in folders]
    found = {step: frame_ply(Path(out), step) for step in steps if frame_ply(Path(out), step).is_file()}
    if not found:
        raise FormatError(f"{out} holds no frame_TTTT/point_cloud.ply; expected a folder of `sacha framewise`")
    return {step: read_world_ply(path) for step, path in found.items()}


def plain(options: TrainOptions) -> dict[str, Any]:
    """Give the options that change the result, as JSON has them."""
    record: dict[str, Any] = json.loads(json.dumps(options.record()))
    return {
        name: value
        for name, value in record.items()
        if name not in {"threads", "checkpoint_every", "image_cache_bytes"}
    }


def require_views(capture: Capture, timestep: int) -> None:
    """Check that a timestep can be fitted and judged.

    Raises:
        DatasetError: it has no training view or no view of a held-out camera.
    """
    for what, views in (("training view", capture.train), ("view of a held-out camera", capture.val)):
        if not any(view.timestep == timestep for view in views):
            known = sorted({view.timestep for view in views})
            there = f"timesteps {known[0]} to {known[-1]} have some" if known else "none has"
            raise DatasetError(f"{capture.root}: timestep {timestep} has no {what}; {there}")


def kept(folder: Path, settings: dict[str, Any]) -> FrameResult | None:
    """Give the result that an earlier call left, if its Gaussians are there, too.

    Raises:
        OptionError: it is of another capture or was made with other options.
        FormatError: it is damaged.
    """
    path = folder / RESULT
    if not path.is_file() or not (folder / "point_cloud.ply").is_file():
        return None
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        before = record.pop("settings")
        found = FrameResult(**record)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise FormatError(f"{path}: not the result of a frame ({error!r}); remove it to fit the frame again") from error
    if before != settings:
        old, new = flat(before) if isinstance(before, dict) else {}, flat(settings)
        name = next(name for name in (*new, *old) if old.get(name) != new.get(name))
        raise OptionError(
            f"{folder} holds a frame with another {name} ({old.get(name)}, not {new.get(name)}); choose another folder"
        )
    return found


def _fit(
    capture: Capture, head: HeadModel, timestep: int, options: TrainOptions, folder: Path, report: Report
) -> FrameResult:
    begun_s = time.monotonic()
    vertices = Poser(head, capture.motion)(timestep)
    origin = vertices.mean(axis=0).astype(np.float32)
    still = still_capture(capture, timestep, origin)
    first = first_gaussians(vertices, head, still, still.train, options)
    if not len(first):
        raise DatasetError(
            f"{capture.root}: no training view of timestep {timestep} shows anything of the tracked mesh"
        )
    shutil.rmtree(folder / TRAINING, ignore_errors=True)
    fitted = into_world(_train(still, first, origin, options, folder / TRAINING, report), origin)
    seconds = time.monotonic() - begun_s
    write_world_ply(folder / "point_cloud.ply", fitted)
    shutil.rmtree(folder / TRAINING)
    scores, picture = _judge(still, read_world_ply(folder / "point_cloud.ply"), options)
    with write_aside(folder / "held_out.png") as aside:
        Image.fromarray(picture).save(aside)
    n = len(fitted)
    return FrameResult(timestep, n, len(first), BYTES_PER_GAUSSIAN * n, *scores, seconds)


def _train(
    still: Capture,
    first: Gaussians,
    origin: Float[np.ndarray, "3"],
    options: TrainOptions,
    folder: Path,
    report: Report,
) -> Gaussians:
    run = Run(still, world_head(), options, folder, report)
    run.begin(resume=False, start_from=None)
    local = replace(first, position=first.position - origin)
    state = initial_state(local, still.motion, run.regions.n_regions, options.density.threshold, options.pruning.ratio)
    run.engine.put(state)
    run.n_gaussians = len(state)
    return run.finish().gaussians


def _judge(
    still: Capture, gaussians: Gaussians, options: TrainOptions
) -> tuple[tuple[float, float], UInt8[np.ndarray, "h w 3"]]:
    """Give mean PSNR and SSIM of the held-out views, and the first beside its image."""
    rasteriser = Rasteriser(options.threads)
    found, sheet = [], None
    for view in still.val:
        truth, drawn = _drawn(still, view, gaussians, options, rasteriser)
        found.append((psnr(drawn, truth), ssim(drawn, truth)))
        if sheet is None:
            shown = np.round(255 * np.clip(drawn, 0, 1)).astype(np.uint8)
            sheet = np.concatenate([truth, shown], axis=1)
    assert sheet is not None
    means = np.mean(found, axis=0)
    return (float(means[0]), float(means[1])), sheet


def _drawn(
    still: Capture, view: View, gaussians: Gaussians, options: TrainOptions, rasteriser: Rasteriser
) -> tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "h w 3"]]:
    truth = still.image(view, options.width, options.height)
    camera = view.camera.resized(truth.shape[1], truth.shape[0])
    return truth, render_avatar(gaussians, WORLD_FRAMES, camera, rasteriser=rasteriser).colour


def _of_all(report: Report, done: int, frames: int) -> Report:
    """Give a report that names the frame that is being fitted."""

    def tell(progress: Progress) -> None:
        if progress.stage == "train":
            stage = f"frame {done + 1} of {frames}"
            report(Progress(stage, progress.done, progress.total, progress.values))

    return tell
