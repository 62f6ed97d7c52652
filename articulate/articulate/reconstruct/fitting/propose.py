"""Propose an object from one image, with hints from a text and a video."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.library.procedural.front_layout import MOVING, FrontLayout, FrontPanel, HingeSide
from articulate.library.procedural.materials import PALETTE, Material
from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.fitting.box_cost import EDGES
from articulate.reconstruct.fitting.categories import USUAL, Generated, generate
from articulate.reconstruct.fitting.confidence import MIN_CONFIDENCE, Evidence
from articulate.reconstruct.fitting.object_front import ObjectFront, find_front
from articulate.reconstruct.proposal import ObjectProposal, Source
from articulate.reconstruct.recognition.categories import category_probabilities, multiply
from articulate.reconstruct.recognition.mask import saliency
from articulate.render.image import png
from articulate.render.raster import Pixels

SALIENT = 0.5
"""Saliency above which a pixel belongs to the object."""
MIN_SHARE, MAX_SHARE = 0.01, 0.97
"""Smallest and largest share of an image that an object covers."""
CROP_MARGIN = 0.12
"""Margin of the crop around the object, as a share of its larger side."""
SURE_MOTION = 0.9
"""Probability of the joint type, given the category, above which it is not doubtful."""
MIN_VISIBLE = 0.5
"""Share of the front in the image below which the result is doubtful."""


@dataclass(frozen=True, kw_only=True)
class MotionHint:
    """Motion of the operated part in a video, in the image that is used."""

    p_revolute: float
    """Probability of a hinge."""
    side: HingeSide
    """Edge of the moving region that stays, for a hinge; empty if unknown."""
    box_px: tuple[float, float, float, float]
    """Left, right, top and bottom of the moving region [px]."""
    doubts: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Type of the joint."""
        return "revolute" if self.p_revolute >= 0.5 else "prismatic"


def propose(
    image: Pixels,
    *,
    hints: Mapping[str, float] | None = None,
    motion: MotionHint | None = None,
    height_m: float | None = None,
) -> ObjectProposal:
    """Propose an object with the category, proportions, parts and joints of an image.

    Args:
        image: Colours (H, W, 3).
        hints: Weights of categories from a text.
        motion: Motion in a video of the object.
        height_m: Height of the object [m], if known.

    Raises:
        UsageError: No object is found, or its category is not in the library.
    """
    mask = object_mask(image, motion)
    probabilities = _probabilities(image, mask, hints, motion)
    ranked = sorted(probabilities, key=lambda name: -probabilities[name])
    category = next(name for name in ranked if name in USUAL)
    front = find_front(image, mask, USUAL[category].prior)
    generated = generate(category, front, height_m)
    evidence: dict[str, Source] = {
        part.name: "image" if generated.layout else "category"
        for part in generated.parts
        if part.motion is not None
    }
    doubts: list[str] = []
    if motion is not None:
        motion = with_category(motion, category)
        doubts += motion.doubts
        generated, moved = _with_motion(generated, front, motion, category)
        evidence |= {part.name: evidence.get(part.name, "category") for part in generated.parts[1:]}
        if moved:
            evidence[moved] = "video"
        else:
            doubts.append(
                f"the part that moves in the video is {motion.kind}, and {_words(category)} of the "
                "library has no such part there"
            )
    known = Evidence(category=probabilities[category], parts=generated.certainty)
    doubts += _doubts(category, known, front)
    return ObjectProposal(
        name=_name(category, generated),
        category=category,
        parts=generated.parts,
        palette=_palette(front),
        confidence=known.confidence(),
        evidence=evidence,
        assumptions=generated.assumptions,
        doubts=tuple(doubts),
        trace=_trace(image, mask, probabilities, front, known),
    )


def with_category(motion: MotionHint, category: str) -> MotionHint:
    """Return the motion with the probability of a hinge given the category.

    A motion that both agree on is not doubtful.
    """
    slides = USUAL[category].slides
    hinge, slide = motion.p_revolute * (1.0 - slides), (1.0 - motion.p_revolute) * slides
    p = hinge / max(hinge + slide, 1e-9)
    sure = max(p, 1.0 - p) > SURE_MOTION
    return replace(motion, p_revolute=p, doubts=() if sure else motion.doubts)


def object_mask(image: Pixels, motion: MotionHint | None) -> NDArray[np.bool_]:
    """Return the pixels of the object (H, W): the largest salient region.

    With a motion, the salient region that the moving region touches, or the moving region itself.

    Raises:
        UsageError: Nothing is salient.
    """
    salient = (saliency(image) > SALIENT).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(salient)
    mask = np.zeros(image.shape[:2], dtype=np.bool_)
    if motion is not None:
        left, right, top, bottom = (round(value) for value in motion.box_px)
        window = (slice(max(0, top), bottom + 1), slice(max(0, left), right + 1))
        touched = [k for k in range(1, count) if (labels[window] == k).any()]
        mask |= np.isin(labels, touched)
        mask[window] = True
    elif count > 1:
        mask = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    share = float(mask.mean())
    if not share >= MIN_SHARE:
        raise UsageError(
            "no object is salient in the image; take the entire object against a calm background"
        )
    return mask


