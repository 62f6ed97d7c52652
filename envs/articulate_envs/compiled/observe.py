"""What is true of a tick and what a policy sees of it, compiled.

It repeats, for one environment at a time, :meth:`articulate.task.object_placement.HandlePath.in_world`,
:meth:`articulate.task.state_estimation.NoisyEstimator.estimate`, :func:`articulate.task.state_estimation.felt` and
:func:`articulate.task.observation.observation`, which a robot runs; tests hold them together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from articulate.task.object_placement import HandlePath
from articulate.task.observation import (
    BENT_UNIT_RAD,
    BEYOND_UNIT,
    FORCE_UNIT_N,
    HANDLE_UNIT_M,
    LEAD_UNIT_M,
    LEAD_UNIT_RAD,
    NEAR_UNIT_M,
    OBSERVATION,
    SINCE_S,
    SPEED_UNIT_M_S,
    WIDTH_UNIT_M,
)
from articulate.task.randomization import COLUMNS
from articulate.transforms import Array, Ints

_BIAS, _YAW = COLUMNS.index("bias_x_m"), COLUMNS.index("bias_yaw_rad")
_AGE = COLUMNS.index("estimate_delay_steps")
_FORCE = COLUMNS.index("force_bias_x_n")
NOISES = 7
"""Random numbers of a tick: for the handle's place, the opening, the force."""
_SIZE, _LOW, _HIGH = OBSERVATION.size, OBSERVATION.low, OBSERVATION.high


class Part(NamedTuple):
    """How the handle of the task's part moves; see :class:`articulate.task.object_placement.HandlePath`."""

    hinge: bool
    axis: Array
    """Axis of its joint in the object (3,)."""
    pivot: Array
    """A point on it (3,) [m]."""
    T_oh: Array
    """Pose of the handle with the joint at 0 (4, 4)."""
    closed: float
    """Position of the joint where the part is closed [m or rad]."""
    span: float
    """Signed way to open [m or rad]."""


class Shown(NamedTuple):
    """Where the parts of N environments are, and what that follows from."""

    part: Part
    T_wo: Array
    """Poses of the objects in the world (N, 4, 4)."""
    scale: Array
    """Their sizes (N,)."""
    size: Array
    """What the joint's position grows with (N,): the size where it slides."""
    opened: Array
    """Fractions open (N,)."""
    handle: Array
    """Poses of the handles in the world (N, 4, 4)."""


class Seen(NamedTuple):
    """What is true now and was told, first axis N; names as in :class:`engine.State`."""

    q: Array
    dq: Array
    target: Array
    width: Array
    width_before: Array
    """Opening between the fingers a tick ago (N,) [m]."""
    smooth: Array
    wish: Array
    since_s: Array
    samples: Array
    """The judgement's (N, WIDTH), which begin with the filtered force in world axes."""
    T_wt: Array
    T_wt_target: Array
    pending_actions: Array
    last_action: Array
    """What the policy said last (N, 8)."""
    tick: Ints
    """Ticks since the episode began (N,)."""


class Past(NamedTuple):
    """What an estimator has seen: ages first, then N."""

    T_wh: Array
    opened: Array
    speed: Array


class Scales(NamedTuple):
    """Numbers that do not change within a run."""

    step_s: float
    ticks: int
    """Length of an episode."""
    move_m: float
    goal: float
    """Fraction open of the task's target."""
    closes: bool
    """Whether the part is moved towards its closed end."""
    noise_m: float
    """Standard deviation of the handle's estimated place [m]."""
    noise_open: float
    """That of the estimated fraction open."""
    noise_n: float
    """That of the force [N]."""


