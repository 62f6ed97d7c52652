"""Child process of one client: requests arrive on a pipe, replies and states leave on it.

A client of a silent controller hangs for ever and ignores Ctrl-C, and changes the scheduling of its
thread. In a separate process it can be killed, and the policy's threads keep their priority.
"""

from __future__ import annotations

import signal
import sys
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from articulate.errors import UsageError
from articulate_deploy.arms.client import (
    IDLE,
    REFLEX,
    USER_STOP,
    ArmClient,
    ArmState,
    ClientSpec,
)
from articulate_deploy.arms.clients import make_client
from articulate_deploy.arms.errors import ArmError, CommandRejectedError, ReflexError, arm_error
from articulate_deploy.arms.motions import EpisodeMotion, RampMotion
from articulate_deploy.arms.scheduling import real_time, use_ordinary_scheduling

Reply = tuple[Any, ...]


def main(link: Connection) -> None:
    """Serve requests until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops the arm
    spec: ClientSpec = link.recv()
    client: ArmClient | None = None
    try:
        client = make_client(spec)
        info = client.connect()
        use_ordinary_scheduling()
        link.send(("done", info))
    except Exception as error:  # noqa: BLE001  clients have no common base class
        link.send(_error(error, spec.address))
        return
    try:
        while True:
            request = link.recv()
            if request[0] == "close":
                return
            try:
                link.send(("done", _serve(client, request, link, spec)))
            except EOFError:
                raise
            except Exception as error:  # noqa: BLE001  as above
                link.send(_error(error, spec.address))
    except (EOFError, BrokenPipeError):
        return  # the parent ended: a motion has braked, see EpisodeMotion
    finally:
        client.close()


def _serve(client: ArmClient, request: Reply, link: Connection, spec: ClientSpec) -> Any:
    kind, *arguments = request
    if kind == "state":
        return client.read_state()
    if kind == "configure":
        return client.configure(*arguments)
    if kind == "recover":
        client.recover()
        return client.read_state()
    state = client.read_state()
    check_mode(state, spec.address)
    if kind == "check":
        return state
    if kind == "ramp":
        motion: Any = RampMotion(link, state.q, *arguments)
    elif kind == "episode":
        motion = EpisodeMotion(arguments[0], link)
    else:
        raise ValueError(kind)
    with real_time() as scheduling:
        client.run(motion)
    error = getattr(motion, "error", None)
    if error is not None:
        raise error
    return {**motion.statistics.as_dict(), "scheduling": scheduling}


def check_mode(state: ArmState, address: str) -> None:
    """Reject a motion unless the arm is idle: reflexes and user stops are never cleared here.

    Raises:
        ArmError: The arm is in another mode.
    """
    if state.mode == IDLE:
        return
    if state.mode == REFLEX:
        names = ", ".join(state.errors) or "no error is named"
        raise ReflexError(
            f"{address}: the arm is in a reflex ({names}); find the cause, then run again with "
            "--recover"
        )
    if state.mode == USER_STOP:
        raise arm_error("User stopped", address)
    raise CommandRejectedError(
        f"{address}: the arm is in the mode {state.mode}; open its brakes, and end guiding and "
        "other programs first"
    )


def _error(error: Exception, address: str) -> Reply:
    """Return the reply that describes an exception."""
    if isinstance(error, ArmError):
        text = str(error)
        found: Any = error if text.startswith(address) else type(error)(f"{address}: {text}")
    elif isinstance(error, UsageError):
        return "error", "usage", str(error)
    elif isinstance(error, (ImportError, AssertionError, AttributeError, TypeError)):
        return "error", "bug", f"{type(error).__name__}: {error}"
    else:
        version = getattr(error, "server_version", None)
        details = (getattr(error, "reason", None), getattr(error, "errors", None))
        text = " ".join([str(error), *(str(detail) for detail in details if detail)])
        found = arm_error(text, address, version=version)
    return "error", found.kind, str(found)


if __name__ == "__main__":
    np.seterr(all="ignore")
    with Connection(int(sys.argv[1])) as pipe:
        main(pipe)
