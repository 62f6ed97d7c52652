"""Programs that mean harm, by family: one text file each, taken apart by ``attacks()``.

A line ``=== name flags`` begins an attack. Flags: ``control`` does harm where nothing holds it,
which a test shows; ``made`` is an expression that gives the text. FOLDER, PORT and so on stand
for what the test offers to be harmed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

HEAD = re.compile(r"^=== (\w+)((?: \w+)*)$", re.MULTILINE)


@dataclass(frozen=True)
class Attack:
    """One program that means harm."""

    name: str
    family: str
    source: str
    control: bool

    def __str__(self) -> str:
        return f"{self.family}-{self.name}"


def attacks() -> list[Attack]:
    """All attacks, sorted by family."""
    found = []
    for path in sorted(Path(__file__).with_name("attacks").glob("*.txt")):
        parts = HEAD.split(path.read_text(encoding="utf-8"))
        for name, flags, body in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
            source = body.removeprefix("\n").removesuffix("\n")
            if "made" in flags.split():
                source = eval(source)  # our own data
            found.append(Attack(name, path.stem, source, "control" in flags.split()))
    return found
