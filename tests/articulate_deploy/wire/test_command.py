"""``articulate sim-robot``."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from tests.articulate_deploy.wire.fci import ArmClient, address, bump

from articulate.robot.arm import PANDA
from articulate_deploy.commands import sim_robot


@pytest.mark.parametrize(
    "flags",
    [
        ["--protocol", "7"],
        ["--max-rate", "-1"],
        ["--address", "192.0.2.1"],
        ["--scene", "missing.zip"],
    ],
)
def test_bad_flags_are_one_line(error_line, flags):
    error_line(f"sim-robot {' '.join(flags)}", lambda: sim_robot.main(flags))


def test_help_names_the_command(capsys):
    with pytest.raises(SystemExit):
        sim_robot.main(["--help"])
    assert capsys.readouterr().out.startswith("usage: articulate sim-robot [flags]")


@pytest.mark.slow
def test_a_client_meets_the_arm_until_it_is_interrupted():
    command = [sys.executable, "-m", "articulate", "sim-robot", "--lockstep", "--json"]
    command += ["--address", address(141)]
    child = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    assert child.stderr is not None
    assert f"serving protocol 5 on {address(141)} in lockstep" in child.stderr.readline()
    with ArmClient(address(141)) as client:
        assert client.state()["q"] == pytest.approx(np.array(PANDA.home))
        assert client.run(bump())[1] == "success"
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=60)
    assert child.returncode == 0
    report = json.loads(out)
    assert report["counts"]["success"] == 1
    assert report["violations"] == {}
