"""Every codec on a small avatar: the bytes alone give it back. Missing ones skip; SACHA_REQUIRE_PEERS=name,name or `all` forbids that."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.animation.splat_binding import subdivided
from sacha_core.animation.standing import Standing
from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.bench.codec_free import free_subject
from sacha_core.bench.codec_scene import Extent, judge, make_scene, scene_of
from sacha_core.bench.scenes import made_avatar
from sacha_core.codec import encode
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers import frames, gpcc, splat_transform
from sacha_core.evaluate.peers.peer import Ground, Peer, PeerError, Setting, visible
from sacha_core.evaluate.peers.registry import PEERS, find_peer
from sacha_core.evaluate.peers.trial import Trials, try_codec
from sacha_core.flame.open import open_head
from sacha_core.interchange.splat_ply import read_world_ply, write_world_ply
from sacha_core.raster.rasteriser import Rasteriser

REQUIRED = os.environ.get("SACHA_REQUIRE_PEERS", "").split(",")
AVATAR, HEAD = made_avatar(400, 1, 2)
SOUND_DB = 30.0  # of the finest setting; a Gaussian that got another's binding or place costs far more
MADE = {  # the made avatar, with a motion that stands still a moment
    0: (Avatar(made_avatar(300, 0, 2)[0].gaussians, HEAD.reference, AVATAR.motion), HEAD), 1: (AVATAR, HEAD),
}  # fmt: skip


def need(peer: Peer) -> None:
    """Skip, or fail where it was asked for, if a codec is missing."""
    lack = peer.lacking()
    if lack is None:
        return
    if "all" in REQUIRED or peer.name in REQUIRED:
        pytest.fail(f"SACHA_REQUIRE_PEERS asks for {peer.name}: {lack}")
    pytest.skip(f"{peer.name} {lack}")


@pytest.mark.parametrize("sh_degree", [0, 1])
@pytest.mark.parametrize("name", PEERS)
def test_a_codec_gives_the_avatar_back(name: str, sh_degree: int) -> None:
    """Oracle: the uncompressed avatar, posed and drawn."""
    peer = find_peer(name)
    need(peer)
    avatar, head = MADE[sh_degree]
    settings = peer.settings(True, sh_degree) or peer.settings(False, sh_degree)[-1:]
    assert len({setting.name for setting in peer.settings(False, sh_degree)}) == len(peer.settings(False, sh_degree))
    domains = {setting.domain: setting for setting in settings}  # the last and finest of each
    found = {domain: try_codec(name, avatar.gaussians, head, setting) for domain, setting in domains.items()}
    given = avatar.gaussians if peer.lossless else visible(avatar.gaussians)
    for trial in found.values():
        assert trial.gaussians is not None
        assert trial.n_bytes > 0
        if name not in {"sacha", "sacha-fitted"}:  # which drop what decodes to nothing or others make up for
            assert np.array_equal(np.bincount(trial.gaussians.binding), np.bincount(given.binding))
    if peer.lossless:
        (trial,) = found.values()
        assert trial.gaussians is not None
        assert sorted(map(tuple, rows_of(trial.gaussians))) == sorted(map(tuple, rows_of(given)))
        return
    scene = make_scene(avatar, head, Extent(1, 8, 9, 0.25))
    scores = judge(scene, {k: t.gaussians for k, t in found.items() if t.gaussians is not None}, Rasteriser(1))
    assert max(one.psnr for one in scores.values()) > SOUND_DB, {k: one.psnr for k, one in scores.items()}


@pytest.mark.parametrize("name", [name for name, peer in PEERS.items() if not peer.needs_head])
def test_a_codec_gives_splats_without_a_head_back(name: str, tmp_path: Path) -> None:
    """Oracle: the uncompressed splats, drawn."""
    peer = find_peer(name)
    need(peer)
    for degree in (0, 1, 3):
        offered = peer.settings_for(False, degree, bound=False)
        assert len({setting.name for setting in offered}) == len(offered) > 0
        assert peer.lossless or {setting.domain for setting in offered} == {"world"}
    write_world_ply(tmp_path / "scene.ply", Standing(AVATAR.gaussians, HEAD, None)(0), 1)
    subject = free_subject(read_world_ply(tmp_path / "scene.ply"), tmp_path / "scene.ply")
    given = subject.avatar.gaussians if peer.lossless else visible(subject.avatar.gaussians)
    setting = peer.settings_for(True, 1, bound=False)[-1]
    trial = try_codec(name, subject.avatar.gaussians, subject.head, setting, bound=False)
    assert trial.gaussians is not None
    assert len(trial.gaussians) == len(given)
    if peer.lossless:
        assert sorted(map(tuple, rows_of(trial.gaussians))) == sorted(map(tuple, rows_of(given)))
        return
    scores = judge(scene_of(subject, Extent(1, 8, 9, 0.25)), {name: trial.gaussians}, Rasteriser(1))
    assert scores[name].psnr > SOUND_DB


def rows_of(gaussians: Gaussians) -> list[list[float]]:
    """Give all numbers of each Gaussian."""
    n = len(gaussians)
    parts = [gaussians.position, gaussians.log_scale, gaussians.quaternion, gaussians.opacity_logit, gaussians.sh_dc,
             gaussians.sh_rest, gaussians.binding]  # fmt: skip
    return np.concatenate([np.asarray(part, np.float64).reshape(n, -1) for part in parts], axis=1).tolist()


def test_ours_takes_an_avatar_as_encode_does() -> None:
    """Oracle: `encode` itself, on a head's vertices, which it knows by their order."""
    head = open_head("synthetic")
    binding = subdivided(head).binding
    some = made_avatar(len(binding), 0, 1)[0].gaussians
    avatar = Avatar(replace(some, binding=binding, opacity_logit=np.full(len(some), 2, np.float32)), head.reference)
    trial = try_codec("sacha-rules", avatar.gaussians, head, Setting("level 2", "local", {"level": 2}))
    assert trial.parts["file"] == encode(avatar, 2, head=head)
    mixed = avatar.gaussians.select(np.random.default_rng(0).permutation(len(some)))
    assert (
        len(encode(replace(avatar, gaussians=mixed), 2, head=head)) > trial.n_bytes
    )  # the order does tell it something


