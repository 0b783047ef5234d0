"""The bench of the CUDA engine: all of it on the CPU with the stand-in, tiny, and what it says where there is no device."""

from __future__ import annotations

import gsplat_stand_in
import pytest

from sacha_core.bench import cuda
from sacha_core.bench.preset import Preset
from sacha_core.errors import OptionError
from sacha_core.progress import silent
from sacha_core.train.cuda.engine import CudaEngine
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

COSINE = 1e-6  # float32, and pixels at a threshold


def test_without_a_device_it_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda, "missing", lambda: "there is none: install one")
    with pytest.raises(OptionError, match="no CUDA device to measure: there is none: install one"):
        cuda.measure(Preset("tiny"), silent)


class StandIn:
    """The CPU in place of a device."""

    name = "a stand-in"

    def open(self, trial, graphs=False):  # noqa: ARG002 (there is nothing to record)
        return CudaEngine(trial.head, trial.motion, trial.options, "cpu", gsplat_stand_in)

    def forget_peak(self):
        pass

    def peak_bytes(self):
        return 3 << 20


@pytest.mark.slow
def test_every_table_is_filled() -> None:
    found = cuda.measured(Preset("tiny", threads=1), silent, StandIn())
    for table in found.tables:
        rows = found.of(table)
        assert rows, table.name
        assert all(column.key in row for row in rows for column in table.columns), table.name
        assert len({tuple(row[key] for key in table.identity) for row in rows}) == len(rows), table.name
    parity = {row["parameter"]: row for row in found.rows if row["table"] == "parity"}
    assert parity.keys() == {*ATTRIBUTES, *FITTED_MOTION}
    assert all(abs(row["short_of_one"]) < COSINE and row["lone"] == 0 for row in parity.values())
    # on the CPU sums have one order
    assert not any(row["apart"] for row in found.rows if row["table"] == "drift")
