"""`sacha inspect --regions`: sums against the file and the decoder's own Gaussians."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sacha_core.codec import decode
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.regions.labels import label_triangles, region_counts
from sacha_core.regions.scheme import PAPER

ROUNDING = 1e-9


def test_regions_add_up_to_the_file(done, sacha_file: Path) -> None:
    outcome = done("inspect", sacha_file, "--regions")
    rows = outcome.report["regions"]
    assert [row["region"] for row in rows] == list(PAPER.regions)
    assert sum(row["bytes"] for row in rows) == outcome.report["bytes"]["gaussians"]
    counts = region_counts(label_triangles(synthetic_head("small")), decode(sacha_file).gaussians.binding)
    assert [row["gaussians"] for row in rows] == counts.tolist()
    assert sum(row["share"] for row in rows) == pytest.approx(1, rel=ROUNDING)
    each = [row["bytes_each"] for row in rows if row["gaussians"]]
    assert np.array(each) == pytest.approx([row["bytes"] / row["gaussians"] for row in rows if row["gaussians"]])
    for row in rows:
        assert f"{row['bytes']:,}" in outcome.out


def test_without_the_option_nothing_is_decoded(done, sacha_file: Path) -> None:
    assert "regions" not in done("inspect", sacha_file).report
