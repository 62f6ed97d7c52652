"""A command that reads a file, and a hostile case of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tests.hostile.changes import XML_TEXTS
from tests.hostile.writers import KINDS, Change, HonestInputs, text


@dataclass(frozen=True, kw_only=True)
class Reader:
    """A command of the product, the honest files that it reads, and one of them."""

    argv: tuple[str, ...]
    """Arguments; the folder of the case is the current one."""
    inputs: dict[str, str]
    """Target of each honest input, by its name in ``HonestInputs``."""
    file: str
    """File that hostile content replaces."""

    def at(self, file: str) -> Reader:
        """Return the same reader with another hostile file."""
        return Reader(argv=self.argv, inputs=self.inputs, file=file)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A hostile input of a reader."""

    name: str
    reader: Reader
    change: Change
    is_default: bool = False
    """True if the default tests include it, in their process."""

    def write(self, folder: Path, honest: HonestInputs) -> None:
        """Write the input into the folder of the case."""
        (folder / "in").mkdir(exist_ok=True)
        for name, target in self.reader.inputs.items():
            honest.copy(name, folder / target)
        self.change(folder / self.reader.file)

    def __str__(self) -> str:
        return self.name


def kinds(*names: str) -> dict[str, Change]:
    """Return the changes with these names that suit any file."""
    return {name: KINDS[name] for name in names}


def xml(root: str) -> dict[str, Change]:
    """Return hostile texts of an XML file with that root."""
    return {k: text(v.replace("{root}", root)) for k, v in XML_TEXTS.items()}


def texts(table: dict[str, str]) -> dict[str, Change]:
    """Return changes that write these texts."""
    return {k: text(v) for k, v in table.items()}
