"""Rest: what still moves in a clip once a joint explains its part.

Where that part is seen on its way the clip is held at its first frame; if enough goes on changing,
another joint moves there, at the same time or before or after.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.compositing import draw
from articulate.reconstruct.actors.geometric.image_pyramid import Scene, scene_of
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction

SWEPT_PX = 320
"""Longest side of the picture in which it is seen where a part comes [px]."""
SWEPT_POSES = 32
ROOM_PX = 4
"""So far beside where a part comes, edges and shadows of it may change [px of that picture]."""
LEAST_SHARE = 0.05
"""What is left must be this share of all that changes, and"""
LEAST_PX = 150
"""so many pixels."""


def rest_of(evidence: Evidence, prediction: Prediction) -> Evidence | None:
    """``evidence`` without what ``prediction`` explains; None if too little else moves.

    What moves before or behind the first part in the picture is held still with it and is lost.
    """
    moving = [joint for joint in prediction.joints if joint.kind != "fixed"]
    if not moving or evidence.video is None or evidence.camera is None or not evidence.placed:
        return None
    scene = scene_of(evidence.video, evidence.camera, evidence.parts)
    swept = np.zeros(scene.change.shape, dtype=np.bool_)
    for joint in moving:
        swept |= _swept(scene, joint, prediction)
    left = cv2.morphologyEx(
        (scene.change & ~swept).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3))
    )
    if left.sum() < max(LEAST_PX, LEAST_SHARE * scene.change.sum()):
        return None
    clip = evidence.video.copy()
    clip[:, swept] = clip[0][swept]
    return replace(evidence, video=clip, tracks=None)


def _swept(scene: Scene, joint: PredictedJoint, prediction: Prediction) -> NDArray[np.bool_]:
    """Where the part of ``joint``, and what is fixed to it, comes in the picture (H, W)."""
    names = [part.name for part in scene.parts]
    fixed = [j.part for j in prediction.joints if j.kind == "fixed" and j.parent == joint.part]
    parts = [names.index(name) for name in (joint.part, *fixed)]
    height, width = scene.change.shape
    look = replace(scene, box=(0, width, 0, height)).look(SWEPT_PX, 2)
    surface = look.surface.only(parts)
    low = 0.0 if joint.lower is None else joint.lower
    high = low + 2.0 * np.pi if joint.upper is None else joint.upper
    seen = np.zeros(look.shot.size, dtype=np.uint8)
    for T_o in joint.T_o(np.linspace(low, high, SWEPT_POSES)):
        seen |= (draw(surface, look.shot, T_o).face_ids >= 0).astype(np.uint8)
    seen = np.asarray(cv2.dilate(seen, np.ones((2 * ROOM_PX + 1, 2 * ROOM_PX + 1))), dtype=np.uint8)
    return np.asarray(
        cv2.resize(seen, (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.bool_
    )
