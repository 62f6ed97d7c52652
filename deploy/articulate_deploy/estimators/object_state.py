"""Estimator of the object's state from markers, from the arm's kinematics, or from both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import RobotStoppedError, UsageError
from articulate.markers.tracker import ObjectMeasurement
from articulate.robot.arm import Arm
from articulate.task.manifest import Manifest
from articulate.task.object_placement import handle_path_of
from articulate.task.observation import Estimate
from articulate.task.task import fraction_open
from articulate.transforms import Array, angle_between, apply
from articulate_deploy.estimators.camera_tracking import CameraTracking
from articulate_deploy.estimators.gripper_hold import ArmReading, GripperHold
from articulate_deploy.estimators.joint_filter import JointFilter, JointMeasurement

MARKERS, ARM = "markers", "arm"
"""Names of the sources."""
ACCELERATION = {"slide": 2.0, "hinge": 5.0}
"""Standard deviation of the acceleration of parts [m/s^2 or rad/s^2]."""
MARKER_STD = {"slide": 0.0005, "hinge": 0.002}
"""Least standard deviation of a measurement by markers [m or rad]."""
MARKER_SCALE = {"slide": 0.03, "hinge": 0.02}
"""Standard deviation of a measurement by markers per travel: errors of the layout."""
BIAS_STD = {"slide": 0.005, "hinge": 0.02}
"""Standard deviation of the constant error of the markers, also from the layout [m or rad]."""
START_STD = {"slide": 0.003, "hinge": 0.01}
"""Standard deviation of the position of a closed part at the beginning [m or rad]."""
BIAS_GATE = 3.0
"""Deviation of the first measurements from the beginning above which the part was left open, in
standard deviations."""
MAX_SLIPS = 3
"""Successive contradictions between arm and markers after which the handle has slipped."""
CONFIDENT_STD = {"slide": 0.005, "hinge": 0.026}
"""Standard deviation up to which the confidence depends on the age only [m or rad]."""
FRESH_S = 0.2
"""Age up to which markers decide that the handle slipped [s]."""
INITIAL_IMAGES = 5
"""Images that the initial state is averaged over."""
MAX_INITIAL_IMAGES = 60
"""Images within which the markers must be visible before an episode."""


class EstimateLostError(RobotStoppedError):
    """The state of the object is unknown during an episode: the robot has to stop."""


class PlacementError(UsageError):
    """The object is not where its placement is."""


class NoMarkerError(UsageError):
    """No marker of the layout is visible before an episode."""


@dataclass(frozen=True, kw_only=True)
class EstimatorConfig:
    """Bounds of the estimator."""

    max_age_s: float = 0.6
    """Longest time without a measurement during an episode [s]."""
    placement_m: float = 0.06
    """Largest distance of the closed handle from its placement [m]."""
    placement_rad: float = 0.22
    """Largest rotation of the object from its placement [rad]."""


@dataclass(frozen=True, kw_only=True)
class EstimatedObject:
    """Object whose state is estimated."""

    asset: Asset
    """Object."""
    joint: str
    """Joint of the task."""
    flip: bool
    """True if the gripper is rotated by 180 degrees about its approach axis."""
    T_wo: Array
    """Placement in the base frame (4, 4) [m]."""
    start: float
    """Position of the joint when an episode begins [m or rad]; with a camera, a first guess."""
    start_std: float = 0.0
    """Its spread over episodes [m or rad]."""


@dataclass(frozen=True)
class EstimatorStatus:
    """Quality of the present estimate."""

    age_s: float
    """Age of the newest measurement [s]."""
    std: float
    """Standard deviation of the joint's position [m or rad]."""
    confidence: float
    """1 for a new and accurate estimate, 0 at the largest age."""
    sources: tuple[str, ...]
    """Sources of the last control step."""


