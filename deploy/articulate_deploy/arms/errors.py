"""Errors of real arms, from the texts of their clients.

No client has an error class for each cause, and the classes differ between clients, so the text
decides.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from articulate.errors import UsageError, shorten


class ArmError(UsageError):
    """The arm cannot move, or has stopped by itself."""

    kind = "arm"


class ArmUnreachableError(ArmError):
    """No controller answers at the address."""

    kind = "not_connected"


class VersionMismatchError(ArmError):
    """The controller uses another version of the protocol than the client."""

    kind = "version_mismatch"


class ReflexError(ArmError):
    """The controller stopped the arm."""

    kind = "reflex"


class UserStopError(ArmError):
    """The user stop is pressed."""

    kind = "user_stop"


class CommunicationLostError(ArmError):
    """Packets were lost or the connection ended."""

    kind = "communication_lost"


class CommandRejectedError(ArmError):
    """The controller does not accept a command in its present state."""

    kind = "command_rejected"


class WatchdogError(ArmError):
    """A watchdog of this program stopped the arm."""

    kind = "watchdog"


KINDS: dict[str, type[ArmError]] = {
    error.kind: error
    for error in (
        ArmError,
        ArmUnreachableError,
        VersionMismatchError,
        ReflexError,
        UserStopError,
        CommunicationLostError,
        CommandRejectedError,
        WatchdogError,
    )
}
"""Error classes by the name that child processes send."""


@dataclass(frozen=True)
class Protocol:
    """Version of the controller's protocol and what connects to it."""

    system: str
    """Robot and version of its system."""
    package: str
    """Package whose client has this version, or its libfranka."""
    advice: str
    """Command that installs it, or the next step."""


_FR3_OLD = "update the arm's system to 5.9.0 or later, or use --robot bridge"
PROTOCOLS = {
    3: Protocol("Panda, system 1.3 to 3.x", "libfranka 0.5 to 0.7", "update the arm to 4.2.1"),
    4: Protocol("Panda, system 4.0 to 4.1", "libfranka 0.8", "update the arm to 4.2.1"),
    5: Protocol(
        "Panda, system 4.2.1 or later",
        "panda-python 1.1.1 or franka-rs 0.4.0",
        'pip install "articulate-robots[deploy-panda]", and use --robot panda',
    ),
    6: Protocol("FR3, system 5.2 to 5.4", "libfranka 0.10 to 0.13.2", _FR3_OLD),
    7: Protocol("FR3, system 5.5 to 5.6", "libfranka 0.13.3 to 0.13.6", _FR3_OLD),
    8: Protocol("FR3, system 5.7.0 to 5.7.1", "libfranka 0.14", _FR3_OLD),
    9: Protocol("FR3, system 5.7.2 to 5.8", "libfranka 0.15 to 0.17", _FR3_OLD),
    10: Protocol(
        "FR3, system 5.9.0 or later",
        "pylibfranka 0.21.3 or franka-rs 0.4.0",
        'pip install "articulate-robots[deploy-fr3]", and use --robot fr3',
    ),
}
"""Versions of the protocol: libfranka-common ``service_types.h`` and the compatibility tables of
the manufacturer's documentation."""

_VERSION = re.compile(r"server version:?\s*(\d+)", re.IGNORECASE)
_REFLEX = re.compile(r"aborted by reflex!?\s*(?:\[([^\]]*)\])?", re.IGNORECASE)
_USER_STOP = ("user stop", "user stopped", "emergency")
_LOST = (
    "udp receive", "timeout", "timed out", "connection got interrupted", "closed connection",
    "connection reset", "broken pipe", "communication_constraints_violation",
    "incorrect object size", "incorrect tcp message size", "protocol error", "connection closed",
    "end of file",
)  # fmt: skip
_ABSENT = (
    "refused", "unreachable", "no route", "not found", "unable to connect", "host", "network",
)  # fmt: skip


def arm_error(text: str, address: str, *, version: int | None = None) -> ArmError:
    """Return the error that a client's message describes.

    Args:
        text: Message of the client.
        address: Address of the controller.
        version: Version of the controller's protocol, if the client names it elsewhere.
    """
    lower, line = text.lower(), shorten(" ".join(text.split()), 160)
    if version is None and (match := _VERSION.search(text)) and "version" in lower:
        version = int(match[1])
    if "incompatible" in lower or (version is not None and "version" in lower):
        return _version_mismatch(address, version)
    if any(word in lower for word in _USER_STOP):
        return UserStopError(
            f"{address}: the user stop is pressed; release it, check that people are away from "
            "the arm, and start again"
        )
    if "communication_constraints_violation" in lower:
        return CommunicationLostError(
            f"{address}: the controller lost too many packets "
            "(communication_constraints_violation); use a dedicated network card and close other "
            "programs"
        )
    if match := _REFLEX.search(text):
        names = ", ".join(re.findall(r"[a-z0-9]+(?:_[a-z0-9]+)+", match[1] or text)) or line
        return ReflexError(
            f"{address}: the arm stopped with the reflex {shorten(names, 120)}; find the cause, "
            "then run again with --recover"
        )
    if "reflex" in lower:
        return ReflexError(
            f"{address}: the arm is in a reflex ({line}); find the cause, then run again with "
            "--recover"
        )
    if "refused" in lower and "command" not in lower:
        return ArmUnreachableError(
            f"{address}: no controller answers (connection refused); check the address, that the "
            "brakes are open and that FCI is active"
        )
    if "reject" in lower or "not possible" in lower or "command" in lower:
        return CommandRejectedError(f"{address}: the controller rejected a command ({line})")
    if any(word in lower for word in _LOST):
        return CommunicationLostError(f"{address}: the connection was lost ({line})")
    if any(word in lower for word in _ABSENT):
        return ArmUnreachableError(f"{address}: no controller answers ({line}); check the address")
    return ArmError(f"{address}: {line}")


def _version_mismatch(address: str, version: int | None) -> VersionMismatchError:
    known = PROTOCOLS.get(version or 0)
    if known is None:
        return VersionMismatchError(
            f"{address}: the controller's protocol is version {version or 'unknown'}, which no "
            "supported client has; use --robot bridge"
        )
    return VersionMismatchError(
        f"{address}: the controller's protocol is version {version} ({known.system}); it needs "
        f"{known.package}: {known.advice}"
    )


def silent_error(address: str, seconds: float) -> ArmUnreachableError:
    """Return the error of a controller that accepts a connection and sends nothing."""
    return ArmUnreachableError(
        f"{address}: no answer from the controller within {seconds:g} s; check that FCI is "
        "active and that no other program is connected"
    )
