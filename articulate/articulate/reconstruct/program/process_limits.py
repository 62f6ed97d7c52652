"""Restrictions of a process: resource limits, an unprivileged user, Landlock, seccomp.

The child process applies them to itself before it reads any byte of a program. Each layer is
effective without the others. Layers that the kernel lacks are omitted; the names of the active ones
are returned for the trace. The module needs only the standard library.
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import signal
import struct
import sys
from collections.abc import Iterable, Sequence

LAYERS = ("limits", "user", "landlock", "seccomp")
"""Layers in the order in which they are applied."""
NOBODY = 65534
"""Id of the unprivileged user and group."""

_PR_SET_PDEATHSIG, _PR_SET_DUMPABLE, _PR_SET_SECCOMP, _PR_SET_NO_NEW_PRIVS = 1, 4, 22, 38
_SECCOMP_MODE_FILTER = 2
_LANDLOCK_CREATE, _LANDLOCK_RESTRICT = 444, 446
_LANDLOCK_FILES = {1: 13, 2: 14, 3: 15, 5: 16}
"""Number of file rights of Landlock, by the version that introduced them."""
_LANDLOCK_TCP, _LANDLOCK_SCOPES = 4, 6
"""Versions that can also forbid TCP, and sockets and signals to processes outside."""

_AUDIT = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
_NUMBERS: dict[str, dict[str, int]] = {
    "x86_64": {
        "read": 0, "write": 1, "mmap": 9, "mprotect": 10, "munmap": 11, "brk": 12,
        "rt_sigaction": 13, "rt_sigprocmask": 14, "rt_sigreturn": 15, "sched_yield": 24,
        "mremap": 25, "madvise": 28, "exit": 60, "gettimeofday": 96, "futex": 202,
        "clock_gettime": 228, "exit_group": 231, "sigaltstack": 131,
    },
    "aarch64": {
        "read": 63, "write": 64, "mmap": 222, "mprotect": 226, "munmap": 215, "brk": 214,
        "rt_sigaction": 134, "rt_sigprocmask": 135, "rt_sigreturn": 139, "sched_yield": 124,
        "mremap": 216, "madvise": 233, "exit": 93, "gettimeofday": 169, "futex": 98,
        "clock_gettime": 113, "exit_group": 94, "sigaltstack": 132,
    },
}  # fmt: skip
"""Allowed system calls by machine: memory, time, the two pipes and exit."""
_PROT_EXEC = 4
_ALLOW, _DENY, _KILL = 0x7FFF0000, 0x00050001, 0x80000000
"""Actions of a filter; ``_DENY`` returns EPERM."""
_LD, _JEQ, _JGE, _JSET, _RET = 0x20, 0x15, 0x35, 0x45, 0x06
"""Instructions of the filter: load a word, jump if equal, if at least, if a bit is set, return."""
_NR, _ARCH, _ARGS = 0, 4, 16
"""Offsets in what a filter sees: number, architecture, arguments of eight bytes each."""


class _Filter(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_void_p))


def restrict_process(*, memory_bytes: int, cpu_s: int, layers: Iterable[str] = LAYERS) -> list[str]:
    """Restrict this process and return the names of the active layers.

    Args:
        memory_bytes: Largest address space [bytes].
        cpu_s: Processor time after which the kernel ends the process [s].
        layers: Names of the layers to apply if the kernel has them.
    """
    wanted = set(layers)
    active = []
    if "user" in wanted and os.geteuid() == 0 and _become_nobody():
        active.append("user")
    if sys.platform == "linux":  # after the change of user, which resets both
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        _prctl(_PR_SET_DUMPABLE, 0)
    if "landlock" in wanted and _landlock():
        active.append("landlock")
    if "limits" in wanted and _limit(memory_bytes, cpu_s):
        active.append("limits")
    if "seccomp" in wanted and _seccomp():
        active.append("seccomp")
    return [layer for layer in LAYERS if layer in active]


def _limit(memory_bytes: int, cpu_s: int) -> bool:
    """Limit the resources of the process; return whether every limit was set."""
    is_complete = True
    for kind, most in (
        (resource.RLIMIT_AS, memory_bytes),
        (resource.RLIMIT_CPU, cpu_s),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_NOFILE, 0),
        (resource.RLIMIT_NPROC, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        try:
            resource.setrlimit(kind, (most, most))
        except (ValueError, OSError):
            is_complete = False
    return is_complete


def _become_nobody() -> bool:
    """Give up the rights of root; a container may have none to give up."""
    try:
        os.setgroups([])
        os.setresgid(NOBODY, NOBODY, NOBODY)
        os.setresuid(NOBODY, NOBODY, NOBODY)
    except OSError:
        return False
    return True


def _prctl(option: int, *arguments: int) -> int:
    libc = ctypes.CDLL(None, use_errno=True)
    filled = [ctypes.c_ulong(a) for a in (*arguments, 0, 0, 0, 0)[:4]]
    return int(libc.prctl(ctypes.c_int(option), *filled))


def _no_new_rights() -> bool:
    return _prctl(_PR_SET_NO_NEW_PRIVS, 1) == 0


def _landlock() -> bool:
    """Forbid every file, TCP, and sockets and signals outwards, as far as the kernel can."""
    if sys.platform != "linux" or platform.machine() not in _NUMBERS:
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    version = int(libc.syscall(_LANDLOCK_CREATE, None, ctypes.c_size_t(0), ctypes.c_uint(1)))
    if version < 1 or not _no_new_rights():
        return False
    rights = max(count for since, count in _LANDLOCK_FILES.items() if since <= version)
    tcp = 0b11 if version >= _LANDLOCK_TCP else 0
    scopes = 0b11 if version >= _LANDLOCK_SCOPES else 0
    words = 3 if scopes else 2 if tcp else 1
    rules = struct.pack("QQQ", (1 << rights) - 1, tcp, scopes)[: 8 * words]
    handle = int(
        libc.syscall(_LANDLOCK_CREATE, rules, ctypes.c_size_t(len(rules)), ctypes.c_uint(0))
    )
    if handle < 0:
        return False
    done = int(libc.syscall(_LANDLOCK_RESTRICT, ctypes.c_int(handle), ctypes.c_uint(0)))
    os.close(handle)
    return done == 0


def _seccomp() -> bool:
    """Deny all but a few system calls; the last layer, as it forbids the calls of the others."""
    machine = platform.machine()
    if sys.platform != "linux" or machine not in _NUMBERS or struct.calcsize("P") != 8:
        return False
    if not _no_new_rights():
        return False
    program = b"".join(seccomp_filter(machine))
    buffer = ctypes.create_string_buffer(program, len(program))
    handed = _Filter(len(program) // 8, ctypes.cast(buffer, ctypes.c_void_p))
    libc = ctypes.CDLL(None, use_errno=True)
    done = libc.prctl(
        ctypes.c_int(_PR_SET_SECCOMP),
        ctypes.c_ulong(_SECCOMP_MODE_FILTER),
        ctypes.byref(handed),
        ctypes.c_ulong(0),
        ctypes.c_ulong(0),
    )
    return int(done) == 0


def seccomp_filter(machine: str) -> Sequence[bytes]:
    """Return the instructions of the filter for ``machine``, eight bytes each.

    ``read`` is allowed from 0, ``write`` to 1, and memory without the right to execute.
    """
    numbers = _NUMBERS[machine]
    out = [_word(_LD, _ARCH), _word(_JEQ, _AUDIT[machine], 1, 0), _word(_RET, _KILL)]
    out += [_word(_LD, _NR), _word(_JGE, 0x40000000, 0, 1), _word(_RET, _KILL)]  # x32
    for name, stream in (("read", 0), ("write", 1)):
        out += [_word(_JEQ, numbers[name], 0, 6)]
        out += [_word(_LD, _ARGS), _word(_JEQ, stream, 0, 3)]
        out += [_word(_LD, _ARGS + 4), _word(_JEQ, 0, 0, 1)]
        out += [_word(_RET, _ALLOW), _word(_RET, _DENY)]
    for name in ("mmap", "mprotect"):
        out += [_word(_JEQ, numbers[name], 0, 4), _word(_LD, _ARGS + 16)]
        out += [_word(_JSET, _PROT_EXEC, 0, 1), _word(_RET, _DENY), _word(_RET, _ALLOW)]
    special = {"read", "write", "mmap", "mprotect"}
    for name in sorted(set(numbers) - special):
        out += [_word(_JEQ, numbers[name], 0, 1), _word(_RET, _ALLOW)]
    return [*out, _word(_RET, _DENY)]


def _word(code: int, value: int, then: int = 0, otherwise: int = 0) -> bytes:
    return struct.pack("HBBI", code, then, otherwise, value)