def part_of(way: HandlePath) -> Part:
    """``way`` as numbers."""
    joint = way.joint
    return Part(
        hinge=joint.kind != "slide",
        axis=np.array(joint.axis_o, dtype=np.float64),
        pivot=np.array(joint.pivot_o, dtype=np.float64),
        T_oh=np.ascontiguousarray(way.T_oh, dtype=np.float64),
        closed=float(joint.closed),
        span=float(joint.span),
    )


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def write_handle(opened, scale, part, T_wo, out):  # type: ignore[no-untyped-def]
    """Write the handle's pose in the world (4, 4) of a part at the fraction ``opened``."""
    q, T, axis = part.closed + opened * part.span, part.T_oh, part.axis
    if part.hinge:
        c, s = np.cos(q), np.sin(q)
        x, y, z = axis[0], axis[1], axis[2]
        rows = (
            (c + x * x * (1.0 - c), x * y * (1.0 - c) - z * s, x * z * (1.0 - c) + y * s),
            (y * x * (1.0 - c) + z * s, c + y * y * (1.0 - c), y * z * (1.0 - c) - x * s),
            (z * x * (1.0 - c) - y * s, z * y * (1.0 - c) + x * s, c + z * z * (1.0 - c)),
        )
    else:
        rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for j in range(4):
        a, b, d = T[0, j], T[1, j], T[2, j]
        if j == 3 and part.hinge:
            a, b, d = a - part.pivot[0], b - part.pivot[1], d - part.pivot[2]
        x = rows[0][0] * a + rows[0][1] * b + rows[0][2] * d
        y = rows[1][0] * a + rows[1][1] * b + rows[1][2] * d
        z = rows[2][0] * a + rows[2][1] * b + rows[2][2] * d
        if j == 3:
            if part.hinge:
                x, y, z = x + part.pivot[0], y + part.pivot[1], z + part.pivot[2]
            else:
                x, y, z = x + q * axis[0], y + q * axis[1], z + q * axis[2]
            x, y, z = scale * x, scale * y, scale * z
        for r in range(3):
            total = T_wo[r, 0] * x + T_wo[r, 1] * y + T_wo[r, 2] * z
            out[r, j] = total + T_wo[r, 3] if j == 3 else total
    out[3, 0] = out[3, 1] = out[3, 2] = 0.0
    out[3, 3] = 1.0


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def write_part(i, rest, shown):  # type: ignore[no-untyped-def]
    """Write how far the part of environment ``i`` is open, and its handle's pose.

    ``rest`` (N, 4) holds the joint's position second.
    """
    size, part = shown.size[i], shown.part
    opened = (rest[i, 1] - size * part.closed) / (size * part.span)
    shown.opened[i] = opened
    write_handle(opened, shown.scale[i], part, shown.T_wo[i], shown.handle[i])


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def write_parts(rows, rest, shown):  # type: ignore[no-untyped-def]
    """:func:`write_part` of environments ``rows`` (M,)."""
    for i in rows:
        write_part(i, rest, shown)


@njit(cache=True, error_model="numpy", boundscheck=False)
def push(past, T_wh, opened, speed):  # type: ignore[no-untyped-def]
    """:meth:`articulate.task.state_estimation.NoisyEstimator.push`."""
    for age in range(len(past.opened) - 1, 0, -1):
        past.T_wh[age] = past.T_wh[age - 1]
        past.opened[age] = past.opened[age - 1]
        past.speed[age] = past.speed[age - 1]
    past.T_wh[0], past.opened[0], past.speed[0] = T_wh, opened, speed


