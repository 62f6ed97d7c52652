"""Words: how parts of a name mostly move. A small ontology, made by hand.

A role says what is looked for in the shape; the shape decides every number. What a word means may
hang on the thing it belongs to: the handle of a bucket swings, that of a drawer stands still.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

Role = Literal[
    "drawer",  # slides out of the front
    "press",  # is pressed into what it sits on
    "lift",  # is drawn off along the way it was put on
    "slot",  # slides up and down
    "spin",  # turns about its own axis, which stands on what it sits on
    "roll",  # turns about its own level axis
    "swivel",  # turns about an upright axis through where it is held
    "latch",  # turns about an axis that stands on what it sits on, at its end
    "rocker",  # tilts about a level axis through its middle
    "door",  # a hinge at an edge, mostly upright
    "flap",  # a hinge at the lower edge
    "lid",  # a hinge at a level edge, mostly the rear one
    "screen",  # a hinge at the level edge that touches
    "clip",  # a small hinge at the front
    "bail",  # a bow that swings about its two ends
    "fold",  # folds in the plane in which it lies
    "temple",  # folds about an upright axis where it is held
    "pane",  # slides sideways or swings
    "still",
    "unknown",
]
"""What is looked for."""

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
"""Role of a part of a certain thing."""

BODIES = ("body", "base", "frame", "housing", "carcass", "chassis", "cabinet")
"""Words of the part that everything else moves against, the surest first."""
SAME = {"cupboard": "furniture", "cabinet": "furniture", "chest": "furniture", "pan": "pot"}
"""Things that are alike."""


def words_of(label: str) -> list[str]:
    """Words of a name in lower case, without numbers and without the ending of many."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    found = re.findall(r"[a-z]+", spaced.lower())
    return [_singular(word) for word in found]


def _singular(word: str) -> str:
    known = word in ROLES or word in BODIES or any(word in pair for pair in OF_THING)
    return word if known or not word.endswith("s") or word.endswith("ss") else word[:-1]


def things_in(labels: Iterable[str], text: str) -> frozenset[str]:
    """What the object may be: words of the text, and of the names of its body."""
    found = set(words_of(text)) - set(ROLES)
    for label in labels:
        words = words_of(label)
        if words and words[-1] in BODIES:
            found |= set(words[:-1])
    return frozenset({SAME.get(word, word) for word in found})


def role_of(label: str, things: Iterable[str]) -> Role:
    """What a part of this name mostly does in such a thing; ``unknown`` if no word is listed."""
    words = words_of(label)
    for word in reversed(words):  # the last word names the part, those before say which
        for thing in sorted(things):
            if (thing, word) in OF_THING:
                return OF_THING[thing, word]
        if word == "button" and "toggle" in words:
            return "rocker"
        if word in ROLES:
            return ROLES[word]
    return "unknown"
