"""The gradients of the Gaussians of a step: from what the rasteriser gives to what Adam takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.animation.posed import Pose
from sacha_core.parallel.buffers import Buffers
from sacha_core.parallel.kept import Kept
from sacha_core.parallel.kernels.packed import Packed
from sacha_core.parallel.kernels.turns import new_turns
from sacha_core.parallel.pool import Pool
from sacha_core.raster.harmonics import sh_rest_gradient
from sacha_core.raster.kernels.harmonics import BASIS
from sacha_core.raster.rasteriser import Frame, HalfWay
from sacha_core.raster.splats import SplatGradients, Splats
from sacha_core.train.faults import LARGEST_GRADIENT
from sacha_core.train.kernels.carry_backward import PULLS
from sacha_core.train.kernels.go_back import PARTS, go_back
from sacha_core.train.kernels.settle import SCRATCH
from sacha_core.train.options import LossOptions
from sacha_core.train.rig import Rig
from sacha_core.train.state import TrainState

__all__ = ["GaussianGradients", "ViewColours"]

CHUNKS = 32  # of triangles, fixed, so that penalties are summed in the same order by any number of threads
GROUPS = np.arange(0, CHUNKS + 1, 2)  # of chunks, jobs of threads
# in the order in which one spoils the next: a colour's gradient reaches the mean through the direction of view
WIDTHS = {"sh_dc": 3, "sensitivity_logit": 1, "opacity_logit": 1, "log_scale": 3, "quaternion": 4, "position": 3}


@dataclass(frozen=True)
class ViewColours:
    """What one view says of the harmonics: their gradient is the basis, in the direction of view, times that by the colour.

    Args:
        centre: (3,) where the camera stands, metres.
        cut: (n, 3) gradient by the colour, 0 where the colour was cut.
    """

    centre: Float[np.ndarray, "3"]
    cut: Float[np.ndarray, "n 3"]


@dataclass(frozen=True)
class Chunks:
    """Triangles with their Gaussians, in chunks of about as many Gaussians.

    Args:
        faces: (chunks + 1,) first triangle of each chunk.
        rows: (chunks + 1,) first Gaussian of each chunk.
        most_faces: triangles of the chunk that has most.
    """

    faces: Int[np.ndarray, " b"]
    rows: Int[np.ndarray, " b"]
    most_faces: int

    @classmethod
    def of(cls, binding: Int[np.ndarray, " n"], n_faces: int) -> Chunks:
        """Deal triangles out; `binding` is sorted."""
        first_row = np.searchsorted(binding, np.arange(n_faces + 1))
        inner = np.searchsorted(first_row, len(binding) * np.arange(1, CHUNKS) // CHUNKS)
        faces = np.array([0, *inner, n_faces])
        return cls(faces, first_row[faces], int(np.diff(faces).max()))


@dataclass(frozen=True)
class Settling:
    """Where a step's gradients go, and what `settle` wants: the same as long as no Gaussian comes or goes.

    Args:
        by_name: see `GaussianGradients`, as are the next two.
        lengths: (n,).
        seen: (n,).
        shares: (n,) of a penalty that each Gaussian has.
        fixed: what `go_back` wants, of each thread.
    """

    by_name: dict[str, np.ndarray]
    lengths: Float[np.ndarray, " n"]
    seen: Int[np.ndarray, " n"]
    shares: Float[np.ndarray, " n"]
    fixed: list[Packed]


class GaussianGradients:
    """Gathers the gradients of a step from its views; owns the arrays, which hold until the next `begin`.

    Args:
        losses: weights and limits of the penalties.
        rig: whose triangles carry the Gaussians, and to whose pose gradients go.
        pool: shares out the work.
        with_mesh: whether gradients go on to the pose, where `Rig.slopes` finds them.

    Attributes:
        by_name: of the attributes but `sh_rest`, by name.
        colours: of each view, from which the gradient by `sh_rest` follows.
        lengths: (n,) lengths of the gradients by places in the images, in normalised device units, summed over the views.
        seen: (n,) how many views showed the Gaussian.
        penalties: for straying and for swelling, means over the views.
    """

    def __init__(self, losses: LossOptions, rig: Rig, pool: Pool, with_mesh: bool) -> None:
        self._rig, self._pool, self._with_mesh = rig, pool, with_mesh
        self._limits = np.array([losses.position_limit, losses.scale_limit, losses.position, losses.scale], np.float32)
        self._buffers = Buffers()
        self._sound, self._found = np.ones(len(GROUPS), bool), np.zeros(3)
        self._chunked: Kept[Chunks] = Kept()
        self._settled: Kept[Settling] = Kept()
        self.penalties, self._all_sound = (0.0, 0.0), True

    def begin(self, state: TrainState, pose: Pose, splats: Splats, views: int) -> None:
        """Begin a step.

        Args:
            state: whose gradients are wanted.
            pose: of the head.
            splats: the Gaussians in the world.
            views: how many will be added.
        """
        binding, position, quaternion = state.binding, state.values["position"], state.values["quaternion"]
        self._chunks = self._chunked.of(lambda: Chunks.of(binding, len(self._rig.faces)), binding)
        self._settling = self._settled.of(
            lambda: self._prepare(state, pose, splats), binding, position, quaternion, pose, splats
        )
        self._state, self._splats, self._views = state, splats, views
        self.by_name, self.lengths, self.seen = self._settling.by_name, self._settling.lengths, self._settling.seen
        self.colours: list[ViewColours] = []

    def _prepare(self, state: TrainState, pose: Pose, splats: Splats) -> Settling:
        """Give where gradients go, and what `settle` wants."""
        n, chunks, values, frames = len(state), self._chunks, state.values, pose.frames
        by_name = {name: self._space(name, n, width) for name, width in WIDTHS.items()}
        shares, penalties = self._space("shares", n, 1), np.zeros((CHUNKS, 2))
        before = (
            chunks.faces, chunks.rows, flat(values["position"]), flat(values["quaternion"]), state.binding,
            flat(splats.scales), flat(splats.quaternions), splats.opacities, flat(splats.colours),
        )  # fmt: skip
        after = (
            flat(pose.vertices), flat(self._rig.faces), flat(frames.rotation), frames.scale, self._with_mesh,
            shares, self._limits, np.float32(LARGEST_GRADIENT), *map(flat, by_name.values()), flat(self._rig.g_corners), penalties,
        )  # fmt: skip
        lengths, seen = self._space("lengths", n, 1), self._space("seen", n, 1, np.int32)
        way, fixed = self._rig.way_back(pose), list[Packed]()
        for worker in range(self._pool.threads):
            space = (
                self._buffers.space(f"scratch {worker}", SCRATCH, np.float32),
                self._buffers.space(f"pulls {worker}", PULLS * chunks.most_faces, np.float32),
            )
            head = way.blocks, way.skin, way.spaces[worker], way.sums, way.joints, self._rig.row
            fixed.append(
                Packed((GROUPS, chunks.rows, self._sound, penalties, self._found, (before, (*after, *space)), head))
            )
        return Settling(by_name, lengths, seen, shares, fixed)

    def add_view(
        self,
        frame: Frame,
        half_way: HalfWay,
        tilts: Float[np.ndarray, "3 n 3"],
        centre: Float[np.ndarray, "3"],
        width: int,
        height: int,
    ) -> None:
        """Add a view: gradients of its share of the loss. With the last, all that `begin` promised is there.

        Args:
            frame: as it was drawn.
            half_way: gradients by the splats, not through the projection yet; their arrays are changed.
            tilts: gradient of each colour by the mean.
            centre: float32, where the camera stands, metres.
            width: of the whole image, pixels.
            height: likewise.
        """
        views, slopes, view, settling = self._views, half_way.slopes, len(self.colours), self._settling
        cut, last = self._space(f"cut {view}", len(self._state), 3), view == views - 1
        self.colours.append(ViewColours(centre, cut))
        half_sides = np.float32(views * width / 2), np.float32(views * height / 2)  # as if there were no other view
        part = np.float32(1 / (views * max(int(np.count_nonzero(frame.visible)), 1)))
        colours = tilts, self._splats.colours, slopes.colours, cut, slopes.means
        notes = (
            view == 0, frame.bins.span, slopes.means_2d, *half_sides, part, cut, np.float32(BASIS[0]),
            settling.shares, self.seen, self.lengths, self.by_name["sh_dc"],
        )  # fmt: skip
        own = of_slopes(slopes)
        totals = self._totals(own) if views > 1 else own
        turns = new_turns(PARTS)

        def work(worker: int, _: int) -> None:
            go_back(
                turns, len(self._state), half_way.scratch[worker], half_way.arguments, colours, notes, own, totals, last,
                settling.fixed[worker].table, self._with_mesh and last, LARGEST_GRADIENT,
            )  # fmt: skip

        self._pool.run(work, self._pool.threads)
        if last:
            strayed, swollen, sound = self._found.tolist()
            self.penalties, self._all_sound = (strayed, swollen), bool(sound)

    def sound(self) -> bool:
        """Tell whether all gradients are finite and small enough to go on with, those by the pose among them."""
        return self._all_sound

    def fault(self) -> tuple[str, int] | None:
        """Give the attribute and the row of the first gradient of a Gaussian that is not; None if all are sound."""
        if self._sound[:-1].all():
            return None
        flat = [np.abs(self.by_name[name].reshape(len(self.seen), -1)).max(axis=1) for name in WIDTHS]
        wrong = ~(np.stack(flat, axis=1) <= LARGEST_GRADIENT)
        row = int(np.argmax(wrong.any(axis=1)))
        return tuple(WIDTHS)[int(np.argmax(wrong[row]))], row

    def by_harmonics(self, degree: int) -> Float[np.ndarray, "n k 3"]:
        """Give the gradient by `sh_rest`, which a step does without."""
        total = np.zeros_like(self._state.values["sh_rest"])
        for view in self.colours:
            total += sh_rest_gradient(self._splats.means, view.centre, degree, view.cut, total.shape[1])
        return total

    def _totals(self, slopes: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        """Give space for the sums over views."""
        return tuple(self._buffers.space(f"total {k}", slope.size, np.float32) for k, slope in enumerate(slopes))

    def _space(self, name: str, n: int, width: int, dtype: type[np.generic] = np.float32) -> np.ndarray:
        space = self._buffers.space(name, n * width, dtype)
        return space if width == 1 else space.reshape(n, width)


def of_slopes(slopes: SplatGradients) -> tuple[np.ndarray, ...]:
    """Give the gradients that are summed over views, flat: by means, scales, quaternions, opacities and colours."""
    return tuple(
        flat(slope) for slope in (slopes.means, slopes.scales, slopes.quaternions, slopes.opacities, slopes.colours)
    )


def flat(array: np.ndarray) -> np.ndarray:
    """Give a contiguous array as one row."""
    return array.reshape(-1)
