"""Pictures for models: frames of the clip, parts in colours of their own, the prediction beside it.

All pictures of one question have the same frame and size, so that they can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import cv2
import numpy as np

from articulate.reconstruct.actors.protocol import Evidence, Pixels, PredictedJoint
from articulate.reconstruct.actors.vlm.model import Picture
from articulate.render.camera import Camera, front_camera
from articulate.render.image import png
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.scene import NOTHING, PartScene, segmentation_image, segmentation_palette
from articulate.transforms import Array

LONGEST_PX = 640
"""Larger pictures are made smaller."""
FRAMES = 8
"""Frames of a clip that are sent, first and last included."""
SHOWN_PX = 320
"""Longest side of one picture of those that are compared."""
STEPS = 13
"""Positions of a prediction that are tried for each frame."""
IN_A_ROW = 4
MARGIN = 0.1
"""Room around the object, as a share of its size."""
SHARES = (0.0, 0.5, 1.0)
"""Positions between the limits that are shown where there is no clip."""
ARROW = 0.25
"""Length of the arrows of the frame, as a share of the object's size."""
FAR_TURN_RAD = float(np.pi / 2)
"""A joint without limits is shown up to here where there is no clip."""
FULL_TURN_RAD = 2.0 * np.pi


def shown(picture: Pixels, longest_px: int = LONGEST_PX) -> Pixels:
    """The picture, made smaller if it is larger than models are sent."""
    factor = longest_px / max(picture.shape[:2])
    if factor >= 1.0:
        return picture
    size = (max(1, round(picture.shape[1] * factor)), max(1, round(picture.shape[0] * factor)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def frame_indices(n_frames: int) -> list[int]:
    """Which frames of a clip are sent."""
    return [int(k) for k in np.unique(np.linspace(0, n_frames - 1, FRAMES).round())]


def evidence_pictures(evidence: Evidence) -> list[Picture]:
    """What was given: frames of the clip, or the picture."""
    if evidence.video is not None:
        n = len(evidence.video)
        return [
            Picture(_caption(evidence, k, n), png(shown(evidence.video[k])))
            for k in frame_indices(n)
        ]
    if evidence.image is not None:
        return [Picture("the picture of the object", png(shown(evidence.image)))]
    return []


def parts_picture(evidence: Evidence) -> Picture:
    """The parts where they are given, each in its colour, with the axes of the frame."""
    camera = camera_of(evidence)
    picture = segmentation_image(PartScene(evidence.parts).rasterize(camera), len(evidence.parts))
    drawn = _with_axes(picture, camera, evidence.parts)
    caption = "the parts where they are given, each in its colour, and the axes of the frame"
    return Picture(caption, png(drawn))


def colours_of(parts: Sequence[PartMesh]) -> dict[str, str]:
    """Colour of each part in that picture, as #rrggbb, by name."""
    colours = segmentation_palette(len(parts))
    return {
        part.name: f"#{r:02x}{g:02x}{b:02x}"
        for part, (r, g, b) in zip(parts, colours.tolist(), strict=True)
    }


def camera_of(evidence: Evidence) -> Camera:
    """The camera of clip or picture, small enough; without one, one that sees all parts."""
    if evidence.camera is not None:
        longest = max(evidence.camera.width_px, evidence.camera.height_px)
        return evidence.camera.scaled(min(1.0, LONGEST_PX / longest))
    camera = front_camera(480, 360)
    low, high = joint_bounds(evidence.parts)
    size = max(float(np.linalg.norm(high - low)), 1e-6)
    T = camera.T_wc.copy()
    T[:3, 3] = 0.5 * (low + high) - camera.T_wc[:3, 2] * 0.6 * size / np.sin(np.radians(17.5))
    return camera.at(T)


def prediction_picture(evidence: Evidence, joints: Sequence[PredictedJoint]) -> Picture:
    """The prediction, drawn as what was given is, beside it; cut out around the object.

    For each frame of a clip the position is shown at which the prediction looks most like the
    frame. Where there is no clip all joints are shown closed, half open and open.
    """
    camera = camera_of(evidence)
    scene = PartScene(evidence.parts)
    held = {joint.part: joint for joint in joints}
    shares = SHARES if evidence.video is None else np.linspace(0.0, 1.0, STEPS)
    poses = [poses_at(evidence.parts, held, float(share)) for share in shares]
    cut = _around(scene, camera, poses)
    drawn = [cut(scene.render_image(camera, T)) for T in poses]
    size = (camera.width_px, camera.height_px)
    if evidence.video is not None:
        chosen = frame_indices(len(evidence.video))
        frames = [cut(_resized(evidence.video[k], size)) for k in chosen]
        below = [_likest(frame, drawn) for frame in frames]
        rows = []
        for k in range(0, len(frames), IN_A_ROW):
            rows += [_row(frames[k : k + IN_A_ROW]), _row(below[k : k + IN_A_ROW])]
        caption = "frames of the clip, and below each row of them the prediction"
        return Picture(caption, png(_column(rows)))
    if evidence.image is None:
        return Picture("the prediction: closed, half open, open", png(_row(drawn)))
    given = cut(_resized(evidence.image, size))
    caption = "the picture, and the prediction: closed, half open, open"
    return Picture(caption, png(_row([given, *drawn])))


def poses_at(parts: Sequence[PartMesh], held: Mapping[str, PredictedJoint], share: float) -> Array:
    """What every joint at a share of its range, 0 lower, 1 upper, does to each part (P, 4, 4)."""
    found: dict[str, Array] = {}

    def of(name: str, seen: frozenset[str]) -> Array:
        if name not in found:
            joint = held.get(name)
            if joint is None or name in seen:
                return np.eye(4)
            low, high = limits_shown(joint)
            above = np.eye(4) if joint.parent is None else of(joint.parent, seen | {name})
            found[name] = above @ joint.T_o(low + share * (high - low))
        return found[name]

    return np.stack([of(part.name, frozenset()) for part in parts])


def limits_shown(joint: PredictedJoint) -> tuple[float, float]:
    """Between which positions a joint is shown [m or rad]."""
    if joint.lower is not None and joint.upper is not None:
        return joint.lower, joint.upper
    return 0.0, FULL_TURN_RAD if joint.kind == "continuous" else FAR_TURN_RAD


def _caption(evidence: Evidence, k: int, n: int) -> str:
    if evidence.times_s is None or len(evidence.times_s) <= k:
        return f"frame {k + 1} of {n}"
    return f"frame {k + 1} of {n}, at {float(evidence.times_s[k]):.2f} s"


def _resized(picture: Pixels, size: tuple[int, int]) -> Pixels:
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _around(scene: PartScene, camera: Camera, poses: Sequence[Array]) -> Callable[[Pixels], Pixels]:
    """Cuts out of a picture where the parts are seen in any of the poses, and makes it small."""
    seen = np.zeros((camera.height_px, camera.width_px), dtype=np.bool_)
    for T in poses:
        seen |= scene.rasterize(camera, T).part_ids != NOTHING
    rows, columns = np.nonzero(seen)
    if not len(rows):
        return lambda picture: shown(picture, SHOWN_PX)
    margin = round(MARGIN * max(np.ptp(rows), np.ptp(columns))) + 1
    top, left = max(0, rows.min() - margin), max(0, columns.min() - margin)
    bottom, right = rows.max() + 1 + margin, columns.max() + 1 + margin
    return lambda picture: shown(picture[top:bottom, left:right], SHOWN_PX)


def _row(pictures: Sequence[Pixels]) -> Pixels:
    return np.concatenate(list(pictures), axis=1)


def _column(rows: Sequence[Pixels]) -> Pixels:
    """Rows below each other, the shorter ones filled up with white."""
    width = max(row.shape[1] for row in rows)
    whole = [
        np.pad(r, ((0, 0), (0, width - r.shape[1]), (0, 0)), constant_values=255) for r in rows
    ]
    return np.concatenate(whole, axis=0)


def _likest(frame: Pixels, drawn: Sequence[Pixels]) -> Pixels:
    """The one of some pictures that differs least from a frame."""
    off = [np.abs(one.astype(np.float32) - frame.astype(np.float32)).mean() for one in drawn]
    return drawn[int(np.argmin(off))]


def _with_axes(picture: Pixels, camera: Camera, parts: Sequence[PartMesh]) -> Pixels:
    """The picture with arrows along x, y and z from the object's lowest, nearest corner on."""
    low, high = joint_bounds(parts)
    length = ARROW * float(np.linalg.norm(high - low))
    start = np.array([high[0], low[1], low[2]])
    uv, depth = camera.project(np.stack([start, *(start + length * np.eye(3))]))
    drawn = np.ascontiguousarray(picture)
    if not (depth > 0.0).all():
        return drawn
    points = [(int(u), int(v)) for u, v in np.rint(uv)]
    for name, point in zip("xyz", points[1:], strict=True):
        cv2.arrowedLine(drawn, points[0], point, (0, 0, 0), 2, cv2.LINE_AA)
        cv2.putText(
            drawn, f"+{name}", point, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 2, cv2.LINE_AA
        )
    return drawn
