"""Bytes of triangles: their sum against the file, noise against nothing, and a plain reading of FORMAT.md against the decoder's account."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec import decode, encode, inspect
from sacha_core.codec.archive_encoder import encode_archive
from sacha_core.codec.grouping import fit_table
from sacha_core.codec.paper_encoder import encode_paper
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.spending import spent_bytes
from sacha_core.codec.symbols import SymbolReader, SymbolWriter
from sacha_core.codec.tables import table_weights
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head

ROUNDING = 1e-9  # of sums in float64, relative
WORD_BITS = 64  # the coder's state at its end, and its last word: what the sum of all tokens may be off by
N = 1500
CONFUSED = 3  # regions of noise cost so many times what regions of nothing do, at least


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


def avatar_of(head: HeadModel, degree: int, n: int = N) -> Avatar:
    """Gaussians of noise on the first half of the triangles, and of nothing but their place on the others."""
    rng = np.random.default_rng(3)
    gaussians = initial_gaussians(head.n_faces, rng, degree).select(rng.integers(0, head.n_faces, n))
    noisy = gaussians.binding < head.n_faces // 2

    def spread(values: np.ndarray) -> np.ndarray:
        shape = (len(values), *(1,) * (values.ndim - 1))
        return np.where(noisy.reshape(shape), rng.normal(0, 0.5, values.shape), 0).astype(np.float32)

    names = ("position", "log_scale", "sh_dc", "sh_rest", "opacity_logit")
    gaussians = replace(gaussians, **{name: spread(getattr(gaussians, name)) for name in names})
    motion = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], n_frames=2)
    return Avatar(replace(gaussians, sensitivity_logit=spread(gaussians.opacity_logit)), head.reference, motion)


FILES = {
    "level 1, degree 0": lambda avatar, head: encode(avatar, 1, head=head),
    "level 4, degree 2": lambda avatar, head: encode(avatar, 4, head=head),
    "without the head": lambda avatar, _: encode(avatar, 2),
    "with the head inside": lambda avatar, head: encode(avatar, 2, head=head, embed_head=True),
    "archive, degree 2": lambda avatar, head: encode_archive(avatar, head=head),
    "paper, degree 1": lambda avatar, head: encode_paper(avatar, 2, head=head),
}


@pytest.mark.parametrize("kind", FILES)
def test_triangles_add_up_to_the_files_bytes_of_gaussians(head: HeadModel, kind: str) -> None:
    degree = int(kind[-1]) if kind[-1].isdigit() else 0
    data = FILES[kind](avatar_of(head, degree), head)
    spent, told = spent_bytes(data, head=head), inspect(data)
    assert spent.triangles.shape == (head.n_faces,)
    assert spent.triangles.sum() == pytest.approx(told.gaussian_bytes, rel=ROUNDING)
    assert sum(of.sum() for of in spent.sections.values()) == pytest.approx(told.gaussian_bytes, rel=ROUNDING)
    sizes = {section.name: section.n_bytes for section in told.sections}
    for name, of in spent.sections.items():
        if name != "(table)":
            assert of.sum() == pytest.approx(sizes[name], rel=ROUNDING), name
        assert of.min() >= 0, name
    assert not {"Static", "Motion", "head"} & spent.sections.keys()


@pytest.mark.parametrize(
    "kind", ["level 1, degree 0", "level 4, degree 2", "without the head", "archive, degree 2", "paper, degree 1"]
)
def test_what_cannot_be_foretold_costs_more(head: HeadModel, kind: str) -> None:
    data = FILES[kind](avatar_of(head, int(kind[-1]) if kind[-1].isdigit() else 0), head)
    spent = spent_bytes(data, head=head).triangles
    binding = decode(data, head=head).gaussians.binding
    count = np.bincount(binding, minlength=head.n_faces)
    noisy, half = slice(None, head.n_faces // 2), slice(head.n_faces // 2, None)
    each = [spent[part].sum() / count[part].sum() for part in (noisy, half)]
    assert each[0] > CONFUSED * each[1]


def test_an_avatar_of_no_gaussians_is_shared_by_all_triangles(head: HeadModel) -> None:
    data = encode(avatar_of(head, 0, n=0), 2, head=head)
    spent = spent_bytes(data, head=head).triangles
    assert spent.sum() == pytest.approx(inspect(data).gaussian_bytes, rel=ROUNDING)
    assert np.ptp(spent) <= ROUNDING * spent.sum()


def test_a_tokens_bits_are_those_of_its_interval() -> None:
    """Every cost against FORMAT.md, "Tokens", read plainly: intervals of 24 bits, and raw bits; their sum against the words written."""
    rng = np.random.default_rng(0)
    values = np.rint(rng.laplace(0, 6, 4000)).astype(np.int64)
    writer = SymbolWriter(1)
    writer.write(values, np.zeros(len(values), np.int64))
    data = writer.finish()
    log: list[np.ndarray] = []
    assert np.array_equal(SymbolReader(ByteReader(data, "x", log=log), 1).read(np.zeros(len(values), np.int64)), values)

    tokens, raw = [], []
    for value in values.tolist():
        shift = max(abs(value).bit_length() - 3, 0) if abs(value) >= 16 else 0
        token = abs(value) if abs(value) < 16 else 16 + 4 * (shift - 2) + (abs(value) >> shift) - 4
        tokens.append(-token if value < 0 else token)
        raw.append(shift)
    low = min(tokens)
    counts = np.bincount(np.array(tokens) + 111, minlength=223)
    first, grades = fit_table(counts)
    assert first == low
    weights = table_weights(grades).tolist()
    share = (2**24 - len(weights)) / sum(weights)
    begins = [math.floor(share * sum(weights[:place])) + place for place in range(len(weights))] + [2**24]
    expected = [
        24 - math.log2(begins[t - low + 1] - begins[t - low]) + bits for t, bits in zip(tokens, raw, strict=True)
    ]
    assert log[0] == pytest.approx(expected, rel=ROUNDING)
    head_bytes = 9 + int.from_bytes(data[1:5], "little")
    assert abs(8 * (len(data) - head_bytes) - sum(expected)) < WORD_BITS
