"""Deployment on a real arm, or on the simulated robot behind the arm's network interface."""

from __future__ import annotations

import ipaddress
import select
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from articulate.errors import (
    ArticulateError,
    ConfigError,
    RobotStoppedError,
    UsageError,
    shorten,
)
from articulate.robot.arm import Arm
from articulate.task.floor_pose import FloorPose
from articulate.transforms import Array
from articulate_deploy.arms.client import ClientSpec
from articulate_deploy.arms.connection import LOCKSTEP_S, START_S
from articulate_deploy.bundle import Bundle, load_bundle
from articulate_deploy.episode import EpisodeResult, run_episode, start_of
from articulate_deploy.episode_log import EpisodeLog
from articulate_deploy.estimators.estimator import Estimator
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.plan import EpisodeRequest, Plan, make_plan
from articulate_deploy.policy_runner import Policy
from articulate_deploy.recording import claimed_folders, finish_episode, write_report
from articulate_deploy.report import DeployReport, make_report
from articulate_deploy.robots.arm import ArmOptions, ArmRobot
from articulate_deploy.safety import ToolLimits
from articulate_deploy.time_scale import check_speed_scale, scaled_manifest
from articulate_deploy.wire.limits import FR3_LIMITS

if TYPE_CHECKING:
    from articulate_deploy.estimators.object_state import ObjectStateEstimator
    from articulate_deploy.wire import SimulatedArm

ARM_PORT = 1337
"""Port of the arm's network interface."""
DEFAULT_CLIENTS = {"panda": "panda-python", "fr3": "pylibfranka", "bridge": "bridge"}
"""Client of each robot; the torques of these are computed here, with the trained set-point filter
and nothing behind it."""
WIRE_PROTOCOLS = {"panda": 5, "fr3": 10}
"""Protocol of the simulated robot that replaces a robot."""
CLIENTS_OF = {
    "panda": ("panda-python", "franka-rs"),
    "fr3": ("pylibfranka", "franka-rs"),
    "bridge": ("bridge",),
}
"""Clients of each robot."""
FR3_MARGIN_RAD = 0.1
"""Distance from the joint limits of the FR3 [rad]."""
NOTICE = (
    "This program is no safety function. Keep the user stop within reach and people out of reach. "
    "Enter stops the arm."
)


@dataclass(frozen=True, kw_only=True)
class ArmRequest:
    """Robot and options of a deployment on an arm."""

    robot: str
    """``panda``, ``fr3`` or ``bridge``."""
    address: str
    """Address of the controller."""
    client: str = ""
    """Client; by default that of the robot."""
    estimator: Path | None = None
    """Estimator file (:mod:`articulate_deploy.estimators.setup`); a simulated robot needs none."""
    placement: FloorPose | None = None
    """Placement of the object instead of that in the estimator file. Without such a file, the arm's
    kinematics are the estimator."""
    speed_scale: float = 1.0
    """Speed of the policy's clock."""
    tool_limits: ToolLimits = field(default_factory=ToolLimits)
    """Limits of the tool."""
    yes: bool = False
    """Ask nothing before motions."""
    recover: bool = False
    """Clear a reflex before the first motion."""
    homing: bool = False
    """Home the gripper first."""

    def __post_init__(self) -> None:
        check_speed_scale(self.speed_scale)
        if not self.address:
            raise ConfigError(
                f"--robot {self.robot} needs --address, for example --address 172.16.0.2"
            )
        if self.client and self.client not in CLIENTS_OF[self.robot]:
            known = ", ".join(CLIENTS_OF[self.robot])
            raise ConfigError(
                f"--client {shorten(self.client)}: not for --robot {self.robot}; known: {known}"
            )

    @property
    def has_sensors(self) -> bool:
        """True if the state of the object is measured, also on a simulated robot."""
        return self.estimator is not None or self.placement is not None


