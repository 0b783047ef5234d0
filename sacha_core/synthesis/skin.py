"""What the surface of a head is made of: colour, gloss and opacity of each fine vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.flame.model import HeadModel
from sacha_core.synthesis.brows import BROW_LINE
from sacha_core.synthesis.hair import above_hairline, hairy
from sacha_core.synthesis.kernels.shading import noise_at
from sacha_core.synthesis.landmarks import Landmarks
from sacha_core.synthesis.palette import Palette, linear
from sacha_core.synthesis.surface import FineSurface

__all__ = ["Coat", "paint_surface"]

N_FRECKLES = 90
FADE_M = 0.010  # the lowest part of the bust fades into the background
COLLAR_SLOPE = 0.25  # how much lower it is in front, metre a metre
COLLAR_M = 0.012  # height of the shirt's collar above the boundary of the bust
HEM_M = 0.0035  # thickness of the shirt


@dataclass(frozen=True)
class Coat:
    """What covers the w fine vertices.

    Args:
        albedo: (w, 3) linear RGB.
        gloss: (w,) 0 is matt, 1 wet.
        opacity: (w,) 0 is background.
        thickness: (w,) metres by which cloth stands off the skin.
        clothed: (w,) where the shirt is, and just above it.
        shirt: (7,) colour and cut, as `renderer.Scene.cloth`.
    """

    albedo: Float[np.ndarray, "w 3"]
    gloss: Float[np.ndarray, " w"]
    opacity: Float[np.ndarray, " w"]
    thickness: Float[np.ndarray, " w"]
    clothed: Bool[np.ndarray, " w"]
    shirt: Float[np.ndarray, "7"]


def step(low: float, high: float, x: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Rise smoothly from 0 at `low` to 1 at `high`."""
    t = np.clip((x - low) / (high - low), 0, 1)
    risen: np.ndarray = t * t * (3 - 2 * t)
    return risen


def paint_surface(
    head: HeadModel,
    fine: FineSurface,
    points: Float[np.ndarray, "w 3"],
    landmarks: Landmarks,
    palette: Palette,
    rng: np.random.Generator,
) -> Coat:
    """Paint the unposed head.

    Args:
        head: its masks say what is where.
        fine: topology of the fine surface.
        points: (w, 3) its unposed vertices, metres.
        landmarks: of the same head.
        palette: the person's colours.
        rng: of chance.
    """
    painter = Painter(head, fine, points, landmarks, palette)
    painter.complexion(rng)
    painter.lips()
    painter.inside()
    painter.scalp()
    painter.brows()
    painter.teeth_and_eyes()
    return painter.dressed()


