"""Propose an object from a query without parts: a text, an image, a video, or two of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np

from articulate.errors import UsageError
from articulate.reconstruct.fitting.part_motion import flows_of
from articulate.reconstruct.fitting.propose import propose as propose_from_image
from articulate.reconstruct.fitting.propose_video import VideoView, propose_from_video
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.query import Query
from articulate.reconstruct.recognition.library_index import LibraryIndex
from articulate.reconstruct.text.description import SeenSize
from articulate.reconstruct.text.propose import propose as propose_from_text
from articulate.render.joint_video import Video
from articulate.video.observe import observe_tracks, track_motion

OBSERVED_PX = 480
"""Longest side of the video in which the motion is observed [px]."""
OBSERVED_FRAMES = 72
NAMED = 1.0
"""Weight of the category that a text names."""


def propose_object(
    query: Query, *, height_m: float | None = None, library: LibraryIndex | None = None
) -> ObjectProposal:
    """Return the object of a query without known parts.

    A text names the category, and the parts if it describes them; image and video then give
    proportions, colour and motion.

    Args:
        query: Input of the user.
        height_m: Height of the object [m], if known.
        library: Renders of objects of known categories, for the category of an image or video.

    Raises:
        UsageError: No object is found in the input.
    """
    text = propose_from_text(query.text) if query.text else None
    if query.image is None and query.video is None:
        if text is None:
            raise UsageError("no text, image or video is given")
        return text
    hints = None if text is None else {text.category: NAMED}
    if query.video is not None:
        found = _from_video(query, hints, height_m, library)
    else:
        assert query.image is not None
        found = propose_from_image(query.image, hints=hints, height_m=height_m, library=library)
    if text is None:
        return found
    seen = _seen_size(found, height_m)
    return _with_text(found, text if seen is None else propose_from_text(query.text, seen))


def _seen_size(found: ObjectProposal, height_m: float | None) -> SeenSize | None:
    """Return the proportions of the body of a proposal; None without one."""
    solids = [solid for own in found.parts[0].shapes for solid in own.solids]
    if not solids:
        return None
    depth, width, height = np.ptp(np.concatenate([s.mesh()[0] for s in solids]), axis=0)
    return SeenSize(width=width / height, depth=depth / height, height_m=height_m)


def _from_video(
    query: Query,
    hints: Mapping[str, float] | None,
    height_m: float | None,
    library: LibraryIndex | None,
) -> ObjectProposal:
    """Return the object whose joint explains the motion in the video."""
    assert query.video is not None
    small = _small(query)
    motion = track_motion(small, query.description)
    seen = observe_tracks(motion, query.description, groupings=1)
    scale = query.video.shape[2] / small.frames.shape[2]
    left, right, top, bottom = seen.box_px
    corners = np.array([[left, top, 1.0], [right, top, 1.0], [right, bottom, 1.0]])
    corners = np.vstack([corners, [left, bottom, 1.0]])
    views = []
    for key in (0, -1):
        uv = corners @ np.linalg.inv(motion.camera[key]).T
        uv = scale * uv[:, :2] / uv[:, 2:]
        (left, top), (right, bottom) = uv.min(axis=0), uv.max(axis=0)
        views.append(
            VideoView(
                image=query.video[key],
                moving_px=(float(left), float(right), float(top), float(bottom)),
                flows=flows_of(motion.seen_from(key), motion.visible, motion.size_px),
                key=key,
            )
        )
    return propose_from_video(
        views,
        seen.p_revolute,
        openings=seen.openings,
        hints=hints,
        height_m=height_m,
        library=library,
    )


def _small(query: Query) -> Video:
    """Return the video at the resolution in which the motion is observed."""
    assert query.video is not None
    assert query.times_s is not None
    count = min(OBSERVED_FRAMES, len(query.video))
    picks = np.unique(np.linspace(0, len(query.video) - 1, count).round().astype(int))
    height, width = query.video.shape[1:3]
    factor = min(1.0, OBSERVED_PX / max(height, width))
    size = (round(width * factor), round(height * factor))
    frames = [cv2.resize(query.video[k], size, interpolation=cv2.INTER_AREA) for k in picks]
    return Video(frames=np.stack(frames).astype(np.uint8), times_s=query.times_s[picks])


def _with_text(found: ObjectProposal, text: ObjectProposal) -> ObjectProposal:
    """Combine the proposal of an image or video with that of a text of the same category."""
    doubts = [d for d in found.doubts if "has a probability" not in d]
    described = "text" in text.evidence.values()
    moved = [name for name, source in found.evidence.items() if source == "video"]
    if not described or moved:
        return replace(found, doubts=(*doubts, *text.doubts), confidence=max(found.confidence, 0.9))
    return replace(
        text,
        palette={**text.palette, **found.palette},
        doubts=(*text.doubts, *(d for d in doubts if "kinds of the parts" not in d)),
        trace=(*text.trace, *found.trace),
    )
