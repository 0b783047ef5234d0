"""A person: a head with an appearance, which any posed mesh of it can put on."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.synthesis.brows import grow_brows, grow_lashes
from sacha_core.synthesis.hair import HairStyle, grow_hair
from sacha_core.synthesis.kernels.shading import (
    ALBEDO,
    CLOTH,
    EYE,
    GLOSS,
    HAIR,
    IRRADIANCE,
    N_COLUMNS,
    NORMAL,
    OPACITY,
    POSITION,
    REST,
    SKIN,
)
from sacha_core.synthesis.landmarks import find_landmarks
from sacha_core.synthesis.light import STUDIO, Shadows, Studio
from sacha_core.synthesis.palette import draw_palette
from sacha_core.synthesis.renderer import Scene, ribbon_faces
from sacha_core.synthesis.skin import paint_surface
from sacha_core.synthesis.strands import joined
from sacha_core.synthesis.surface import subdivide

__all__ = ["Subject"]

ROUNDS = 2  # of subdivision: 1.5 mm between vertices on the face of a FLAME-sized head
SHADOW_ROUNDS = 1  # of the mesh that casts shadows
SKIN_WRAP = (0.30, 0.16, 0.12)  # how far light reaches round the terminator: red light travels furthest under skin
HAIR_WRAP = (0.5, 0.5, 0.5)
HAIR_BIAS_M = 0.012  # strands lie above the mesh that casts shadows, or a little inside it
IRIS_RADIUS_M, PUPIL_RADIUS_M = 0.0061, 0.0023


class Subject:
    """A head dressed for the camera: fine surface, painted skin, hair, brows and lashes.

    What it looks like is fixed by the head, the person's unposed vertices and the seed.

    Args:
        head: the head model, with the official masks.
        vertices: (v, 3) of the person unposed, metres (`flame.posing.person_template`).
        seed: of colours and chance.
        style: of the hair.
        studio: where light comes from.

    Raises:
        HeadError: the head lacks a mask.
        GeometryError: a triangle of the unposed head has no area.
    """

    def __init__(
        self,
        head: HeadModel,
        vertices: Float[np.ndarray, "v 3"],
        seed: int = 0,
        style: HairStyle | None = None,
        studio: Studio = STUDIO,
    ) -> None:
        style = style or HairStyle()
        rng = np.random.default_rng([seed, 1])
        self.faces, self.studio = head.faces, studio
        self.fine = subdivide(head.faces, head.n_vertices, ROUNDS)
        points, _ = self.fine.refine(vertices)
        coarse_normals = self.fine.refine(vertices, rounds=0)[1]
        marks = find_landmarks(head, vertices)
        palette = draw_palette(seed)
        self.rest_frames = triangle_frames(vertices, head.faces)
        self.coat = paint_surface(head, self.fine, points, marks, palette, rng)
        m = style.points_per_strand
        self.strands = joined(
            [
                grow_hair(head, vertices, marks, palette.hair, style, rng),
                grow_brows(head, vertices, coarse_normals, marks, palette.hair, m, rng),
                grow_lashes(head, vertices, marks, palette.hair, m, rng),
            ]
        )
        self.iris = np.array(
            [*palette.iris, *(r / marks.eye_radii.mean() for r in (IRIS_RADIUS_M, PUPIL_RADIUS_M))], np.float32
        )
        ribbons = ribbon_faces(len(self.strands), m, len(points))
        self.all_faces = np.concatenate([self.fine.faces[-1], ribbons])
        self.fixed, self.kinds = self.fixed_table(head, points, marks.eyes)

    def fixed_table(
        self, head: HeadModel, points: Float[np.ndarray, "w 3"], eyes: Float[np.ndarray, "2 3"]
    ) -> tuple[Float[np.ndarray, "r 17"], np.ndarray]:
        """Give the table of vertices with the columns that no pose changes, and the kinds of all triangles."""
        w, q = len(points), self.strands.radii.size
        table = np.zeros((w + q, N_COLUMNS), np.float32)
        table[:w, ALBEDO : ALBEDO + 3] = self.coat.albedo
        table[:w, GLOSS] = self.coat.gloss
        table[:w, OPACITY] = self.coat.opacity
        table[:w, REST : REST + 3] = points
        table[w:, ALBEDO : ALBEDO + 3] = self.strands.albedo.reshape(-1, 3)
        table[w:, OPACITY] = 1
        kinds = np.full(len(self.all_faces), SKIN, np.uint8)
        kinds[len(self.fine.faces[-1]) :] = HAIR
        clothed = self.coat.clothed[self.fine.faces[-1]].any(axis=1)
        kinds[: len(clothed)][clothed] = CLOTH
        for eye, name in zip(eyes, ("left_eyeball", "right_eyeball"), strict=True):
            ball = np.zeros(head.n_vertices, bool)
            ball[head.masks[name]] = True
            of_ball = np.repeat(ball[head.faces].all(axis=1), 4**ROUNDS)
            kinds[: len(of_ball)][of_ball] = EYE
            rows = np.unique(self.fine.faces[-1][of_ball])
            direction = points[rows] - eye
            table[rows, REST : REST + 3] = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        return table, kinds

    def scene(self, vertices: Float[np.ndarray, "v 3"]) -> Scene:
        """Pose, light and shadow the subject once, for any number of cameras.

        Args:
            vertices: (v, 3) of the posed mesh, metres, float32.

        Raises:
            GeometryError: a triangle of the posed head has no area.
        """
        coarse, _ = self.fine.refine(vertices, rounds=SHADOW_ROUNDS)
        points, normals = self.fine.refine(vertices)
        points = points + normals * self.coat.thickness[:, None].astype(np.float32)
        shadows = Shadows(self.studio, coarse, self.fine.faces[SHADOW_ROUNDS])
        strands, outward = self.strands.follow(self.rest_frames, triangle_frames(vertices, self.faces))
        strands, outward = strands.astype(np.float32), outward.astype(np.float32)
        tangents = np.gradient(strands, axis=1)
        tangents /= np.maximum(np.linalg.norm(tangents, axis=2, keepdims=True), 1e-9)
        w = len(points)
        table = self.fixed.copy()
        table[:w, POSITION : POSITION + 3] = points
        table[:w, NORMAL : NORMAL + 3] = normals
        table[:w, IRRADIANCE : IRRADIANCE + 3] = shadows.irradiance(points, normals, SKIN_WRAP)
        flat = np.ascontiguousarray(strands.reshape(-1, 3))
        light = shadows.irradiance(flat, np.ascontiguousarray(outward.reshape(-1, 3)), HAIR_WRAP, HAIR_BIAS_M)
        table[w:, POSITION : POSITION + 3] = flat
        table[w:, NORMAL : NORMAL + 3] = tangents.reshape(-1, 3)
        table[w:, IRRADIANCE : IRRADIANCE + 3] = light * self.strands.exposure.reshape(-1, 1)
        return Scene(
            points,
            flat,
            self.strands.radii.reshape(-1).astype(np.float32),
            strands.shape[1],
            self.all_faces,
            self.kinds,
            table,
            self.studio.lamp_table(),
            self.iris,
            self.coat.shirt,
        )