def crop_around(image: Pixels, mask: NDArray[np.bool_]) -> Pixels:
    """Return the region of an image (H, W, 3) around the object, with a margin."""
    rows, columns = np.nonzero(mask)
    left, right = np.percentile(columns, [1, 99])
    top, bottom = np.percentile(rows, [1, 99])
    margin = CROP_MARGIN * max(right - left, bottom - top)
    height, width = mask.shape
    return np.ascontiguousarray(
        image[
            max(0, int(top - margin)) : min(height, int(bottom + margin) + 1),
            max(0, int(left - margin)) : min(width, int(right + margin) + 1),
        ]
    )


def _probabilities(
    image: Pixels,
    mask: NDArray[np.bool_],
    hints: Mapping[str, float] | None,
    motion: MotionHint | None,
) -> dict[str, float]:
    """Combine image, text and motion."""
    found = category_probabilities(image, crop_around(image, mask))
    if hints:
        found = multiply(found, {name: hints.get(name, 1e-4) for name in {*found, *hints}})
    if motion is not None:
        p = motion.p_revolute
        slides = {name: USUAL[name].slides if name in USUAL else 0.2 for name in found}
        found = multiply(found, {n: p * (1.0 - s) + (1.0 - p) * s for n, s in slides.items()})
    return found


def _with_motion(
    generated: Generated, front: ObjectFront, motion: MotionHint, category: str
) -> tuple[Generated, str]:
    """Return the object whose moving part fits the video, and the name of that part."""
    if generated.layout is not None:
        layout, moved = _layout_with_motion(generated.layout, front, motion, category)
        return replace(generated, layout=layout, parts=tuple(layout.parts())), moved
    wanted = {"prismatic"} if motion.kind == "prismatic" else {"revolute", "continuous"}
    fitting = [p for p in generated.parts if p.motion is not None and p.motion.kind in wanted]
    return generated, fitting[0].name if fitting else ""


def _layout_with_motion(
    layout: FrontLayout, front: ObjectFront, motion: MotionHint, category: str
) -> tuple[FrontLayout, str]:
    """Give the panel at the moving region the observed kind and hinge."""
    best, most = -1, 0.0
    left, right, top, bottom = motion.box_px
    for k, panel in enumerate(layout.panels):
        if panel.kind not in MOVING:
            continue
        uv = _panel_corners(panel, front)
        wide = min(right, uv[:, 0].max()) - max(left, uv[:, 0].min())
        high = min(bottom, uv[:, 1].max()) - max(top, uv[:, 1].min())
        area = float(np.prod(uv.max(axis=0) - uv.min(axis=0)))
        overlap = max(0.0, wide) * max(0.0, high) / max(area, 1.0)
        if overlap > most:
            best, most = k, overlap
    moving = [k for k, panel in enumerate(layout.panels) if panel.kind in MOVING]
    if best < 0 and len(moving) == 1:
        best = moving[0]
    if best < 0:
        return layout, ""
    panel = layout.panels[best]
    if motion.kind == "prismatic":
        changed = replace(panel, kind="drawer", hinge="")
    elif panel.kind == "flap" or motion.side in {"top", "bottom"}:
        side = motion.side if motion.side in {"top", "bottom"} else panel.hinge
        changed = replace(panel, kind="flap", hinge=side or "bottom")
    else:
        side = motion.side if motion.side in {"left", "right"} else panel.hinge
        changed = replace(panel, kind="door", hinge=side or "right")
    name = changed.name if changed.kind == panel.kind and changed.name else f"moved_{changed.kind}"
    changed = replace(changed, name=name)
    panels = (*layout.panels[:best], changed, *layout.panels[best + 1 :])
    return replace(layout, panels=panels), changed.name


def _panel_corners(panel: FrontPanel, front: ObjectFront) -> NDArray[np.float64]:
    """Return the corners of a panel in the image (4, 2) [px]."""
    fit, base = front.fit, front.base_share
    edges = [(panel.left, panel.top), (panel.right, panel.top)]
    edges += [(panel.right, panel.bottom), (panel.left, panel.bottom)]
    points = [(fit.depth / 2, (u - 0.5) * fit.width, base + v * (1.0 - base)) for u, v in edges]
    uv, _ = fit.camera.project(np.array(points))
    return uv


def _doubts(category: str, known: Evidence, front: ObjectFront) -> list[str]:
    doubts = []
    if known.confidence() < MIN_CONFIDENCE:
        doubts.append(
            {
                "category": f"the category {_words(category)} has a probability of "
                f"{known.category:.0%}; name the object with --text",
                "parts": "number and kinds of the parts are uncertain; name them with --text, "
                'e.g. "a cabinet with two drawers above a door"',
            }[known.weakest()]
        )
    if front.visible < MIN_VISIBLE:
        doubts.append("the front is not entirely in the image; take it entirely, from the front")
    return doubts


def _palette(front: ObjectFront) -> dict[str, Material]:
    """Return the materials; those of bodies and fronts have the colour of the front."""
    above = front.image[: max(1, round((1.0 - front.base_share) * len(front.image)))]
    rgb = np.median(above.reshape(-1, 3), axis=0) / 255.0
    rgba = (round(float(rgb[0]), 3), round(float(rgb[1]), 3), round(float(rgb[2]), 3), 1.0)
    names = ("white_lacquer", "white_sheet", "steel", "oak")
    return {**PALETTE, **{name: replace(PALETTE[name], rgba=rgba) for name in names}}


def _name(category: str, generated: Generated) -> str:
    return generated.layout.name if generated.layout else _words(category).replace(" ", "_")


def _words(category: str) -> str:
    return "".join(f" {c.lower()}" if c.isupper() else c for c in category).strip()


def _trace(
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
