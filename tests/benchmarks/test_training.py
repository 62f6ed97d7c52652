"""The benchmark of full training runs and prints its result."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("robosuite", reason="robosuite is not installed; scripts/install does that")

TINY = """
ppo: {n_envs: 2, n_steps: 16, batch_size: 32, n_epochs: 1}
"""


@pytest.mark.slow
def test_a_tiny_measurement_prints_the_ratio_and_its_terms(tmp_path):
    (tmp_path / "tiny.yaml").write_text(TINY)
    script = Path(__file__).parents[2] / "benchmarks" / "training.py"
    flags = ["--seconds", "0", "--rounds", "1", "--workers", "1", "2", "--threads", "1"]
    done = subprocess.run(
        [sys.executable, str(script), "--json", "--preset", str(tmp_path / "tiny.yaml"), *flags],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=os.environ | {"PYTHONWARNINGS": "ignore"},
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["robosuite_ratio"] == pytest.approx(
        result["ours_steps_per_s"] / result["robosuite_steps_per_s"]
    )
    assert result["workers"] in (1, 2)
    assert set(result["search_steps_per_s"]) == {"1", "2"}
    assert result["blocks"]["robosuite"][0]["cpu_seconds"] > 0.0
    assert result["settings"]["rollout"] == 32
    assert result["versions"]["mujoco"] == "3.9.0"