class Painter:
    """Lays one coat of colour over another; lengths are in distances between the eyes."""

    def __init__(
        self,
        head: HeadModel,
        fine: FineSurface,
        points: Float[np.ndarray, "w 3"],
        landmarks: Landmarks,
        palette: Palette,
    ) -> None:
        self.head, self.fine, self.points, self.marks, self.palette = head, fine, points, landmarks, palette
        self.albedo = np.tile(palette.skin, (len(points), 1))
        self.gloss = np.full(len(points), 0.3)

    def mask(self, *names: str) -> Float[np.ndarray, " w"]:
        """Give 1 inside official masks and 0 outside, with a ramp as wide as a triangle."""
        inside = np.zeros(self.head.n_vertices)
        for name in names:
            inside[self.head.masks[name]] = 1
        return self.fine.interpolate(inside)

    def fine_ids(self, name: str) -> Int[np.ndarray, " m"]:
        """Give the vertices of an official mask; in the fine surface they have the same numbers."""
        ids: np.ndarray = self.head.masks[name]
        return ids

    def spot(self, centre: Float[np.ndarray, "3"], radius: float) -> Float[np.ndarray, " w"]:
        """Give a soft ball of influence; `radius` in distances between the eyes."""
        squared = ((self.points - centre) ** 2).sum(axis=1) / (radius * self.marks.spacing) ** 2
        near: np.ndarray = np.exp(-squared)
        return near

    def at(self, right: float, up: float, forward: float) -> Float[np.ndarray, "3"]:
        """Give a place relative to the middle between the eyes, in distances between them; right is the subject's left."""
        place: np.ndarray = self.marks.eyes.mean(axis=0) + self.marks.spacing * np.array([right, up, forward])
        return place

    def mix(self, weight: Float[np.ndarray, " w"], colour: Float[np.ndarray, "3"]) -> None:
        """Cover by a colour."""
        self.albedo += weight[:, None] * (colour - self.albedo)

    def tint(self, weight: Float[np.ndarray, " w"], factor: tuple[float, float, float]) -> None:
        """Multiply by a colour."""
        self.albedo *= 1 + weight[:, None] * (np.array(factor) - 1)

    def complexion(self, rng: np.random.Generator) -> None:
        """Redden what is red on a face, shade what is dark, and add mottling and freckles."""
        marks = self.marks
        for side in (-1, 1):
            self.tint(self.spot(self.at(0.72 * side, -0.75, 0.05), 0.38), (1.04, 0.78, 0.76))
            self.tint(
                self.spot(marks.eyes[0 if side > 0 else 1] + (0, -0.2 * marks.spacing, marks.eye_radii[0]), 0.16),
                (0.93, 0.86, 0.88),
            )
        self.tint(self.spot(marks.nose, 0.25), (1.03, 0.82, 0.80))
        self.tint(self.mask("left_ear", "right_ear"), (1.04, 0.82, 0.80))
        self.tint(self.spot(marks.mouth - (0, 0.55 * marks.spacing, 0), 0.3), (1.01, 0.93, 0.92))
        mottle = noise_at(self.points, 90.0) * 0.6 + noise_at(self.points, 220.0) * 0.4
        self.tint(mottle, (1.03, 1.06, 1.07))
        freckles = self.at(0.0, -0.62, 0.35) + marks.spacing * rng.normal(size=(N_FRECKLES, 3)) * (0.55, 0.28, 0.25)
        for centre, strength in zip(freckles, rng.uniform(0.1, 0.35, N_FRECKLES), strict=True):
            nearest = self.points[np.argmin(((self.points - centre) ** 2).sum(axis=1))]
            self.tint(strength * self.spot(nearest, 0.022), (0.72, 0.55, 0.45))
        oil = self.spot(self.at(0.0, 0.75, 0.3), 0.55) + self.spot(marks.nose, 0.35)
        self.gloss += 0.1 * np.minimum(oil, 1)

    def lips(self) -> None:
        """Paint the lips, with their fine upright lines."""
        lips = self.mask("lips")
        lines = noise_at(self.points * (1.0, 0.12, 0.3), 900.0)
        colour = self.palette.skin * (0.84, 0.47, 0.49)
        self.mix(0.85 * step(0.25, 0.85, lips), colour)
        self.tint(lips * lines, (0.94, 0.92, 0.92))
        self.gloss += 0.25 * lips

    def inside(self) -> None:
        """Darken the mouth from the lips inwards, and redden the lids' inner side."""
        behind = self.fine.interpolate(self.marks.mouth_inside.astype(np.float64))
        depth = (self.marks.mouth[2] - self.points[:, 2]) / self.marks.spacing
        self.mix(behind, self.palette.skin * (0.6, 0.22, 0.22))
        self.tint(behind * step(0.02, 0.45, depth), (0.22, 0.16, 0.16))
        lids = self.fine.interpolate(self.marks.lid_inside.astype(np.float64))
        self.tint(lids, (0.92, 0.62, 0.60))

    def scalp(self) -> None:
        """Darken the skin under the hair, with a soft hairline."""
        rest = self.points[: self.head.n_vertices]
        scalp = self.fine.interpolate(hairy(self.head, rest, self.marks).astype(np.float64))
        scalp *= above_hairline(self.points, self.marks)
        ragged = scalp + 0.18 * noise_at(self.points, 160.0) * scalp * (1 - scalp) * 4
        self.mix(0.92 * step(0.35, 0.95, ragged), self.palette.hair * 0.7)
        self.gloss -= 0.25 * step(0.3, 0.9, scalp)

    def brows(self) -> None:
        """Shade the skin under the brows, which are too thin to cover it."""
        for eye, side in zip(self.marks.eyes, (1, -1), strict=True):
            outwards = side * (self.points[:, 0] - eye[0]) / self.marks.spacing
            up = (self.points[:, 1] - eye[1]) / self.marks.spacing
            line, half = (np.interp(outwards, BROW_LINE[:, 0], BROW_LINE[:, k]) for k in (1, 2))
            ends = step(BROW_LINE[0, 0] - 0.03, BROW_LINE[0, 0] + 0.03, outwards)
            ends *= 1 - step(BROW_LINE[-1, 0] - 0.03, BROW_LINE[-1, 0] + 0.02, outwards)
            front = self.points[:, 2] > eye[2]
            self.mix(0.5 * ends * front * np.exp(-(((up - line) / half) ** 2)), self.palette.hair)

    def teeth_and_eyes(self) -> None:
        """Paint teeth; eyeballs are painted where they are seen."""
        teeth = self.fine.interpolate(self.marks.teeth.astype(np.float64))
        self.mix(teeth, linear((232, 222, 204)))
        self.gloss += 0.45 * teeth

    def dressed(self) -> Coat:
        """Put on the shirt, and give the finished coat."""
        bottom = float(self.points[:, 1].min())
        axis = self.points[self.fine_ids("neck")][:, 2].mean()
        height = self.points[self.fine_ids("boundary")][:, 1].max() + COLLAR_M
        # Lower in front than behind.
        shirt = np.array([*self.palette.cloth, height + COLLAR_SLOPE * axis, COLLAR_SLOPE, axis, self.marks.spacing])
        below = height - COLLAR_SLOPE * (self.points[:, 2] - axis) - self.points[:, 1]
        torso = self.mask("boundary", "neck") > 0
        return Coat(
            np.clip(self.albedo, 0.002, 0.95),
            np.clip(self.gloss, 0, 1),
            step(bottom, bottom + FADE_M, self.points[:, 1]),
            HEM_M * step(-0.002, 0.004, below) * torso,
            torso & (below > -0.012),
            shirt.astype(np.float32),
        )
