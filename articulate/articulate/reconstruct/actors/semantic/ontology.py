"""Usual motion of parts by name: a small handwritten ontology.

A role determines what is sought in the shape; the shape determines every number. The meaning of a
word may depend on the object: the handle of a bucket swings, that of a drawer is fixed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

Role = Literal[
    "drawer",  # slides out of the front
    "press",  # is pressed into its panel
    "lift",  # is pulled off
    "slot",  # slides up and down
    "spin",  # rotates about its own axis, normal to its panel
    "roll",  # rotates about its own horizontal axis
    "swivel",  # rotates about a vertical axis through its contact
    "latch",  # rotates about the normal of its panel at its end
    "rocker",  # tilts about a horizontal axis through its centre
    "door",  # a hinge at an edge, usually vertical
    "flap",  # a hinge at the lower edge
    "lid",  # a hinge at a horizontal edge, usually the rear one
    "screen",  # a hinge at the horizontal edge in contact
    "clip",  # a small hinge at the front
    "bail",  # a bow that swings about its two ends
    "fold",  # folds in its own plane
    "temple",  # folds about a vertical axis at its contact
    "pane",  # slides sideways or swings
    "still",
    "unknown",
]
"""Kind of motion that is sought."""

ROLES: dict[str, Role] = {
    **dict.fromkeys(("drawer", "tray", "rack", "basket", "crisper", "bin", "pullout"), "drawer"),
    **dict.fromkeys(("button", "key", "keycap", "push", "trigger"), "press"),
    **dict.fromkeys(("cap", "cork", "stopper", "pump", "container", "nozzle", "stem"), "lift"),
    **dict.fromkeys(("slot", "slider", "plunger"), "slot"),
    **dict.fromkeys(("knob", "dial", "lens", "rotor", "fan", "propeller", "globe"), "spin"),
    **dict.fromkeys(("sphere", "turntable", "hand", "disc", "wheelhandle"), "spin"),
    **dict.fromkeys(("wheel", "roller", "castor wheel"), "roll"),
    **dict.fromkeys(("caster", "castor", "spout", "faucet", "tap", "arm", "yoke"), "swivel"),
    **dict.fromkeys(("lever", "crank", "latch"), "latch"),
    **dict.fromkeys(("toggle", "rocker"), "rocker"),
    **dict.fromkeys(("door", "gate", "hatch", "shutter", "leaf"), "door"),
    **dict.fromkeys(("window", "pane", "sash"), "pane"),
    **dict.fromkeys(("lid", "cover", "flap", "top", "hood", "board", "flip"), "lid"),
    **dict.fromkeys(("pedal", "pad", "footrest"), "lid"),
    **dict.fromkeys(("screen", "display", "monitor", "seat", "backrest"), "screen"),
    **dict.fromkeys(("lock", "clasp", "hasp", "buckle"), "clip"),
    **dict.fromkeys(("bail",), "bail"),
    **dict.fromkeys(("blade",), "fold"),
    **dict.fromkeys(("temple",), "temple"),
    **dict.fromkeys(
        (
            *("body", "base", "frame", "shelf", "leg", "foot", "housing", "carcass", "glass"),
            *("handle", "grip", "pull", "wall", "panel", "mirror", "bar", "stand", "box", "rim"),
            *("hinge", "foot", "case", "chassis", "support", "post", "tabletop", "back", "side"),
        ),
        "still",
    ),
}
"""Role of a part by a word of its name."""

OF_THING: dict[tuple[str, str], Role] = {
    ("bucket", "handle"): "bail",
    ("pot", "handle"): "still",
    ("basket", "handle"): "bail",
    ("kettle", "handle"): "still",
    ("safe", "handle"): "latch",
    ("door", "handle"): "latch",
    ("suitcase", "handle"): "clip",
    ("pen", "button"): "lift",
    ("oven", "door"): "flap",
    ("dishwasher", "door"): "flap",
    ("dishwasher", "shelf"): "drawer",
    ("bottle", "lid"): "lift",
    ("pot", "lid"): "lift",
    ("kettle", "lid"): "lift",
    ("pump", "lid"): "lift",
    ("jar", "lid"): "lift",
    ("coffee", "lid"): "lift",
    ("dispenser", "lid"): "lift",
    ("suitcase", "lid"): "flap",
    ("faucet", "switch"): "swivel",
    ("lamp", "switch"): "rocker",
    ("switch", "switch"): "rocker",
    ("switch", "button"): "rocker",
    ("switch", "part"): "press",
    ("toaster", "part"): "slot",
    ("toaster", "slider"): "slot",
    ("toaster", "lever"): "slot",
    ("fan", "blade"): "spin",
    ("scissors", "leg"): "fold",
    ("scissors", "blade"): "fold",
    ("pliers", "leg"): "fold",
    ("eyeglasses", "leg"): "temple",
    ("glasses", "leg"): "temple",
    ("knife", "handle"): "still",
    ("stapler", "body"): "screen",
    ("stapler", "lid"): "screen",
    ("chair", "seat"): "swivel",
    ("chair", "back"): "screen",
    ("suitcase", "pull"): "lift",
    ("suitcase", "front"): "door",
    ("laptop", "lid"): "screen",
    ("phone", "lid"): "screen",
    ("window", "door"): "pane",
    ("camera", "lid"): "lid",
    ("washing", "lid"): "lid",
    ("cart", "wheel"): "roll",
    ("lighter", "wheel"): "roll",
    ("mouse", "wheel"): "roll",
}
"""Role of a part of a certain object."""

POSITIONS = frozenset({"top", "back", "side"})
"""Words after ``drawer`` or ``door`` that only state its place."""
BODIES = ("body", "base", "frame", "housing", "carcass", "chassis", "cabinet")
"""Names of the part that all others move against, the most specific first."""
SAME = {"cupboard": "furniture", "cabinet": "furniture", "chest": "furniture", "pan": "pot"}
"""Synonyms of objects."""


def words_of(label: str) -> list[str]:
    """Return the words of a name in lower case, singular, without numbers."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    found = re.findall(r"[a-z]+", spaced.lower())
    return [_singular(word) for word in found]


def _singular(word: str) -> str:
    known = word in ROLES or word in BODIES or any(word in pair for pair in OF_THING)
    return word if known or not word.endswith("s") or word.endswith("ss") else word[:-1]


def object_words_in(labels: Iterable[str], text: str) -> frozenset[str]:
    """Return the words that may name the object: of the text, and of the names of its body."""
    found = set(words_of(text)) - set(ROLES)
    for label in labels:
        words = words_of(label)
        if words and words[-1] in BODIES:
            found |= set(words[:-1])
    return frozenset({SAME.get(word, word) for word in found})


def role_of(label: str, object_words: Iterable[str]) -> Role:
    """Return the usual role of a part of this name in such an object, or ``unknown``."""
    words = words_of(label)
    if words and words[-1] in POSITIONS and {"drawer", "door"} & {*words[:-1]}:
        words.pop()
    for word in reversed(words):  # the last word names the part, earlier ones qualify it
        for thing in sorted(object_words):
            if (thing, word) in OF_THING:
                return OF_THING[thing, word]
        if word == "button" and "toggle" in words:
            return "rocker"
        if word in ROLES:
            return ROLES[word]
    return "unknown"
