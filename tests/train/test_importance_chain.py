"""The whole importance score q again, from the pixels of the images to the number: naive float64 from the paper's formulas alone.

Nothing of the package computes the expected side: it has its own posing, triangle frames, projection, compositor, sensitivity map and
percentile.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ball
from PIL import Image

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.camera import Camera
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.importance import importance, look
from sacha_core.train.options import ImportanceOptions, TrainOptions
from sacha_core.train.state import initial_state
from sacha_core.train.views import TrainingViews, grouped

N, SIDE = 50, 32
LAMBDA_S, LAMBDA_A = 0.7, 1.3
OPTIONS = TrainOptions(
    threads=1,
    device="cpu",
    fine_tune=False,
    importance=ImportanceOptions(pixel_factor=LAMBDA_S, gaussian_factor=LAMBDA_A),
)
FLOAT32 = 2e-4  # relative: float32 weights of a few hundred pixels
FLIPS = 0.02  # pixels: a few decisions at alpha = 1/255, that float32 takes otherwise


@dataclass(frozen=True)
class Small:
    """A head with 50 Gaussians and a capture of noise and edges."""

    head: HeadModel
    gaussians: Gaussians
    capture: Capture


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Small:
    root: Path = tmp_path_factory.mktemp("small")
    rng, head = np.random.default_rng(5), ball()
    start = initial_gaussians(head.n_faces, rng, 0).select(np.sort(rng.choice(head.n_faces, N)))
    gaussians = replace(
        start,
        position=rng.normal(0, 0.5, (N, 3)).astype(np.float32),
        log_scale=rng.normal(-1, 0.7, (N, 3)).astype(np.float32),
        quaternion=rng.normal(size=(N, 4)).astype(np.float32),
        opacity_logit=rng.normal(1, 2, N).astype(np.float32),
        sensitivity_logit=rng.normal(0, 1.5, N).astype(np.float32),
    )
    rest = Motion.rest(0, 3, 2)
    motion = replace(
        rest,
        expression=rng.normal(0, 1, (2, 3)).astype(np.float32),
        translation=rng.normal(0, 0.02, (2, 3)).astype(np.float32),
    )
    views = []
    for timestep, index in ((0, 0), (0, 1), (1, 0), (1, 2)):
        eye = 0.5 * np.array([np.sin(1.9 * index), 0.3, np.cos(1.9 * index)])
        camera = Camera.look_at(eye, np.zeros(3), SIDE, SIDE, 1.5 * SIDE)
        pixels = np.full((SIDE, SIDE, 3), 255, np.uint8)
        pixels[4:28, 6:25] = rng.integers(60, 200, 3) + rng.integers(
            -2, 3, (24, 19, 1)
        )  # edges as faint as the threshold
        pixels[8:20, 9:17] = rng.integers(0, 256, (12, 8, 3))
        path = root / f"{timestep}_{index}.png"
        Image.fromarray(pixels).save(path)
        views.append(View(timestep, index, camera, path, None))
    return Small(head, gaussians, Capture(root, head.reference, None, motion, tuple(views), (), ()))


def naive_map(pixels: np.ndarray) -> np.ndarray:
    """Mark sensitive pixels: luma, gamma, Sobel, blocks of five; one pixel after the other."""
    h, w, _ = pixels.shape
    light = np.zeros((h, w))
    for y in range(h):
        for x in range(w):
            r, g, b = (int(c) for c in pixels[y, x])
            luma = (r * 19595 + g * 38470 + b * 7471 + 0x8000) >> 16  # Pillow's ITU-R 601
            light[y, x] = round(255 * (luma / 255) ** (1 / 1.5)) / 255

    def at(y: int, x: int) -> float:
        return float(light[min(max(y, 0), h - 1), min(max(x, 0), w - 1)])

    edge = np.zeros((h, w))
    for y in range(h):
        for x in range(w):
            across = sum(k * (at(y + d, x + 1) - at(y + d, x - 1)) for d, k in ((-1, 1), (0, 2), (1, 1)))
            down = sum(k * (at(y + 1, x + d) - at(y - 1, x + d)) for d, k in ((-1, 1), (0, 2), (1, 1)))
            edge[y, x] = math.hypot(across, down) > 0.05
    blocks = [
        [edge[5 * i : 5 * i + 5, 5 * j : 5 * j + 5].sum() / 25 > 0.3 for j in range(w // 5)] for i in range(h // 5)
    ]
    return np.array([[blocks[y * (h // 5) // h][x * (w // 5) // w] for x in range(w)] for y in range(h)], float)


def turn(quaternion: np.ndarray) -> np.ndarray:
    """Give the matrix of a quaternion wxyz by Rodrigues' formula."""
    unit = quaternion / np.linalg.norm(quaternion)
    sine = np.linalg.norm(unit[1:])
    axis, angle = unit[1:] / sine, 2 * math.atan2(sine, unit[0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def placed(small: Small, timestep: int) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Give mean, covariance and opacity of each Gaussian in the world."""
    motion, head = small.capture.motion, small.head
    vertices = head.v_template.astype(np.float64) + head.exprdirs.astype(np.float64) @ motion.expression[timestep]
    vertices = vertices + motion.translation[timestep]  # no joint turns
    found = []
    for i in range(N):
        g = small.gaussians
        a, b, c = vertices[head.faces[g.binding[i]]]
        first = (b - a) / np.linalg.norm(b - a)
        normal = np.cross(first, c - a)
        normal /= np.linalg.norm(normal)
        third = -np.cross(normal, first)
        size = (np.linalg.norm(b - a) + abs(third @ (c - a))) / 2
        frame = np.stack([first, normal, third], axis=1)
        mean = size * frame @ g.position[i].astype(np.float64) + (a + b + c) / 3
        axes = frame @ turn(g.quaternion[i].astype(np.float64)) * (size * np.exp(g.log_scale[i].astype(np.float64)))
        found.append((mean, axes @ axes.T, 1 / (1 + math.exp(-float(g.opacity_logit[i])))))
    return found


def naive_weights(small: Small, view: View) -> np.ndarray:
    """Give (n, h, w) blending weights alpha T, front to back."""
    camera, weights, drawn = view.camera, np.zeros((N, SIDE, SIDE)), []
    rotation = np.asarray(camera.rotation, np.float64)
    for i, (mean, covariance, opacity) in enumerate(placed(small, view.timestep)):
        x, y, z = rotation @ mean + camera.translation
        slope_x = np.clip(x / z, (-0.15 * SIDE - camera.cx) / camera.fx, (1.15 * SIDE - camera.cx) / camera.fx)
        slope_y = np.clip(y / z, (-0.15 * SIDE - camera.cy) / camera.fy, (1.15 * SIDE - camera.cy) / camera.fy)
        jacobian = np.array(
            [[camera.fx / z, 0, -camera.fx * slope_x / z], [0, camera.fy / z, -camera.fy * slope_y / z]]
        )
        flat = jacobian @ rotation
        spread = flat @ covariance @ flat.T + 0.3 * np.eye(2)
        place = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        drawn.append((z, i, place, np.linalg.inv(spread), opacity))
    for row in range(SIDE):
        for column in range(SIDE):
            through = 1.0
            for _, i, place, conic, opacity in sorted(drawn, key=lambda splat: splat[0]):
                d = np.array([column + 0.5 - place[0], row + 0.5 - place[1]])
                alpha = opacity * math.exp(-0.5 * d @ conic @ d)
                if alpha < 1 / 255:
                    continue
                alpha = min(alpha, 0.99)
                if through * (1 - alpha) <= 1e-4:
                    break
                weights[i, row, column] = alpha * through
                through *= 1 - alpha
    return weights


def naive_percentile(values: list[float], percent: float) -> float:
    ordered = sorted(values)
    place = percent / 100 * (len(ordered) - 1)
    low = math.floor(place)
    return ordered[low] + (place - low) * (ordered[min(low + 1, len(ordered) - 1)] - ordered[low])


@pytest.fixture(scope="module")
def expected(small: Small) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give both sums of weights, and q."""
    weight, sensitive = np.zeros(N), np.zeros(N)
    for view in small.capture.train:
        marked = naive_map(np.asarray(Image.open(view.image_path).convert("RGB")))
        assert 0.05 < marked.mean() < 0.95
        of = naive_weights(small, view)
        weight += of.sum(axis=(1, 2))
        sensitive += (of * marked).sum(axis=(1, 2))
    g = small.gaussians
    volumes = [4 / 3 * math.pi * math.prod(math.exp(float(s)) for s in g.log_scale[i]) for i in range(N)]
    reference = naive_percentile(volumes, 90)
    q = np.array([
        (weight[i] + LAMBDA_S * sensitive[i])
        * (1 + LAMBDA_A / (1 + math.exp(-float(g.sensitivity_logit[i]))))
        * min(volumes[i] / reference, 1) ** 0.1
        for i in range(N)
    ])  # fmt: skip
    return weight, sensitive, q


@pytest.mark.parametrize("cameras", [1, 2])
def test_q_is_that_of_the_formulas(small: Small, expected, cameras: int) -> None:
    weight, sensitive, q = expected
    engine = CpuEngine(small.head, small.capture.motion, OPTIONS)
    state = initial_state(small.gaussians, small.capture.motion, 8, 1e-3, 0.2)
    engine.put(state)
    views = TrainingViews(small.capture)
    steps = ([views[i] for i in step] for step in grouped(views.views, range(4), cameras))
    seen = look(engine, steps, 4, 0)
    largest = weight.max()
    assert (weight > 1).sum() > 30  # most do show, and some are hidden or nearly
    assert np.abs(seen.weights[:, 0] - weight).max() < FLOAT32 * largest + FLIPS
    assert np.abs(seen.weights[:, 1] - sensitive).max() < FLOAT32 * largest + FLIPS
    found = importance(state, OPTIONS, seen, triangle_frames(small.head.v_template, small.head.faces).scale)
    assert np.abs(found - q).max() < (FLOAT32 * largest + FLIPS) * (1 + LAMBDA_S) * (1 + LAMBDA_A)
    seen_well = weight > 5
    assert found[seen_well] == pytest.approx(q[seen_well], rel=5e-3)
    assert (found[weight == 0] == 0).all()
