"""The paper's first table, with an avatar of one's own beside the reported rows."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sacha_core.cli.console import table

if TYPE_CHECKING:
    from sacha_core.cli.sources import Opened
    from sacha_core.evaluate.picture_metrics import ViewScores

__all__ = ["sizes_of", "table_one"]


def sizes_of(path: Path, opened: Opened) -> dict[str, int]:
    """Count an avatar's bytes in every way that is in use.

    Args:
        path: what was judged.
        opened: the same, opened.

    Returns:
        `file`, of a `.sacha` file without the head it may carry; and as a model of GaussianAvatars, `model` without and
        `model_with_zero_offset` with the vertex offsets that it saves for each frame and that are always zero.
    """
    from sacha_core.codec import inspect
    from sacha_core.evaluate.published import model_bytes

    counted = model_bytes(opened.avatar.gaussians, opened.avatar.motion, opened.head.n_vertices)
    found = {"model": counted.without_offset, "model_with_zero_offset": counted.with_offset}
    if opened.kind == "sacha":
        told = inspect(path)
        found = {"file": told.total_bytes - told.head_bytes, **found}
    return found


def table_one(sizes: Mapping[str, int], scores: ViewScores, side: str) -> tuple[str, dict[str, Any]]:
    """Set one's own rows beside the reported ones.

    Args:
        sizes: of `sizes_of`.
        scores: of novel expressions.
        side: how large the images were that were compared.

    Returns:
        The table with its protocol, and the same for machines.
    """
    from sacha_core.evaluate.published import PROTOCOL, REPORTED

    quality = scores.quality
    network = next((name for name in ("vgg", "alex") if getattr(quality, f"lpips_{name}") is not None), None)
    lpips = None if network is None else getattr(quality, f"lpips_{network}")
    names = {
        "file": "yours, .sacha",
        "model": "yours, as a model" + " (decoded)" * ("file" in sizes),
        "model_with_zero_offset": "  with its zero offsets",
    }
    ssim = quality.ssim if isfinite(quality.ssim) else None  # it need not have been asked for
    figures = [f"{quality.psnr:.4f}", *("-" if found is None else f"{found:.4f}" for found in (ssim, lpips))]
    rows = [(names[kind], f"{n_bytes / 1e6:.2f}", *figures) for kind, n_bytes in sizes.items()]
    rows += [
        (row.method, f"{row.megabytes:.2f}", f"{row.psnr:.4f}", f"{row.ssim:.4f}", f"{row.lpips:.4f}")
        for row in REPORTED
    ]
    yours = f"yours: held-out expressions of this capture, {len(scores.images)} images of {side}, "
    yours += "no LPIPS (--metrics psnr ssim lpips)" if network is None else f"LPIPS with {network.upper()}"
    set_table = table(("novel expression", "MB", "PSNR", "SSIM", "LPIPS"), rows)
    told = {
        "bytes": dict(sizes),
        "psnr": quality.psnr,
        "ssim": ssim,
        "lpips": lpips,
        "lpips_network": network,
        "reported": [row._asdict() for row in REPORTED],
    }
    return f"{set_table}\n{yours}\n{PROTOCOL}", told
