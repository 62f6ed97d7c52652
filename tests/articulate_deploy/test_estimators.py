"""Estimators of the object's state: markers, the arm's kinematics, and both, with faults."""

from typing import Any, cast

import numpy as np
import pytest

from articulate.markers.camera_device import CameraError, Frame
from articulate.markers.tracker import ObjectTracker
from articulate.robot.arm import PANDA
from articulate.task.object_placement import handle_path_of
from articulate.transforms import pose
from articulate_deploy.estimators.camera_tracking import SteppedTracking, ThreadedTracking
from articulate_deploy.estimators.gripper_hold import ArmReading
from articulate_deploy.estimators.joint_filter import JointFilter, JointMeasurement
from articulate_deploy.estimators.object_state import (
    EstimatedObject,
    EstimateLostError,
    EstimatorConfig,
    NoMarkerError,
    ObjectStateEstimator,
    PlacementError,
)
from marker_scenes import HD, marked_object, projected_corners, reach

STEP_S = 0.05


class Corners:
    """Camera whose images are the corners themselves."""

    name = "rendered"

    def __init__(self, lab: Any):
        self.lab, self.lost = lab, False
        self.covered: tuple[int, ...] = ()

    def read(self):
        if self.lost:
            raise CameraError("camera '0' is lost: it delivers no image")
        lab = self.lab
        corners = projected_corners(lab.thing, lab.q, lab.rng, sigma_px=0.05)
        for number in self.covered:
            corners.pop(number)
        return Frame(cast(Any, corners), lab.time_s)

    def close(self):
        self.lost = True


class Lab:
    """Object, camera and an arm that may hold the handle, moved by :meth:`step`."""

    def __init__(self, kind, sources, delay_s=0.0, T_wo_error=None, config=None, seed=5):
        self.thing = marked_object(kind, seed)
        self.rng = np.random.default_rng(0)
        self.time_s, self.q, self.width = 0.0, 0.0, 0.08
        self.path = handle_path_of(self.thing.asset, self.thing.joint)
        self.camera: Any = Corners(self)
        self.tracker: Any = ObjectTracker(self.thing.asset, self.thing.joint, self.thing.layout, HD)
        setattr(self.tracker, "process", self.tracker.process_detections)  # noqa: B010
        placed = self.thing.T_wo if T_wo_error is None else self.thing.T_wo @ T_wo_error
        with_camera, with_arm = "markers" in sources, "arm" in sources
        self.arm_q = np.asarray(PANDA.home)
        self.move_arm()
        self.estimator = ObjectStateEstimator(
            EstimatedObject(
                asset=self.thing.asset, joint=self.thing.joint, flip=False, T_wo=placed, start=0.0
            ),
            clock=lambda: self.time_s,
            camera=SteppedTracking(
                self.camera, self.tracker, self.thing.layout, delay_s=delay_s,
                clock=lambda: self.time_s,
            ) if with_camera else None,
            T_wc=self.thing.T_wc if with_camera else None,
            arm=(PANDA, lambda: ArmReading(self.arm_q, self.width)) if with_arm else None,
            config=config,
        )  # fmt: skip

    def move_arm(self):
        T_wo = self.thing.T_wo
        opened = np.array([self.q / self.path.span])
        T_wh = self.path.in_world(T_wo=T_wo[None], scale=np.ones(1), opened=opened)
        held_w = T_wh[0, :3, 3] + T_wh[0, :3, 0] * 0.01  # a centimetre beside its middle
        self.arm_q = reach(self.arm_q, held_w)

    def step(self, dq=0.0):
        self.time_s += STEP_S
        self.q += dq
        if self.width < 0.07:
            self.move_arm()
        self.estimator.update()
        return abs(self.opened * self.path.span - self.q)

    @property
    def opened(self):
        return float(self.estimator.estimate().opened[0])

    def grasp(self):
        self.width = 0.02
        for _ in range(4):
            self.step()


RATE = {"slide": 0.005, "hinge": 0.02}
BOUND = {"slide": 0.003, "hinge": np.radians(1.0)}


@pytest.mark.parametrize("kind", ["slide", "hinge"])
@pytest.mark.parametrize("sources", [("markers",), ("arm",), ("markers", "arm")])
def test_the_part_is_followed(kind, sources):
    lab = Lab(kind, sources)
    lab.estimator.reset()
    lab.grasp()
    errors = [lab.step(RATE[kind]) for _ in range(20)]
    assert max(errors) < BOUND[kind]
    speed = float(lab.estimator.estimate().speed[0])
    assert speed == pytest.approx(RATE[kind] / STEP_S, rel=0.2)
    assert lab.estimator.status.confidence > 0.8
    expected = lab.path.in_world(
        T_wo=lab.thing.T_wo[None], scale=np.ones(1), opened=np.array([lab.q / lab.path.span])
    )
    found = lab.estimator.estimate().T_wh
    assert np.abs(found[:, :3, 3] - expected[:, :3, 3]).max() < 0.008


