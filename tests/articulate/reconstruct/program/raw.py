"""Runs attacks without the guard and looks for what they have done."""

from __future__ import annotations

import os
import re
import socket
import stat
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.articulate.reconstruct.program.hostile import Attack

from articulate.reconstruct.program.sandbox import ChildEnded, Sandbox, SandboxLimits

HERE = Path(__file__).parent
ROOT = HERE.parents[3] / "articulate"
GONE_S = 5.0
"""A process that was killed is gone after this time [s]."""
AGE = 1000.0
"""Time of last change of the file that must stay as it is [s since 1970]."""


@dataclass(frozen=True)
class Outcome:
    """What became of an attack."""

    layers: tuple[str, ...]
    end: str
    """How it ended, in a word or sentence."""
    harm: tuple[str, ...]
    """What it has done outside of itself."""


def attacked(attack: Attack, folder: Path, layers: tuple[str, ...]) -> Outcome:
    """Run an attack as plain Python behind ``layers``; ``folder`` is what it may harm."""
    folder.chmod(0o777)
    kept = folder / "kept"
    kept.write_text("kept")
    kept.chmod(0o666)
    os.utime(kept, (AGE, AGE))
    script = _script(attack)
    with socket.socket() as tcp, socket.socket(socket.AF_UNIX) as unix, script as file:
        tcp.bind(("127.0.0.1", 0))
        unix.bind(str(folder / "socket"))
        (folder / "socket").chmod(0o777)
        for server in (tcp, unix):
            server.listen(8)
            server.setblocking(False)
        source = attack.source.replace("FOLDER", str(folder))
        source = source.replace("PORT", str(tcp.getsockname()[1]))
        limits = SandboxLimits(seconds=6.0, cpu_s=1, memory_bytes=400_000_000, layers=layers)
        found, end, pid = _run(Path(file.name), source, limits)
        harm = [*_changed(folder), *_left(pid, file.name)]
        harm += [name for name, server in (("tcp", tcp), ("unix", unix)) if _was_called(server)]
    return Outcome(found, end, tuple(harm))


def _script(attack: Attack):
    words = re.findall(r"^\s*(?:import|from) +([\w., ]+)", attack.source, re.MULTILINE)
    names = {name.strip().split(" ")[0] for line in words for name in line.split(",")}
    known = sorted(n for n in names if n and n.split(".")[0] in sys.stdlib_module_names)
    modules = [n for n in known if n not in {"antigravity", "__future__"}]
    script = tempfile.NamedTemporaryFile("w", prefix="raw-", suffix=".py")  # noqa: SIM115  # a with
    text = (HERE / "raw_child.py").read_text(encoding="utf-8")
    text = text.replace('ROOT = ""\n', f"ROOT = {str(ROOT)!r}\n")
    text = text.replace('MODULES = [""]\n', f"MODULES = {modules!r}\n")
    script.write(text)
    script.flush()
    return script


def _run(script: Path, source: str, limits: SandboxLimits) -> tuple[tuple[str, ...], str, int]:
    layers: tuple[str, ...] = ()
    with Sandbox(script, limits) as child:
        try:
            layers = tuple(child.receive()["layers"])
            child.send({"source": source})
            end = str(child.receive().get("ended"))
        except ChildEnded as ended:
            end = str(ended)
    return layers, end, child.process.pid


def _changed(folder: Path) -> list[str]:
    found = [f"made {p.name}" for p in folder.iterdir() if p.name not in {"kept", "socket"}]
    kept = folder / "kept"
    if not kept.is_file():
        return [*found, "deleted kept"]
    status = kept.stat()
    if kept.read_text() != "kept" or status.st_mtime != AGE:
        found.append("wrote kept")
    if stat.S_IMODE(status.st_mode) != 0o666:
        found.append("changed the rights of kept")
    return found


def _left(pid: int, script: str) -> list[str]:
    """Processes that the child has left for good: of its session, or with its command line."""
    found = _others(pid, script)
    until = time.monotonic() + GONE_S
    while found and time.monotonic() < until:
        time.sleep(0.02)
        found = _others(pid, script)
    return found


def _others(pid: int, script: str) -> list[str]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            line = (folder / "cmdline").read_bytes().decode(errors="replace")
            session = (folder / "stat").read_text().rsplit(")", 1)[1].split()[3]
        except OSError:
            continue
        if script in line or session == str(pid):
            found.append(f"left process {folder.name}")
    return found


def _was_called(server: socket.socket) -> bool:
    try:
        server.accept()[0].close()
    except BlockingIOError:
        return False
    return True
