# SPDX-License-Identifier: Apache-2.0
"""A sweep on a cluster, through joblib's own back end: the scores are those of this machine's cores."""

from pathlib import Path

import pytest
from joblib import parallel_config

from seed_sim.closed_loop.sweep import sweep

pytest.importorskip("distributed", reason="needs Dask: pip install dask distributed")

from distributed import Client, LocalCluster

TOUCH = """
name: touch
tool: squeegee
frame: {position: 0.45 0.0 0.0 m, rpy: 0 0 0 deg}
phases:
  - {name: approach, to: 0 0 0.015 m, speed: 0.1 m/s}
  - {name: press, control: {force: 0 0 -8 N}, until: settled, dwell: 1.5 s}
"""


def test_sweep_on_a_dask_cluster_scores_as_it_does_here(tmp_path: Path) -> None:
    task, seeds = tmp_path / "touch.yaml", [31, 32]
    task.write_text(TOUCH)

    def swept(jobs: int) -> dict:
        result = sweep(str(task), ["nominal"], seeds, law="seed", estimator="noisy", jobs=jobs)
        return result["columns"]["nominal"]

    cluster = LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
    with cluster, Client(cluster), parallel_config(backend="dask"):
        there = swept(-1)
    here = swept(1)
    assert [r["seed"] for r in there["runs"]] == seeds
    assert [r["force_z"] for r in there["runs"]] == [r["force_z"] for r in here["runs"]]
    assert there["force_z_rmse"] == here["force_z_rmse"]