@njit(cache=True, error_model="numpy", boundscheck=False)
def observations(seen, past, drawn, noise, scales):  # type: ignore[no-untyped-def]
    """Observations (N, size) with errors as drawn (N, columns) and ``noise`` (N, NOISES) of 1.

    What is not finite, of environments that diverged, is 0.
    """
    out = np.empty((len(noise), _SIZE))
    T_wh, rest = np.empty((3, 4)), np.empty(5)
    for i in range(len(out)):
        age = int(drawn[i, _AGE])
        true = past.T_wh[age, i]
        c, s = np.cos(drawn[i, _YAW]), np.sin(drawn[i, _YAW])
        for j in range(3):
            T_wh[0, j] = c * true[0, j] - s * true[1, j]
            T_wh[1, j] = s * true[0, j] + c * true[1, j]
            T_wh[2, j] = true[2, j]
            T_wh[j, 3] = true[j, 3] + drawn[i, _BIAS + j] + scales.noise_m * noise[i, j]
        opened = past.opened[age, i] + scales.noise_open * noise[i, 3]
        k = _write_arm(seen, i, out[i])
        k = _write_handle_seen(seen, i, T_wh, scales.move_m, out[i], k)
        rest[0] = opened
        short = abs(opened) - scales.goal if scales.closes else scales.goal - opened
        rest[1] = -short / BEYOND_UNIT
        rest[2] = 10.0 * past.speed[age, i]
        rest[3] = seen.width[i] / WIDTH_UNIT_M
        rest[4] = (seen.width[i] - seen.width_before[i]) / scales.step_s / SPEED_UNIT_M_S
        for j in range(5):
            out[i, k + j] = rest[j]
        _write_force(seen, i, drawn[i], noise[i], scales.noise_n, out[i], k + 5)
        _write_told(seen, i, 1.0 - seen.tick[i] / scales.ticks, out[i], k + 8)
        for j in range(_SIZE):
            value = min(max(out[i, j], _LOW[j]), _HIGH[j])
            out[i, j] = 0.0 if np.isnan(out[i, j]) else value
    return out


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _write_arm(seen, i, out):  # type: ignore[no-untyped-def]
    """``joint_pos`` to ``tracking_error``; where to go on."""
    for j in range(7):
        out[j] = seen.q[i, j]
        out[7 + j] = seen.dq[i, j]
        out[14 + j] = (seen.target[i, j] - seen.q[i, j]) / BENT_UNIT_RAD
    T, led = seen.T_wt[i], seen.T_wt_target[i]
    turn = np.empty((3, 3))
    for r in range(3):
        out[21 + r] = 0.0
        for j in range(3):
            turn[r, j] = T[0, r] * led[0, j] + T[1, r] * led[1, j] + T[2, r] * led[2, j]
            out[21 + r] += T[j, r] * (led[j, 3] - T[j, 3]) / LEAD_UNIT_M
    out[24] = 0.5 / LEAD_UNIT_RAD * (turn[2, 1] - turn[1, 2])
    out[25] = 0.5 / LEAD_UNIT_RAD * (turn[0, 2] - turn[2, 0])
    out[26] = 0.5 / LEAD_UNIT_RAD * (turn[1, 0] - turn[0, 1])
    return 27


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _write_handle_seen(seen, i, T_wh, move_m, out, k):  # type: ignore[no-untyped-def]
    """``handle_pos`` to ``handle_axes``; where to go on."""
    T, led = seen.T_wt[i], seen.T_wt_target[i]
    for r in range(3):
        place = aimed = z = x = 0.0
        for j in range(3):
            place += T[j, r] * (T_wh[j, 3] - T[j, 3])
            aimed += led[j, r] * (T_wh[j, 3] - led[j, 3])
            z += T[j, r] * T_wh[j, 2]
            x += T[j, r] * T_wh[j, 0]
        aimed -= move_m * seen.pending_actions[i, r]
        out[k + r] = place / HANDLE_UNIT_M
        out[k + 3 + r] = place / NEAR_UNIT_M
        out[k + 6 + r] = aimed / HANDLE_UNIT_M
        out[k + 9 + r] = aimed / NEAR_UNIT_M
        out[k + 12 + r] = z
        out[k + 15 + r] = x
    return k + 18


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _write_force(seen, i, drawn, noise, noise_n, out, k):  # type: ignore[no-untyped-def]
    """``measured_force``."""
    T = seen.T_wt[i]
    for r in range(3):
        out[k + r] = 0.0
        for j in range(3):
            felt = seen.samples[i, j] + drawn[_FORCE + j] + noise_n * noise[4 + j]
            out[k + r] += T[j, r] * felt / FORCE_UNIT_N


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _write_told(seen, i, time_left, out, k):  # type: ignore[no-untyped-def]
    """``gripper_command`` to ``time_left``."""
    out[k] = seen.smooth[i]
    out[k + 1] = seen.wish[i]
    out[k + 2] = min(seen.since_s[i], SINCE_S) / SINCE_S
    for j in range(7):
        out[k + 3 + j] = seen.pending_actions[i, j]
    for j in range(8):
        out[k + 10 + j] = seen.last_action[i, j]
    out[k + 18] = time_left
