"""Prompts: one text file each, with a version in the first line and ``$name`` placeholders."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from string import Template

NAMES = (
    "frame",
    "joint_program",
    "link_program",
    "link_critic",
    "affordance",
    "movers",
    "choices",
    "critic",
    "object_detector",
    "category_selector",
    "object_selector",
    "task_specifier",
    "layout_planner",
    "part_annotator",
)
HEAD = re.compile(r"# (?P<name>[a-z_]+), version (?P<version>\d+)\n")


@dataclass(frozen=True)
class Prompt:
    """A prompt with placeholders."""

    name: str
    version: int
    text: str

    @property
    def placeholders(self) -> frozenset[str]:
        """Names of the values that :meth:`filled` needs."""
        return frozenset(Template(self.text).get_identifiers())

    def filled(self, **values: str) -> str:
        """Return the text with all placeholders filled; their names must match exactly."""
        if self.placeholders != set(values):
            raise ValueError(
                f"{self.name}: placeholders {sorted(self.placeholders)}, values {sorted(values)}"
            )
        return Template(self.text).substitute(values)


def prompt(name: str) -> Prompt:
    """Read the prompt ``name``, one of :data:`NAMES`."""
    content = resources.files(__name__).joinpath(f"{name}.txt").read_text("utf-8")
    head = HEAD.match(content)
    if head is None or head["name"] != name:
        raise ValueError(f"{name}.txt: must begin with its name and version")
    return Prompt(name, int(head["version"]), content[head.end() :].strip())
