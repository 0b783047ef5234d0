"""What files and imports leave out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sacha_core.bench.preset import Preset
from sacha_core.bench.scenes import made_avatar
from sacha_core.bench.skips.skip import Bytes, Process, apart
from sacha_core.codec import decode, encode
from sacha_core.train.state import FITTED_MOTION

__all__ = ["file_skips", "import_skips"]

CODEC = "tests/skips/test_skips_codec.py"
PROGRAM = "tests/cli/test_program.py"
EVERYTHING = "import sacha_core; [getattr(sacha_core, name) for name in sacha_core.__all__]"


def file_skips(preset: Preset) -> Iterator[Bytes]:
    """Give the bytes of attributes that have their default, of an avatar that was made."""
    avatar, head = made_avatar(preset.of(300, 20_000, 20_000), 3, preset.of(7, 100, 1000))
    gaussians, motion = avatar.gaussians, avatar.motion
    assert motion is not None
    plain = encode(avatar, head=head)
    zero = encode(replace(avatar, gaussians=replace(gaussians, sh_rest=np.zeros_like(gaussians.sh_rest))), head=head)
    back = decode(zero, head=head).gaussians.sh_rest
    yield Bytes(
        "harmonics that are zero, in a file",
        len(zero),
        len(plain),
        apart(back, 0),
        f"{CODEC}::test_harmonics_that_are_zero",
    )
    learned = np.ones(len(gaussians), np.float32)
    same = encode(replace(avatar, gaussians=replace(gaussians, sensitivity_logit=learned)), head=head)
    yield Bytes(
        "sensitivity, in a file (else as float32)", len(plain), len(plain) + learned.nbytes,
        float(same != plain), f"{CODEC}::test_sensitivity",
    )  # fmt: skip
    offsets = np.random.default_rng(preset.seed).normal(0, 1e-4, (head.n_vertices, 3)).astype(np.float32)
    some, none = (
        encode(replace(avatar, motion=replace(motion, static_offset=o)), head=head) for o in (offsets, 0 * offsets)
    )
    kept = decode(none, head=head).motion
    assert kept is not None
    yield Bytes(
        "vertex offsets that are zero, in a file",
        len(none),
        len(some),
        apart(kept.static_offset, 0),
        f"{CODEC}::test_vertex_offsets",
    )
    first: dict[str, Any] = {name: np.repeat(getattr(motion, name)[:1], len(motion), axis=0) for name in FITTED_MOTION}
    still = encode(replace(avatar, motion=replace(motion, **first)), head=head)
    without = len(encode(replace(avatar, motion=None), head=head))
    found = decode(still, head=head).motion
    moved = max(apart(getattr(found, name), getattr(found, name)[:1]) for name in FITTED_MOTION)
    yield Bytes(
        "motion that rests, in a file",
        len(still) - without,
        len(plain) - without,
        moved,
        f"{CODEC}::test_motion_that_rests",
    )


def import_skips(_: Preset) -> Iterator[Process]:
    """Give what starting leaves out."""
    main = "from sacha_core.cli import main; main(['--help'])"
    yield Process(
        "packages, in `import sacha_core`", "import sacha_core", EVERYTHING,
        f"{PROGRAM}::test_importing_the_front_door_is_light_and_quick",
    )  # fmt: skip
    yield Process(
        "packages, in `sacha --help`", main, f"import tyro, rich.console; {EVERYTHING}; {main}",
        f"{PROGRAM}::test_the_front_page_needs_no_package_and_is_quick",
    )  # fmt: skip
