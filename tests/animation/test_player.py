"""Oracles: the plain path (`decode`, `Poser`, `triangle_frames`, `render_avatar`); a fresh player; counts of what was computed."""

from __future__ import annotations

import gc
import threading
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from posed_heads import random_gaussians

from sacha_core.animation import figure as figure_module
from sacha_core.animation import player as player_module
from sacha_core.animation.player import Player, PlayOptions
from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.codec import decode, encode
from sacha_core.errors import FormatError, GeometryError, HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.scene import render_avatar
from sacha_core.synthesis.sequences import perform

N_FRAMES, GROUP = 7, 3
TYPICAL, LARGEST = (
    1e-5,
    0.03,
)  # float32 posing in another order; where it decides otherwise at a threshold, a few pixels jump
FLOATS = PlayOptions(dtype=np.float32)


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


@pytest.fixture(scope="module")
def avatar(head: HeadModel) -> Avatar:
    gaussians = random_gaussians(head.n_faces, 600)
    gaussians.position[:] /= 4
    gaussians.log_scale[:] -= 1.5
    gaussians.sh_rest[:] /= 10
    gaussians.opacity_logit[::7] = -8  # too faint to be seen
    return Avatar(gaussians, head.reference, perform(head, "EXP-5", N_FRAMES, 0))


@pytest.fixture(scope="module")
def stream(avatar: Avatar, head: HeadModel) -> bytes:
    return encode(avatar, 4, head=head, group_frames=GROUP)


