"""Oracles: the whole file's decode, of which packets must make up the same frames to the bit; and counts of what was sent and kept back."""

from __future__ import annotations

import struct
import time
import zlib
from dataclasses import fields, replace

import numpy as np
import pytest
from synthetic_avatars import random_avatar, random_motion, small_head

import sacha_core
from sacha_core.avatar.motion import Motion
from sacha_core.codec import Received, decode, encode, encode_archive, packets_of
from sacha_core.codec.packet import GROUP, HEAD_BYTES, Packet
from sacha_core.errors import FormatError, HeadError, OptionError

GROUP_FRAMES, N_FRAMES = 8, 37
STREAM_S = 1.0  # for a hostile packet of a few KB, like a file of that size


@pytest.fixture(scope="module")
def encoder() -> sacha_core.Encoder:
    return sacha_core.Encoder(random_avatar(30, n_frames=N_FRAMES, seed=2), 3, group_frames=GROUP_FRAMES)


@pytest.fixture(scope="module")
def packets(encoder) -> list[bytes]:
    return list(encoder.packets())


@pytest.fixture(scope="module")
def frames(packets) -> dict[int, Motion]:
    """Frames of each group, as a listener hears them who misses nothing."""
    heard = listen(sacha_core.Decoder(), packets)
    return {received.number: received.frames for received in heard if received.kind == "frames"}


def listen(decoder: sacha_core.Decoder, packets: list[bytes]) -> list[Received]:
    return [received for packet in packets for received in decoder.feed(packet)]


def assert_same(left: Motion, right: Motion) -> None:
    for field in fields(left):
        ours, theirs = getattr(left, field.name), getattr(right, field.name)
        assert ours.tobytes() == theirs.tobytes() if isinstance(theirs, np.ndarray) else ours == theirs, field.name


def resealed(packet: bytes, **changes: object) -> bytes:
    return replace(Packet.parse(packet), **changes).pack()


def test_packets_say_what_the_file_says(packets, frames):
    avatar = random_avatar(30, n_frames=N_FRAMES, seed=2)
    whole = decode(encode(avatar, 3, group_frames=GROUP_FRAMES))
    decoder = sacha_core.Decoder()
    heard = listen(decoder, packets)
    assert [received.kind for received in heard] == ["avatar", *["frames"] * 5]
    assert [received.first_frame for received in heard[1:]] == [0, 8, 16, 24, 32]
    for received in heard[1:]:
        at = received.first_frame
        assert_same(received.frames, whole.motion.frames(slice(at, at + GROUP_FRAMES)))
        assert_same(received.frames, frames[received.number])
    for field in fields(whole.gaussians):
        ours, theirs = (getattr(one.gaussians, field.name) for one in (decoder.avatar, whole))
        if isinstance(theirs, np.ndarray):
            assert np.array_equal(ours, theirs), field.name
    assert (decoder.lost, decoder.missing, decoder.frame_rate) == (0, (), 25.0)
    assert_same(decoder.avatar.motion, whole.motion.frames(slice(0)))


def test_a_file_is_cut_into_the_same_packets(packets):
    data = encode(random_avatar(30, n_frames=N_FRAMES, seed=2), 3, group_frames=GROUP_FRAMES)
    assert list(packets_of(data)) == packets
    assert sum(len(packet) for packet in packets[1:]) < len(data)


def test_frames_that_come_one_by_one_make_the_same_packets(packets):
    avatar = random_avatar(30, n_frames=N_FRAMES, seed=2)
    encoder = sacha_core.Encoder(avatar, 3, group_frames=GROUP_FRAMES)
    sent = [encoder.first]
    for frame in range(N_FRAMES):
        made = encoder.push(avatar.motion.frames(slice(frame, frame + 1)))
        assert len(made) == (frame % GROUP_FRAMES == GROUP_FRAMES - 1)
        sent += made
    sent += encoder.finish()
    assert sent == packets
    assert encoder.finish() == []
    with pytest.raises(OptionError, match="finished"):
        encoder.push(avatar.motion)


