"""Checks of a manifest against this version and its arm.

Types are checked when a manifest is read; here the values are checked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from articulate.config import to_plain
from articulate.errors import BundleError, ConfigError, nearest
from articulate.robot.arm import arm_named
from articulate.robot.control import check_control
from articulate.task.manifest import Manifest, limit_table_sha256
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.task import TASK_RULES, Limits

MAX_RATE_HZ = 200.0
"""Highest control rate [Hz]; the default is 20 Hz."""
MAX_STEPS = 1000
"""Most physics steps in a control step."""
MIN_TIMESTEP_S = 5e-4
"""Shortest physics step [s]; the default is 0.005 s."""
MAX_GOLDEN = 1000
"""Most golden pairs."""
MAX_NAME = 200
"""Longest name of a joint."""
MAX_ATOL = 1e-2
"""Largest tolerance of golden pairs."""
MAX_RANGE = 1e6
"""Largest bound of a randomization range; differences of larger ones overflow."""
MAX_SIZES = 1000
"""Most sizes of the object."""
Bound = tuple[str, bool, str]
"""Name of a value, whether it is accepted, and a description of accepted values."""


def check_manifest(manifest: Manifest, where: str) -> None:
    """Check arm, layouts and values of a manifest.

    Raises:
        BundleError: It is for another arm or layout, or a value is not accepted.
    """
    for name in _not_finite(to_plain(manifest), ""):
        raise BundleError(f"{where}: {name} is not a finite number")
    _check_arm(manifest, where)
    _check_layouts(manifest, where)
    _check_task(manifest, where)
    for bounds in (_control_bounds, _task_bounds, _other_bounds):
        for name, accepted, reason in bounds(manifest):
            if not accepted:
                raise BundleError(f"{where}: {name} {reason}; export it again")
    _check_controller(manifest, where)


def _not_finite(value: Any, name: str) -> Iterator[str]:
    """Yield the dotted names of numbers that are not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        yield name
    inside = value if isinstance(value, dict) else {}
    inside = dict(enumerate(value)) if isinstance(value, list) else inside
    for key, item in inside.items():
        yield from _not_finite(item, f"{name}.{key}" if name else str(key))


def _check_arm(manifest: Manifest, where: str) -> None:
    try:
        arm = arm_named(manifest.robot.name)
    except ConfigError as error:
        raise BundleError(f"{where}: {error}") from None
    expected = limit_table_sha256(arm)
    if {manifest.limit_table_sha256, limit_table_sha256(manifest.robot)} != {expected}:
        raise BundleError(
            f"{where}: its limit tables are not those of the {arm.name}; export it again"
        )


def _check_layouts(manifest: Manifest, where: str) -> None:
    for name, layout, known in (
        ("observation", manifest.observation, OBSERVATION),
        ("action", manifest.action, ACTION),
    ):
        if layout != known:
            names = [a.name for a, b in zip(layout.fields, known.fields, strict=False) if a != b]
            difference = names[0] if names else "its number of fields"
            raise BundleError(
                f"{where}: {name} is not the one of this version ({difference}); export it again"
            )


def _check_task(manifest: Manifest, where: str) -> None:
    """Check that the task is known and its joint belongs to the object."""
    task, joints = manifest.task, {joint.name: joint for joint in manifest.object.joints}
    if task.name not in TASK_RULES:
        known = nearest(task.name, TASK_RULES)
        raise BundleError(f"{where}: task.name is {task.name[:60]!r}{known}")
    if task.joint not in joints:
        raise BundleError(f"{where}: its object has no joint {task.joint[:60]!r}; export it again")
    if not task.joint.isprintable() or len(task.joint) > MAX_NAME:  # reports print it
        raise BundleError(
            f"{where}: task.joint is {task.joint[:60]!a}; it must be printable and short"
        )
    joint = joints[task.joint]
    if joint.kind != task.kind or joint.span == 0.0 or task.span * joint.span <= 0.0:
        raise BundleError(
            f"{where}: task.span is {task.span:.3g} ({task.kind}), and joint {joint.name} opens by "
            f"{joint.span:.3g} ({joint.kind}); both must open the same way, and not by 0"
        )


