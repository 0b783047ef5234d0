"""Hard captures: one camera, one frame, pictures with nothing to learn from. Each is trained on for a while, with every kind of event."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import UInt8

from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.tiny import AIM, HEIGHT, WIDTH, capture_of, eventful, ring, tiny_head
from sacha_core.errors import DatasetError
from sacha_core.interchange.capture import Capture, View
from sacha_core.progress import silent
from sacha_core.raster.camera import Camera
from sacha_core.train.loop import Run, train
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import TrainedModel

__all__ = ["cases", "trained"]

ITERATIONS = 40
VARIANTS = ("sacha", "default")
LEARNS = 0.9  # of the first loss, which the last is below where there is something to learn

FINITE = "train to the end without a fault, every parameter finite"
LEARN = f"{FINITE}; the loss falls"
FINITE_OR_EMPTY = f"{FINITE}; or say that no Gaussian is left"

Make = Callable[[Path], Capture]


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` trains ten times as long."""
    iterations = 10 * ITERATIONS if full else ITERATIONS
    for name, given, make in _learnable():
        yield Case(name, given, LEARN, partial(_trains, make, iterations, True))
    for name, given, make in _hopeless():
        yield Case(name, given, FINITE_OR_EMPTY, partial(_trains, make, iterations, False))
    yield Case("no view to train on", "a capture without training views", "be refused by name", _no_views)
    yield Case("a broken picture", "a file that ends in its middle", "be refused by name", _broken_picture)
    yield Case("a camera in no place", "its translation is not a number", "be refused by name", _nowhere)


def _learnable() -> Iterator[tuple[str, str, Make]]:
    yield "one camera", "six frames before one camera: monocular", partial(_filmed, ring(1), 6)
    yield "one frame", "six cameras, one timestep", partial(_filmed, ring(6), 1)
    yield "one camera, one frame", "a single picture", partial(_filmed, ring(1), 1)
    yield "a stereo pair", "two cameras 6 cm apart, three frames", partial(_filmed, _stereo(), 3)
    yield "black pictures", "six cameras, two frames", partial(_filled, 0)
    yield "grey pictures", "six cameras, two frames", partial(_filled, 127)
    yield "pictures of noise", "every pixel random, other in each picture", _noise


def _hopeless() -> Iterator[tuple[str, str, Make]]:
    yield "white pictures", "nothing but background", partial(_filled, 255)
    yield "transparent pictures", "RGBA with alpha 0", _transparent
    yield "cameras that look away", "the head behind all of them", _away
    yield (
        "cameras in the head",
        "5 mm from its middle: most of it nearer than the near plane",
        partial(_filmed, ring(4, 0.005), 2),
    )
    yield "cameras far away", "at 400 m, where the head is a tenth of a pixel", partial(_filmed, ring(4, 400.0), 2)
    yield "one pixel", "pictures of 1 x 1", partial(_filmed, ring(4, width=1, height=1), 2)
    yield "narrow pictures", "3 x 60, less than SSIM's window across", partial(_filmed, ring(4, width=3, height=60), 2)
    yield "pictures of several sizes", "each camera its own", _several_sizes


def _trains(make: Make, iterations: int, learns: bool, findings: Findings) -> None:
    for variant in findings.each({name: name for name in VARIANTS}):
        try:
            with TemporaryDirectory() as folder:
                model, losses = trained(make(Path(folder)), eventful(iterations, variant), Path(folder) / variant)
        except DatasetError as refusal:
            none_left = not learns and "no Gaussian is left" in str(refusal)
            findings.require(none_left, f"{variant} says that none is left" if none_left else str(refusal))
            continue
        findings.require(model.faults.count == 0, str(model.faults))
        model.gaussians.validate(tiny_head().n_faces)
        model.motion.validate()
        findings.require(len(losses) == iterations and bool(np.isfinite(losses).all()), "every loss finite")
        if learns:
            fall = float(np.mean(losses[-5:]) / np.mean(losses[:5]))
            findings.below(f"{variant}: last over first losses", fall, LEARNS)


def trained(capture: Capture, options: TrainOptions, folder: Path) -> tuple[TrainedModel, list[float]]:
    """Train a tiny head; give the model and the loss of each iteration that had no fault."""
    run = Run(capture, tiny_head(), options, folder, silent)
    run.begin(resume=False, start_from=None)
    losses = []
    while run.iteration < options.schedule.iterations:
        run.iterate()
        losses += [part["total"] for part in (run.engine.losses(),) if part]
    return run.finish(), losses


def _filmed(cameras: Sequence[Camera], n_frames: int, folder: Path) -> Capture:
    return capture_of(folder, cameras, n_frames)


def _filled(value: int, folder: Path) -> Capture:
    return capture_of(folder, ring(6), 2, lambda view, *_: _plain(view, value))


def _plain(view: View, value: int) -> UInt8[np.ndarray, "h w 3"]:
    return np.full((view.camera.height, view.camera.width, 3), value, np.uint8)


def _noise(folder: Path) -> Capture:
    rng = np.random.default_rng(15)
    return capture_of(folder, ring(6), 2, lambda *_: rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8))


def _transparent(folder: Path) -> Capture:
    return capture_of(folder, ring(6), 2, lambda *_: np.zeros((HEIGHT, WIDTH, 4), np.uint8))


def _stereo() -> tuple[Camera, ...]:
    return tuple(Camera.look_at(AIM + np.array([x, 0, 0.8]), AIM, WIDTH, HEIGHT, 120.0) for x in (-0.03, 0.03))


def _away(folder: Path) -> Capture:
    about = np.array([1, -1, -1])  # half a turn about the camera's own axis across

    def turned(camera: Camera) -> Camera:
        return replace(camera, rotation=camera.rotation * about[:, None], translation=camera.translation * about)

    return capture_of(folder, [turned(camera) for camera in ring(6)], 2)


def _several_sizes(folder: Path) -> Capture:
    sizes = ((20, 30), (41, 17), (64, 64), (8, 50))
    return capture_of(folder, [camera.resized(*size) for camera, size in zip(ring(4), sizes, strict=True)], 2)


def _no_views(findings: Findings) -> None:
    with TemporaryDirectory() as folder:
        capture = replace(capture_of(Path(folder), ring(2), 1), train=())
        _refused(findings, capture, "no view to train on")


def _broken_picture(findings: Findings) -> None:
    with TemporaryDirectory() as folder:
        capture = capture_of(Path(folder), ring(2), 1)
        path = capture.train[1].image_path
        path.write_bytes(path.read_bytes()[:-200])
        _refused(findings, capture, path.name)


def _nowhere(findings: Findings) -> None:
    with TemporaryDirectory() as folder:
        capture = capture_of(Path(folder), ring(2), 1)
        first, second = capture.train
        lost = replace(first, camera=replace(first.camera, translation=np.full(3, np.nan)))
        _refused(findings, replace(capture, train=(lost, second)), str(capture.root))


def _refused(findings: Findings, capture: Capture, words: str) -> None:
    action = partial(train, capture, tiny_head(), eventful(ITERATIONS), capture.root / "model")
    findings.refused(action, DatasetError, words)
