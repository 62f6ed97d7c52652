"""Ray: a loopback cluster of two nodes, one of which is killed in the middle."""

from __future__ import annotations

import pytest
from tests.articulate.jobs.test_jobs import job_of, until

ray = pytest.importorskip("ray", reason="ray is not installed: pip install the extra cluster")

from articulate.jobs.job import load_state  # noqa: E402
from articulate.jobs.launcher import run_jobs  # noqa: E402
from articulate.jobs.ray import RayLauncher  # noqa: E402

WAITS = (
    "import pathlib, sys, time; p = pathlib.Path(sys.argv[1]); p.mkdir();"
    "end = time.time() + 60\n"
    "while not (p.parent.parent / 'go').exists() and time.time() < end: time.sleep(0.1)"
)


@pytest.mark.filterwarnings("ignore")
def test_jobs_survive_the_loss_of_a_node(tmp_path):
    from ray.cluster_utils import Cluster

    cluster = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}
    )
    other = cluster.add_node(num_cpus=1)
    ray.init(address=cluster.address, log_to_driver=False)
    jobs = [job_of(tmp_path / name, WAITS, "print('went on')") for name in "ab"]
    seen = []

    def on_change(progress):
        seen.append(progress)
        if len(seen) == 1 or (tmp_path / "go").exists():
            return
        if progress.count("running") == 2:
            cluster.remove_node(other, allow_graceful=False)
            until(lambda: "lost" in [load_state(job.folder).phase for job in jobs])
            (tmp_path / "go").touch()

    try:
        progress = run_jobs(jobs, RayLauncher(2, tmp_path), on_change)
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert progress.count("done") == 2
    attempts = sorted(len(load_state(job.folder).attempts) for job in jobs)
    assert attempts == [1, 2]  # the lost one alone ran again
