"""Estimators from a file: which sensors, with which calibration.

A YAML file, with paths relative to it::

    kind: fused                 # markers, arm or fused
    device: "0"                 # video device; rendered: images of a simulated robot
    layout: markers.yaml
    calibration: webcam.json
    camera_pose: webcam-pose.json
    placement: placement.json   # by default the placement of training
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from articulate.config import from_mapping, read_yaml
from articulate.errors import ConfigError, quote
from articulate.markers.camera_calibration import (
    CameraCalibration,
    load_calibration,
    load_camera_pose,
)
from articulate.markers.camera_device import OpenCvCamera
from articulate.markers.layout import MarkerLayout, load_layout
from articulate.markers.tracker import ObjectTracker
from articulate.robot.arm import Arm
from articulate.task.floor_pose import FloorPose, load_location
from articulate.task.manifest import Manifest
from articulate.task.observation import Estimate
from articulate.transforms import Array
from articulate_deploy.estimators.camera_tracking import (
    CameraTracking,
    SteppedTracking,
    ThreadedTracking,
)
from articulate_deploy.estimators.gripper_hold import ArmReading
from articulate_deploy.estimators.object_state import (
    EstimatedObject,
    EstimatorConfig,
    ObjectStateEstimator,
    check_placement,
    estimated_object,
    placed_at,
)
from articulate_deploy.estimators.rendered_camera import RenderedCamera
from articulate_deploy.robots.robot import GRIPPER_KEY, SimulatedRobot, read_keys

RENDERED = "rendered"
"""Device name of rendered images."""


@dataclass(frozen=True, kw_only=True)
class EstimatorFile:
    """Content of an estimator file."""

    kind: Literal["markers", "arm", "fused"] = "fused"
    """Sources: markers, the arm's kinematics while it holds the handle, or both."""
    device: str = "0"
    """Number, path or address of the video device, or ``rendered``."""
    layout: Path | None = None
    """Marker layout of the object."""
    calibration: Path | None = None
    """Calibration of the camera."""
    camera_pose: Path | None = None
    """Pose of the camera in the base frame."""
    placement: Path | None = None
    """Placement file of the object; None: the placement of training."""
    delay_s: float = 0.05
    """Time from the exposure to the state, for rendered images [s]."""
    max_age_s: float = 0.6
    """Longest time without a measurement [s]."""
    placement_m: float = 0.06
    """Largest distance of the handle from the placement [m]."""
    placement_rad: float = 0.22
    """Largest rotation from the placement [rad]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.max_age_s <= 2.0:
            raise ConfigError(f"estimator: max_age_s is {self.max_age_s:g}; it must be in (0, 2] s")
        if not 0.0 <= self.delay_s <= 0.5:
            raise ConfigError(f"estimator: delay_s is {self.delay_s:g}; it must be in [0, 0.5] s")
        for name in ("layout", "calibration", "camera_pose"):
            if self.kind != "arm" and getattr(self, name) is None:
                raise ConfigError(f"estimator: {name} is missing; kind {self.kind} needs it")


class Readable(Protocol):
    """Robot whose state can be read."""

    def get_observation(self) -> dict[str, float]:
        """Return joint angles [rad], joint speeds [rad/s], gripper opening [m], force [N]."""


@dataclass(frozen=True, eq=False)
class _Sensors:
    """Files of an estimator, read."""

    config: EstimatorFile
    layout: MarkerLayout | None
    calibration: CameraCalibration | None
    T_wc: Array | None
    at: FloorPose | None


class StepClock:
    """Time of a simulated robot, advanced by one control step at a time."""

    def __init__(self, step_s: float) -> None:
        """Begin at 0 with steps of ``step_s`` [s]."""
        self.step_s, self.time_s = step_s, 0.0

    def __call__(self) -> float:
        """Return the time [s]."""
        return self.time_s


class SteppedEstimator(ObjectStateEstimator):
    """Estimator whose clock advances with the control steps."""

    step_clock: StepClock | None = None

    def update(self) -> None:
        """Advance the clock and take in the measurements of the control step."""
        if self.step_clock is not None:
            self.step_clock.time_s += self.step_clock.step_s
        super().update()


def load_sensors(path: Path | None, placement: FloorPose | None = None) -> _Sensors:
    """Read an estimator file and the files that it names.

    Args:
        path: Estimator file; None for the arm's kinematics only.
        placement: Placement of the object instead of that in the file.

    Raises:
        ConfigError: A file cannot be used, or the calibration is of another camera.
    """
    if path is None:
        return _Sensors(EstimatorFile(kind="arm"), None, None, None, placement)
    config = from_mapping(EstimatorFile, read_yaml(path), str(path))

    def at(file: Path | None) -> Path:
        assert file is not None
        return path.parent / file

    location = placement
    if location is None and config.placement is not None:
        location = load_location(at(config.placement)).pose
    if config.kind == "arm":
        return _Sensors(config, None, None, None, location)
    calibration = load_calibration(at(config.calibration))
    camera_pose = load_camera_pose(at(config.camera_pose))
    calibration.check_camera(camera_pose.camera)
    layout = load_layout(at(config.layout))
    return _Sensors(config, layout, calibration, camera_pose.T_wc, location)


def check_sensors(path: Path | None, manifest: Manifest, placement: FloorPose | None) -> None:
    """Read all files of an estimator and check the placement, before anything is connected.

    Raises:
        ConfigError: A file cannot be used.
        PlacementError: The object is not where the policy was trained.
    """
    _object(manifest, load_sensors(path, placement))


def sensor_estimator(
    path: Path | None, manifest: Manifest, robot: Readable, placement: FloorPose | None = None
) -> ObjectStateEstimator:
    """Return the estimator of a real arm that a file describes, with its camera open.

    Args:
        path: Estimator file; None for the arm's kinematics only.
        manifest: Object, arm and placement.
        robot: Connected robot.
        placement: Placement of the object instead of that in the file.

    Raises:
        ConfigError: A file cannot be used.
        CameraError: The camera cannot be opened.
    """
    sensors = load_sensors(path, placement)
    camera: CameraTracking | None = None
    if sensors.layout is not None and sensors.calibration is not None:
        if sensors.config.device == RENDERED:
            raise ConfigError(f"{path}: device {quote(RENDERED)} is for simulated robots only")
        calibration = sensors.calibration
        tracker = _tracker(manifest, sensors.layout, calibration)
        size_px = (calibration.width_px, calibration.height_px)
        device = OpenCvCamera(sensors.config.device, calibration.camera, size_px)
        camera = ThreadedTracking(device, tracker, sensors.layout)
    return ObjectStateEstimator(
        _object(manifest, sensors),
        clock=time.monotonic,
        camera=camera,
        T_wc=sensors.T_wc,
        arm=_arm(sensors, manifest, robot),
        config=_bounds(sensors),
    )


def rendered_estimator(
    path: Path | None,
    manifest: Manifest,
    robot: SimulatedRobot,
    placement: FloorPose | None = None,
    *,
    seed: int = 0,
) -> ObjectStateEstimator:
    """Return the estimator of a simulated robot that a file describes, with rendered images.

    The success criteria use the true state.

    Args:
        path: Estimator file; None for the arm's kinematics only.
        manifest: Object, arm and placement.
        robot: Simulated robot.
        placement: Placement of the object instead of that in the file.
        seed: Seed of the images.

    Raises:
        ConfigError: A file cannot be used.
    """
    sensors = load_sensors(path, placement)
    clock = StepClock(manifest.control.step_s)
    camera: CameraTracking | None = None
    if sensors.layout is not None and sensors.calibration is not None:
        assert sensors.T_wc is not None
        device = RenderedCamera(
            robot, manifest, sensors.layout, sensors.calibration, sensors.T_wc,
            clock=clock, seed=seed,
        )  # fmt: skip
        tracker = _tracker(manifest, sensors.layout, sensors.calibration)
        camera = SteppedTracking(
            device, tracker, sensors.layout, delay_s=sensors.config.delay_s, clock=clock
        )
    truth: Callable[[], Estimate] = robot.object_state
    found = SteppedEstimator(
        _object(manifest, sensors),
        clock=clock,
        camera=camera,
        T_wc=sensors.T_wc,
        arm=_arm(sensors, manifest, robot),
        truth=truth,
        config=_bounds(sensors),
    )
    found.step_clock = clock
    return found


def _tracker(
    manifest: Manifest, layout: MarkerLayout, calibration: CameraCalibration
) -> ObjectTracker:
    return ObjectTracker(manifest.object, manifest.task.joint, layout, calibration)


def _object(manifest: Manifest, sensors: _Sensors) -> EstimatedObject:
    thing = estimated_object(manifest)
    if sensors.at is None:
        return thing
    T_wo, advice = sensors.at.T_wo(), "train a policy there with train --placement"
    check_placement(thing, T_wo, _bounds(sensors), "the placement of training", advice)
    return placed_at(thing, T_wo)


def _arm(
    sensors: _Sensors, manifest: Manifest, robot: Readable
) -> tuple[Arm, Callable[[], ArmReading]] | None:
    if sensors.config.kind == "markers":
        return None

    def read() -> ArmReading:
        measured = robot.get_observation()
        return ArmReading(read_keys(measured), measured[GRIPPER_KEY])

    return manifest.robot, read


def _bounds(sensors: _Sensors) -> EstimatorConfig:
    config = sensors.config
    return EstimatorConfig(
        max_age_s=config.max_age_s,
        placement_m=config.placement_m,
        placement_rad=config.placement_rad,
    )
