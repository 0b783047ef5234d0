"""Hostile files by the thousand: whatever the bytes, an avatar or one of our errors, within a second and in little memory.

Every input goes through the plain loops and through the compiled ones, which must give the same.

`python tests/codec/fuzzing.py --inputs 1000000 --seed 1` runs as many as are asked for, tells how they ended, and keeps every input that
broke a promise in `tests/codec/found`, where the tests read it again. Input i of a seed is the same everywhere.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import struct
import sys
import time
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
from both_loops import compiling
from synthetic_avatars import (
    random_avatar,
    random_gaussians,
    random_importance,
    smooth_avatar,
    tiny_head,
    vertex_avatar,
)

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec import Decoder, Encoder, decode, embedded_head, encode, encode_archive, encode_paper, inspect
from sacha_core.codec.container import Section, pack_sections, parse_sections
from sacha_core.codec.packet import AVATAR, HEAD_BYTES
from sacha_core.errors import FormatError, HeadError, OptionError

FOUND = Path(__file__).parent / "found"
PACKETS = b"packets\0"  # begins an input of packets, each behind its length
SECONDS = 1.0  # of processor time an input may take
MEMORY = (
    48 << 20
)  # bytes that a process may grow by: 16 MiB for a small file, as much for a head inside, and what the platform rounds up to
EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)
N_COUNTS, FIRST_COUNT = 7, 5  # in the header
ALLOWED = (FormatError, HeadError, OptionError)  # the last one where a file needs an external program

Sections = list[Section]
Maker = Callable[[random.Random, list[Sections]], bytes]


@cache
def seeds() -> list[Sections]:
    """Give the sections of small valid files of every level and profile."""
    head = tiny_head()
    smooth = [smooth_avatar(12, head, 3, n_harmonics, seed=n_harmonics) for n_harmonics in (0, 3, 8, 15)]
    still = [replace(avatar, motion=None) for avatar in smooth]
    rough = random_avatar(14, 2, 3, 1, head)
    rough.gaussians.position[::3] *= 3000
    files = [
        encode(avatar, level, head=head, group_frames=2) for level, avatar in zip((1, 2, 3, 4), smooth, strict=True)
    ]
    files += [encode(still[1], 2), encode(still[3], 4, head=head), encode(rough, 4, head=head, drop_invisible=False)]
    files += [encode(vertex_avatar(head), 2, head=head), encode(random_avatar(0, 0, head=head), 1)]
    files += [encode_archive(smooth[1]), encode_archive(still[2]), encode_archive(decode(encode_paper(smooth[1], 1)))]
    files += [encode_paper(smooth[1], 2), encode_paper(still[3], 4), encode_paper(smooth[0], 1)]
    files += [encode(still[0], 1, head=head, embed_head=True)]
    files += [encode(smooth[2], 3, head=head, importance=random_importance(smooth[2].gaussians))]
    files += [encode(replace(still[1], gaussians=random_gaussians(30, 2, 3)), 4, head=head, drop_invisible=False)]
    return [list(parse_sections(file)[1].values()) for file in files]


def changed(rng: random.Random, body: bytes) -> bytes:
    """Change a few places of some bytes: bits, numbers to their extremes, runs copied, cut out or put in."""
    data = bytearray(body)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        at = rng.randrange(len(data) + 1) if rng.random() < 0.6 else rng.randrange(min(len(data), 24) + 1)
        kind, length = rng.randrange(8), rng.choice((1, 2, 4, 8, rng.randrange(1, 40)))
        if kind == 0 and data:
            data[min(at, len(data) - 1)] ^= 1 << rng.randrange(8)
        elif kind == 1 and data:
            data[min(at, len(data) - 1)] = rng.randrange(256)
        elif kind == 2:
            size = rng.choice((1, 2, 4))
            value = struct.pack("<I", rng.choice(EXTREMES))[:size]
            data[at : at + size] = value[: len(data[at : at + size])]
        elif kind == 3 and data:
            here = min(at, len(data) - 1)
            data[here] = (data[here] + rng.choice((-1, 1))) % 256
        elif kind == 4:
            del data[at : at + length]
        elif kind == 5:
            data[at:at] = rng.randbytes(length)
        elif kind == 6:
            start = rng.randrange(len(data) + 1)
            data[at : at + length] = data[start : start + length]
        else:
            data[at : at + length] = bytes([rng.choice((0, 0xFF))]) * len(data[at : at + length])
    return bytes(data)


def sealed(sections: Sections, bodies: dict[int, bytes]) -> bytes:
    """Give a file with other bytes in some sections and right checksums."""
    return pack_sections([Section(s.name, bodies.get(i, s.data)) for i, s in enumerate(sections)])


def some_section(rng: random.Random, sections: Sections) -> int:
    """Choose a section; the head, which is read last, seldom."""
    number = rng.randrange(len(sections))
    return number if sections[number].name != "head" or rng.random() < 0.5 else 0


def mutated(rng: random.Random, files: list[Sections]) -> bytes:
    """Change one or two sections, checksums right."""
    sections = rng.choice(files)
    chosen = {some_section(rng, sections) for _ in range(rng.choice((1, 1, 1, 2)))}
    return sealed(sections, {number: changed(rng, sections[number].data) for number in chosen})


def cut(rng: random.Random, files: list[Sections]) -> bytes:
    """Cut a section short or lengthen it, checksums right."""
    sections = rng.choice(files)
    number = some_section(rng, sections)
    body = sections[number].data
    return sealed(
        sections, {number: body[: rng.randrange(len(body) + 1)] + rng.randbytes(rng.choice((0, 0, 1, 4, 16)))}
    )


def bomb(rng: random.Random, files: list[Sections]) -> bytes:
    """Claim other counts in the header, some of them near what the file may hold."""
    sections = rng.choice(files)
    header = bytearray(sections[0].data)
    for _ in range(rng.choice((1, 1, 2))):
        value = rng.choice((*EXTREMES, rng.randrange(1, 70), rng.randrange(1 << 10, 1 << 17)))
        struct.pack_into("<I", header, FIRST_COUNT + 4 * rng.randrange(N_COUNTS), value)
    return sealed(sections, {0: bytes(header)})


def noise(rng: random.Random, files: list[Sections]) -> bytes:
    """Put random bytes into a section, checksums right."""
    sections = rng.choice(files)
    number = some_section(rng, sections)
    return sealed(sections, {number: rng.randbytes(rng.choice((0, 1, 8, 60, 300, len(sections[number].data))))})


def exchanged(rng: random.Random, files: list[Sections]) -> bytes:
    """Take a section from another file, or say another profile."""
    sections, other = rng.choice(files), rng.choice(files)
    if rng.random() < 0.3:
        header = bytearray(sections[0].data)
        header[rng.choice((0, 3, 4))] = rng.randrange(8)
        return sealed(sections, {0: bytes(header)})
    named = {s.name: s.data for s in other}
    number = rng.randrange(len(sections))
    return sealed(sections, {number: named.get(sections[number].name, rng.choice(other).data)})


def unsealed(rng: random.Random, files: list[Sections]) -> bytes:
    """Change a file anywhere, or give random bytes; checksums wrong."""
    if rng.random() < 0.3:
        return rng.randbytes(rng.choice((0, 7, 30, 500)))
    return changed(rng, pack_sections(rng.choice(files)))


@cache
def packet_seeds() -> list[list[bytes]]:
    """Give the packets of small streams."""
    head = tiny_head()
    avatars = [smooth_avatar(8, head, 5, 0, seed=1), smooth_avatar(6, head, 3, 3, seed=2)]
    return [list(Encoder(avatar, 2, head=head, group_frames=2).packets()) for avatar in avatars]


def packets(rng: random.Random, files: list[Sections]) -> bytes:
    """Send packets in disorder, some lost, some changed, most checksums right; the avatar among them may be a hostile file."""
    told = list(rng.choice(packet_seeds()))
    if rng.random() < 0.3:
        rng.shuffle(told)
    if rng.random() < 0.2:
        told += rng.choice(packet_seeds())
    sent = []
    for packet in told:
        body = packet[4:]
        if rng.random() < 0.1:
            continue
        if packet[5] == AVATAR and rng.random() < 0.3:
            payload = mutated(rng, files)
            body = packet[4:HEAD_BYTES][:-4] + struct.pack("<I", len(payload)) + payload
        elif packet[5] != AVATAR and rng.random() < 0.5:
            at = rng.choice((0, 0, HEAD_BYTES - 4))
            body = body[:at] + changed(rng, body[at:])
        if rng.random() < 0.5 and len(body) >= HEAD_BYTES - 4:
            body = body[: HEAD_BYTES - 8] + struct.pack("<I", len(body) - HEAD_BYTES + 4) + body[HEAD_BYTES - 4 :]
        sent.append(struct.pack("<I", zlib.crc32(body) if rng.random() < 0.95 else rng.randrange(1 << 32)) + body)
    return in_one(sent)


def in_one(sent: list[bytes]) -> bytes:
    """Give an input of packets."""
    return PACKETS + b"".join(struct.pack("<I", len(packet)) + packet for packet in sent)


MAKERS: dict[str, tuple[int, Maker]] = {
    "mutated": (64, mutated),
    "cut": (9, cut),
    "bomb": (8, bomb),
    "noise": (7, noise),
    "exchanged": (6, exchanged),
    "unsealed": (6, unsealed),
    "packets": (8, packets),
}


def make(seed: int, number: int) -> tuple[str, bytes]:
    """Give an input and its kind."""
    rng = random.Random(f"{seed} {number}")
    (kind,) = rng.choices(list(MAKERS), [weight for weight, _ in MAKERS.values()])
    return kind, MAKERS[kind][1](rng, seeds())


def attempt(data: bytes) -> str:
    """Read a file in every way; raise where it does anything but decode to a valid avatar or be refused. Give a digest; "" for refused."""
    head = tiny_head()
    if data.startswith(PACKETS):
        return received(data[len(PACKETS) :])
    try:
        avatar = decode(data, head=head)
        inspect(data)
        embedded_head(data)
    except ALLOWED:
        return ""
    avatar.gaussians.validate(avatar.head.n_faces)
    if avatar.motion is not None:
        avatar.motion.validate()
    return digest_of(avatar.gaussians, avatar.motion)


def digest_of(*parts: Gaussians | Motion | None) -> str:
    """Give a digest of all arrays."""
    found = hashlib.sha256()
    for part in parts:
        for name in [] if part is None else [one.name for one in fields(part)]:
            value = np.asarray(getattr(part, name))
            found.update(f"{name} {value.dtype} {value.shape}".encode())
            found.update(np.ascontiguousarray(value).tobytes())
    return found.hexdigest()


def received(data: bytes) -> str:
    """Feed packets to a decoder, which may refuse an avatar for its head, and nothing else. Give a digest of frames; "" where none came."""
    decoder, at, told = Decoder(tiny_head()), 0, list[str]()
    while at < len(data):
        (n_bytes,) = struct.unpack_from("<I", data, at)
        try:
            outcomes = decoder.feed(data[at + 4 : at + 4 + n_bytes])
        except HeadError:
            outcomes = []
        for outcome in outcomes:
            assert (outcome.kind == "frames") == (outcome.frames is not None)
            assert (outcome.kind == "damaged") <= bool(outcome.problem)
            if outcome.frames is not None:
                outcome.frames.validate()
                told += [digest_of(outcome.frames)] * (len(outcome.frames) > 0)
        at += 4 + n_bytes
    if decoder.avatar is not None:
        decoder.avatar.gaussians.validate(decoder.avatar.head.n_faces)
    return "".join(told)


def peak_memory() -> int:
    """Give the most memory that this process ever had, bytes; 0 where the platform does not tell."""
    if sys.platform == "win32":
        return 0
    import resource  # noqa: PLC0415  # not everywhere

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


@dataclass
class Tally:
    """How inputs ended.

    Args:
        ends: how many, by kind and whether they decoded.
        broken: what broke a promise, by number of the input.
        slowest_s: most processor time that one took.
        grown: bytes by which the process grew beyond where it was after the valid files.
    """

    ends: Counter[tuple[str, bool]] = field(default_factory=Counter)
    broken: dict[int, str] = field(default_factory=dict)
    slowest_s: float = 0.0
    grown: int = 0

    @property
    def total(self) -> int:
        """How many inputs there were."""
        return sum(self.ends.values()) + len(self.broken)


def run(seed: int, start: int, stop: int, tell: Callable[[str], object] = lambda _: None) -> Tally:
    """Try inputs `start` to `stop` - 1 of a seed."""
    tally = Tally()
    for compiled in (False, True):
        with compiling(compiled):
            for data in [*map(pack_sections, seeds()), *map(in_one, packet_seeds())]:
                assert attempt(data)
    highest = base = peak_memory()
    for number in range(start, stop):
        kind, data = make(seed, number)
        problem, given = "", list[str]()
        for compiled in (False, True):
            before = time.process_time()
            try:
                with compiling(compiled):
                    given.append(attempt(data))
            except Exception as fault:  # noqa: BLE001  # any other error is what is looked for
                problem = f"{type(fault).__name__}: {fault}"
            spent, peak = time.process_time() - before, peak_memory()
            if spent > SECONDS:
                problem = problem or f"took {spent:.2f} s"
            if peak - highest > MEMORY:
                problem = problem or f"took {(peak - highest) >> 20} MiB"
            highest = max(highest, peak)
            tally.slowest_s, tally.grown = max(tally.slowest_s, spent), highest - base
        if len(set(given)) > 1:
            problem = problem or "compiled loops give something else"
        if problem:
            tally.broken[number] = f"{kind}: {problem}"
            tell(f"input {number} of seed {seed}: {tally.broken[number]}")
        else:
            tally.ends[kind, bool(given[0])] += 1
        if number % 20_000 == 19_999:
            tell(f"{number + 1 - start} inputs, {len(tally.broken)} broke a promise")
    return tally


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=int(np.random.default_rng().integers(1 << 31)))
    parser.add_argument("--start", type=int, default=0)
    options = parser.parse_args()
    tally = run(options.seed, options.start, options.start + options.inputs, say)
    for number in tally.broken:
        FOUND.mkdir(exist_ok=True)
        (FOUND / f"seed{options.seed}_{number}.bin").write_bytes(make(options.seed, number)[1])
    decoded = sum(count for (_, fine), count in tally.ends.items() if fine)
    say(
        f"seed {options.seed}: {tally.total} inputs, {decoded} decoded, {tally.total - decoded - len(tally.broken)} refused, "
        f"{len(tally.broken)} broke a promise; slowest {tally.slowest_s:.2f} s, grew by {tally.grown >> 20} MiB"
    )
    return 1 if tally.broken else 0


if __name__ == "__main__":
    sys.exit(main())
