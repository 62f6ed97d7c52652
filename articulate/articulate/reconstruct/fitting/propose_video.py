"""Propose an object from a video in which one of its parts moves.

The object is fitted in the first and in the last frame, in one of which it is mostly closed. For
the most probable categories, every joint that the fitted object can have is compared with the point
tracks; the joint that explains them best is that of the video.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.fitting.categories import USUAL, generate
from articulate.reconstruct.fitting.confidence import MIN_MOTION, Evidence, MotionEvidence
from articulate.reconstruct.fitting.object_front import ObjectFront, find_front
from articulate.reconstruct.fitting.operated_parts import (
    OperatedPart,
    fitted_joint,
    operated_parts,
)
from articulate.reconstruct.fitting.part_motion import Flow, JointMotion, MotionMatch, match_motion
from articulate.reconstruct.fitting.propose import (
    front_palette,
    image_trace,
    object_mask,
    object_name,
    with_hints,
    words,
)
from articulate.reconstruct.proposal import ObjectProposal, Source
from articulate.reconstruct.recognition.categories import category_probabilities, multiply
from articulate.reconstruct.recognition.library_index import LibraryIndex
from articulate.render.image import png
from articulate.render.raster import Pixels
from articulate.render.scene import PartScene
from articulate.transforms import Array
from articulate.video.opening_direction import OPENINGS, opening_index

MOST_CATEGORIES = 5
"""Categories that are fitted."""
LEAST_CATEGORY = 0.03
"""Probability of a category over that of the most probable one below which it is not fitted."""
COST_SCALE, CATEGORY_COST_SCALE = 0.025, 0.06
"""Error of the motion that makes a joint of a category, and the category, less probable by a factor
of e."""
SHARE_WEIGHT = 0.5
"""Weight of the probability of a part among those of its category."""
OPENING_WEIGHT = 0.5
"""Weight of the direction in which the part opens, as seen from the tracks without the object."""
OPEN_SCALE = 0.5
"""Share of the range at which a joint is open in its frame, with the same effect."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VideoView:
    """Frame of a video in which the object is fitted."""

    image: Pixels
    """Colours (H, W, 3)."""
    moving_px: tuple[float, float, float, float]
    """Left, right, top and bottom of the moving region [px]."""
    flows: tuple[Flow, ...]
    """Motion of points between key frames, as seen from the camera of this frame."""
    key: int
    """Key frame of this view, 0 or -1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Candidate:
    """A joint of an object that may have moved, compared with the tracks."""

    view: int
    category: str
    front: ObjectFront
    operated: OperatedPart
    joint: JointMotion
    match: MotionMatch
    score: float
    """Logarithm of the probability among those of its category, up to a constant."""
    opening: float
    """The part of it that the direction of opening contributes."""

    @property
    def answer(self) -> tuple[str, str, tuple[float, ...]]:
        """Category, joint type and rounded axis."""
        axis = tuple(float(x) for x in np.round(self.joint.axis) + 0.0)
        return self.category, self.joint.kind, axis


def propose_from_video(
    views: Sequence[VideoView],
    p_revolute: float,
    *,
    openings: Sequence[float] = (0.0,) * OPENINGS,
    hints: Mapping[str, float] | None = None,
    height_m: float | None = None,
    library: LibraryIndex | None = None,
) -> ObjectProposal:
    """Propose an object with the category, proportions, parts and joints of a video.

    Args:
        views: First and last frame.
        p_revolute: Probability that the operated part rotates.
        openings: Logarithm of the likelihood of each opening (``OPENINGS``,).
        hints: Weights of categories from a text.
        height_m: Height of the object [m], if known.
        library: Renders of objects of known categories.

    Raises:
        UsageError: No object is found.
    """
    masks = [object_mask(view.image, view.moving_px) for view in views]
    probabilities = with_hints(_probabilities(views, masks, p_revolute, library), hints)
    candidates = [
        candidate
        for category in _categories(probabilities)
        for k, view in enumerate(views)
        for candidate in _candidates(
            k, view, masks[k], category, p_revolute=p_revolute, openings=openings, height_m=height_m
        )
    ]
    logs = _with_categories(candidates, probabilities)
    best = candidates[int(np.argmax(logs))]
    scores = np.exp(logs - logs.max())
    same = np.array([one.answer == best.answer for one in candidates])
    named = np.array([one.category == best.category for one in candidates])
    known = MotionEvidence(
        category=float(scores[named].sum() / scores.sum()) * _share(probabilities, candidates),
        joint=float(scores[same].sum() / scores[named].sum()),
        error=best.match.cost,
    )
    generated, front = best.operated.generated, best.front
    evidence: dict[str, Source] = {
        part.name: "image" if generated.layout else "category"
        for part in generated.parts
        if part.motion is not None
    }
    evidence[best.operated.part] = "video"
    image = views[best.view].image
    seen = Evidence(category=probabilities[best.category], parts=generated.certainty)
    trace = image_trace(image, masks[best.view], probabilities, front, seen)
    return ObjectProposal(
        name=object_name(best.category, generated),
        category=best.category,
        parts=generated.parts,
        palette=front_palette(front),
        confidence=known.confidence(),
        evidence=evidence,
        assumptions=generated.assumptions,
        doubts=tuple(_doubts(best, known)),
        trace=(*trace[:-1], _motion_step(best, known, image)),
    )


def _probabilities(
    views: Sequence[VideoView],
    masks: Sequence[NDArray[np.bool_]],
    p_revolute: float,
    library: LibraryIndex | None,
) -> dict[str, float]:
    """Combine the appearance in the views (mean of logarithms) and the type of the motion."""
    pairs = zip(views, masks, strict=True)
    seen = [category_probabilities(view.image, mask, library) for view, mask in pairs]
    mean = {n: float(np.prod([p[n] for p in seen]) ** (1.0 / len(seen))) for n in seen[0]}
    slides = {name: USUAL[name].slides if name in USUAL else 0.2 for name in mean}
    motion = {n: p_revolute * (1.0 - s) + (1.0 - p_revolute) * s for n, s in slides.items()}
    return multiply(mean, motion)


def _categories(probabilities: Mapping[str, float]) -> list[str]:
    ranked = sorted(probabilities, key=lambda name: -probabilities[name])
    ranked = [name for name in ranked if name in USUAL][:MOST_CATEGORIES]
    least = LEAST_CATEGORY * probabilities[ranked[0]]
    return [name for name in ranked if probabilities[name] >= least]


def _share(probabilities: Mapping[str, float], candidates: Sequence[_Candidate]) -> float:
    """Return the probability of the categories that are fitted."""
    return sum(probabilities[name] for name in sorted({one.category for one in candidates}))


def _with_categories(candidates: Sequence[_Candidate], probabilities: Mapping[str, float]) -> Array:
    """Return the logarithm of the probability of each candidate (N,), up to a constant."""
    out = np.array([one.score for one in candidates])
    names = np.array([one.category for one in candidates])
    for name in sorted(set(names)):
        same = np.flatnonzero(names == name)
        best = same[int(np.argmax(out[same]))]
        level = np.log(max(probabilities[name], 1e-9)) + candidates[best].opening
        level -= candidates[best].match.cost / CATEGORY_COST_SCALE
        out[same] += level - out[best]
    return out


def _candidates(
    number: int,
    view: VideoView,
    mask: NDArray[np.bool_],
    category: str,
    *,
    p_revolute: float,
    openings: Sequence[float],
    height_m: float | None,
) -> list[_Candidate]:
    """Return the joints of one category in one view, compared with the tracks."""
    front = find_front(view.image, mask, USUAL[category].prior)
    generated = generate(category, front, height_m)
    out = []
    for operated in operated_parts(category, generated, front, view.moving_px):
        meshes, joint = fitted_joint(operated, front.fit)
        match = match_motion(meshes, joint, front.fit.camera, view.flows)
        slides = joint.kind == "prismatic"
        opening = OPENING_WEIGHT * openings[opening_index(joint.kind, joint.axis)]
        opened = abs(float(match.positions[view.key]) - joint.fitted) / joint.span
        score = (
            SHARE_WEIGHT * np.log(max(operated.share, 1e-9))
            + np.log(max(1.0 - p_revolute if slides else p_revolute, 1e-3))
            - match.cost / COST_SCALE
            - opened / OPEN_SCALE
            + opening
        )
        out.append(
            _Candidate(
                view=number,
                category=category,
                front=front,
                operated=operated,
                joint=joint,
                match=match,
                score=float(score),
                opening=opening,
            )
        )
    return out


def _doubts(best: _Candidate, known: MotionEvidence) -> list[str]:
    if known.confidence() >= MIN_MOTION:
        return []
    reasons = {
        "category": f"the category {words(best.category)} has a probability of "
        f"{known.category:.0%}; name the object with --text",
        "joint": "it is uncertain which part moves in the video, and how (probability "
        f"{known.joint:.0%}); record it from another side, with the camera at rest",
        "motion": "no joint of the object explains the motion in the video; record the entire "
        "object, with the camera at rest",
    }
    return [reasons[known.weakest()]]


def _motion_step(best: _Candidate, known: MotionEvidence, image: Pixels) -> TraceStep:
    """Return the trace of the joint in the video."""
    meshes, joint = fitted_joint(best.operated, best.front.fit)
    camera = best.front.fit.camera
    poses = np.broadcast_to(np.eye(4), (len(meshes), 4, 4)).copy()
    widest = float(best.match.positions.max())
    poses[[mesh.name in joint.moves for mesh in meshes]] = joint.transform(widest)
    seen = PartScene(meshes).rasterize(camera, poses)
    moving = np.isin(seen.part_ids, [k for k, m in enumerate(meshes) if m.name in joint.moves])
    shaded = image.copy()
    shaded[moving] = (0.5 * shaded[moving] + [110.0, 20.0, 20.0]).astype(np.uint8)
    return TraceStep(
        title="Motion in the video",
        text=f"Of all joints that the object can have, that of {joint.part} explains the point "
        "tracks best. The image has the part at its widest position.",
        figures={
            "error of the motion": round(best.match.cost, 4),
            "widest position, as a share of the range": round(widest / joint.span, 2),
            "probability of the joint": round(known.joint, 4),
            "probability of the category": round(known.category, 4),
            "confidence": round(known.confidence(), 3),
        },
        images={"Moving part": png(shaded)},
    )
