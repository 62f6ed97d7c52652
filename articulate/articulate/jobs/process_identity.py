"""Which process it is.

The number of a process is given to another one later; in a container that was restarted even at
once. Number and start together are no other process's until the machine itself is restarted.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

BOOT = Path("/proc/sys/kernel/random/boot_id")
START_FIELD = 22
"""Place of the start in ``/proc/PID/stat``, counted from 1; proc(5)."""


def this_process() -> dict[str, Any]:
    """What tells this process from all others, for a file that says who holds something."""
    pid = os.getpid()
    return {"host": socket.gethostname(), "pid": pid, "start": started(pid), "boot": boot()}


def is_here(holder: Mapping[str, Any]) -> bool:
    """Whether ``holder`` is, or was, a process of this machine since it was started.

    Containers on different machines may have one name: what the kernel calls this start of the
    machine decides, where it was noted.
    """
    if holder.get("host") != socket.gethostname():
        return False
    return holder.get("boot") in (None, boot())


def runs(holder: Mapping[str, Any]) -> bool:
    """Whether ``holder``, a process of this machine, still runs and is no later one."""
    pid = int(holder["pid"])
    return is_alive(pid) and holder.get("start") in (None, started(pid))


def is_alive(pid: int) -> bool:
    """Whether a process of this machine has this number and is no zombie."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:  # no such file system here
        return True


def started(pid: int) -> int | None:
    """When a process began [clock ticks since the machine did]; None where nothing says so."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The second field is the program's name in brackets, which may hold spaces and brackets.
    return int(text.rpartition(")")[2].split()[START_FIELD - 3])


def boot() -> str | None:
    """What the kernel calls this start of the machine; None where nothing says so."""
    try:
        return BOOT.read_text(encoding="utf-8").strip()
    except OSError:
        return None
