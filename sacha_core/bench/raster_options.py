"""What a caller of the rasteriser may leave out of a picture, what that saves, and what it changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import to_world
from sacha_core.bench.clock import Times, interleave
from sacha_core.bench.picture_error import picture_error
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Column, Row, Table
from sacha_core.bench.scenes import front_camera, made_avatar
from sacha_core.flame.posing import pose_vertices
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.parallel.pool import Pool
from sacha_core.raster.bounds import image_bounds
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours
from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import Splats

__all__ = ["OPTIONS", "option_rows"]

DEGREE = 3
DIRTY_PIXELS = 128
REUSE_DEG = 0.5
POSE = 20  # frame of the made motion: the mouth open, the head turned
OPTIONS = Table(
    "options",
    "What one may leave out, on an avatar of this many Gaussians of SH degree 3 with a fourth channel for sensitivity.",
    (
        Column("option", "option"), Column("n", "Gaussians"), Column("width", "width"), Column("height", "height"),
        Column("channels", "channels"), Column("threads", "threads"), Column("colour_ms", "harmonics, ms"),
        Column("forward_ms", "forward, ms"), Column("backward_ms", "backward, ms"), Column("total_ms", "all, ms"),
        Column("max_error", "largest error"), Column("mean_error", "mean error"), Column("change", "change of the picture"),
    ),
    ("option", "n", "width", "height", "threads"),
)  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """An avatar in the world before a camera.

    Args:
        splats: n Gaussians with four channels as seen by the camera: colours of the full degree, and sensitivity.
        sh_dc: (n, 3) harmonics, degree 0.
        sh_rest: (n, k, 3) the others.
        camera: from where.
    """

    splats: Splats
    sh_dc: Float[np.ndarray, "n 3"]
    sh_rest: Float[np.ndarray, "n k 3"]
    camera: Camera

    def colours(self, degree: int, camera: Camera, pool: Pool | None = None) -> Float[np.ndarray, "n 3"]:
        """Give the colours as seen from a camera."""
        return sh_colours(self.sh_dc, self.sh_rest, self.splats.means, camera.centre, degree, pool)

    def shuffled(self, seed: int) -> Scene:
        """Give the same with Gaussians in another order than their triangles'."""
        rows = np.random.default_rng(seed).permutation(len(self.splats))
        arrays = {name: array[rows] for name, array in vars(self.splats).items()}
        return replace(self, splats=Splats(**arrays), sh_dc=self.sh_dc[rows], sh_rest=self.sh_rest[rows])


