"""The way back from Gaussians in the world to their parameters and the pose, against finite differences of the way there in float64.

In float64 it is a plain twin that they judge; the kernel, which knows float32 alone, is held to the twin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from plain_carry_backward import carry_backward

from sacha_core.animation.carry import carry
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.parallel.pool import Pool
from sacha_core.train.kernels.carry_backward import PULLS
from sacha_core.train.kernels.settle import SCRATCH, settle
from sacha_core.train.rig import Rig
from sacha_core.train.state import FITTED_MOTION

STEP = 1e-5  # of central differences in float64: cut and rounding are each some 1e-10 then
DIFFERENCES = 1e-7  # relative to the largest entry; of these
GRADIENT_32 = 1e-4  # likewise; of float32, in sums of some hundred terms that partly cancel
OWN = ("position", "log_scale", "quaternion")
N = 40


def random_head(n_joints: int, correctives: bool, v: int = 40) -> HeadModel:
    rng = np.random.default_rng(n_joints)
    weights, regressor = rng.random((v, n_joints)), rng.random((n_joints, v))
    weights[0, 1:] = 0
    return HeadModel(
        name="random",
        v_template=rng.normal(size=(v, 3)).astype(np.float32),
        faces=np.concatenate(
            [np.arange(v - v % 3).reshape(-1, 3), rng.permuted(np.tile(np.arange(v), (5, 1)), axis=1)[:, :3]]
        ).astype(np.int32),
        shapedirs=rng.normal(size=(v, 3, 2)).astype(np.float32),
        exprdirs=(rng.normal(size=(v, 3, 4)) / 10).astype(np.float32),
        J_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1], np.int32)[:n_joints],
        posedirs=(rng.normal(size=(v, 3, 9 * (n_joints - 1))) / 10).astype(np.float32) if correctives else None,
    )


@dataclass
class Scene:
    """Gaussians on a random head in a random pose, and a linear loss of what becomes of them in the world."""

    head: HeadModel
    values: dict[str, np.ndarray]
    binding: np.ndarray
    upstream: tuple[np.ndarray, ...]

    @classmethod
    def random(cls, n_joints: int = 5, correctives: bool = True, rest: bool = False) -> Scene:
        rng, head = np.random.default_rng(7), random_head(n_joints, correctives)
        widths = {"expression": 4, "rotation": 3, "neck": 3, "jaw": 3, "eyes": 6, "translation": 3}
        values = {name: (0.0 if rest else 1.0) * rng.normal(size=width) for name, width in widths.items()}
        spreads = (1.0, 0.5, 2.0)
        values |= {name: s * rng.normal(size=(N, c)) for name, s, c in zip(OWN, spreads, (3, 3, 4), strict=True)}
        bound = rng.choice(head.n_faces - 1, 7, replace=False)  # some triangles carry nothing, others several
        upstream = tuple(rng.normal(size=(N, c)) for c in (3, 3, 4))
        return cls(head, values, np.sort(rng.choice(bound, N)).astype(np.int32), upstream)

    def rig(self, dtype: type[np.floating], threads: int = 1) -> Rig:
        motion = Motion(
            np.ones(2, np.float32), np.zeros((0, 3), np.float32), *(np.zeros((1, w)) for w in (4, 3, 3, 3, 6, 3))
        )
        return Rig(self.head, motion, Pool(threads), dtype)

    def loss(self, rig: Rig, values: dict[str, np.ndarray]) -> float:
        world = carry(*(values[name] for name in OWN), self.binding, rig.pose(values))
        return float(sum((a * b).sum() for a, b in zip(world, self.upstream, strict=True)))

    def gradients(
        self, dtype: type[np.floating], with_mesh: bool = True, threads: int = 1, unseen: tuple[int, ...] = ()
    ) -> dict[str, np.ndarray]:
        seen = np.ones(N, np.int32)
        seen[list(unseen)] = 0
        rig, values = self.rig(dtype, threads), {name: value.astype(dtype) for name, value in self.values.items()}
        pose = rig.pose(values)
        own = [values[name] for name in OWN]
        world = carry(*own, self.binding, pose)
        first_row = np.searchsorted(self.binding, np.arange(self.head.n_faces + 1)).astype(np.int32)
        back = {name: np.full_like(value, np.nan) for name, value in zip(OWN, own, strict=True)}
        rig.g_corners[:] = np.nan
        bounds = np.linspace(0, self.head.n_faces, threads + 1).astype(int)
        slopes = [u.astype(dtype) for u in self.upstream]
        if dtype == np.float64:
            carry_backward(
                0, self.head.n_faces, first_row, seen, own[2], *world, *slopes, pose.vertices, rig.faces,
                pose.frames.rotation, pose.frames.scale, pose.frames.origin, with_mesh, *back.values(), rig.g_corners,
            )  # fmt: skip
        else:
            self.settle(bounds, first_row, seen, own, world, slopes, pose, rig, with_mesh, back)
        if with_mesh:
            back |= rig.backward(pose, {name: values[name] for name in FITTED_MOTION})
        return back

    def settle(self, bounds, first_row, seen, own, world, slopes, pose, rig, with_mesh, back) -> None:
        """Let the kernel go back, without penalties, a chunk for each of the bounds."""
        ones, four, limits = (
            np.ones(N, np.float32),
            np.ones(4 * N, np.float32),
            np.array([1e30, 1e30, 0, 0], np.float32),
        )
        flat = [array.reshape(-1) for array in (*own, *world, *slopes)]
        out, most, frames = [np.full(N, np.nan, np.float32) for _ in range(2)], int(np.diff(bounds).max()), pose.frames
        for chunk in range(len(bounds) - 1):
            sound = settle(
                chunk, chunk + 1, bounds, first_row[bounds], flat[0], flat[2], self.binding, flat[4], flat[5], ones, four,
                flat[6], flat[7], flat[8], ones, four, pose.vertices.reshape(-1), rig.faces.reshape(-1), frames.rotation.reshape(-1),
                frames.scale, with_mesh, seen.astype(np.float32), limits, np.float32(1e18), np.zeros(3 * N, np.float32), *out,
                back["log_scale"].reshape(-1), back["quaternion"].reshape(-1), back["position"].reshape(-1), rig.g_corners.reshape(-1),
                np.zeros((len(bounds), 2)), np.empty(SCRATCH, np.float32), np.empty(PULLS * most, np.float32),
            )  # fmt: skip
            assert sound


@pytest.mark.parametrize("rest", [False, True], ids=["posed", "at rest, where Rodrigues' angle vanishes"])
@pytest.mark.parametrize(("n_joints", "correctives"), [(5, True), (5, False), (3, True), (1, False)])
def test_gradients_are_finite_differences(n_joints: int, correctives: bool, rest: bool) -> None:
    scene = Scene.random(n_joints, correctives, rest)
    rig, rng = scene.rig(np.float64), np.random.default_rng(0)
    gradients = scene.gradients(np.float64)
    for name, gradient in gradients.items():
        assert gradient.shape == scene.values[name].shape
        entries = rng.choice(gradient.size, min(gradient.size, 12), replace=False)
        for entry in entries:
            ends = []
            for sign in (1, -1):
                moved = {key: value.copy() for key, value in scene.values.items()}
                moved[name].reshape(-1)[entry] += sign * STEP
                ends.append(scene.loss(rig, moved))
            slope = (ends[0] - ends[1]) / (2 * STEP)
            assert gradient.reshape(-1)[entry] == pytest.approx(slope, abs=DIFFERENCES * max(abs(gradient).max(), 1)), (
                name
            )


def test_float32_agrees_with_float64() -> None:
    scene = Scene.random()
    double = scene.gradients(np.float64)
    for name, single in scene.gradients(np.float32).items():
        assert single.dtype == np.float32
        np.testing.assert_allclose(single, double[name], atol=GRADIENT_32 * abs(double[name]).max(), err_msg=name)


def test_threads_change_no_bit() -> None:
    scene = Scene.random()
    alone = scene.gradients(np.float32)
    for name, gradient in scene.gradients(np.float32, threads=3).items():
        assert np.array_equal(gradient, alone[name]), name


def test_a_mesh_that_stands_still_changes_nothing_for_those_on_it() -> None:
    scene = Scene.random()
    alone = scene.gradients(np.float32)
    for name, gradient in scene.gradients(np.float32, with_mesh=False).items():
        assert np.array_equal(gradient, alone[name]), name


def test_what_is_not_seen_has_no_gradient_and_gives_none_whatever_its_values() -> None:
    scene, hidden = Scene.random(), (0, 11, N - 1)
    for part in scene.upstream:
        part[list(hidden)] = 0
    expected = scene.gradients(np.float32)
    scene.values["log_scale"][hidden[0]] = 800.0  # beyond what exp can hold
    scene.values["position"][hidden[1]] = np.inf
    scene.values["quaternion"][hidden[2]] = 0.0
    with np.errstate(over="ignore"):
        gradients = scene.gradients(np.float32, unseen=hidden)
    for name, gradient in gradients.items():
        assert gradient == pytest.approx(expected[name], rel=1e-12, abs=1e-12), name
    assert not any(gradients[name][row].any() for name in OWN for row in hidden)
