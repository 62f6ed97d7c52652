"""Messages between this program and a bridge: MessagePack maps over ZeroMQ, one reply a request.

The program is a REQ socket, the bridge a REP socket at port :data:`PORT`. A request has the key
``call`` and the arguments below; a reply has ``ok`` (bool), and ``error`` (text) where it is false.
Numbers are float64; q in rad, dq in rad/s, torques in Nm, forces in N in axes of the base, time
in s.

======== =================================================== ==================================
call     arguments                                           reply
======== =================================================== ==================================
hello    version (int)                                       version, name
state    none                                                state
settings stiffness, damping, torque_max (7 each),            settings that are in force
         collision_force_n, collision_torque_nm
begin    none; the bridge holds the present pose             state
target   q (7): set points, 1000 a second                    the next state
end      none; the motion ends at rest                       state
recover  none                                                state
gripper  command: ``grasp``, ``move`` or ``homing``; width,  done (bool)
         speed, force; replies at once
width    none                                                width, busy (bool)
======== =================================================== ==================================

A state has ``time``, ``q``, ``dq``, ``torque`` (7 each), ``wrench`` (6), ``mode`` (a name of
:mod:`articulate_deploy.arms.client`) and ``errors`` (list of names). A bridge replies to ``target``
when its next cycle of 1 ms has passed, and stops the arm if none arrives for 20 ms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from articulate_deploy.arms.client import ArmState

VERSION = 1
PORT = 7310
KEYS = ("time", "q", "dq", "torque", "wrench", "mode", "errors")


def encode_state(state: ArmState) -> dict[str, Any]:
    """Return a state as a map."""
    return {
        "time": state.time_s,
        "q": state.q.tolist(),
        "dq": state.dq.tolist(),
        "torque": state.torque.tolist(),
        "wrench": state.wrench.tolist(),
        "mode": state.mode,
        "errors": list(state.errors),
    }


def decode_state(content: dict[str, Any]) -> ArmState:
    """Return the state of a map.

    Raises:
        ValueError: A key is missing or a value has another size.
    """
    missing = [key for key in KEYS if key not in content]
    if missing:
        raise ValueError(f"protocol error: a state lacks {missing[0]}")
    arrays = {key: np.array(content[key], dtype=np.float64) for key in KEYS[1:5]}
    sizes = {"q": 7, "dq": 7, "torque": 7, "wrench": 6}
    for key, size in sizes.items():
        if arrays[key].shape != (size,) or not np.isfinite(arrays[key]).all():
            raise ValueError(f"protocol error: {key} must be {size} finite numbers")
    return ArmState(
        time_s=float(content["time"]),
        mode=str(content["mode"]),
        errors=tuple(map(str, content["errors"])),
        **arrays,
    )