def _control_bounds(manifest: Manifest) -> Iterator[Bound]:
    control = manifest.control
    for name in ("omega_rad_s", "step_rad", "move_m", "turn_rad", "max_tracking_error_rad"):
        value = getattr(control, name)
        yield f"control.{name}", value > 0.0, f"is {value}; it must be above 0"
    low, high = manifest.robot.bounds(max(control.margin_rad, 0.0))
    yield (
        "control.margin_rad",
        control.margin_rad >= 0.0 and bool(np.all(low < high)),
        f"is {control.margin_rad}; it must not be negative, nor leave a joint no room",
    )
    rate = control.rate_hz
    yield (
        "control.rate_hz",
        1.0 <= rate <= MAX_RATE_HZ,
        f"is {rate}; it must be in [1, {MAX_RATE_HZ:g}]",
    )
    step = manifest.scene.timestep_s
    count = 1.0 / (rate * step) if step > 0.0 else 0.0
    fits = 1.0 <= round(count) <= MAX_STEPS and abs(count - round(count)) <= 1e-6
    yield (
        "scene.timestep_s",
        fits and step >= MIN_TIMESTEP_S,
        f"is {step}; it must be at least {MIN_TIMESTEP_S} s and divide a control step into 1 to "
        f"{MAX_STEPS} steps",
    )


def _task_bounds(manifest: Manifest) -> Iterator[Bound]:
    task = manifest.task
    episode, limits = task.episode_s, task.limits
    step_s = manifest.control.step_s
    accepted = step_s <= episode <= 10.0
    yield "task.episode_s", accepted, f"is {episode}; it must be in [{step_s:g}, 10] s"
    yield (
        "task.hold_s",
        0.0 < task.hold_s <= episode,
        f"is {task.hold_s}; it must be in (0, {episode}] s",
    )
    largest = Limits()
    for name in (
        "speed_share", "torque_share", "force_n", "moment_nm", "filter_s", "short_filter_s",
    ):  # fmt: skip
        value, most = getattr(limits, name), getattr(largest, name)
        yield f"task.limits.{name}", 0.0 < value <= most, f"is {value}; it must be in (0, {most}]"
    control = manifest.control
    for name in ("force_limit_n", "force_limit_holding_n"):
        value, most = getattr(control, name), largest.force_n
        accepted = 0.0 < value <= most
        yield f"control.{name}", accepted, f"is {value}; it must be in (0, {most}] N"


def _other_bounds(manifest: Manifest) -> Iterator[Bound]:
    start, robot, scene = manifest.start, manifest.robot, manifest.scene
    q, (low, high) = np.asarray(start.q), robot.bounds()
    inside = q.shape == low.shape and bool(np.all((low <= q) & (q <= high)))
    yield (
        "start.q",
        inside,
        f"is {np.round(q, 3).tolist()}; it must be 7 angles within the joint limits",
    )
    tolerance, wide = start.tolerance_rad, robot.gripper.max_width_m
    yield "start.tolerance_rad", tolerance >= 0.0, f"is {tolerance}; it must not be negative"
    yield (
        "start.gripper_width_m",
        0.0 <= start.gripper_width_m <= wide,
        f"is {start.gripper_width_m}; it must be in [0, {wide}]",
    )
    for name in ("max_width_m", "finger_speed_m_s", "force_n", "stiffness_n_m"):
        value = getattr(robot.gripper, name)
        yield f"robot.gripper.{name}", value > 0.0, f"is {value}; it must be above 0"
    for table in ("stiffness", "damping"):
        positive = all(value > 0.0 for value in getattr(robot, table))
        yield f"robot.{table}", positive, "holds a gain that is not above 0"
    yield "scene.scale", scene.scale > 0.0, f"is {scene.scale}; it must be above 0"
    atol = manifest.golden.atol
    yield "golden.atol", 0.0 < atol <= MAX_ATOL, f"is {atol}; it must be in (0, {MAX_ATOL}]"
    count = manifest.golden.count
    yield "golden.count", 1 <= count <= MAX_GOLDEN, f"is {count}; it must be 1 to {MAX_GOLDEN}"
    seed, sizes = manifest.episodes.seed, manifest.randomization.scales
    yield "episodes.seed", seed >= 0, f"is {seed}; it must be 0 or more"
    yield "randomization.scales", sizes <= MAX_SIZES, f"is {sizes}; it must be at most {MAX_SIZES}"
    smoothing = robot.gripper.smoothing
    yield "robot.gripper.smoothing", 0.0 <= smoothing < 1.0, f"is {smoothing}; it must be in [0, 1)"
    for name, value in vars(manifest.randomization).items():
        most = np.max(np.abs(value))
        yield f"randomization.{name}", bool(most <= MAX_RANGE), f"is {value}; above {MAX_RANGE:g}"


def _check_controller(manifest: Manifest, where: str) -> None:
    """Check that targets of the controller stay within the limit tables of the arm."""
    try:
        check_control(manifest.control, manifest.robot, manifest.task.episode_s)
    except ConfigError as error:
        raise BundleError(f"{where}: {error}") from None