@pytest.mark.parametrize("seed", range(12))
def test_whatever_becomes_of_packets_costs_at_most_their_groups(packets, frames, seed):
    """Lost, repeated, swapped and damaged at random; what does arrive is right, and what did not is told."""
    rng = np.random.default_rng(seed)
    decoder, arriving, sound = sacha_core.Decoder(), [packets[0]], set()
    for number, packet in enumerate(packets[1:], 1):
        fate = rng.integers(4)
        if fate == 0:
            continue
        spoiled = bytearray(packet)
        if fate == 1:
            spoiled[rng.integers(len(packet))] ^= 1 << rng.integers(8)
        else:
            sound.add(number)
        arriving += [bytes(spoiled)] * (2 if fate == 2 else 1)
    order = np.argsort(np.arange(len(arriving)) + rng.uniform(0, 3, len(arriving)))
    heard = listen(decoder, [arriving[i] for i in order])
    assert len([received for received in heard if received.kind != "early"]) == len(arriving)
    got = {received.number: received for received in heard if received.kind == "frames"}
    assert set(got) == sound
    for number, received in got.items():
        assert received.first_frame == (number - 1) * GROUP_FRAMES
        assert_same(received.frames, frames[number])
    between = set(range(min(sound, default=0), max(sound, default=-1) + 1))
    assert (decoder.missing, decoder.lost) == (tuple(sorted(between - sound)), len(between - sound))
    n_damaged = len(arriving) - 1 - len(sound) - sum(received.kind == "repeated" for received in heard)
    assert sum(received.kind == "damaged" for received in heard) == n_damaged


def test_a_listener_joins_at_any_group(packets, frames):
    for start in range(1, len(packets)):
        heard = listen(sacha_core.Decoder(), [packets[0], packets[start]])
        assert_same(heard[1].frames, frames[start])


def test_groups_wait_for_the_avatar(packets, frames):
    decoder = sacha_core.Decoder()
    assert [received.kind for received in listen(decoder, packets[2:4])] == ["early", "early"]
    heard = decoder.feed(packets[0])
    assert [(received.kind, received.number) for received in heard] == [("avatar", 0), ("frames", 2), ("frames", 3)]
    assert_same(heard[2].frames, frames[3])
    assert [received.kind for received in decoder.feed(packets[0])] == ["repeated"]


def test_groups_that_wait_are_bounded():
    decoder = sacha_core.Decoder()
    for number in range(1, 400):
        decoder.feed(Packet(GROUP, 1, number, 1, bytes(10_000)).pack())
    assert sum(len(packet.payload) for packet in decoder._early) <= 1 << 20
    assert decoder.feed(Packet(GROUP, 1, 1, 1, bytes(2 << 20)).pack())[0].kind == "damaged"


def test_live_frames_keep_the_error_that_a_rehearsal_was_made_for():
    """Metamorphic: a stream fitted to a rehearsal carries other frames of the same person within the same steps."""
    head = small_head()
    avatar = random_avatar(20, n_frames=40, head=head, seed=5)
    other = replace(random_motion(64, head.n_vertices, seed=6), shape=avatar.motion.shape)
    for rehearsal in (avatar.motion, avatar.motion.frames(slice(0))):
        encoder = sacha_core.Encoder(replace(avatar, motion=rehearsal), 2, group_frames=GROUP_FRAMES, live=True)
        decoder = sacha_core.Decoder(head)
        heard = listen(decoder, [encoder.first, *encoder.push(other), *encoder.finish()])
        back = np.concatenate([received.frames.rotation for received in heard[1:]])
        assert np.abs(back - other.rotation).max() < 1.1 * 0.002  # a step of the level, see test_codec_avatar
        with pytest.raises(OptionError, match="live"):
            next(encoder.packets())


