"""Camera of a simulated robot: images of the markers, covered by the arm where it is in front."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from articulate.assets.asset import joint_motion
from articulate.markers.camera_calibration import CameraCalibration
from articulate.markers.camera_device import Frame
from articulate.markers.layout import MarkerLayout, moved_links
from articulate.markers.synthetic_images import Occluder, marker_plane, render_planes
from articulate.robot.arm import Arm
from articulate.robot.kinematics import joint_poses, tool_pose
from articulate.task.manifest import Manifest
from articulate.task.object_placement import handle_path_of
from articulate.transforms import Array, apply, inverse
from articulate_deploy.robots.robot import SimulatedRobot, read_keys

LINK_RADIUS_M = 0.07
"""Radius of the links of the arm from the elbow on [m]."""
GRIPPER_RADIUS_M = 0.035
"""Half of the depth of the gripper [m]."""
GRIPPER_HALF_M = 0.10
"""Half of the width of the gripper [m]."""
FINGER_RADIUS_M = 0.012
"""Half of the thickness of a finger [m]."""
MIN_DEPTH_M = 0.05
"""Least distance of a covering part from the camera [m]."""


class RenderedCamera:
    """A :class:`~articulate.markers.camera_device.CameraDevice` that renders the markers."""

    def __init__(
        self,
        robot: SimulatedRobot,
        manifest: Manifest,
        layout: MarkerLayout,
        calibration: CameraCalibration,
        T_wc: Array,
        *,
        clock: Callable[[], float],
        seed: int = 0,
    ) -> None:
        """Create a camera.

        Args:
            robot: Simulated robot.
            manifest: Object and arm.
            layout: True marker layout.
            calibration: True intrinsics.
            T_wc: True pose of the camera in the base frame (4, 4) [m].
            clock: Function that returns the time [s].
            seed: Seed of background and noise.
        """
        self.name = calibration.camera
        self._robot, self._manifest, self._layout = robot, manifest, layout
        self._calibration, self._T_cw, self._clock = calibration, inverse(T_wc), clock
        self._path = handle_path_of(
            manifest.object, manifest.task.joint, flip=manifest.placement.flip
        )
        self._moved = moved_links(manifest.object, manifest.task.joint)
        self._rng = np.random.default_rng(seed)

    def read(self) -> Frame:
        """Return an image of the present state."""
        state = self._robot.object_state()
        opened = float(state.opened[0])
        T_co = self._T_cw @ state.T_wh[0] @ inverse(self._path.at(np.asarray(opened)))
        joint = self._manifest.object.joint(self._manifest.task.joint)
        q = joint.closed + opened * joint.span
        motion = joint_motion(joint, q) @ inverse(joint_motion(joint, joint.closed))
        planes = [
            marker_plane(
                self._layout.dictionary,
                marker,
                T_co @ (motion if marker.link in self._moved else np.eye(4)) @ marker.T_om(),
            )
            for marker in self._layout.markers
        ]
        arm_q = read_keys(self._robot.get_observation())
        covers = arm_occluders(self._manifest.robot, arm_q, self._T_cw, self._calibration)
        image = render_planes(self._calibration, planes, self._rng, occluders=covers, samples=2)
        return Frame(image, self._clock())

    def close(self) -> None:
        """Do nothing."""


def arm_occluders(
    arm: Arm, q: Array, T_cw: Array, calibration: CameraCalibration
) -> list[Occluder]:
    """Return the outlines of the arm from the elbow on and of the gripper.

    Args:
        arm: Kinematics.
        q: Joint angles (7,) [rad].
        T_cw: Transform from the base frame to the camera frame (4, 4) [m].
        calibration: Intrinsics of the camera.
    """
    T_wt = tool_pose(arm, q)
    links = [*joint_poses(arm, q)[3:, :3, 3], apply(T_wt, np.array([0.0, 0.0, -0.12]))]
    capsules = [(a, b, LINK_RADIUS_M) for a, b in pairwise(links)]
    for height in (-0.12, -0.07):
        ends = apply(T_wt, np.array([[0, -GRIPPER_HALF_M, height], [0, GRIPPER_HALF_M, height]]))
        capsules.append((ends[0], ends[1], GRIPPER_RADIUS_M))
    for side in (-0.04, 0.04):
        ends = apply(T_wt, np.array([[0.0, side, -0.06], [0.0, side, 0.0]]))
        capsules.append((ends[0], ends[1], FINGER_RADIUS_M))
    found = (_outline(apply(T_cw, np.stack([a, b])), r, calibration) for a, b, r in capsules)
    return [cover for cover in found if cover is not None]


def _outline(ends_c: Array, radius_m: float, calibration: CameraCalibration) -> Occluder | None:
    """Return the outline of a capsule between two points in the camera frame (2, 3) [m]."""
    if ends_c[:, 2].min() < MIN_DEPTH_M:
        return None
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    centers = calibration.projected(ends_c)
    radii = calibration.focal_px * radius_m / ends_c[:, 2]
    outline = (centers[:, None] + radii[:, None, None] * circle).reshape(-1, 2)
    return Occluder(outline, float(ends_c[:, 2].min()) - radius_m)
