"""The benchmark of the engine on MuJoCo Warp runs, with few environments on any device."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("robosuite", reason="robosuite is not installed; scripts/install does that")


@pytest.mark.slow  # kernels compile for minutes
def test_a_tiny_measurement_prints_both_ratios_and_the_device():
    pytest.importorskip("mujoco_warp", reason="mujoco-warp is not installed (extra warp)")
    script = Path(__file__).parents[2] / "benchmarks" / "gpu_engine.py"
    flags = "--envs 2 --steps 2 --rounds 1 --threads 1 --json"
    done = subprocess.run(
        [sys.executable, str(script), *flags.split()],
        capture_output=True,
        text=True,
        check=False,
        timeout=1800,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["device"].startswith("warp on ")
    (row,) = result["sizes"]
    assert row["engine_ratio"] > 0.0
    assert row["episodes_ratio"] > 0.0
    assert row["engine_ratio"] == pytest.approx(
        row["engine_steps_per_s_warp"] / row["engine_steps_per_s_cpu"]
    )
