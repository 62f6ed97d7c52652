"""Prompts: one text file each, with a version in its first line and ``$names`` to be filled."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from string import Template

NAMES = ("frame", "joint_program", "link_program", "movers", "picks", "critic")
HEAD = re.compile(r"# (?P<name>[a-z_]+), version (?P<version>\d+)\n")


@dataclass(frozen=True)
class Prompt:
    """A prompt with gaps."""

    name: str
    version: int
    text: str

    @property
    def gaps(self) -> frozenset[str]:
        """Names that must be given to :meth:`filled`."""
        return frozenset(Template(self.text).get_identifiers())

    def filled(self, **values: str) -> str:
        """The text; every gap must be given, and nothing else."""
        if self.gaps != set(values):
            raise ValueError(f"{self.name}: gaps {sorted(self.gaps)}, values {sorted(values)}")
        return Template(self.text).substitute(values)


def prompt(name: str) -> Prompt:
    """The prompt called ``name``, one of :data:`NAMES`."""
    content = resources.files(__name__).joinpath(f"{name}.txt").read_text("utf-8")
    head = HEAD.match(content)
    if head is None or head["name"] != name:
        raise ValueError(f"{name}.txt: does not begin with its name and version")
    return Prompt(name, int(head["version"]), content[head.end() :].strip())