@pytest.mark.parametrize("inter", [False, True])
def test_frames_as_pictures_come_back(inter: bool) -> None:
    """Oracle: the frames' own splats, as far as the quantisation lets them; a still frame after the first costs little in time."""
    need(find_peer("hevc"))
    ground = Ground(HEAD)
    world = ground.to_domain(visible(AVATAR.gaussians), "world")
    data = frames.encode_pictures([world, world], ground, "trained", 7, inter)
    back = frames.decode_pictures(data)
    alone = len(frames.encode_pictures([world], ground, "trained", 7, inter))
    assert len(back) == 2
    assert (len(data) < 1.2 * alone) == inter
    step = np.ptp(world.position, axis=0).max() / 4095
    for one in back:
        nearest = np.abs(one.position[:, None] - world.position[None]).max(axis=2).min(axis=1)
        assert nearest.max() <= 0.51 * step


@pytest.mark.parametrize("inter", [False, True])
def test_frames_of_different_splats_come_back_as_pictures(inter: bool) -> None:
    """Oracle: each frame's own splats, as far as the quantisation lets them, and as many of them."""
    need(find_peer("hevc"))
    ground = Ground(HEAD)
    world = ground.to_domain(visible(AVATAR.gaussians), "world")
    given = [world, world.select(np.arange(len(world))[::3]), world.select(np.arange(len(world) - 7)[::-1])]
    step = np.ptp(world.position, axis=0).max() / 4095
    for one, back in zip(
        given, frames.decode_pictures(frames.encode_pictures(given, ground, "trained", 7, inter)), strict=True
    ):
        assert len(back) == len(one)
        distance = np.abs(one.position[:, None] - back.position[None]).max(axis=2)
        assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) <= 0.51 * step


def test_a_missing_program_is_told_with_how_to_get_it(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for variable in (splat_transform.VARIABLE, gpcc.VARIABLE):
        monkeypatch.delenv(variable, raising=False)
    for name, words in {"spz": splat_transform.PACKAGE, "gpcc": gpcc.VARIABLE}.items():
        lack = find_peer(name).lacking()
        assert lack is not None
        assert words in lack
        with pytest.raises(PeerError, match="needs"):
            try_codec(name, AVATAR.gaussians, HEAD, find_peer(name).settings(True, 1)[0])


def test_a_codec_that_fails_or_takes_too_long_costs_a_row_and_not_the_run() -> None:
    trials = Trials(HEAD)
    try:
        xz = find_peer("xz")
        (setting,) = xz.settings(True, 1)
        hasty = Peer("xz", xz.title, xz.lacking, xz.settings, xz.encode, xz.decode, limit_s=0.0)
        assert "took more than 0 s" in trials(hasty, AVATAR.gaussians, setting).failure
        wrong = trials(find_peer("sacha"), AVATAR.gaussians, Setting("level 99", "local", {"level": 99}))
        assert wrong.failure.startswith("OptionError: ")
        assert wrong.gaussians is None
        fine = trials(xz, AVATAR.gaussians, setting)
        assert not fine.failure
        assert fine.gaussians is not None
    finally:
        trials.end()


def test_an_unknown_codec_is_refused() -> None:
    with pytest.raises(OptionError, match="there is no codec 'zip'; expected one of sacha, "):
        find_peer("zip")
