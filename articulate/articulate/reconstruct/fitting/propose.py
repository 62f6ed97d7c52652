"""Propose an object from one image, with hints from a text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.library.procedural.materials import PALETTE, Material
from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.fitting.box_cost import EDGES
from articulate.reconstruct.fitting.categories import USUAL, Generated, generate
from articulate.reconstruct.fitting.confidence import MIN_CONFIDENCE, Evidence
from articulate.reconstruct.fitting.object_front import ObjectFront, find_front
from articulate.reconstruct.proposal import ObjectProposal, Source
from articulate.reconstruct.recognition.categories import category_probabilities, multiply
from articulate.reconstruct.recognition.library_index import LibraryIndex
from articulate.reconstruct.recognition.mask import saliency
from articulate.render.image import png
from articulate.render.raster import Pixels

SALIENT = 0.5
"""Saliency above which a pixel belongs to the object."""
MIN_SHARE, MAX_SHARE = 0.01, 0.97
"""Smallest and largest share of an image that an object covers."""
MIN_SALIENT = 0.3
"""Salient share of the moving region below which it belongs to the object."""
MIN_VISIBLE = 0.5
"""Share of the front in the image below which the result is doubtful."""


def propose(
    image: Pixels,
    *,
    hints: Mapping[str, float] | None = None,
    height_m: float | None = None,
    library: LibraryIndex | None = None,
) -> ObjectProposal:
    """Propose an object with the category, proportions, parts and joints of an image.

    Args:
        image: Colours (H, W, 3).
        hints: Weights of categories from a text.
        height_m: Height of the object [m], if known.
        library: Renders of objects of known categories.

    Raises:
        UsageError: No object is found, or its category is not in the library.
    """
    mask = object_mask(image, None)
    seen = category_probabilities(image, mask, library)
    probabilities = with_hints(seen, hints)
    ranked = sorted(probabilities, key=lambda name: -probabilities[name])
    category = next(name for name in ranked if name in USUAL)
    front = find_front(image, mask, USUAL[category].prior)
    generated = generate(category, front, height_m)
    evidence: dict[str, Source] = {
        part.name: "image" if generated.layout else "category"
        for part in generated.parts
        if part.motion is not None
    }
    known = Evidence(category=probabilities[category], parts=generated.certainty)
    return ObjectProposal(
        name=object_name(category, generated),
        category=category,
        parts=generated.parts,
        palette=front_palette(front),
        confidence=known.confidence(),
        evidence=evidence,
        assumptions=generated.assumptions,
        doubts=tuple(_doubts(category, known, front)),
        trace=image_trace(image, mask, probabilities, front, known),
    )


def object_mask(
    image: Pixels, moving_px: tuple[float, float, float, float] | None
) -> NDArray[np.bool_]:
    """Return the pixels of the object (H, W): the largest salient region.

    With a moving region (left, right, top, bottom) [px], the salient regions that it touches, and
    the moving region itself if it is mostly not salient.

    Raises:
        UsageError: Nothing is salient.
    """
    salient = (saliency(image) > SALIENT).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(salient)
    mask = np.zeros(image.shape[:2], dtype=np.bool_)
    if moving_px is not None:
        left, right, top, bottom = (round(value) for value in moving_px)
        window = (slice(max(0, top), bottom + 1), slice(max(0, left), right + 1))
        touched = [k for k in range(1, count) if (labels[window] == k).any()]
        mask |= np.isin(labels, touched)
        if mask[window].mean() < MIN_SALIENT:
            mask[window] = True
    elif count > 1:
        mask = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    share = float(mask.mean())
    if not share >= MIN_SHARE:
        raise UsageError(
            "no object is salient in the image; take the entire object against a calm background"
        )
    return mask


def with_hints(
    probabilities: Mapping[str, float], hints: Mapping[str, float] | None
) -> Mapping[str, float]:
    """Return probabilities of categories, multiplied by the weights of a text."""
    if not hints:
        return probabilities
    names = {*probabilities, *hints}
    return multiply(probabilities, {name: hints.get(name, 1e-4) for name in names})


def _doubts(category: str, known: Evidence, front: ObjectFront) -> list[str]:
    doubts = []
    if known.confidence() < MIN_CONFIDENCE:
        doubts.append(
            {
                "category": f"the category {words(category)} has a probability of "
                f"{known.category:.0%}; name the object with --text",
                "parts": "number and kinds of the parts are uncertain; name them with --text, "
                'e.g. "a cabinet with two drawers above a door"',
            }[known.weakest()]
        )
    if front.visible < MIN_VISIBLE:
        doubts.append("the front is not entirely in the image; take it entirely, from the front")
    return doubts


def front_palette(front: ObjectFront) -> dict[str, Material]:
    """Return the materials; those of bodies and fronts have the colour of the front."""
    above = front.image[: max(1, round((1.0 - front.base_share) * len(front.image)))]
    rgb = np.median(above.reshape(-1, 3), axis=0) / 255.0
    rgba = (round(float(rgb[0]), 3), round(float(rgb[1]), 3), round(float(rgb[2]), 3), 1.0)
    names = ("white_lacquer", "white_sheet", "steel", "oak")
    return {**PALETTE, **{name: replace(PALETTE[name], rgba=rgba) for name in names}}


def object_name(category: str, generated: Generated) -> str:
    """Return the name of an object and of its URDF."""
    return generated.layout.name if generated.layout else words(category).replace(" ", "_")


def words(category: str) -> str:
    """Split the name of a category: ``WashingMachine`` becomes ``washing machine``."""
    return "".join(f" {c.lower()}" if c.isupper() else c for c in category).strip()


def image_trace(
    image: Pixels,
    mask: NDArray[np.bool_],
    probabilities: Mapping[str, float],
    front: ObjectFront,
    known: Evidence,
) -> tuple[TraceStep, ...]:
    """Return mask, categories and fit for the trace page."""
    shaded = image.copy()
    shaded[~mask] = (0.4 * shaded[~mask] + 0.6 * 255).astype(np.uint8)
    ranked = sorted(probabilities.items(), key=lambda item: -item[1])[:5]
    overlay = image.copy()
    uv, _ = front.fit.camera.project(front.fit.corners())
    scale = max(1, round(max(image.shape[:2]) / 400))
    for a, b in EDGES:
        ends = [(round(float(uv[k, 0])), round(float(uv[k, 1]))) for k in (a, b)]
        cv2.line(overlay, ends[0], ends[1], (220, 40, 40), scale, cv2.LINE_AA)
    parsed = front.image.copy()
    height, width = parsed.shape[:2]
    for part in front.parts:
        first = (round(part.left * width) + 1, round((1.0 - part.top) * height) + 1)
        second = (round(part.right * width) - 2, round((1.0 - part.bottom) * height) - 2)
        cv2.rectangle(parsed, first, second, (220, 40, 40), 2)
    return (
        TraceStep(
            title="Object and category",
            text="The object is the salient region of the image.",
            figures={name: round(value, 3) for name, value in ranked},
            images={"Object": png(shaded)},
        ),
        TraceStep(
            title="Box and camera",
            text="A box is fitted to outline and edges; the camera is estimated with it.",
            figures={
                "width over height": round(front.fit.width, 3),
                "depth over height": round(front.fit.depth, 3),
                "azimuth [deg]": round(float(np.degrees(front.fit.parameters["azimuth"])), 1),
                "elevation [deg]": round(float(np.degrees(front.fit.parameters["elevation"])), 1),
                "overlap of the outlines": round(front.fit.overlap, 3),
                "cost": round(front.fit.cost, 3),
            },
            images={"Fitted box": png(overlay), "Parts of the front": png(parsed)},
        ),
        TraceStep(
            title="Confidence",
            text="Probability that category and parts are right, from the evidence for them.",
            figures={
                "confidence": round(known.confidence(), 3),
                "category": round(known.category, 4),
                **({} if known.parts is None else {"parts of the front": round(known.parts, 4)}),
            },
        ),
    )
