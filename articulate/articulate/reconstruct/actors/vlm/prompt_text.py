"""Text of prompts: evidence, joints and earlier attempts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.actors.protocol import ActorAttempt, Evidence, PredictedJoint, Verdict
from articulate.reconstruct.actors.vlm.images import colours_of, evidence_images, parts_image
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Content
from articulate.render.image import as_png
from articulate.transforms import Array, normalised

INPUT = {
    "video": "Frames of a video in which one part of the object is moved. The camera is fixed.",
    "image": "An image of the object.",
    "text": "There is no image; only the parts are known.",
}
UNPLACED = "Each part is moved so that the centre of its box is the origin; none is turned."
PLACED = "Every part is where it belongs while all joints are at 0."


def evidence_content(evidence: Evidence) -> tuple[Content, ...]:
    """Return the evidence as text and images: the input, the parts and their colours."""
    content: list[Content] = [INPUT[evidence.modality]]
    if evidence.text:
        content.append(f"Description by the user: {evidence.text!r}.")
    content += evidence_images(evidence)
    if evidence.placed:
        content.append(parts_image(evidence))
    content.append(describe_parts(evidence))
    return tuple(content)


def describe_parts(evidence: Evidence) -> str:
    """List the parts with name, label, colour and box."""
    colours = colours_of(evidence.parts) if evidence.placed else {}
    lines = [f"The parts. {PLACED if evidence.placed else UNPLACED}"]
    for part in evidence.parts:
        low, high = part.bounds
        label = evidence.labels.get(part.name, "")
        colour = f", colour {colours[part.name]}" if colours else ""
        box = f"size {format_vector(high - low)}"
        if colours:
            box = f"box from {format_vector(low)} to {format_vector(high)}"
        lines.append(f"- {part.name}{f' ({label})' * bool(label)}{colour}, {box}")
    return "\n".join(lines)


def describe_attempts(attempts: Sequence[ActorAttempt]) -> tuple[Content, ...]:
    """Describe earlier proposals with the critic's verdicts; the last with the critic's images."""
    if not attempts:
        return ()
    lines = ["Your earlier proposals, with the verdicts of a critic:"]
    for k, attempt in enumerate(attempts):
        lines.append(f"{k + 1}. {describe_joints(attempt.joints)}")
        if attempt.verdict is not None:
            lines.append(f"   The critic: {describe_verdict(attempt.verdict)}")
    lines.append("Propose again. Correct what the critic rejects, and keep what is right.")
    images = attempts[-1].verdict.images if attempts[-1].verdict is not None else {}
    return (
        "\n".join(lines),
        *(CaptionedImage(f"your last proposal: {c}", as_png(p)) for c, p in images.items()),
    )


def describe_joints(joints: Iterable[PredictedJoint]) -> str:
    """Describe the joints that move."""
    moving = [joint for joint in joints if joint.kind != "fixed"]
    return "; ".join(map(describe_joint, moving)) or "no joint"


def describe_joint(joint: PredictedJoint) -> str:
    """Describe one joint."""
    text = f"{joint.part} against {joint.parent}: {joint.kind}, axis {format_vector(joint.axis_o)}"
    if joint.kind != "prismatic":
        text += f" through {format_vector(joint.pivot_o)}"
    if joint.lower is not None and joint.upper is not None:
        text += f", from {joint.lower:.3f} to {joint.upper:.3f}"
        text += " m" if joint.kind == "prismatic" else " rad"
    return text


def describe_verdict(verdict: Verdict) -> str:
    """Describe a verdict."""
    return f"{verdict.failure}, rated {verdict.rating:.1f} of 10. {verdict.reason}".strip()


def format_vector(values: Iterable[float]) -> str:
    """Format numbers in brackets, with three digits."""
    return f"({', '.join(f'{value + 0.0:.3f}' for value in values)})"


def describe_direction(direction_o: Array) -> str:
    """Describe a unit vector (3,) by its largest components, as seen from the object's front."""
    names = (("front", "back"), ("right", "left"), ("up", "down"))
    unit = normalised(direction_o)
    words = [
        names[k][int(unit[k] < 0.0)]
        for k in np.argsort(-np.abs(unit))
        if abs(float(unit[k])) > np.sin(np.radians(22.5))
    ]
    return " and ".join(words)


def with_placements(evidence: Evidence, T_o: dict[str, Array]) -> Evidence:
    """Return the evidence with each part moved by its pose in ``T_o`` (4, 4) [m]."""
    parts = tuple(p.moved(T_o[p.name]) if p.name in T_o else p for p in evidence.parts)
    return replace(evidence, parts=parts, placed=True)