class ObjectStateEstimator:
    """An :class:`~articulate_deploy.estimators.estimator.Estimator` from sensors.

    With a camera only it is the marker estimator, with an arm only that of the arm's kinematics,
    with both the fused one.
    """

    def __init__(
        self,
        thing: EstimatedObject,
        *,
        clock: Callable[[], float],
        camera: CameraTracking | None = None,
        T_wc: Array | None = None,
        arm: tuple[Arm, Callable[[], ArmReading]] | None = None,
        truth: Callable[[], Estimate] | None = None,
        config: EstimatorConfig | None = None,
    ) -> None:
        """Create an estimator.

        Args:
            thing: Object.
            clock: Function that returns the time of the control loop [s].
            camera: Tracking of the object by a camera.
            T_wc: Pose of that camera in the base frame (4, 4) [m].
            arm: Arm that holds the handle, and the function that reads its state.
            truth: Function that returns the true state, for the success criteria; None: the
                estimate serves for them too.
            config: Bounds.
        """
        assert camera is not None or arm is not None, "an estimator needs a source"
        assert (camera is None) == (T_wc is None), "a camera needs its pose"
        self._thing, self._clock, self._camera, self._T_wc = thing, clock, camera, T_wc
        self._truth, self._config = truth, config or EstimatorConfig()
        self._path = handle_path_of(thing.asset, thing.joint, flip=thing.flip)
        self._kind = thing.asset.joint(thing.joint).kind
        handle = thing.asset.handle_of(thing.joint)
        length = 0.0 if handle is None else handle.extent[0]
        self._hold = None if arm is None else GripperHold(arm[0], self._path, length)
        self._read_arm = None if arm is None else arm[1]
        self._filter = JointFilter(ACCELERATION[self._kind])
        self._bias, self._slips = 0.0, 0
        self._T_wo = thing.T_wo
        self._sources: tuple[str, ...] = ()
        self._camera_error, self._marker_time_s = "", -np.inf

    @property
    def T_wo(self) -> Array:
        """Estimated pose of the object in the base frame (4, 4) [m]."""
        return self._T_wo

    @property
    def status(self) -> EstimatorStatus:
        """Quality of the present estimate."""
        now = self._clock()
        age = max(now - self._filter.time_s, 0.0)
        _, _, std = self._filter.at(now)
        fresh = max(0.0, 1.0 - age / self._config.max_age_s)
        confidence = fresh * min(1.0, CONFIDENT_STD[self._kind] / max(std, 1e-9))
        return EstimatorStatus(age, std, confidence, self._sources)

    def reset(self) -> None:
        """Begin a new episode, with the robot at its start and the part at rest.

        Raises:
            CameraError: The camera is lost.
            NoMarkerError: The markers are not visible.
            PlacementError: The object is not where its placement is.
        """
        self._filter.reset()
        self._camera_error, self._sources, self._marker_time_s = "", (), -np.inf
        self._bias, self._slips = 0.0, 0
        if self._hold is not None:
            self._hold.reset()
        if self._camera is None:
            self._T_wo = self._thing.T_wo
            thing = self._thing
            self._filter.add(JointMeasurement(self._clock(), thing.start, self._start_std, ARM))
        else:
            self._measure_start(self._camera)
        self._check_placement()

    def _measure_start(self, camera: CameraTracking) -> None:
        """Average the first images, and estimate the constant error of the markers."""
        camera.reset()
        found: list[ObjectMeasurement] = []
        while len(found) < INITIAL_IMAGES:
            measured = camera.next_measurement()
            if measured is not None and measured.q is not None:
                found.append(measured)
                self._T_wo = self._in_base(measured.T_co)
            elif camera.frames >= MAX_INITIAL_IMAGES:
                raise NoMarkerError(
                    f"camera {camera.name}: the object is not visible: {camera.describe()}; "
                    "check light, focus and view, or the layout"
                )

        offset = float(np.mean([m.q for m in found])) - self._thing.start
        bias, start = BIAS_STD[self._kind], self._start_std
        if abs(offset) <= BIAS_GATE * np.hypot(bias, start):
            self._bias = offset * bias**2 / (bias**2 + start**2)
        for m in found:
            assert m.q is not None
            self._add(m.time_s, m.q, m.q_std)

    @property
    def _start_std(self) -> float:
        """Standard deviation of the position at the beginning [m or rad]."""
        return float(np.hypot(START_STD[self._kind], self._thing.start_std))

    def _check_placement(self) -> None:
        """Raise PlacementError if the object is not where its placement is."""
        check_placement(
            self._thing,
            self._T_wo,
            self._config,
            "the placement",
            "measure it with articulate locate",
        )

    def update(self) -> None:
        """Take in the measurements of a control step.

        Raises:
            EstimateLostError: The last measurement is too old, or the object was moved.
        """
        now = self._clock()
        sources: list[str] = []
        if self._camera is not None and self._use_camera(self._camera):
            sources.append(MARKERS)
        if self._hold is not None and self._read_arm is not None and self._use_arm(now):
            sources.append(ARM)
        self._sources = tuple(sources)
        age = now - self._filter.time_s
        if self._camera is None and self._hold is not None and not self._hold.holds:
            age = 0.0  # nothing else measures the part, and nothing moves it
        if age > self._config.max_age_s + 1e-9:
            reason = self._camera_error or self._visibility()
            raise EstimateLostError(
                f"no measurement of {self._thing.joint} for {age:.2f} s, more than "
                f"{self._config.max_age_s:g} s: {reason}"
            )

    def estimate(self) -> Estimate:
        """Return the input of the policy."""
        position, speed, _ = self._filter.at(self._clock())
        path = self._path
        opened = np.array([fraction_open(position, path.closed, path.span)])
        T_wh = path.in_world(T_wo=self._T_wo[None], scale=np.ones(1), opened=opened)
        return Estimate(T_wh=T_wh, opened=opened, speed=np.array([speed * np.sign(path.span)]))

    def monitored_state(self) -> Estimate:
        """Return the true state if it is known, else the estimate."""
        return self.estimate() if self._truth is None else self._truth()

    def close(self) -> None:
        """Release the camera."""
        if self._camera is not None:
            self._camera.close()

    def _use_camera(self, camera: CameraTracking) -> bool:
        """Use the states of new images; return True if one measured the joint."""
        try:
            found = camera.take_measurements()
        except UsageError as error:
            self._camera_error = str(error)
            return False
        used = False
        for measured in found:
            self._T_wo = self._in_base(measured.T_co)
            if measured.q is not None:
                used |= self._add(measured.time_s, measured.q, measured.q_std)
        if camera.moved_m > self._config.placement_m:
            raise EstimateLostError(
                f"the object or camera {camera.name} moved by {100 * camera.moved_m:.0f} cm"
            )
        return used

    def _use_arm(self, now: float) -> bool:
        """Use the arm's pose if it holds the handle; return True if it agrees with the filter."""
        assert self._hold is not None
        assert self._read_arm is not None
        position = self._filter.at(now)[0]
        found = self._hold.update(self._read_arm(), self._T_wo, position)
        if found is None:
            return False
        if self._filter.add(JointMeasurement(now, *found, ARM)):
            self._slips = 0
            return True
        self._slips += now - self._marker_time_s < FRESH_S
        if self._slips >= MAX_SLIPS:  # the next grasp begins at the position of the filter
            self._hold.release()
            self._slips = 0
        return False

    def _add(self, time_s: float, q: float, std: float) -> bool:
        self._marker_time_s = time_s
        q -= self._bias
        travel = abs(q - self._thing.start)
        std = float(np.hypot(max(std, MARKER_STD[self._kind]), MARKER_SCALE[self._kind] * travel))
        return self._filter.add(JointMeasurement(time_s, q, std, MARKERS))

    def _in_base(self, T_co: Array) -> Array:
        assert self._T_wc is not None
        return np.asarray(self._T_wc @ T_co)

    def _visibility(self) -> str:
        if self._camera is None:
            return "the gripper does not hold the handle"
        return f"camera {self._camera.name}: {self._camera.describe()}"


