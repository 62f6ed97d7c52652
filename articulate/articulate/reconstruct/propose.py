"""Propose an object from a query without parts: a text, an image, a video, or two of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np

from articulate.errors import UsageError
from articulate.library.procedural.front_layout import HingeSide
from articulate.reconstruct.fitting.propose import MotionHint
from articulate.reconstruct.fitting.propose import propose as propose_from_image
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.query import Query
from articulate.reconstruct.text.propose import propose as propose_from_text
from articulate.render.joint_video import Video
from articulate.render.raster import Pixels
from articulate.video.observe import Observation, observe_joint

OBSERVED_PX = 480
"""Longest side of the video in which the motion is observed [px]."""
OBSERVED_FRAMES = 72
NAMED = 1.0
"""Weight of the category that a text names."""


def propose_object(query: Query, *, height_m: float | None = None) -> ObjectProposal:
    """Return the object of a query without known parts.

    A text names the category, and the parts if it describes them; image and video then give
    proportions, colour and motion.

    Args:
        query: Input of the user.
        height_m: Height of the object [m], if known.

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
        image, motion = _from_video(query)
    else:
        assert query.image is not None
        image, motion = query.image, None
    found = propose_from_image(image, hints=hints, motion=motion, height_m=height_m)
    if text is None:
        return found
    return _with_text(found, text)


def _from_video(query: Query) -> tuple[Pixels, MotionHint]:
    """Return the frame in which the object is closed, and the observed motion in it."""
    assert query.video is not None
    assert query.times_s is not None
    small = _small(query)
    seen = observe_joint(small, query.description)
    scale = query.video.shape[2] / small.frames.shape[2]
    closed_first = seen.opening is not False
    image = query.video[0 if closed_first else -1]
    doubts = []
    if seen.doubtful:
        doubts.append(
            f"the motion is {seen.kind} with a confidence of {seen.confidence:.2f}; record it "
            "from another side, with the camera at rest"
        )
    left, right, top, bottom = (scale * value for value in seen.box_px)
    return image, MotionHint(
        p_revolute=seen.p_revolute,
        side=_side(seen),
        box_px=(left, right, top, bottom),
        doubts=tuple(doubts),
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


def _side(seen: Observation) -> HingeSide:
    sides: Mapping[str, HingeSide] = {
        "left": "left",
        "right": "right",
        "top": "top",
        "bottom": "bottom",
    }
    return sides.get(seen.side or "", "")


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