def deploy_on_arm(
    path: Path,
    request: ArmRequest,
    episodes: EpisodeRequest,
    *,
    out: Path | None = None,
    on_episode: Callable[[int, EpisodeResult], None] | None = None,
    show: Callable[[str], None] = lambda _: None,
) -> DeployReport:
    """Run the bundle at ``path`` on an arm and return the report.

    At a loopback address where nothing listens, a simulated robot is started there.

    Args:
        path: The bundle.
        request: Robot and options.
        episodes: Episodes to run.
        out: Folder for recordings; None writes none.
        on_episode: Called with the number and the result of each episode.
        show: Prints a line.

    Raises:
        ArmError: The arm cannot move.
        RobotStoppedError: The arm was stopped after it had moved.
        ConfigError: A value is not accepted.
    """
    bundle = load_bundle(path)
    policy = Policy(bundle)
    plan = make_plan(bundle, episodes.episodes, seed=episodes.seed, randomise=episodes.randomise)
    folders = [] if out is None else [out]
    with ExitStack() as stack:
        simulated = _simulated(path, request, stack)
        session = _Session(bundle, policy, request, plan, simulated, show)
        stack.callback(session.close)
        stack.enter_context(claimed_folders(folders))
        results: list[EpisodeResult] = []
        with _stopped_error(session.robot), session.robot:
            for k in range(episodes.episodes):
                result = session.run(k, out)
                results.append(result)
                if on_episode is not None:
                    on_episode(k, result)
        report = make_report(path, bundle, session.robot, plan, episodes, tuple(results))
        report = replace(report, sender=session.sender())
        if out is not None:
            write_report(out, report)
    return report


class _Session:
    """Robot, estimator and policy of a deployment."""

    def __init__(
        self,
        bundle: Bundle,
        policy: Policy,
        request: ArmRequest,
        plan: Plan,
        simulated: SimulatedArm | None,
        show: Callable[[str], None],
    ) -> None:
        self._policy, self._request, self._plan, self._show = policy, request, plan, show
        scaled = scaled_manifest(bundle.manifest, request.speed_scale)
        self._manifest = replace(scaled, robot=common_limits(scaled.robot, request.robot))
        self._simulated = simulated
        client = request.client or DEFAULT_CLIENTS[request.robot]
        lockstep = simulated is not None and client != "franka-rs"
        if not request.yes and not sys.stdin.isatty():
            raise UsageError("motions of an arm are confirmed at a terminal; use one, or --yes")
        if simulated is None and not request.has_sensors:
            raise ConfigError(
                f"--robot {request.robot} at {request.address} needs --estimator FILE: the state "
                "of the object is not known there"
            )
        if request.has_sensors:
            from articulate_deploy.estimators.setup import check_sensors  # late: OpenCV

            check_sensors(request.estimator, self._manifest, request.placement)
        self._sensors: ObjectStateEstimator | None = None
        self.robot = ArmRobot(
            self._manifest,
            ClientSpec(client, request.address),
            ArmOptions(
                lockstep=lockstep,
                start_s=LOCKSTEP_S if lockstep else START_S,
                recover=request.recover,
                homing=request.homing,
            ),
            name=request.robot,
            confirm=self._confirm,
        )
        if simulated is not None:
            self.robot.sample_source = simulated.take_samples
        else:
            show(NOTICE)

    def _confirm(self, text: str) -> None:
        if self._request.yes:
            return
        if input(f"{text} Continue? [y/N] ").strip().lower() not in {"y", "yes"}:
            raise UsageError("not confirmed; nothing was moved")

    def _estimator(self, k: int) -> Estimator:
        if self._request.has_sensors:
            return self._sensor_estimator()
        assert self._simulated is not None
        return TruthEstimator(
            self._simulated,
            self._plan.config,
            self._manifest.task,
            self._plan.params(k),
            self._plan.noise(k),
        )

    def _sensor_estimator(self) -> Estimator:
        """Return the estimator of the request; its camera is opened once."""
        from articulate_deploy.estimators import setup  # late: OpenCV

        request = self._request
        if self._sensors is not None:
            return self._sensors
        if self._simulated is None:
            self._sensors = setup.sensor_estimator(
                request.estimator, self._manifest, self.robot, request.placement
            )
        else:
            view: Any = SimpleNamespace(
                object_state=self._simulated.object_state,
                get_observation=self.robot.get_observation,
            )
            self._sensors = setup.rendered_estimator(
                request.estimator, self._manifest, view, request.placement
            )
        return self._sensors

    def close(self) -> None:
        """Close the camera."""
        if self._sensors is not None:
            self._sensors.close()

    def run(self, k: int, out: Path | None) -> EpisodeResult:
        """Run episode ``k``; its recording grows with each control step."""
        params, manifest = self._plan.params(k), self._manifest
        start = start_of(manifest, params)
        if self._simulated is not None:
            self._simulated.set_episode_params(params)
            self._simulated.reset_to(start, manifest.start.gripper_width_m)
        if self._request.has_sensors and not self.robot.has_moved:
            self._sensor_estimator().reset()  # the object is visible and at its placement
        self.robot.reset_to(start, manifest.start.gripper_width_m)
        recording = None if out is None else EpisodeLog(out, k)
        try:
            result = run_episode(
                self._policy,
                self.robot,
                self._estimator(k),
                manifest,
                delay_steps=int(params["delay_steps"][0]) if self._simulated is not None else 0,
                recording=recording,
                speed_scale=self._request.speed_scale,
                tool_limits=self._request.tool_limits,
                check=_check_stop_key,
            )
        except BaseException:
            if recording is not None:
                recording.close()
            raise
        if recording is not None:
            finish_episode(recording)
        return result

    def sender(self) -> dict[str, float | str]:
        """Return the timing of the sender over all motions."""
        rows = self.robot.statistics
        if not rows:
            return {}
        out: dict[str, float | str] = {"scheduling": rows[-1]["scheduling"]}
        for name in rows[0]:
            if name.endswith("_ms"):
                out[name] = float(np.median([row[name] for row in rows]))
            elif name != "scheduling":
                out[name] = float(np.sum([row[name] for row in rows]))
        if self._simulated is not None:
            out["limit_faults"] = float(sum(self._simulated.violations.values()))
        return out


