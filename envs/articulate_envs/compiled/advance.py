"""The inner loop of the batched engine: plant, physics and judgement, compiled, without the GIL.

``advance`` steps a slice of environments through one tick. It calls ``mj_step`` of MuJoCo's own
library through its address and reads MuJoCo's arrays in place, so that several Python threads
run it side by side. It repeats :func:`articulate.robot.control` and
:func:`articulate.task.episode_monitor.judge_sample` number by number; tests hold them together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import carray, njit, types  # type: ignore[attr-defined]  # numba says no __all__
from numba.core import cgutils
from numba.extending import intrinsic

from articulate.task.episode_monitor import COLUMN
from articulate.transforms import Array, Ints, Mask
from articulate_envs.buffered_engine import DIVERGED
from articulate_envs.compiled.motion import aim, room_of, write_tool
from articulate_envs.compiled.observe import write_part

_intrinsic: Callable[[Any], Any] = intrinsic  # its own annotation forgets the first argument

_FORCE, _SHORT, _RAW = COLUMN["force"], COLUMN["force_short"], COLUMN["force_raw"]
_MOMENT, _SPEED, _SHARE = COLUMN["moment"], COLUMN["speed_share"], COLUMN["torque_share"]
_RATE, _CODE = COLUMN["torque_rate"], COLUMN["code"]
_TIME, _WHEN = COLUMN["time"], COLUMN["violation_time"]


class Pointers(NamedTuple):
    """Addresses of what each of N environments keeps from tick to tick, and which size it has.

    ``drawn`` are the F arrays of its model in which models of one size differ, of ``doubles``
    numbers each; the others are arrays of its ``mjData``.
    """

    size: Ints
    """(N,)."""
    doubles: Ints
    """(F,)."""
    drawn: Ints
    """(N, F)."""
    qpos: Ints
    qvel: Ints
    warm: Ints
    ctrl: Ints
    xfrc: Ints


class ThreadWorkspaces(NamedTuple):
    """Addresses of what each of T threads steps environments with, one after the other.

    That is one ``mjData``, and one model of each of S sizes, in which ``drawn`` are the arrays that
    differ. What an environment keeps is laid there and taken away again, so that all that a step
    reads and computes beside stays in the cache of a core. MuJoCo's time is not kept: nothing
    depends on it.
    """

    model: Ints
    """(T, S)."""
    drawn: Ints
    """(T, S, F)."""
    data: Ints
    """(T,), as all that follow."""
    qpos: Ints
    qvel: Ints
    warm: Ints
    ctrl: Ints
    xfrc: Ints
    torque: Ints
    sensors: Ints
    site: Ints


class Where(NamedTuple):
    """Sizes of those arrays and indices into them, the same for all environments."""

    nq: int
    nv: int
    arm_q: int
    finger_q: int
    arm_ctrl: int
    finger_ctrl: int
    part_q: int
    part_v: int
    push_row: int
    tool_site: int
    hand_sensor: int
    floor_sensor: int
    robot_sensor: int


class Constants(NamedTuple):
    """Numbers that do not change within a run."""

    substeps: int
    dt: float
    A: Array
    B: Array
    dq_max: Array
    tau_max: Array
    dtau_max: float
    speed_share: float
    torque_share: float
    force: float
    moment: float
    gain: float
    short_gain: float
    finger_step: float
    finger_closed: float
    finger_open: float


class Aiming(NamedTuple):
    """What a tick reads and writes beside the buffers that are kept, first axis N."""

    motion: Array
    """What acts now (N, 7)."""
    yields: Mask
    """Which hands take their targets back instead (N,)."""
    tool: Array
    """Poses of the tool at the joints (N, 4, 4)."""
    led: Array
    """Poses of the tool at the targets (N, 4, 4)."""


@_intrinsic
def _doubles(typingctx: Any, address: Any) -> Any:
    """The address as a pointer to float64."""
    sig = types.CPointer(types.float64)(types.int64)  # type: ignore[no-untyped-call]  # numba's

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return sig, codegen


@_intrinsic
def _call(typingctx: Any, function: Any, first: Any, second: Any) -> Any:
    """Call the C function ``void f(void*, void*)`` at an address."""
    sig = types.void(types.int64, types.int64, types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir  # type: ignore[import-untyped]  # comes with numba

        pointer = cgutils.voidptr_t
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        target = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(a, pointer) for a in args[1:]])
        return context.get_dummy_value()

    return sig, codegen


@_intrinsic
def _take(typingctx: Any, address: Any) -> Any:
    """Write 1 to the int64 at the address and return what stood there, in one."""
    sig = types.int64(types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir

        word = ir.IntType(64)
        place = builder.inttoptr(args[0], word.as_pointer())
        return builder.atomic_rmw("xchg", place, word(1), "acq_rel")

    return sig, codegen


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def advance(  # type: ignore[no-untyped-def]  # compiled; types are those of the tuples above
    desk,
    first,
    order,
    taken,
    mj_step,
    pointers,
    desks,
    where,
    constants,
    chain,
    aiming,
    buffers,
    shown,
):
    """Step all environments that nobody else has ``taken`` (N,) through one tick.

    Several threads run it at once, each at its own ``desk`` and from its own ``first`` in ``order``
    (N,) on, which puts those side by side that read the same arrays; who is done helps the others.
    One that diverges stands still from then on, its last finite state in the buffers and a NaN in
    its samples, by which the judgement knows it.
    """
    room = room_of()
    n = len(taken)
    for k in range(n):
        i = order[(first + k) % n]
        if taken[i] != 0 or _take(taken.ctypes.data + 8 * i) != 0:
            continue
        aim(buffers.target[i], aiming.motion[i], buffers.q[i], aiming.yields[i], chain, room)
        _advance_one(i, desk, mj_step, pointers, desks, where, constants, buffers)
        write_tool(buffers.q[i], chain, room[0], aiming.tool[i])
        write_tool(buffers.target[i], chain, room[0], aiming.led[i])
        write_part(i, buffers.rest, shown)


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _advance_one(i, desk, mj_step, pointers, desks, where, constants, buffers):  # type: ignore[no-untyped-def]
    if buffers.rest[i, 3] == 0.0:
        return
    size = pointers.size[i]
    for f in range(len(pointers.doubles)):
        _copy(pointers.drawn[i, f], desks.drawn[desk, size, f], pointers.doubles[f])
    _copy(pointers.qpos[i], desks.qpos[desk], where.nq)
    _copy(pointers.qvel[i], desks.qvel[desk], where.nv)
    _copy(pointers.warm[i], desks.warm[desk], where.nv)
    push = carray(_doubles(pointers.xfrc[i] + 48 * where.push_row), 3)
    for k in range(3):
        push[k] = buffers.push[i, k]
    _copy(pointers.xfrc[i] + 48 * where.push_row, desks.xfrc[desk] + 48 * where.push_row, 3)
    _step(i, desk, desks.model[desk, size], mj_step, desks, where, constants, buffers)
    _copy(desks.qpos[desk], pointers.qpos[i], where.nq)
    _copy(desks.qvel[desk], pointers.qvel[i], where.nv)
    _copy(desks.warm[desk], pointers.warm[i], where.nv)
    _copy(desks.ctrl[desk], pointers.ctrl[i], where.finger_ctrl + 2)


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _copy(source, to, n):  # type: ignore[no-untyped-def]
    """Write ``n`` numbers from one address to another."""
    read, write = carray(_doubles(source), n), carray(_doubles(to), n)
    for k in range(n):
        write[k] = read[k]


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _step(i, desk, model, mj_step, desks, where, constants, buffers):  # type: ignore[no-untyped-def]
    """Run the substeps of environment ``i`` at a desk, and write where they end."""
    ctrl = carray(_doubles(desks.ctrl[desk]), where.finger_ctrl + 2)
    qpos = carray(_doubles(desks.qpos[desk]), where.nq)
    qvel = carray(_doubles(desks.qvel[desk]), where.nv)
    torque = carray(_doubles(desks.torque[desk]), where.arm_q + 7)
    sensors = carray(_doubles(desks.sensors[desk]), where.robot_sensor + 1)
    tool = carray(_doubles(desks.site[desk] + 24 * where.tool_site), 3)
    rest = buffers.rest[i]
    for _ in range(constants.substeps):
        _follow(i, ctrl, where, constants, buffers)
        _call(mj_step, model, desks.data[desk])
        for k in range(max(where.part_v, where.finger_q + 1) + 1):
            if not abs(qvel[k]) < DIVERGED:
                rest[3] = 0.0
                buffers.samples[i, 0] = np.nan  # not a peak: those stay as they were
                return
        _judge(i, qvel, torque, sensors, tool, where, constants, buffers)
    for k in range(7):
        buffers.q[i, k] = qpos[where.arm_q + k]
        buffers.dq[i, k] = qvel[where.arm_q + k]
    rest[0] = qpos[where.finger_q] - qpos[where.finger_q + 1]
    rest[1] = qpos[where.part_q]
    rest[2] = qvel[where.part_v]


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _follow(i, ctrl, where, constants, buffers):  # type: ignore[no-untyped-def]
    A, B = constants.A, constants.B
    for k in range(7):
        x, v, a = buffers.filter[i, k, 0], buffers.filter[i, k, 1], buffers.filter[i, k, 2]
        u = buffers.target[i, k]
        for r in range(3):
            buffers.filter[i, k, r] = A[r, 0] * x + A[r, 1] * v + A[r, 2] * a + B[r] * u
        ctrl[where.arm_ctrl + k] = buffers.filter[i, k, 0]
    step = -constants.finger_step if buffers.closing[i] > 0.0 else constants.finger_step
    wide = min(max(buffers.finger[i] + step, constants.finger_closed), constants.finger_open)
    buffers.finger[i] = wide
    ctrl[where.finger_ctrl] = wide
    ctrl[where.finger_ctrl + 1] = -wide


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _judge(i, qvel, torque, sensors, tool, where, constants, buffers):  # type: ignore[no-untyped-def]
    row = buffers.samples[i]
    fx = fy = fz = mx = my = mz = 0.0
    for start in (where.hand_sensor, where.floor_sensor):
        ax, ay, az = sensors[start + 1], sensors[start + 2], sensors[start + 3]
        dx = sensors[start + 7] - tool[0]
        dy = sensors[start + 8] - tool[1]
        dz = sensors[start + 9] - tool[2]
        fx, fy, fz = fx - ax, fy - ay, fz - az
        mx -= sensors[start + 4] + dy * az - dz * ay
        my -= sensors[start + 5] + dz * ax - dx * az
        mz -= sensors[start + 6] + dx * ay - dy * ax
    gain, short = constants.gain, constants.short_gain
    row[0] += gain * (fx - row[0])
    row[1] += gain * (fy - row[1])
    row[2] += gain * (fz - row[2])
    row[3] += gain * (mx - row[3])
    row[4] += gain * (my - row[4])
    row[5] += gain * (mz - row[5])
    row[6] += short * (fx - row[6])
    row[7] += short * (fy - row[7])
    row[8] += short * (fz - row[8])
    force = np.sqrt(row[0] ** 2 + row[1] ** 2 + row[2] ** 2)
    moment = np.sqrt(row[3] ** 2 + row[4] ** 2 + row[5] ** 2)
    speed = share = rate = 0.0
    for k in range(7):
        t = torque[where.arm_q + k]
        speed = max(speed, abs(qvel[where.arm_q + k]) / constants.dq_max[k])
        share = max(share, abs(t) / constants.tau_max[k])
        rate = max(rate, abs(t - buffers.torque[i, k]) / constants.dt)
        buffers.torque[i, k] = t
    if row[_TIME] == 0.0:
        rate = 0.0
    row[_FORCE] = max(row[_FORCE], force)
    row[_SHORT] = max(row[_SHORT], np.sqrt(row[6] ** 2 + row[7] ** 2 + row[8] ** 2))
    row[_RAW] = max(row[_RAW], np.sqrt(fx * fx + fy * fy + fz * fz))
    row[_MOMENT] = max(row[_MOMENT], moment)
    row[_SPEED] = max(row[_SPEED], speed)
    row[_SHARE] = max(row[_SHARE], share)
    row[_RATE] = max(row[_RATE], rate)
    row[_TIME] += constants.dt
    if row[_CODE] == 0.0:
        code = 0.0
        if sensors[where.robot_sensor] > sensors[where.hand_sensor] + 0.5:
            code = 1.0
        elif speed > constants.speed_share:
            code = 2.0
        elif share >= constants.torque_share:
            code = 3.0
        elif rate > constants.dtau_max:
            code = 4.0
        elif force > constants.force:
            code = 5.0
        elif moment > constants.moment:
            code = 6.0
        if code > 0.0:
            row[_CODE] = code
            row[_WHEN] = row[_TIME]