@pytest.mark.parametrize("kind", ["slide", "hinge"])
def test_the_arm_bridges_covered_markers(kind):
    lab = Lab(kind, ("markers", "arm"), delay_s=0.05)
    lab.estimator.reset()
    lab.grasp()
    lab.camera.covered = (0, 1)
    errors = [lab.step(RATE[kind]) for _ in range(20)]
    assert max(errors) < BOUND[kind]
    assert lab.estimator.status.sources == ("arm",)
    lab.camera.covered = ()
    errors = [lab.step(RATE[kind]) for _ in range(5)]
    assert max(errors) < BOUND[kind]
    assert "markers" in lab.estimator.status.sources


def test_an_error_of_the_placement_cancels_while_the_handle_is_held():
    turned = pose((0.01, 0.01, 0.0), np.array([[1, -0.02, 0], [0.02, 1, 0], [0, 0, 1.0]]))
    lab = Lab("slide", ("arm",), T_wo_error=turned)
    lab.estimator.reset()
    lab.grasp()
    assert max(lab.step(0.005) for _ in range(30)) < 0.004


def test_without_markers_an_estimate_is_held_and_then_lost():
    lab = Lab("slide", ("markers",), config=EstimatorConfig(max_age_s=0.5))
    lab.estimator.reset()
    lab.camera.covered = (0, 1)
    for _ in range(10):
        assert lab.step() < 0.003
    assert lab.estimator.status.confidence < 0.1
    with pytest.raises(EstimateLostError, match=r"0\.55 s.* markers 0, 1 are not visible"):
        lab.step()


def test_a_camera_that_is_lost_ends_the_episode():
    lab = Lab("slide", ("markers",))
    lab.estimator.reset()
    lab.camera.lost = True
    with pytest.raises(EstimateLostError, match="delivers no image"):
        for _ in range(20):
            lab.step()


def test_a_handle_that_slips_is_followed_by_the_markers():
    lab: Any = Lab("slide", ("markers", "arm"))
    lab.estimator.reset()
    lab.grasp()
    for _ in range(5):
        lab.step(0.005)
    arm_q = lab.arm_q
    lab.move_arm = lambda: None  # the gripper stays, the part moves on
    errors = [lab.step(0.005) for _ in range(20)]
    assert np.array_equal(arm_q, lab.arm_q)
    assert errors[-1] < 0.006


def test_a_moved_object_ends_the_episode():
    lab = Lab("slide", ("markers",), config=EstimatorConfig(max_age_s=5.0))
    lab.estimator.reset()
    object.__setattr__(lab.thing, "T_wo", lab.thing.T_wo @ pose((0.0, 0.12, 0.0)))
    with pytest.raises(EstimateLostError, match="moved by 1"):
        for _ in range(10):
            lab.step()


def test_errors_before_motion(error_line):
    lab = Lab("slide", ("markers",), T_wo_error=pose((0.0, 0.15, 0.0)))
    assert issubclass(PlacementError, Exception)
    error_line("ObjectStateEstimator.reset(moved)", lab.estimator.reset)
    lab = Lab("slide", ("markers",))
    lab.camera.covered = (1,)
    assert issubclass(NoMarkerError, Exception)
    error_line("ObjectStateEstimator.reset(covered)", lab.estimator.reset)
    lab.camera.lost = True
    error_line("ObjectStateEstimator.reset(camera lost)", lab.estimator.reset)


def test_a_thread_follows_images_and_reports_a_lost_camera():
    lab = Lab("slide", ("markers",))
    tracking = ThreadedTracking(lab.camera, lab.tracker, lab.thing.layout)
    try:
        tracking.reset()
        found = [tracking.next_measurement() for _ in range(3)]
        assert any(m is not None and abs(m.q or 0.0) < 0.003 for m in found)
        lab.camera.lost = True
        with pytest.raises(CameraError):
            for _ in range(100):
                tracking.next_measurement()
    finally:
        tracking.close()


def test_late_measurements_are_used_at_their_time():
    late, in_time = JointFilter(2.0), JointFilter(2.0)
    measured = [JointMeasurement(0.05 * k, 0.01 * k, 0.001, "markers") for k in range(12)]
    for m in measured:
        in_time.add(m)
    for m in [*measured[:8], *measured[9:], measured[8]]:
        late.add(m)
    assert late.at(0.6) == pytest.approx(in_time.at(0.6), abs=1e-6)
    assert not in_time.add(JointMeasurement(0.6, 0.5, 0.001, "markers"))
    assert in_time.at(0.6)[0] == pytest.approx(0.12, abs=0.002)
    assert not in_time.add(JointMeasurement(-1.0, 0.0, 0.001, "markers"))
