"""The peer that the rasteriser is timed against: the same picture by float32 torch, tile after tile, and its gradient by autograd."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch
from jaxtyping import Float

from sacha_core.raster.camera import Camera
from sacha_core.raster.splats import Splats

__all__ = ["PlainRasteriser", "on_threads"]

TILE = 16
ALPHA_MIN, ALPHA_MAX, STOP, DILATION = 1 / 255, 0.99, 1e-4, 0.3


@contextmanager
def on_threads(threads: int) -> Iterator[None]:
    """Let torch use so many threads, and take denormals as zero, inside."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)  # kinder to the peer
    try:
        yield
    finally:
        torch.set_num_threads(before)
        torch.set_flush_denormal(False)


class PlainRasteriser:
    """Projects all splats at once, then composites the dense matrix of splats and pixels of each tile."""

    def forward(self, splats: Splats, camera: Camera, background: Float[np.ndarray, " c"]) -> torch.Tensor:
        """Draw: (c, h, w)."""
        with torch.no_grad():
            return self._draw(self._leaves(splats, False), camera, background)

    def forward_backward(
        self,
        splats: Splats,
        camera: Camera,
        background: Float[np.ndarray, " c"],
        gradient: Float[np.ndarray, "c h w"],
    ) -> None:
        """Draw, and take a gradient back to every attribute."""
        image = self._draw(self._leaves(splats, True), camera, background)
        torch.autograd.backward(image, torch.from_numpy(gradient))

    @staticmethod
    def _leaves(splats: Splats, learn: bool) -> list[torch.Tensor]:
        """Give the attributes as tensors."""
        arrays = (splats.means, splats.scales, splats.quaternions, splats.opacities, splats.colours)
        return [torch.from_numpy(a).detach().requires_grad_(learn) for a in arrays]

    @staticmethod
    def _project(leaves: list[torch.Tensor], camera: Camera) -> tuple[torch.Tensor, ...]:
        """Give the projected means, depths, dilated covariances (xx, xy, yy) and their determinants."""
        means, scales, quaternions, *_ = leaves
        rotation = torch.tensor(camera.rotation, dtype=torch.float32)
        x, y, z = (means @ rotation.T + torch.tensor(camera.translation, dtype=torch.float32)).unbind(1)
        w, i, j, k = (quaternions / quaternions.norm(dim=1, keepdim=True)).unbind(1)
        turn = torch.stack(
            [1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j),
             2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i),
             2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)], 1
        ).reshape(-1, 3, 3)  # fmt: skip
        zero = torch.zeros_like(z)
        jacobian = torch.stack(
            [camera.fx / z, zero, -camera.fx * x / z**2, zero, camera.fy / z, -camera.fy * y / z**2], 1
        ).reshape(-1, 2, 3)
        axes = jacobian @ (rotation @ (turn * scales[:, None, :]))
        covariance = axes @ axes.transpose(1, 2) + DILATION * torch.eye(2)
        a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
        determinant = a * c - b * b
        return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy, z, a, b, c, determinant

    def _draw(self, leaves: list[torch.Tensor], camera: Camera, background: np.ndarray) -> torch.Tensor:
        """Give the image, tile after tile."""
        opacities, colours = leaves[3], leaves[4]
        mean_x, mean_y, z, a, b, c, determinant = self._project(leaves, camera)
        behind = torch.from_numpy(background)
        columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
        with torch.no_grad():
            lists = self._lists((mean_x, mean_y, z, a, c), opacities, columns, rows)
        shares = [share / determinant for share in (c, b, a)]
        table = torch.cat([torch.stack([mean_x, mean_y, *shares, opacities], 1), colours], 1)
        # one gather for all tiles: a gather for each would give each a gradient of all splats
        gathered = table[torch.tensor([g for chosen in lists for g in chosen])]
        parts = iter(torch.split_with_sizes(gathered, [len(chosen) for chosen in lists]))
        strips = []
        for row in range(rows):
            y = torch.arange(row * TILE, min((row + 1) * TILE, camera.height)) + 0.5
            spans = [(k * TILE, min((k + 1) * TILE, camera.width)) for k in range(columns)]
            strips.append(
                torch.cat([self._tile(next(parts), torch.arange(*span) + 0.5, y, behind) for span in spans], 2)
            )
        return torch.cat(strips, 1)

    @staticmethod
    def _lists(
        projected: tuple[torch.Tensor, ...], opacities: torch.Tensor, columns: int, rows: int
    ) -> list[list[int]]:
        """Give the splats of each tile, front to back: those whose box reaches it."""
        mean_x, mean_y, z, a, c = projected
        limit = 2 * torch.log(opacities / ALPHA_MIN)
        reach_x, reach_y = (a * limit).sqrt(), (c * limit).sqrt()
        left, right = ((mean_x + s * reach_x).div(TILE).floor().long().clamp(0, columns - 1) for s in (-1, 1))
        top, bottom = ((mean_y + s * reach_y).div(TILE).floor().long().clamp(0, rows - 1) for s in (-1, 1))
        lists: list[list[int]] = [[] for _ in range(columns * rows)]
        boxes = torch.stack([left, right, top, bottom], 1).tolist()
        for g in torch.argsort(z, stable=True).tolist():
            x0, x1, y0, y1 = boxes[g]
            for row in range(y0, y1 + 1):
                for column in range(x0, x1 + 1):
                    lists[row * columns + column].append(g)
        return lists

    @staticmethod
    def _tile(part: torch.Tensor, x: torch.Tensor, y: torch.Tensor, behind: torch.Tensor) -> torch.Tensor:
        """Blend one tile's splats at all its pixels."""
        if not len(part):
            return behind[:, None, None].expand(-1, len(y), len(x))
        centre_x, centre_y, share_xx, share_xy, share_yy, opacity = part[:, :6, None, None].unbind(1)
        dx, dy = x[None, None, :] - centre_x, y[None, :, None] - centre_y
        power = -0.5 * (share_xx * dx * dx - 2 * share_xy * dx * dy + share_yy * dy * dy)
        alpha = opacity * torch.exp(power)
        alpha = torch.where(alpha >= ALPHA_MIN, alpha.clamp(max=ALPHA_MAX), 0.0)
        after = torch.cumprod(1 - alpha, 0)
        keep = after > STOP
        before = torch.cat([torch.ones_like(after[:1]), after[:-1]])
        weight = torch.where(keep, alpha * before, 0.0)
        rest = torch.where(keep, 1 - alpha, 1.0).prod(0)
        return torch.einsum("nhw,nc->chw", weight, part[:, 6:]) + behind[:, None, None] * rest
