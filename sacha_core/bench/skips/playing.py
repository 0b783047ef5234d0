"""What opening and playing a file leave out."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from sacha_core.animation.player import Player, PlayOptions
from sacha_core.animation.posed import PosedHead
from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.bench.preset import Preset
from sacha_core.bench.scenes import front_camera, made_avatar, made_motion
from sacha_core.bench.skips.skip import Work, apart
from sacha_core.codec import decode, encode, open_stream
from sacha_core.flame.model import HeadModel
from sacha_core.parallel.pool import Pool
from sacha_core.train.state import FITTED_MOTION

__all__ = ["playing_skips"]

SMALLEST = np.float32(1e-30)  # a coefficient that is not 0, and moves no vertex by a bit


def playing_skips(preset: Preset) -> Iterator[Work]:
    """Give what playback leaves out, with an avatar that was made."""
    avatar, head = made_avatar(preset.of(300, 20_000, 50_000), 3, preset.of(7, 100, 100))
    yield from frames_again(preset, avatar, head)
    yield zero_coefficients(preset, head)
    yield directions_at_rest(preset, head)
    yield from motion_groups(preset, head)


def frames_again(preset: Preset, avatar: Avatar, head: HeadModel) -> Iterator[Work]:
    """Show a frame again."""
    camera, options = front_camera(*preset.of((55, 80), (275, 401), (550, 802))), PlayOptions(preset.threads)
    with Player(avatar.gaussians, head, avatar.motion, options) as player:
        shown = 0

        def again() -> np.ndarray:
            return player.frame(shown, camera)

        def another() -> np.ndarray:
            nonlocal shown
            shown = 1 - shown
            return player.frame(shown, camera)

        def error() -> float:
            picture = another().copy()
            return apart(picture, again())

        proof = "tests/animation/test_player.py::test_nothing_is_computed_again"
        yield Work("a frame that shows what is shown", again, another, error, proof)


def zero_coefficients(preset: Preset, head: HeadModel) -> Work:
    """Pose with one expression weight in eight; the plain way, the others are all but zero."""
    motion = made_motion(1)
    posed = PosedHead(head, motion, Pool(preset.threads))
    vectors = np.concatenate([motion.rotation[0], motion.neck[0], motion.jaw[0], motion.eyes[0]]).reshape(5, 3)
    sparse = np.where(np.arange(motion.expression.shape[1]) % 8, 0, motion.expression[0] + 1).astype(np.float32)
    dense = np.where(sparse, sparse, SMALLEST)

    def vertices(expression: np.ndarray) -> np.ndarray:
        return posed.pose(expression, vectors, motion.translation[0]).vertices

    return Work(
        "expression weights that are zero (7 of 8)", partial(vertices, sparse), partial(vertices, dense),
        lambda: apart(vertices(sparse).copy(), vertices(dense)), "tests/animation/test_posed.py::test_zero_coefficients_are_not_read",
    )  # fmt: skip


def directions_at_rest(preset: Preset, head: HeadModel) -> Work:
    """Pose with directions that move a part of the head each; the plain way, every block of vertices looks at all of them."""
    motion = made_motion(1)
    sparse, dense = (PosedHead(head, motion, Pool(preset.threads)) for _ in range(2))
    dense.moves[:] = True
    vectors = np.concatenate([motion.rotation[0], motion.neck[0], motion.jaw[0], motion.eyes[0]]).reshape(5, 3)

    def vertices(posed: PosedHead) -> np.ndarray:
        return posed.pose(motion.expression[0], vectors, motion.translation[0]).vertices

    proof = "tests/animation/test_posed.py::test_directions_are_not_read_where_they_move_nothing"
    return Work(
        f"directions where they move nothing ({1 - sparse.moves.mean():.0%} of blocks)",
        partial(vertices, sparse), partial(vertices, dense), lambda: apart(vertices(sparse), vertices(dense)), proof,
    )  # fmt: skip


def motion_groups(preset: Preset, head: HeadModel) -> Iterator[Work]:
    """Open a long motion, and jump into it."""
    avatar, _ = made_avatar(100, 0, preset.of(30, 3000, 10_000))
    data = encode(avatar, head=head, group_frames=preset.of(10, 100, 100))
    reader = open_stream(data, head=head).motion
    assert reader is not None
    last = (len(reader) - 1) // reader.group_frames

    def opened() -> Motion:
        found = open_stream(data, head=head).motion
        assert found is not None
        return found.still()

    def whole() -> Motion:
        found = decode(data, head=head).motion
        assert found is not None
        return found

    def group_error() -> float:
        group, everything = reader.group(last), reader.all()
        tail = len(group)
        return max(apart(getattr(group, name), getattr(everything, name)[-tail:]) for name in FITTED_MOTION)

    folder = "tests/codec/test_motion_groups.py"
    yield Work(
        f"motion not played yet ({len(reader):,} frames), on opening", opened, whole,
        lambda: apart(opened().shape, whole().shape), f"{folder}::test_opening_decodes_no_frame_and_a_group_no_other",
    )  # fmt: skip
    yield Work(
        "groups before the frame jumped to", lambda: reader.group(last), reader.all, group_error,
        f"{folder}::test_any_group_decodes_alone",
    )  # fmt: skip
