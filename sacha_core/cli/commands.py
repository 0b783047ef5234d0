"""The list of commands: what `sacha --help` shows, and where each one lives."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["COMMANDS", "Command"]


class Command(NamedTuple):
    """One subcommand.

    Args:
        module: its file in this folder, without the suffix.
        summary: its line in `sacha --help`; None for a command that only programs call.
    """

    module: str
    summary: str | None


COMMANDS = {
    "demo": Command("demo", "Film, train, compress, decode and judge a synthetic head, in minutes."),
    "synth": Command("synth", "Make a multi-view capture of the synthetic head."),
    "train": Command("train", "Train an avatar on a multi-view capture."),
    "score": Command("score", "Measure what each Gaussian of an avatar is worth, region by region."),
    "prune": Command("prune", "Cut an avatar down to a budget by its scores, without training."),
    "encode": Command("encode", "Compress an avatar and its motion into a .sacha file."),
    "decode": Command("decode", "Turn a .sacha file back into PLY, motion or model."),
    "bind": Command("bind", "Bind free splats, LAM's among them, to a head that moves them."),
    "batch": Command("batch", "Encode or decode every avatar of a folder."),
    "export": Command("export", "Write an avatar in the formats of viewers, engines and the web."),
    "inspect": Command("inspect", "Show what a .sacha file holds and what it costs."),
    "render": Command("render", "Draw one frame of an avatar, or a video of it."),
    "view": Command("view", "Show an avatar in the browser: play it, turn it, pull faces."),
    "evaluate": Command("evaluate", "Judge an avatar on views and expressions held out."),
    "ablate": Command("ablate", "Train, compress and judge variants beside one another."),
    "framewise": Command("framewise", "Fit each frame of a capture by itself: the baseline without an avatar."),
    "bench": Command("bench", "Measure time and error of every part on this machine."),
    "convert-head": Command("convert_head", "Make a head model from a FLAME pickle or a rig."),
    "doctor": Command("doctor", "Check this installation, or a capture."),
    "scene": Command("scene", None),
    "splats": Command("splats", None),
    "bake": Command("bake", None),
    "assemble": Command("assemble", None),
}