def common_limits(arm: Arm, robot: str) -> Arm:
    """Return the arm of a bundle with limits that hold on ``robot`` too.

    The FR3 has the kinematics of the Panda, but other limits; its speed limits fall to 0 near the
    ends of the joints, from which :data:`FR3_MARGIN_RAD` keeps away.
    """
    envelope = FR3_LIMITS.envelope
    if robot != "fr3" or envelope is None:
        return arm

    def seven(values: Array) -> Any:
        return tuple(float(v) for v in values)

    return replace(
        arm,
        q_min=seven(np.maximum(arm.q_min, envelope.q_low + FR3_MARGIN_RAD)),
        q_max=seven(np.minimum(arm.q_max, envelope.q_high - FR3_MARGIN_RAD)),
        dq_max=seven(np.minimum(arm.dq_max, FR3_LIMITS.dq_max)),
        ddq_max=seven(np.minimum(arm.ddq_max, FR3_LIMITS.ddq_max)),
        dddq_max=seven(np.minimum(arm.dddq_max, FR3_LIMITS.dddq_max)),
    )


def _simulated(path: Path, request: ArmRequest, stack: ExitStack) -> SimulatedArm | None:
    """Start the simulated robot at a loopback address where nothing listens."""
    if request.robot not in WIRE_PROTOCOLS or not is_free_loopback(request.address):
        return None
    from articulate_deploy.wire import SimulatedArm  # late: MuJoCo

    arm = SimulatedArm(
        path,
        request.address,
        protocol=WIRE_PROTOCOLS[request.robot],
        max_rate=1.0 if request.client == "franka-rs" else 0.0,
    )
    return stack.enter_context(arm)


def is_free_loopback(address: str) -> bool:
    """Return whether ``address`` is a loopback address at which no controller listens."""
    try:
        if not ipaddress.ip_address(address).is_loopback:
            return False
    except ValueError:
        return False
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((address, ARM_PORT)) != 0


def _check_stop_key() -> None:
    """Stop the arm if Enter was pressed at the terminal.

    Raises:
        RobotStoppedError: It was.
    """
    try:
        pressed = sys.stdin.isatty() and bool(select.select([sys.stdin], [], [], 0.0)[0])
    except (OSError, ValueError):  # closed, or not a file
        return
    if pressed:
        sys.stdin.readline()
        raise RobotStoppedError("stopped by the stop key")


@contextmanager
def _stopped_error(robot: ArmRobot) -> Iterator[None]:
    """Turn all errors of an arm that has moved into :class:`RobotStoppedError`."""
    try:
        yield
    except RobotStoppedError:
        raise
    except ArticulateError as error:
        if not robot.has_moved:
            raise
        raise RobotStoppedError(f"the arm is stopped: {error}") from None
