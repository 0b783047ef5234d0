"""Groups of frames into bytes and back; each can be decoded alone, given its `FrameModel`.

The loops are in `kernels/frames.py`. FORMAT.md, "Motion", is the specification.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.adaptive import Kernels, kernels_for
from sacha_core.codec.frame_model import FrameModel
from sacha_core.codec.kernels import frames, residuals
from sacha_core.codec.residuals import MORE, encode_residuals, first_registers, fresh_models
from sacha_core.errors import FormatError

__all__ = ["Chosen", "Mates", "choose_frames", "decode_frames", "encode_frames"]

STATE_ROWS = 5
PLAIN: Kernels = {name: getattr(frames, name) for name in ("choose_group", "decode_group")}
LAGRANGIAN = 0.04  # squared steps that a bit is worth, about; measured to be the best on tracked and on made motion
LARGEST_DEAD_ZONE = 0.4


@dataclass(frozen=True)
class Mates:
    """Whose errors each parameter can make up for, since they move the same vertices.

    Args:
        starts: (q + 1,) where each parameter's entries begin.
        others: earlier parameters.
        couplings: how far this parameter should be off, in its units, for each unit that the other one is.
    """

    starts: Int[np.ndarray, " o"]
    others: Int[np.ndarray, " m"]
    couplings: Float[np.ndarray, " m"]


@dataclass(frozen=True)
class Chosen:
    """The frames of a group as they will be decoded.

    Args:
        residuals: (t, q).
        kinds: (t, q) class of each.
        units: (t, q) the parameters that move.
    """

    residuals: Int[np.ndarray, "t q"]
    kinds: Int[np.ndarray, "t q"]
    units: Int[np.ndarray, "t q"]


def dead_zones() -> Float[np.ndarray, " k"]:
    """Give by how much less than a half rounds up, by class; then the same from 0 to 1, where a sign is to be paid, too."""
    rows = [kind if kind < len(MORE) else residuals.FIRST_SHIFTED + (kind & 1) for kind in range(residuals.CLASSES)]
    bits = -np.log2(1 - np.array(MORE)[rows] / 65536)
    bits[residuals.FIRST_SHIFTED :] = 0
    zones = np.concatenate([LAGRANGIAN * bits, LAGRANGIAN * (bits + 1)])
    return np.asarray(np.minimum(zones, LARGEST_DEAD_ZONE))


DEAD_ZONES = dead_zones()


def choose_frames(
    targets: Float[np.ndarray, "t q"], model: FrameModel, mates: Mates, expected: int = 0, compiled: bool | None = None
) -> Chosen:
    """Choose the residuals of a group.

    Args:
        targets: the parameters that move, in units.
        model: how they are expected.
        mates: whose errors are made up for.
        expected: roughly how many numbers the caller chooses in all: decides whether compiling pays.
        compiled: force compiled (True) or plain (False) loops; for tests.
    """
    t, q = targets.shape
    flat, tables = np.ascontiguousarray(targets, np.float64).reshape(-1), model.tables
    room = [np.zeros(t * q, np.int64) for _ in range(3)]
    state = [np.zeros(q, np.int64) for _ in range(STATE_ROWS)]
    lists = (model.sources, model.weights, mates.starts, mates.others)
    sources, weights, starts, others = (np.ascontiguousarray(one, np.int64) for one in lists)
    kernels = kernels_for(max(expected, targets.size), compiled)
    if kernels:
        coupled = (starts, others, np.ascontiguousarray(mates.couplings, np.float64))
        kernels["choose_group"](
            flat, *room, q, tables, sources, weights, tuple(state), np.zeros(q), coupled, DEAD_ZONES
        )
        return Chosen(*(part.reshape(t, q) for part in room))
    plain: list[Any] = [part.tolist() for part in room]
    coupled_plain = (starts.tolist(), others.tolist(), mates.couplings.tolist())
    rows = [row.tolist() for row in state]
    PLAIN["choose_group"](
        flat.tolist(), *plain, q, tables.tolist(), sources.tolist(), weights.tolist(), rows, [0.0] * q, coupled_plain, DEAD_ZONES.tolist(),
    )  # fmt: skip
    return Chosen(*(np.array(part, np.int64).reshape(t, q) for part in plain))


def encode_frames(chosen: Chosen, expected: int = 0, compiled: bool | None = None) -> bytes:
    """Code a group as chosen."""
    return encode_residuals(chosen.residuals.reshape(-1), chosen.kinds.reshape(-1), expected, compiled)


def decode_frames(
    data: bytes,
    n_frames: int,
    model: FrameModel,
    offset: int | None = None,
    expected: int = 0,
    compiled: bool | None = None,
) -> Int[np.ndarray, "t q"]:
    """Read the frames of one group, in units.

    Args:
        data: of the group.
        n_frames: in it.
        model: that it was made with.
        offset: where `data` lies in its file, for messages.
        expected: roughly how many numbers the caller will read, this group's included.
        compiled: force compiled (True) or plain (False) loops; for tests.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    q, tables, registers = len(model.size), model.tables, first_registers(data)
    kernels = kernels_for(max(expected, n_frames * q), compiled)
    sources, weights = (np.ascontiguousarray(one, np.int64) for one in (model.sources, model.weights))
    values: Any
    if kernels:
        values, state = np.zeros(n_frames * q, np.int64), tuple(np.zeros(q, np.int64) for _ in range(STATE_ROWS))
        used = np.array(registers)
        bytes_read = np.frombuffer(data, np.uint8)
        wrong = kernels["decode_group"](
            used, bytes_read, np.array(fresh_models()), values, q, tables, sources, weights, state
        )
        registers = used.tolist()
    else:
        values, rows = [0] * (n_frames * q), [[0] * q for _ in range(STATE_ROWS)]
        wrong = PLAIN["decode_group"](
            registers, data, fresh_models(), values, q, tables.tolist(), sources.tolist(), weights.tolist(), rows
        )
    if wrong >= 0:
        raise FormatError(f"frame {wrong} of the group has a value beyond {frames.LIMIT} units", offset)
    if len(data) > registers[2]:
        raise FormatError(f"{len(data) - registers[2]} bytes of the group are left over", offset)
    return np.array(values, np.int64).reshape(n_frames, q)
