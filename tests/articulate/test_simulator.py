"""MuJoCo's warnings go to a logger and into no file."""

import logging

from articulate.simulator import mujoco

BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


def test_a_warning_is_logged_and_leaves_no_file_behind(tmp_path, monkeypatch, caplog, capfd):
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qvel[0] = float("nan")
    with caplog.at_level(logging.INFO, "articulate.simulator"):
        mujoco.mj_step(model, data)
    assert "QVEL" in caplog.text
    assert not any(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")
