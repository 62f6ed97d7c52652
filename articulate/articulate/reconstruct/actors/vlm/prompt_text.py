"""Told: evidence and earlier attempts in words, for prompts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.actors.protocol import ActorAttempt, Evidence, PredictedJoint, Verdict
from articulate.reconstruct.actors.vlm.images import colours_of, evidence_pictures, parts_picture
from articulate.reconstruct.actors.vlm.model import Picture, Piece
from articulate.render.image import as_png
from articulate.transforms import Array, normalised

GIVEN = {
    "video": "Frames of a clip in which one part of the object is moved. The camera stands still.",
    "image": "A picture of the object.",
    "text": "No picture was given; only the parts are known.",
}
UNPLACED = "Each part is moved so that the middle of its box is the origin; none is turned."
PLACED = "Every part is where it belongs while all joints are at 0."


def pieces_of(evidence: Evidence) -> tuple[Piece, ...]:
    """What is known, as words and pictures: what was given, the parts, their colours."""
    pieces: list[Piece] = [GIVEN[evidence.modality]]
    if evidence.text:
        pieces.append(f"Somebody says of it: {evidence.text!r}.")
    pieces += evidence_pictures(evidence)
    if evidence.placed:
        pieces.append(parts_picture(evidence))
    pieces.append(parts_told(evidence))
    return tuple(pieces)


def parts_told(evidence: Evidence) -> str:
    """The list of parts: name, what it is, colour, box."""
    colours = colours_of(evidence.parts) if evidence.placed else {}
    lines = [f"The parts. {PLACED if evidence.placed else UNPLACED}"]
    for part in evidence.parts:
        low, high = part.bounds
        label = evidence.labels.get(part.name, "")
        colour = f", colour {colours[part.name]}" if colours else ""
        box = f"box from {three(low)} to {three(high)}" if colours else f"size {three(high - low)}"
        lines.append(f"- {part.name}{f' ({label})' * bool(label)}{colour}, {box}")
    return "\n".join(lines)


def attempts_told(attempts: Sequence[ActorAttempt]) -> tuple[Piece, ...]:
    """What was proposed before and what the critic said; the last with the critic's pictures."""
    if not attempts:
        return ()
    lines = ["You proposed before, and a critic looked at it:"]
    for k, attempt in enumerate(attempts):
        lines.append(f"{k + 1}. {joints_told(attempt.joints)}")
        if attempt.verdict is not None:
            lines.append(f"   The critic: {verdict_told(attempt.verdict)}")
    lines.append("Propose again. Mend what the critic says is wrong, and keep what is right.")
    pictures = attempts[-1].verdict.images if attempts[-1].verdict is not None else {}
    return (
        "\n".join(lines),
        *(Picture(f"your last proposal: {c}", as_png(p)) for c, p in pictures.items()),
    )


def joints_told(joints: Iterable[PredictedJoint]) -> str:
    """Joints that move, in words."""
    moving = [joint for joint in joints if joint.kind != "fixed"]
    return "; ".join(map(joint_told, moving)) or "no joint"


def joint_told(joint: PredictedJoint) -> str:
    """One joint, in words."""
    told = f"{joint.part} against {joint.parent}: {joint.kind}, axis {three(joint.axis_o)}"
    if joint.kind != "prismatic":
        told += f" through {three(joint.pivot_o)}"
    if joint.lower is not None and joint.upper is not None:
        told += f", from {joint.lower:.3f} to {joint.upper:.3f}"
        told += " m" if joint.kind == "prismatic" else " rad"
    return told


def verdict_told(verdict: Verdict) -> str:
    """A verdict, in words."""
    return f"{verdict.failure}, rated {verdict.rating:.1f} of 10. {verdict.reason}".strip()


def three(values: Iterable[float]) -> str:
    """Three numbers in brackets."""
    return f"({', '.join(f'{value + 0.0:.3f}' for value in values)})"


def direction_told(way_o: Array) -> str:
    """A direction in words: its largest parts, as seen by somebody before the object."""
    names = (("front", "back"), ("right", "left"), ("up", "down"))
    way = normalised(way_o)
    words = [
        names[k][int(way[k] < 0.0)]
        for k in np.argsort(-np.abs(way))
        if abs(float(way[k])) > np.sin(np.radians(22.5))
    ]
    return " and ".join(words)


def placed(evidence: Evidence, T_o: dict[str, Array]) -> Evidence:
    """The evidence with each part where ``T_o`` (4, 4) puts it."""
    parts = tuple(p.moved(T_o[p.name]) if p.name in T_o else p for p in evidence.parts)
    return replace(evidence, parts=parts, placed=True)
