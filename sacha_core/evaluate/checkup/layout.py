"""What a folder is that is no capture: people name the tracker's own output, the raw recording, or the folder above."""

from __future__ import annotations

from pathlib import Path

__all__ = ["guess_folder"]

MOST_NAMED = 3  # sequences in a message


def guess_folder(root: Path) -> str | None:
    """Say what a folder seems to be instead of a capture, and what to do; None where it looks like nothing we know.

    Source: questions that users of GaussianAvatars and VHAP asked (VHAP issues 17 and 40, GaussianAvatars issue 67).
    """
    if not root.is_dir():
        return None
    export = "export it first with VHAP's export_as_nerf_dataset.py"
    sequences = sorted(path.parent for path in root.glob("*/transforms_train.json"))
    named = ", ".join(str(path) for path in sequences[:MOST_NAMED]) + ", ..." * (len(sequences) > MOST_NAMED)
    guesses = (
        (
            ("point_cloud/iteration_*/point_cloud.ply",),
            "is a trained model, not a capture: name the one that it was trained on; sacha evaluate MODEL DATASET judges it",
        ),
        (
            ("tracked_flame_params*.npz", "*/tracked_flame_params*.npz"),
            f"is what VHAP's tracker writes; {export}, and name that folder",
        ),
        (
            ("*/transforms_train.json",),
            f"holds {len(sequences)} captures: name one of them ({named}), or join them with VHAP's combine_nerf_datasets.py",
        ),
        (
            ("transforms.json",),
            f"has transforms.json and no splits of it (transforms_train.json): {export}, which writes them",
        ),
        (
            ("calibration/", "sequences/", "camera_params.json"),
            f"is a raw recording of NeRSemble: track it with VHAP, and {export}",
        ),
        (("*.mp4", "images/*"), f"holds pictures without tracking: track them with VHAP, and {export}"),
    )
    return next((f"{root} {words}" for patterns, words in guesses if any(any(root.glob(p)) for p in patterns)), None)