def check_placement(
    thing: EstimatedObject, T_wo: Array, bounds: EstimatorConfig, place: str, advice: str
) -> None:
    """Check that an object at ``T_wo`` (4, 4) [m] is near its placement.

    Args:
        thing: Object at its placement.
        T_wo: Measured or given pose in the base frame.
        bounds: Largest distance and rotation.
        place: Name of the placement, for the message.
        advice: Alternative to moving the object, for the message.

    Raises:
        PlacementError: It is not.
    """
    path = handle_path_of(thing.asset, thing.joint, flip=thing.flip)
    handle_o = path.at(np.zeros(()))[:3, 3]
    shift = apply(T_wo, handle_o) - apply(thing.T_wo, handle_o)
    distance = float(np.linalg.norm(shift))
    turn = float(angle_between(T_wo[:3, 0], thing.T_wo[:3, 0]))
    if distance <= bounds.placement_m and turn <= bounds.placement_rad:
        return
    x, y, z = shift
    raise PlacementError(
        f"{thing.asset.name}: its handle is {100 * distance:.1f} cm and the object "
        f"{np.degrees(turn):.0f} degrees from {place}, more than {100 * bounds.placement_m:.0f} cm "
        f"or {np.degrees(bounds.placement_rad):.0f} degrees; move the object by {-100 * x:.1f} "
        f"{-100 * y:.1f} {-100 * z:.1f} cm, or {advice}"
    )


def estimated_object(manifest: Manifest) -> EstimatedObject:
    """Return the object of a bundle at its placement, closed or in the middle of its beginning."""
    joint = manifest.object.joint(manifest.task.joint)
    low, high = manifest.task.begin
    return EstimatedObject(
        asset=manifest.object,
        joint=manifest.task.joint,
        flip=manifest.placement.flip,
        T_wo=manifest.placement.T_wo(),
        start=joint.closed + 0.5 * (low + high) * joint.span,
        start_std=abs(high - low) * abs(joint.span) / np.sqrt(12.0),
    )


def placed_at(thing: EstimatedObject, T_wo: Array) -> EstimatedObject:
    """Return the same object at another placement ``T_wo`` (4, 4) [m]."""
    return replace(thing, T_wo=T_wo)