def camera_from(azimuth: float = 0.4, width: int = 66, height: int = 80) -> Camera:
    eye = np.array([np.sin(azimuth), 0.1, np.cos(azimuth)])
    return Camera.look_at(eye, np.zeros(3), width, height, 150.0)


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts poses, Gaussians carried and coloured, and drawings from here on; on one thread, where each is done in one go."""
    counts: Counter[str] = Counter()

    def counted(owner: object, name: str, what: str) -> None:
        plain = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *a, **k: counts.update([what]) or plain(*a, **k))

    counted(figure_module.PosedHead, "pose", "posed")
    counted(figure_module, "carry_range", "carried")
    counted(figure_module, "harmonic_colours", "coloured")
    counted(player_module.Rasteriser, "forward", "drawn")
    return counts


@pytest.mark.parametrize("sh_degree", [None, 0, 2])
def test_frames_agree_with_the_plain_path(stream: bytes, head: HeadModel, sh_degree: int | None) -> None:
    whole, camera = decode(stream, head=head), camera_from()
    pose = Poser(head, whole.motion, np.float64)
    options = PlayOptions(dtype=np.float32, sh_degree=sh_degree, background=0.3)
    with Player.open(stream, head, options) as player:
        assert (len(player), player.frame_rate) == (N_FRAMES, whole.motion.frame_rate)
        for index in (5, 0, 1, 2, 3, 6):
            frames = triangle_frames(pose(index), head.faces)
            expected = render_avatar(whole.gaussians, frames, camera, 0.3, sh_degree).colour
            difference = np.abs(player.frame(index, camera) - expected)
            assert np.quantile(difference, 0.99) < TYPICAL
            assert difference.max() < LARGEST
            assert expected.std() > 0.05


def test_every_frame_is_what_a_fresh_player_gives(stream: bytes, head: HeadModel) -> None:
    """Nothing is left over from the frames and cameras before, whatever their order; the camera that stands close leaves no margin."""
    cameras = [
        camera_from(),
        camera_from(1.9),
        camera_from(0.4, 50, 90),
        replace(camera_from(), fx=400.0, fy=400.0),
        camera_from(),
    ]
    rng = np.random.default_rng(1)
    with Player.open(stream, head) as player:
        for _ in range(25):
            index, camera = int(rng.integers(N_FRAMES)), cameras[rng.integers(len(cameras))]
            picture = player.frame(index, camera)
            with Player.open(stream, head) as fresh:
                np.testing.assert_array_equal(picture, fresh.frame(index, camera))


@pytest.mark.parametrize("options", [{"crop": False}, {"threads": 1}, {"threads": 3}], ids=str)
def test_what_changes_no_bit(stream: bytes, head: HeadModel, options: dict[str, object]) -> None:
    with Player.open(stream, head, FLOATS) as player, Player.open(stream, head, replace(FLOATS, **options)) as other:
        for index in range(3):
            np.testing.assert_array_equal(player.frame(index, camera_from()), other.frame(index, camera_from()))


def test_leaving_out_what_is_too_faint_changes_no_bit(
    stream: bytes, head: HeadModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    avatar = decode(stream, head=head)
    avatar.gaussians.opacity_logit[::5] = -8
    with Player(avatar.gaussians, head, avatar.motion, FLOATS) as player:
        monkeypatch.setattr(figure_module, "ALPHA_MIN", np.float32(0))
        with Player(avatar.gaussians, head, avatar.motion, FLOATS) as whole:
            assert len(player._figure) < len(whole._figure) == len(avatar.gaussians)
            np.testing.assert_array_equal(player.frame(1, camera_from()), whole.frame(1, camera_from()))


def test_leaving_out_harmonics_that_are_zero_changes_no_bit(head: HeadModel, monkeypatch: pytest.MonkeyPatch) -> None:
    gaussians = random_gaussians(head.n_faces, 600)
    for first, coefficient in ((0, 0), (1, 3), (2, 8)):
        gaussians.sh_rest[first::4, coefficient:] = 0
    gaussians.position[:] /= 4
    gaussians.log_scale[:] -= 1.5
    with Player(gaussians, head, options=FLOATS) as player:
        assert np.bincount(player._figure._degrees).min() > 100
        monkeypatch.setattr(figure_module, "degrees_in_use", lambda rest: np.full(len(rest), 3, np.uint8))
        with Player(gaussians, head, options=FLOATS) as whole:
            np.testing.assert_array_equal(player.frame(0, camera_from()), whole.frame(0, camera_from()))


def test_bytes_are_the_rounded_floats(stream: bytes, head: HeadModel) -> None:
    with Player.open(stream, head) as player, Player.open(stream, head, FLOATS) as floats:
        blended = floats.frame(2, camera_from())
        expected = np.round(np.clip(blended, 0, 1) * np.float32(255)).astype(np.uint8)
        np.testing.assert_array_equal(player.frame(2, camera_from()), expected)


def test_nothing_is_computed_again(stream: bytes, head: HeadModel, work: Counter[str]) -> None:
    with Player.open(stream, head, PlayOptions(threads=1)) as player:
        first = player.frame(1, camera_from())
        assert work == {"posed": 1, "carried": 1, "coloured": 1, "drawn": 1}
        assert player.frame(1, camera_from()) is first
        assert work == {"posed": 1, "carried": 1, "coloured": 1, "drawn": 1}
        player.frame(1, replace(camera_from(), cx=20.0))  # stands where it stood
        assert work == {"posed": 1, "carried": 1, "coloured": 1, "drawn": 2}
        player.frame(1, camera_from(0.5))
        assert work == {"posed": 1, "carried": 1, "coloured": 2, "drawn": 3}
        player.frame(2, camera_from(0.5))
        assert work == {"posed": 2, "carried": 2, "coloured": 3, "drawn": 4}


def test_frames_of_equal_parameters_are_one_frame(avatar: Avatar, head: HeadModel, work: Counter[str]) -> None:
    with Player(avatar.gaussians, head, avatar.motion.frames(np.array([0, 3, 3, 0]))) as player:
        pictures = [player.frame(index, camera_from()) for index in range(4)]
        assert pictures[1] is pictures[2]
        assert work["drawn"] == 3


def test_colours_of_views_that_hardly_turn_are_used_again(stream: bytes, head: HeadModel, work: Counter[str]) -> None:
    options = replace(FLOATS, colour_turn_deg=1.0, threads=1)
    with Player.open(stream, head, options) as player, Player.open(stream, head, FLOATS) as exact:
        player.frame(0, camera_from(0.4))
        work.clear()
        picture = player.frame(0, camera_from(0.4 + np.radians(0.9)))
        assert work["coloured"] == 0
        difference = np.abs(picture - exact.frame(0, camera_from(0.4 + np.radians(0.9))))
        assert 0 < difference.max() < 0.05
        work.clear()
        picture = player.frame(0, camera_from(0.4 + np.radians(1.5)))
        assert work["coloured"] == 1
        np.testing.assert_array_equal(picture, exact.frame(0, camera_from(0.4 + np.radians(1.5))))


def test_given_colours(avatar: Avatar, head: HeadModel) -> None:
    colours = np.random.default_rng(0).random((len(avatar.gaussians), 3)).astype(np.float32)
    frames = triangle_frames(Poser(head, avatar.motion, np.float64)(2), head.faces)
    expected = render_avatar(avatar.gaussians, frames, camera_from(), colours=colours).colour
    with Player(avatar.gaussians, head, avatar.motion, FLOATS, colours) as player:
        difference = np.abs(player.frame(2, camera_from()) - expected)
    assert np.quantile(difference, 0.99) < TYPICAL
    with pytest.raises(OptionError, match="colours have shape"):
        Player(avatar.gaussians, head, avatar.motion, FLOATS, colours[:-1])


def test_avatars_without_motion_and_motions_without_frames(avatar: Avatar, head: HeadModel) -> None:
    with Player(avatar.gaussians, head) as player:
        assert len(player) == 1
        assert player.frame(0, camera_from()).std() > 5
    rest = Motion.rest(1, 1, n_frames=0)
    data = encode(Avatar(avatar.gaussians, head.reference, rest), 1, head=head)
    with Player.open(data, head) as player:
        assert len(player) == 0
        with pytest.raises(OptionError, match="frame 0 does not exist; the motion has no frames"):
            player.frame(0, camera_from())


def test_avatars_without_gaussians(head: HeadModel) -> None:
    with Player(random_gaussians(head.n_faces, 0), head, options=replace(FLOATS, background=0.25)) as player:
        np.testing.assert_array_equal(player.frame(0, camera_from()), np.float32(0.25))


def test_cameras_that_see_nothing(stream: bytes, head: HeadModel) -> None:
    away = Camera.look_at(np.array([0, 0, 1.0]), np.array([0, 0, 2.0]), 40, 30, 50.0)
    with Player.open(stream, head, replace(FLOATS, background=0.25)) as player:
        assert player.frame(0, replace(camera_from(), width=40, height=30)).min() < 0.2
        for _ in range(3):
            np.testing.assert_array_equal(player.frame(0, away), np.float32(0.25))
            player.frame(1, replace(camera_from(), width=40, height=30))


def test_the_head_is_found_where_none_is_given(
    avatar: Avatar, head: HeadModel, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path))
    path = tmp_path / "a.sacha"
    path.write_bytes(encode(avatar, 2, head=head, embed_head=True))
    with Player.open(path) as inside, Player.open(encode(avatar, 2, head=head)) as by_name:
        np.testing.assert_array_equal(inside.frame(0, camera_from()), by_name.frame(0, camera_from()))
    with pytest.raises(HeadError):
        Player.open(path, synthetic_head("small", 1))


def test_faults_name_their_frame_or_group(avatar: Avatar, head: HeadModel, stream: bytes) -> None:
    motion = avatar.motion
    translation = motion.translation.copy()
    translation[1] = 1e30
    with Player(avatar.gaussians, head, replace(motion, translation=translation)) as player:
        before = player.frame(0, camera_from()).copy()
        with pytest.raises(GeometryError, match="frame 1: triangle 0 has zero area"):
            player.frame(1, camera_from())
        np.testing.assert_array_equal(player.frame(0, camera_from()), before)
    wide = np.ones((N_FRAMES, head.exprdirs.shape[2] + 1), np.float32)
    with (
        Player(avatar.gaussians, head, replace(motion, expression=wide)) as player,
        pytest.raises(HeadError, match="expression components"),
    ):
        player.frame(0, camera_from())
    with Player.open(stream, head) as player, pytest.raises(OptionError, match="pixels"):
        player.frame(0, camera_from(width=0))
    damaged = player_with_damaged_group(stream, head, 1)
    with damaged as player:
        player.frame(GROUP - 1, camera_from())
        with pytest.raises(FormatError, match=r"motion group 1: frame \d+ of the group .* \(at byte \d+\)"):
            player.seek(GROUP)
        with pytest.raises(FormatError, match="motion group 1"):
            player.frame(GROUP, camera_from())
        player.frame(2 * GROUP, camera_from())


def player_with_damaged_group(stream: bytes, head: HeadModel, number: int) -> Player:
    player = Player.open(stream, head)
    reader = player.motion
    start, n_bytes = reader._head.groups[number]
    spoiled = bytearray(reader._data)
    spoiled[start : start + n_bytes] = b"\xff" * n_bytes  # an endless suffix
    reader._data = bytes(spoiled)
    return player


def test_closing_leaves_no_thread_behind(stream: bytes, head: HeadModel) -> None:
    gc.collect()
    before = set(threading.enumerate())
    with Player.open(stream, head) as player:
        player.frame(0, camera_from())
        player.frame(1, camera_from())
    with pytest.raises(OptionError, match="closed"):
        player.frame(2, camera_from())
    del player
    gc.collect()
    until = time.monotonic() + 5
    while set(threading.enumerate()) - before and time.monotonic() < until:
        time.sleep(0.01)
    assert set(threading.enumerate()) <= before


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"threads": 0}, "0 threads"),
        ({"background": np.ones(4)}, "background"),
        ({"background": np.nan}, "background"),
        ({"colour_turn_deg": np.nan}, "degrees"),
        ({"colour_turn_deg": -1.0}, "degrees"),
        ({"dtype": np.int16}, "int16"),
    ],
)
def test_options_that_make_no_sense_are_refused(avatar: Avatar, head: HeadModel, options: dict, said: str) -> None:
    with pytest.raises(OptionError, match=said):
        Player(avatar.gaussians, head, options=PlayOptions(**options))


def test_a_camera_of_another_shape_is_refused_and_the_player_goes_on(avatar: Avatar, head: HeadModel) -> None:
    camera = camera_from()
    with Player(avatar.gaussians, head) as player:
        for broken in ({"rotation": np.eye(4)}, {"translation": np.zeros(4)}):
            with pytest.raises(OptionError, match="shapes"):
                player.frame(0, replace(camera, **broken))
        assert player.frame(0, camera).shape == (camera.height, camera.width, 3)
