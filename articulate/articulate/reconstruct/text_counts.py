"""What a sentence counts: "a cabinet with two drawers" says that there are two."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

NUMBERS = {
    word: n
    for n, words in enumerate(
        ("no", "a an one single", "two", "three", "four", "five", "six", "seven", "eight", "nine")
    )
    for word in words.split()
} | {"ten": 10, "twelve": 12}
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
BETWEEN = 3
"""Most words between a number and what it counts: "two small upper drawers"."""

OWNING = r"\b(?:with|that|which|whose|having|has|of)\b|[,;:.]"
"""What stands between the object itself and its parts: "a light switch with two levers"."""


def counts_in(text: str) -> dict[str, int]:
    """How many of each part a sentence says there are, where it says a number."""
    words = re.findall(r"[a-z]+|\d+", text.lower())
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


def miscounted(text: str, labels: Iterable[str]) -> list[str]:
    """Where parts are not as many as a sentence says, one clause each."""
    there = Counter(singular(label.split()[-1]) for label in labels if label)
    head = re.split(OWNING, text.lower(), maxsplit=1)[0]
    itself = counts_in(re.sub(r"\b(?:one|single|1)\b", "", head))  # "a switch", not "one door"
    return [
        f"the text says {number} {part}{'s' * (number != 1)}, and the parts hold {there[part]}"
        for part, number in counts_in(text).items()
        if there[part] != number and not (there[part] == 0 and itself.get(part) == number == 1)
    ]


def singular(word: str) -> str:
    """A word without the ending of many, as far as parts need it."""
    if word.endswith("shelves"):
        return "shelf"
    if word.endswith(("ches", "shes", "xes")):
        return word[:-2]
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word
