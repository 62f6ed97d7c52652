"""Numbers of parts in a text: "a cabinet with two drawers" has two drawers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

from articulate.reconstruct.text.measures import with_digits

NUMBERS = {"no": 0, "a": 1, "an": 1, "single": 1, "double": 2, "twin": 2}
"""Words before a part that are numbers, apart from numerals."""
PARTS = frozenset(
    [
        "button",
        "caster",
        "door",
        "drawer",
        "flap",
        "handle",
        "key",
        "knob",
        "lever",
        "lid",
        "pedal",
        "seat",
        "shelf",
        "switch",
        "wheel",
        "window",
        "tray",
        "blade",
        "leg",
    ]
)
"""Words that are counted."""
POSITIONS = frozenset(
    ["left", "right", "top", "bottom", "upper", "lower", "middle", "centre", "center"]
)
"""Words after a part in its name that state its place."""
BETWEEN = 3
"""Most words between a number and its part: "two small upper drawers"."""

SEPARATOR = r"\b(?:with|that|which|whose|having|has|of)\b|[,;:.]"
"""Separates the object from its parts: "a light switch with two levers"."""


def counts_in(text: str) -> dict[str, int]:
    """Return the number of each part that a text gives."""
    words = re.findall(r"[a-z]+|\d+", with_digits(text.lower()))
    found: dict[str, int] = {}
    for k, word in enumerate(words):
        part = singular(word)
        if part not in PARTS:
            continue
        for before in reversed(words[max(0, k - BETWEEN) : k]):
            if singular(before) in PARTS or before in {"with", "and", "of"}:
                break
            number = int(before) if before.isdigit() else NUMBERS.get(before)
            if number is not None:
                found[part] = found.get(part, 0) + number
                break
    return found


def count_mismatch(text: str, labels: Iterable[str]) -> list[str]:
    """Describe each difference between the numbers in a text and the labelled parts."""
    labelled = Counter(_part_in(label) for label in labels if label)
    head = re.split(SEPARATOR, text.lower(), maxsplit=1)[0]
    itself = counts_in(re.sub(r"\b(?:one|single|1)\b", "", head))  # "a switch", not "one door"
    return [
        f"the text names {number} {part}{'s' * (number != 1)}, the parts include {labelled[part]}"
        for part, number in counts_in(text).items()
        if labelled[part] != number
        and not (labelled[part] == 0 and itself.get(part) == number == 1)
    ]


def _part_in(label: str) -> str:
    """Return the word for the part in a label: ``door`` in ``door right``."""
    words = label.split()
    while len(words) > 1 and words[-1] in POSITIONS:
        words.pop()
    return singular(words[-1])


def singular(word: str) -> str:
    """Return the singular of a part's name."""
    if word.endswith("shelves"):
        return "shelf"
    if word.endswith(("ches", "shes", "xes")):
        return word[:-2]
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word
