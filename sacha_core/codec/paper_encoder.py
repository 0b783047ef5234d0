"""An avatar into a `.sacha` file as the SACHA paper compresses it: a profile to compare with.

Source: the SACHA paper, section on compression.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec.container import Section, pack_sections
from sacha_core.codec.encoder import check_head, check_offsets, pad
from sacha_core.codec.head import encode_head
from sacha_core.codec.header import PAPER, Header
from sacha_core.codec.paper import WITH_TOOL, coded_rows, encode_binding, encode_rows, geometry_head
from sacha_core.codec.paper_map import RATES, columns_of, qps_of, row_order, to_integers
from sacha_core.codec.paper_motion import encode_paper_motion
from sacha_core.codec.paper_tool import encode_with_tool
from sacha_core.errors import FormatError, OptionError
from sacha_core.flame.model import HeadModel

__all__ = ["encode_paper", "matched"]


def encode_paper(
    avatar: Avatar,
    level: int = 2,
    *,
    head: HeadModel | None = None,
    embed_head: bool = False,
    tmc3: Path | None = None,
) -> bytes:
    """Compress an avatar at one of the four rate points of MPEG's JEE6.2.

    Args:
        avatar: what to compress; its sensitivity logits are not sent.
        level: 1 (smallest) to 4 (best).
        head: the head model that it is bound to; only needed to embed it, checked where given.
        embed_head: add the head model itself to the file.
        tmc3: a `tmc3` or GeS-TM program that codes points and attributes; without it this project's own coder does, at the same steps.

    Returns:
        The bytes of the file. Decoding what a program coded needs it as well.

    Raises:
        FormatError: the avatar is not finite, bound outside its head, or beyond what the profile holds; or the program failed.
        HeadError: `head` is not the one that the avatar names, or is missing where it shall be embedded.
        OptionError: there is no such level, or the program cannot be run.
    """
    if level not in RATES:
        raise OptionError(f"level {level!r} of the paper profile does not exist; levels are 1 to 4")
    check_head(avatar, head, embed_head)
    gaussians, motion = avatar.gaussians, avatar.motion
    gaussians.validate(avatar.head.n_faces)
    made = (level, len(gaussians), gaussians.sh_degree, avatar.head, avatar.scheme)
    header = Header(*made, profile=PAPER)
    k = header.n_harmonics
    rows, low = to_integers(gaussians)
    qps = qps_of(level, gaussians.sh_degree)
    if tmc3 is None or not len(rows):
        decoded, told = coded_rows(rows, qps, k)
        order = row_order(decoded)
        sorted_told = {name: (centre, levels[order]) for name, (centre, levels) in told.items()}
        sections = encode_rows(decoded[order], low, sorted_told, qps)
    else:
        flat = [qp for name in columns_of(k) if name != "Geometry" for qp in qps[name]]
        coded, decoded = encode_with_tool(tmc3, rows, flat, k)
        decoded = decoded[row_order(decoded)]
        order = matched(rows, decoded)
        sections = [Section("Geometry", geometry_head(low, WITH_TOOL)), Section("Tool", coded)]
    sections.append(Section("Binding", encode_binding(gaussians.binding[order])))
    if motion is not None:
        motion.validate()
        header = header.telling(motion)
        check_offsets(header)
        sections += encode_paper_motion(motion)
    if embed_head and head is not None:
        sections.append(Section("head", encode_head(head)))
    return pack_sections(pad([Section("Header", header.pack()), *sections], header))


def matched(given: Int[np.ndarray, "n c"], decoded: Int[np.ndarray, "n c"]) -> Int[np.ndarray, " n"]:
    """Give the row of `given` that each row of `decoded` came from: the one at the same point, of several there the most alike.

    Raises:
        FormatError: the points are not the same.
    """
    order = row_order(given)
    place = row_order(decoded)
    if not np.array_equal(given[order, :3], decoded[place, :3]):
        raise FormatError("the program does not give back the points that it was given")
    found = np.empty(len(given), np.int64)
    found[place] = order
    points = decoded[place, :3]
    starts = np.flatnonzero(np.append(True, (np.diff(points, axis=0) != 0).any(axis=1)))
    ends = np.append(starts[1:], len(points))
    for start, end in zip(starts[ends - starts > 1].tolist(), ends[ends - starts > 1].tolist(), strict=True):
        ours, theirs = order[start:end], place[start:end]
        far = np.abs(decoded[theirs][:, None] - given[ours][None]).sum(axis=2)
        for pair in np.argsort(far, axis=None, kind="stable").tolist():
            row, column = divmod(pair, end - start)
            if far[row, column] >= 0:
                found[theirs[row]] = ours[column]
                far[row, :] = far[:, column] = -1
    return found