def test_frames_that_do_not_fit_are_refused():
    avatar = random_avatar(5, n_frames=9)
    encoder = sacha_core.Encoder(avatar, 2, group_frames=4)
    with pytest.raises(FormatError, match="expression weights"):
        encoder.push(random_motion(3, n_expression=7))
    far = random_motion(4)
    far.translation[2] = 1e9
    with pytest.raises(FormatError, match="steps"):
        encoder.push(far)
    with pytest.raises(OptionError, match="expected 1 to"):
        sacha_core.Encoder(avatar, 2, group_frames=5000)
    for wrong in (1.5, 4.0, float("nan"), "25", None):
        with pytest.raises(OptionError, match=r"group_frames is .*, expected a whole number from 1 to"):
            sacha_core.Encoder(avatar, 2, group_frames=wrong)
    assert sacha_core.Encoder(avatar, 2, group_frames=np.int64(4)).first == encoder.first
    with pytest.raises(OptionError, match="needs a motion"):
        sacha_core.Encoder(replace(avatar, motion=None))
    with pytest.raises(FormatError, match="lossy"):
        next(packets_of(encode_archive(avatar)))
    with pytest.raises(OptionError, match="without a motion"):
        next(packets_of(encode(replace(avatar, motion=None))))


def test_a_head_that_is_needed_is_named(packets):
    head = small_head()
    encoder = sacha_core.Encoder(random_avatar(9, n_frames=5, head=head), head=head)
    assert sacha_core.Decoder(head).feed(encoder.first)[0].kind == "avatar"
    with pytest.raises(HeadError, match="bumpy"):
        sacha_core.Decoder().feed(encoder.first)


def test_another_avatar_begins_another_stream(packets, frames):
    other = list(sacha_core.Encoder(random_avatar(7, n_frames=9, seed=8), 2, group_frames=4).packets())
    decoder = sacha_core.Decoder()
    listen(decoder, packets[:3])
    foreign = decoder.feed(other[1])
    assert (foreign[0].kind, foreign[0].number) == ("foreign", 1)
    kinds = [received.kind for received in listen(decoder, other)]
    assert kinds == ["avatar", *["frames"] * 3]
    assert len(decoder.avatar.gaussians) <= 7


def test_hostile_contents_under_right_checksums_are_told_and_cost_their_group(packets, frames):
    """Mutations of payloads, numbers and lengths, sealed anew: no exception, no endless work, and the stream goes on."""
    rng = np.random.default_rng(4)
    decoder = sacha_core.Decoder()
    listen(decoder, packets[:2])
    for trial in range(150):
        which = packets[rng.integers(len(packets))]
        payload = bytearray(Packet.parse(which).payload)
        for _ in range(rng.integers(1, 4)):
            payload[rng.integers(len(payload))] = rng.integers(256)
        changes = {"payload": bytes(payload[: rng.integers(len(payload) + 1)]) if trial % 3 else bytes(payload)}
        if trial % 5 == 0:
            changes["n_frames"] = int(rng.integers(1, 65536))
        if trial % 7 == 0 and Packet.parse(which).kind == GROUP:
            changes["number"] = int(rng.integers(1, 2**32))
        if trial % 11 == 0:
            changes["stream"] = int(rng.integers(2**32))
        start = time.process_time()
        for received in decoder.feed(resealed(which, **changes)):
            assert received.kind in ("frames", "damaged", "repeated", "foreign", "avatar")
            assert (received.frames is not None) == (received.kind == "frames")
        assert time.process_time() - start < STREAM_S
    assert len(decoder.missing) <= 4096
    decoder = sacha_core.Decoder()
    listen(decoder, [packets[0], resealed(packets[1], payload=b"\xff" * 300)])
    assert_same(decoder.feed(packets[2])[0].frames, frames[2])


@pytest.mark.parametrize("seed", range(10))
def test_any_bytes_are_told_to_be_damaged(seed):
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, 256, rng.integers(0, 200), dtype=np.uint8).tobytes()
    sealed = struct.pack("<I", zlib.crc32(noise)) + noise
    for data in (noise, sealed, b""):
        assert sacha_core.Decoder().feed(data)[0].kind == "damaged"


def test_cuts_of_a_packet_are_told(packets):
    for length in (*range(HEAD_BYTES + 2), len(packets[1]) - 1):
        assert sacha_core.Decoder().feed(packets[1][:length])[0].kind == "damaged"
