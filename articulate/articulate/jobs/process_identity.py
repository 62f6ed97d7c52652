"""Identify processes, measure their processor time, and end them with their parent.

A process number is reused later; in a restarted container even at once. Number and start time
together are unique until the machine itself is restarted.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

BOOT = Path("/proc/sys/kernel/random/boot_id")
START_FIELD = 22
"""Place of the start time in ``/proc/PID/stat``, counted from 1; proc(5)."""
TIME_FIELDS = (14, 15, 16, 17)
"""Places of user and system time of a process and of its ended children; proc(5)."""
PR_SET_PDEATHSIG = 1
"""From ``linux/prctl.h``."""
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None
"""Loaded before any fork: a child between fork and exec must not import."""


def this_process() -> dict[str, Any]:
    """Return the identity of this process, for a file that names the holder of something."""
    pid = os.getpid()
    return {"host": socket.gethostname(), "pid": pid, "start": start_time(pid), "boot": boot_id()}


def is_local(holder: Mapping[str, Any]) -> bool:
    """Return whether ``holder`` is or was a process of this machine since it was started.

    Containers on different machines may have the same host name, so the kernel's boot identifier
    decides where it was recorded.
    """
    if holder.get("host") != socket.gethostname():
        return False
    return holder.get("boot") in (None, boot_id())


def is_running(holder: Mapping[str, Any]) -> bool:
    """Return whether ``holder``, a process of this machine, still runs and is no later one."""
    pid = int(holder["pid"])
    return is_alive(pid) and holder.get("start") in (None, start_time(pid))


def is_alive(pid: int) -> bool:
    """Return whether a process of this machine has this number and is no zombie."""
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


def start_time(pid: int) -> int | None:
    """Return the start of a process [jiffies since boot]; None where it is unknown."""
    fields = _stat(pid)
    return None if fields is None else int(fields[START_FIELD - 3])


def boot_id() -> str | None:
    """Return the kernel's identifier of this start of the machine; None where it is unknown."""
    try:
        return BOOT.read_text(encoding="utf-8").strip()
    except OSError:
        return None


def processor_time_s(pid: int) -> float | None:
    """Return the processor time of a process and all its descendants [s]; None if unknown."""
    fields = _stat(pid)
    if fields is None:
        return None
    total = sum(int(fields[k - 3]) for k in TIME_FIELDS) / os.sysconf("SC_CLK_TCK")
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = path.read_text(encoding="ascii").split()
        except OSError:  # the thread has ended
            continue
        total += sum(processor_time_s(int(child)) or 0.0 for child in children)
    return total


def end_with_parent(parent: int | None = None) -> None:
    """Let the kernel kill this process when its parent ends (Linux only).

    Args:
        parent: Number of the parent. If it ended before this call, this process exits at once.
    """
    if _LIBC is not None:
        _LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if parent is not None and os.getppid() != parent:
        os._exit(1)


def _stat(pid: int) -> list[str] | None:
    """Return the fields of ``/proc/PID/stat`` from the third on; None if it cannot be read."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The second field is the program's name in brackets, which may hold spaces and brackets.
    return text.rpartition(")")[2].split()
