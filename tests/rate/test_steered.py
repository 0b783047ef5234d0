"""Files of a budget: exactly the Gaussians that it leaves, at most the bytes that it allows, and more of what it is told matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.codec import decode
from sacha_core.density.budget import Budget
from sacha_core.density.rebudget import rebudget
from sacha_core.density.scores_file import Scores
from sacha_core.evaluate.importance import score_avatar
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.rate.steered import SteeredEncoder, error_factors
from sacha_core.rate.target import encode_to_size
from sacha_core.regions.partition import partition_by
from sacha_core.train.options import TrainOptions

HEAD = synthetic_head("small")
REGIONS = partition_by(HEAD)
MOUTH = REGIONS.label("mouth")
EYES = REGIONS.label("eyes")
EXACT = 1e-12  # float64, a few operations


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    """Give an avatar of coloured Gaussians, one a triangle."""
    rng = np.random.default_rng(3)
    gaussians = initial_gaussians(HEAD.n_faces, rng, 0)
    n = len(gaussians)
    gaussians = replace(
        gaussians,
        log_scale=rng.normal(-0.5, 0.3, (n, 3)).astype(np.float32),
        opacity_logit=rng.normal(2, 1, n).astype(np.float32),
        sh_dc=rng.normal(0, 1, (n, 3)).astype(np.float32),
    )
    return Avatar(gaussians, HEAD.reference)


@pytest.fixture(scope="module")
def scores(avatar: Avatar) -> Scores:
    """Score it by small pictures of its own."""
    options = TrainOptions(width=96, height=140)
    return score_avatar(avatar.gaussians, HEAD, None, None, options).scores


def test_the_file_holds_exactly_the_gaussians_that_the_budget_leaves(avatar: Avatar, scores: Scores) -> None:
    budget = Budget(0.4, {MOUTH: 2.0}, locks={EYES: None})
    encoded = SteeredEncoder(avatar, HEAD, scores, REGIONS, budget).encode(1)
    kept = rebudget(scores, REGIONS, budget).rows
    assert sorted(encoded.rows.tolist()) == kept.tolist()
    decoded = decode(encoded.data, head=HEAD).gaussians
    assert np.array_equal(decoded.binding, avatar.gaussians.binding[encoded.rows])


def test_a_size_is_kept_to_and_the_mouth_gets_more_of_it_where_it_is_said_to_matter(
    avatar: Avatar, scores: Scores
) -> None:
    most, kept = 2_000, {}  # so few bytes that what shows of the mouth has to give, too
    for name, weights in {"neutral": {}, "mouth": {MOUTH: 2.0}}.items():
        encoder = SteeredEncoder(avatar, HEAD, scores, REGIONS, Budget(1.0, weights), fixed_keep=False)
        reached = encode_to_size(encoder, most)
        assert 0.9 * most < len(reached.encoded.data) <= most
        rows = reached.encoded.rows
        kept[name] = np.bincount(REGIONS.labels[avatar.gaussians.binding[rows]], minlength=len(REGIONS.regions))
        # who stays is who the common ranking puts first, as many as the level pays for
        same = rebudget(scores, REGIONS, Budget(len(rows) / len(scores.score), weights))
        assert sorted(rows.tolist()) == same.rows.tolist()
    assert kept["mouth"][MOUTH] > kept["neutral"][MOUTH]


def test_shares_hold_at_whatever_number_the_size_allows(avatar: Avatar, scores: Scores) -> None:
    budget = Budget(1.0, shares={MOUTH: (0.2, 0.25)})
    encoder = SteeredEncoder(avatar, HEAD, scores, REGIONS, budget, fixed_keep=False)
    for level in (1, 3):
        rows = encoder.encode(level).rows
        mouth = (REGIONS.labels[avatar.gaussians.binding[rows]] == MOUTH).sum()
        assert 0.2 * len(rows) <= mouth <= 0.25 * len(rows)


def test_a_finer_level_pays_for_more_gaussians(avatar: Avatar, scores: Scores) -> None:
    encoder = SteeredEncoder(avatar, HEAD, scores, REGIONS, Budget(1.0), fixed_keep=False)
    counts = [len(encoder.choose(level).rows) for level in (1, 2, 4)]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_to_raise_all_weights_alike_is_to_raise_none(scores: Scores) -> None:
    every = dict.fromkeys(range(len(REGIONS.regions)), 3.0)
    assert error_factors(scores, REGIONS, Budget(0.5)) == pytest.approx(1.0, rel=EXACT)
    assert error_factors(scores, REGIONS, Budget(0.5, every)) == pytest.approx(1.0, rel=EXACT)
    one = error_factors(scores, REGIONS, Budget(0.5, {MOUTH: 3.0}))
    mouth = REGIONS.labels[scores.gaussians.binding] == MOUTH
    assert one[mouth].min() == pytest.approx(3 * one[~mouth].max(), rel=EXACT)
    assert np.average(one, weights=scores.score) == pytest.approx(1.0, rel=EXACT)
    painted = np.where(REGIONS.labels == MOUTH, 3.0, 1.0)
    assert error_factors(scores, REGIONS, Budget(0.5, importance=painted)) == pytest.approx(one, rel=EXACT)
