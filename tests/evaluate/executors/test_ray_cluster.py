"""Ray: the executor's promises, kept on a cluster of two nodes of this machine that the test starts."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_executors import Act

from sacha_core.errors import OptionError
from sacha_core.evaluate.executors.jobs import Job, Outcome
from sacha_core.evaluate.executors.ray_cluster import RayCluster
from sacha_core.progress import silent

if os.environ.get("SACHA_REQUIRE_RAY") != "1":
    pytest.importorskip("ray", reason="Ray is not installed; SACHA_REQUIRE_RAY=1 makes this a failure")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Start two nodes with one processor each, whose workers find this code."""
    from ray.cluster_utils import Cluster  # noqa: PLC0415 - which may be missing

    node = {"num_cpus": 1, "object_store_memory": 80 << 20}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
        cluster = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
        try:
            cluster.add_node(**node)
            yield cluster.address
        finally:
            cluster.shutdown()


def test_a_cluster_gives_every_job_an_outcome(address: str, tmp_path: Path) -> None:
    """Oracle: what each job did; two wait for one another's start, so both workers are at work at once."""
    kinds = ("fine", "wrong input", "bug", "die")
    jobs = [Job(kind, Act(kind, tmp_path / kind)) for kind in kinds]
    jobs += [
        Job("after", Act("fine", tmp_path / "after"), ("fine",)),
        Job("never", Act("fine", tmp_path / "never"), ("bug",)),
    ]
    told: set[str] = set()
    outcomes = {o.name: o for o in RayCluster(address).run(jobs, lambda progress: told.add(progress.stage))}
    assert outcomes["fine"] == Outcome("fine")
    assert outcomes["after"] == Outcome("after")
    assert outcomes["wrong input"] == Outcome("wrong input", "this is wrong")
    assert outcomes["bug"].error == "RuntimeError: nobody thought of this"
    assert outcomes["die"].error is not None
    assert outcomes["die"].error.startswith("its worker was lost: ")
    assert outcomes["never"].error == "not begun, since bug failed"
    assert "fine" in told


def test_a_cluster_that_is_not_there_is_told_in_one_line() -> None:
    """Oracle: the error."""
    with pytest.raises(OptionError, match=r"there is no Ray cluster at 127\.0\.0\.1:1: "):
        list(RayCluster("127.0.0.1:1").run([], silent))
