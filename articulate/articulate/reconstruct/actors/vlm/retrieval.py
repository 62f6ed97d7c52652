"""Retrieval of a library's object by a model.

::

    input ─► object detector ─► category selector ─► object selector (tournament) ─► object
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from articulate.errors import AssetError, UsageError
from articulate.reconstruct.actors.protocol import Evidence, TraceStep
from articulate.reconstruct.actors.vlm.answers import (
    DetectedObject,
    SelectedCategories,
    SelectedObject,
)
from articulate.reconstruct.actors.vlm.images import evidence_images, front_image
from articulate.reconstruct.actors.vlm.model import (
    CaptionedImage,
    CaptionedVideo,
    Content,
    Request,
    Turn,
)
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import schema_of
from articulate.reconstruct.part_set import PartSet
from articulate.render.encode_video import write_video

MAX_NUM_IMAGES = 8
"""Most candidates in one request of the object selector."""
MAX_CANDIDATES = 64
"""Most candidates of the tournament, evenly spread over the selected categories."""
VIDEO_FPS = 5.0
"""Frames per second that a model samples from a video."""


@dataclass(frozen=True, kw_only=True)
class LibraryObject:
    """An object of a library."""

    object_id: str
    category: str
    load: Callable[[], PartSet]
    """Read its parts; raises AssetError."""


def detect_object(session: ModelSession, evidence: Evidence) -> DetectedObject:
    """Describe the object of an image, video or text.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    return session.generate(detector_request(evidence), DetectedObject)


def detector_request(evidence: Evidence) -> Request:
    """Create the request for the object and its affordance."""
    content: list[Content] = []
    if evidence.video is not None:
        content.append(_video(evidence))
    else:
        content += evidence_images(evidence)
    if evidence.text:
        content.append(f"Description by the user: {evidence.text!r}.")
    return Request(
        title="object and affordance",
        system=prompt("object_detector").filled(),
        turns=(Turn("user", tuple(content)),),
        schema=schema_of(DetectedObject),
    )


def select_categories(
    session: ModelSession, detected: DetectedObject, categories: Sequence[str]
) -> tuple[str, ...]:
    """Return the categories of a library that fit, the best first.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    if len(categories) <= 1:
        return tuple(categories)

    def check(answer: SelectedCategories) -> str:
        unknown = [name for name in answer.categories if name not in categories]
        if unknown or not 1 <= len(answer.categories) <= 3:
            return f"categories must be one to three of: {', '.join(categories)}"
        return ""

    request = Request(
        title="category",
        system=prompt("category_selector").filled(categories=", ".join(categories)),
        turns=(Turn("user", (f"{detected.kind}. {detected.description}",)),),
        schema=schema_of(SelectedCategories),
    )
    return tuple(dict.fromkeys(session.generate(request, SelectedCategories, check).categories))


def select_object(
    session: ModelSession,
    evidence: Evidence,
    detected: DetectedObject,
    candidates: Sequence[LibraryObject],
    max_num_images: int = MAX_NUM_IMAGES,
) -> PartSet:
    """Return the parts of the most similar candidate, by a tournament.

    The best of each group of ``max_num_images`` candidates remains, until one is left. Candidates
    that cannot be read are omitted.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: No candidate can be read, or a request cannot be sent.
    """
    remaining = [part_set for part_set in map(_loaded, candidates) if part_set is not None]
    if not remaining:
        raise UsageError("no object of the selected categories can be read; give another --library")
    images = {part_set.name: front_image(part_set.meshes) for part_set in remaining}
    while len(remaining) > 1:
        groups = _groups(remaining, max_num_images)
        remaining = [_best_of(session, evidence, detected, group, images) for group in groups]
    return remaining[0]


def _best_of(
    session: ModelSession,
    evidence: Evidence,
    detected: DetectedObject,
    group: Sequence[PartSet],
    images: Mapping[str, bytes],
) -> PartSet:
    if len(group) == 1:
        return group[0]

    def check(answer: SelectedObject) -> str:
        good = 1 <= answer.candidate <= len(group)
        return "" if good else f"candidate must be 1 to {len(group)}"

    images_of = [CaptionedImage(f"candidate {k}", images[p.name]) for k, p in enumerate(group, 1)]
    text = f"{detected.description} {detected.affordance}"
    request = Request(
        title="most similar candidate",
        system=prompt("object_selector").filled(description=text),
        turns=(Turn("user", (*evidence_images(evidence)[:1], *images_of)),),
        schema=schema_of(SelectedObject),
    )
    return group[session.generate(request, SelectedObject, check).candidate - 1]


def retrieve(
    session: ModelSession, evidence: Evidence, library: Sequence[LibraryObject]
) -> tuple[PartSet, TraceStep]:
    """Return the parts of the library's object that is most similar to the input.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: No candidate can be read, or a request cannot be sent.
    """
    detected = detect_object(session, evidence)
    candidates = candidates_for(session, detected, library)
    found = select_object(session, evidence, detected, candidates)
    text = f"{detected.kind}: {detected.description} {detected.affordance}"
    return found, TraceStep(title=f"retrieved {found.source} of {len(candidates)}", text=text)


def candidates_for(
    session: ModelSession, detected: DetectedObject, library: Sequence[LibraryObject]
) -> list[LibraryObject]:
    """Return at most :data:`MAX_CANDIDATES` objects of the categories that fit."""
    categories = sorted({entry.category for entry in library})
    chosen = select_categories(session, detected, categories)
    found = [entry for name in chosen for entry in library if entry.category == name]
    step = max(1.0, len(found) / MAX_CANDIDATES)
    return [found[int(k * step)] for k in range(min(len(found), MAX_CANDIDATES))]


def _loaded(candidate: LibraryObject) -> PartSet | None:
    try:
        return candidate.load()
    except AssetError:
        return None


def _groups(items: Sequence[PartSet], size: int) -> list[Sequence[PartSet]]:
    """Split items into groups of nearly equal size, at most ``size``."""
    n = -(-len(items) // size)
    bounds = [round(k * len(items) / n) for k in range(n + 1)]
    return [items[a:b] for a, b in pairwise(bounds)]


def _video(evidence: Evidence) -> CaptionedVideo:
    """Encode the video; models that take no video receive its frames."""
    assert evidence.video is not None
    height, width = evidence.video.shape[1:3]
    times = evidence.times_s
    seconds = 0.0 if times is None or len(times) < 2 else float(times[-1] - times[0])
    fps = (len(evidence.video) - 1) / seconds if seconds > 0.0 else 24.0
    with tempfile.TemporaryDirectory() as folder:
        size = (width // 2 * 2, height // 2 * 2)
        frames = evidence.video[:, : size[1], : size[0]]
        path = write_video(Path(folder) / "input.mp4", frames, size, fps)
        content = path.read_bytes()
    images = tuple(evidence_images(evidence))
    return CaptionedVideo("the video", content, VIDEO_FPS, images)