@dataclass
class Option:
    """One way to draw the scene.

    Args:
        name: what is left out.
        scene: what is drawn.
        threads: on so many.
        degree: of the harmonics; None to keep the colours of a view `REUSE_DEG` away.
        channels: 4, or 3 without sensitivity.
        crop: the rectangle that the avatar takes, or a square in its middle; None for the whole image.
    """

    name: str
    scene: Scene
    threads: int
    degree: int | None = DEGREE
    channels: int = 4
    crop: Literal["avatar", "square"] | None = None
    rasteriser: Rasteriser = field(init=False)
    colours: Float[np.ndarray, "n c"] = field(init=False)
    frame: Frame | None = field(init=False, default=None)
    corner: tuple[int, int] = field(init=False, default=(0, 0))

    def __post_init__(self) -> None:
        self.pool = Pool(self.threads)
        self.rasteriser = Rasteriser(pool=self.pool)
        camera = self.scene.camera
        self.colours = self.scene.splats.colours[:, : self.channels].copy()
        if self.degree is None:
            self.colours[:, :3] = self.scene.colours(DEGREE, turned(camera, REUSE_DEG))
        shape = (self.channels, camera.height, camera.width)
        self.upstream = np.random.default_rng(0).normal(size=shape).astype(np.float32)

    def colour(self) -> None:
        """Evaluate the harmonics, unless colours are kept."""
        if self.degree is not None:
            self.colours[:, :3] = self.scene.colours(self.degree, self.scene.camera, self.pool)

    def forward(self) -> None:
        """Draw, finding the rectangle first where that depends on the avatar."""
        camera, splats = self.scene.camera, replace(self.scene.splats, colours=self.colours)
        if self.crop == "avatar":
            found = image_bounds(splats.means, splats.scales, splats.opacities, camera, pool=self.pool)
            box = found or (0, 0, camera.width, camera.height)
        elif self.crop == "square":
            side = min(DIRTY_PIXELS, camera.width, camera.height)
            box = ((camera.width - side) // 2, (camera.height - side) // 2, side, side)
        else:
            box = (0, 0, camera.width, camera.height)
        self.corner = box[:2]
        self.frame = self.rasteriser.forward(splats, camera.crop(*box), np.ones(self.channels, np.float32))

    def backward(self) -> None:
        """Take a gradient back."""
        assert self.frame is not None
        height, width = self.frame.transmittance.shape
        left, top = self.corner
        self.rasteriser.backward(self.frame, self.upstream[:, top : top + height, left : left + width])

    def picture(self, before: Float[np.ndarray, "4 h w"]) -> Float[np.ndarray, "3 h w"]:
        """Give the colours of the whole image: what was not drawn is as it was before, or white around the avatar."""
        self.colour()
        self.forward()
        assert self.frame is not None
        height, width = self.frame.transmittance.shape
        left, top = self.corner
        whole = before[:3].copy() if self.crop == "square" else np.ones_like(before[:3])
        whole[:, top : top + height, left : left + width] = self.frame.image[:3]
        return whole


def option_rows(preset: Preset, threads: int) -> list[Row]:
    """Time every option turn by turn, and compare the pictures with the exact one and with the whole one."""
    scene = posed_scene(preset.of(500, 50_000, 50_000), preset.of((60, 90), (550, 802), (550, 802)))
    options = [
        Option("whole picture", scene, threads),
        Option("cropped to the avatar", scene, threads, crop="avatar"),
        Option(f"a region of {DIRTY_PIXELS} x {DIRTY_PIXELS}", scene, threads, crop="square"),
        Option("no sensitivity channel", scene, threads, channels=3),
        *(Option(f"SH degree {degree}", scene, threads, degree) for degree in (2, 1, 0)),
        Option(f"colours kept within {REUSE_DEG}°", scene, threads, degree=None),
        Option("not sorted by triangle", scene.shuffled(preset.seed), threads),
    ]
    for option in options:
        option.forward()
    tasks: dict[tuple[str, str], Callable[[], None]] = {
        (option.name, part): getattr(option, part) for option in options for part in ("colour", "forward", "backward")
    }
    times = interleave(tasks, rounds=preset.of(3, 15, 41), budget_s=preset.of(1, 15, 120))
    whole = options[0].frame
    assert whole is not None
    before, depths = whole.image.copy(), whole.bins.projection.depths[: len(scene.splats)].copy()
    exact = replace(scene.splats, colours=scene.splats.colours[:, :3])
    rows: list[Row] = []
    for option in options:
        picture = option.picture(before)
        error = picture_error(picture, exact, scene.camera, np.ones(3), depths, preset.of(2, 48, 128))
        steps: list[Times] = [times[option.name, part] for part in ("colour", "forward", "backward")]
        rows.append(
            {
                "table": OPTIONS.name, "option": option.name, "n": len(scene.splats), "height": scene.camera.height,
                "width": scene.camera.width, "channels": option.channels, "threads": threads,
                **steps[0].row("colour"), **steps[1].row("forward"), **steps[2].row("backward"),
                **(steps[0] + steps[1] + steps[2]).row("total"), **error.row(),
                "change": float(np.abs(picture - before[:3]).max()),
            }
        )  # fmt: skip
    return rows


def posed_scene(n: int, size: tuple[int, int]) -> Scene:
    """Put a made avatar into the world, in a pose, before a camera."""
    avatar, head = made_avatar(n)
    gaussians, camera = avatar.gaussians, front_camera(*size)
    assert avatar.motion is not None
    frames = triangle_frames(pose_vertices(head, avatar.motion, POSE), head.faces)
    world = to_world(gaussians, frames)
    seen = sh_colours(gaussians.sh_dc, gaussians.sh_rest, world.means, camera.centre, DEGREE)
    sensitivity = np.random.default_rng(1).uniform(0, 1, (n, 1)).astype(np.float32)
    splats = Splats(
        world.means, world.scales, world.quaternions, world.opacities, np.concatenate([seen, sensitivity], 1)
    )
    return Scene(splats, gaussians.sh_dc, gaussians.sh_rest, camera)


def turned(camera: Camera, by_deg: float) -> Camera:
    """Give a camera that went round the world's middle by an angle, still looking at it."""
    angle = np.radians(by_deg)
    c, s = np.cos(angle), np.sin(angle)
    around = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return replace(camera, rotation=camera.rotation @ around.T)
