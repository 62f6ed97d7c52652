"""The benchmark of the engine runs, and its replay ends in the states of the engine."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("robosuite", reason="robosuite is not installed; scripts/install does that")

TINY = """
ppo: {n_envs: 2, n_steps: 16, batch_size: 32, n_epochs: 1}
randomization: {scales: 3}
steps: 640
fine_tuning: {imitation_steps: 64}
"""
FLAGS = (
    "--rounds 1 --envs 4 --steps 10 --updates 1 --counts 2 4 --scaling-steps 4 --workers 1 "
    "--threads 2"
)


def printed(tmp_path, *flags):
    """Output of the benchmark with few and short measurements."""
    (tmp_path / "tiny.yaml").write_text(TINY)
    script = Path(__file__).parents[2] / "benchmarks" / "engine.py"
    preset = ["--preset", str(tmp_path / "tiny.yaml")]
    done = subprocess.run(
        [sys.executable, str(script), "--json", *preset, *FLAGS.split(), *flags],
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
        env=os.environ | {"PYTHONWARNINGS": "ignore"},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow  # 23 s; the engine itself is compared with others in test_single_engine
def test_the_replay_by_mj_step_ends_in_the_states_of_the_engine(tmp_path):
    """From the same states with the same controls."""
    result = printed(tmp_path, "--parts", "limit")
    assert result["replay_error"] < 1e-9
    assert result["limit_ratio"] > 0.0


@pytest.mark.slow
def test_a_tiny_measurement_prints_every_figure(tmp_path):
    result = printed(tmp_path)
    for name in ("limit", "robosuite", "training"):
        assert any(key.startswith(f"{name}_ratio") for key in result)
    assert result["limit_ratio"] > 0.0
    assert result["robosuite_ratio_equal"] == pytest.approx(
        result["equal_steps_per_s"][0] / result["robosuite_steps_per_s"][0]
    )
    share = result["training_imitation_share"]
    assert share == pytest.approx(0.2)  # 64 of a seed's 640 steps for each of two members
    names = [f"training_{kind}_steps_per_s" for kind in ("imitation", "ppo")]
    imitation, ppo = (result[name] for name in names)
    mean = 1 / (share / imitation + (1 - share) / ppo)
    assert result["training_steps_per_s"] == pytest.approx(mean)
    assert set(result["steps_per_s_at"]) == {"2", "4"}
    assert 0.0 < result["lowest_share_of_best"] <= 1.0
    assert result["reset_ms"] > 0.0
    assert set(result["reset_one_ms_at"]) == {"2", "4"}
    assert set(result["missed"]) <= set(result["required"])
    assert ("limit_ratio" in result["missed"]) == (
        result["limit_ratio"] < result["required"]["limit_ratio"][0]
    )
    assert result["scene"]["substeps"] == 10
