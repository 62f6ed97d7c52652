"""Estimators from a file, with the rendered camera of a simulated robot."""

from typing import Any, cast

import numpy as np
import pytest

from articulate.errors import ConfigError
from articulate.markers.camera_calibration import CameraPose, save_calibration, save_camera_pose
from articulate.markers.layout import Marker, MarkerLayout, save_layout
from articulate.render.camera import look_at
from articulate.robot.arm import PANDA
from articulate.task.floor_pose import FloorPose
from articulate.task.object_placement import handle_poses
from articulate.task.randomization import nominal_params
from articulate.transforms import inverse, matrix_to_quat
from articulate_deploy.arm_deployment import common_limits
from articulate_deploy.estimators.rendered_camera import arm_occluders
from articulate_deploy.estimators.setup import (
    check_sensors,
    load_sensors,
    rendered_estimator,
    sensor_estimator,
)
from articulate_deploy.robots import robot_named
from articulate_deploy.robots.robot import action_dict, read_keys
from marker_scenes import HD


def write_files(folder, manifest, kind="fused", camera="rendered", device="rendered"):
    """Write markers beside the handle, and a camera that sees them from the side."""
    asset, joint = manifest.object, manifest.object.joint(manifest.task.joint)
    T_oh = handle_poses(asset, joint.name, np.zeros(()))
    ahead = T_oh[:3, 2]
    side = np.cross((0.0, 0.0, 1.0), ahead)
    on_part = T_oh[:3, 3] + 0.04 * ahead + 0.15 * side
    on_body = T_oh[:3, 3] + 0.05 * ahead + 0.17 * side + (0.0, 0.0, 0.08)
    normal = tuple((-ahead).tolist())
    save_layout(
        folder / "markers.yaml",
        MarkerLayout(
            markers=tuple(
                Marker(id=k, link=link, size_m=0.04, center_m=tuple(at.tolist()), normal=normal)
                for k, (link, at) in enumerate(
                    [(asset.links[0].name, on_body), (joint.link, on_part)]
                )
            )
        ),
    )
    T_wo = manifest.placement.T_wo()
    R = T_wo[:3, :3]
    middle = R @ (0.5 * (on_part + on_body)) + T_wo[:3, 3]
    T_wc = look_at(middle + R @ (0.45 * side - 0.45 * ahead) + (0.0, 0.0, 0.35), middle)
    save_calibration(folder / "camera.json", HD)
    pos, quat = T_wc[:3, 3].tolist(), matrix_to_quat(T_wc[:3, :3]).tolist()
    save_camera_pose(
        folder / "pose.json", CameraPose(camera=camera, pos_w=tuple(pos), quat_w=tuple(quat))
    )
    file = folder / "estimator.yaml"
    file.write_text(
        f"kind: {kind}\ndevice: {device}\nlayout: markers.yaml\ncalibration: camera.json\n"
        "camera_pose: pose.json\n"
    )
    return file, T_wc


def test_a_simulated_robot_is_seen_by_a_rendered_camera(bundle, tmp_path):
    manifest = bundle.manifest
    file, T_wc = write_files(tmp_path, manifest)
    with robot_named("mujoco", bundle) as robot:
        robot.set_episode_params(nominal_params())
        robot.reset_to(np.asarray(manifest.start.q), manifest.start.gripper_width_m)
        estimator = rendered_estimator(file, manifest, robot)
        estimator.reset()
        for _ in range(2):
            q = read_keys(robot.get_observation())
            robot.send_action(action_dict(q, 0.08))
            estimator.update()
        found, true = estimator.estimate(), robot.object_state()
        assert abs(found.opened - true.opened).max() < 0.01
        assert np.abs(found.T_wh - true.T_wh).max() < 0.01
        assert estimator.monitored_state().opened == true.opened
        assert estimator.status.age_s == pytest.approx(0.05)
        estimator.close()
    covers = arm_occluders(PANDA, np.asarray(PANDA.home), inverse(T_wc), HD)
    assert len(covers) > 4


def test_files_that_do_not_fit_are_errors(bundle, tmp_path, error_line):
    manifest = bundle.manifest
    file, _ = write_files(tmp_path, manifest, camera="other")
    error_line("load_sensors(pose of another camera)", lambda: load_sensors(file))
    file, _ = write_files(tmp_path, manifest)
    error_line(
        "sensor_estimator(rendered)", lambda: sensor_estimator(file, manifest, cast(Any, None))
    )
    for text in ("kind: fused\n", "kind: arm\nmax_age_s: 9\n", "kind: arm\ndelay_s: 2\n"):
        file.write_text(text)
        error_line(f"load_sensors({text.split()[-1]})", lambda: load_sensors(file))
    file.write_text("kind: arm\n")
    assert load_sensors(file).layout is None
    with pytest.raises(ConfigError):
        load_sensors(tmp_path / "absent.yaml")


def test_an_object_that_is_not_where_the_policy_was_trained_is_an_error(bundle, error_line):
    manifest = bundle.manifest
    placed = manifest.placement
    x, y, z = placed.pos_w

    def at(shift_m):
        yaw = float(np.degrees(placed.yaw_rad))
        return FloorPose(x_m=x + shift_m, y_m=y, yaw_deg=yaw, z_m=z)

    check_sensors(None, manifest, at(0.05))
    error_line("check_sensors(placement)", lambda: check_sensors(None, manifest, at(0.10)))
    limits = common_limits(manifest.robot, "fr3")
    low, high = limits.bounds()
    assert np.all(low >= manifest.robot.bounds()[0])
    assert np.all(high <= manifest.robot.bounds()[1])
    assert limits.q_min[5] > 0.6  # the FR3 bends joint 6 less than the Panda
    assert common_limits(manifest.robot, "panda") is manifest.robot
