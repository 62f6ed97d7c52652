"""Images for models: frames of the video, parts in distinct colours, renderings of a prediction.

All images of one request have the same camera and size, so that they can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import cv2
import numpy as np

from articulate.reconstruct.actors.protocol import Evidence, Pixels, PredictedJoint
from articulate.reconstruct.actors.vlm.model import CaptionedImage
from articulate.reconstruct.actors.vlm.motion_traces import (
    part_traces,
    video_traces,
    with_traces,
)
from articulate.render.camera import Camera, front_camera
from articulate.render.image import png
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.scene import NO_PART, PartScene, segmentation_image, segmentation_palette
from articulate.transforms import Array

LONGEST_PX = 640
"""Longest side of an image; larger ones are scaled down."""
FRAMES = 8
"""Frames of a video that are sent, first and last included."""
TILE_PX = 320
"""Longest side of one image in a comparison."""
STEPS = 13
"""Positions of a prediction that are compared with each frame."""
COLUMNS = 4
MARGIN = 0.1
"""Margin around the object, as a share of its size."""
ENDS = (0, STEPS // 2, STEPS - 1)
"""Positions that are rendered without a video."""
ARROW = 0.25
"""Length of the arrows of the coordinate frame, as a share of the object's size."""
FAR_TURN_RAD = float(np.pi / 2)
"""Largest rendered position of a joint without limits."""
FULL_TURN_RAD = 2.0 * np.pi


def scale_down(image: Pixels, longest_px: int = LONGEST_PX) -> Pixels:
    """Scale an image (H, W, 3) down to the longest side [px]; smaller ones stay as they are."""
    factor = longest_px / max(image.shape[:2])
    if factor >= 1.0:
        return image
    size = (max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def frame_indices(n_frames: int) -> list[int]:
    """Return the indices of the frames that are sent, of ``n_frames``."""
    return [int(k) for k in np.unique(np.linspace(0, n_frames - 1, FRAMES).round())]


def evidence_images(evidence: Evidence) -> list[CaptionedImage]:
    """Return the frames of the video and the traces of moving points, or the image."""
    if evidence.video is not None:
        n = len(evidence.video)
        frames = [
            CaptionedImage(_caption(evidence, k, n), png(scale_down(evidence.video[k])))
            for k in frame_indices(n)
        ]
        traced = with_traces(evidence.video[0], video_traces(evidence), n - 1)
        caption = "traces of moving points over the entire video, on its first frame"
        return [*frames, CaptionedImage(caption, png(scale_down(traced)))]
    if evidence.image is not None:
        return [CaptionedImage("the image of the object", png(scale_down(evidence.image)))]
    return []


def parts_image(evidence: Evidence) -> CaptionedImage:
    """Render the parts in their colours, with the axes of the coordinate frame."""
    camera = camera_of(evidence)
    image = segmentation_image(PartScene(evidence.parts).rasterize(camera), len(evidence.parts))
    image = _with_axes(image, camera, evidence.parts)
    caption = "the parts at position 0, each in its colour, and the axes of the frame"
    return CaptionedImage(caption, png(image))


def placement_image(evidence: Evidence) -> CaptionedImage:
    """Render placed parts in their own colours, without axes."""
    image = PartScene(evidence.parts).render_image(camera_of(evidence))
    return CaptionedImage("the rendering of the assembled parts", png(image))


def front_image(parts: Sequence[PartMesh]) -> bytes:
    """Render parts from the front as a small PNG."""
    evidence = Evidence(modality="text", parts=tuple(parts))
    return png(scale_down(PartScene(parts).render_image(camera_of(evidence)), TILE_PX))


def colours_of(parts: Sequence[PartMesh]) -> dict[str, str]:
    """Return the colour of each part in that image, as #rrggbb, by name."""
    colours = segmentation_palette(len(parts))
    return {
        part.name: f"#{r:02x}{g:02x}{b:02x}"
        for part, (r, g, b) in zip(parts, colours.tolist(), strict=True)
    }


def camera_of(evidence: Evidence) -> Camera:
    """Return the camera of the evidence, scaled down; without one, a camera that sees all parts."""
    if evidence.camera is not None:
        longest = max(evidence.camera.width_px, evidence.camera.height_px)
        return evidence.camera.scaled(min(1.0, LONGEST_PX / longest))
    camera = front_camera(480, 360)
    low, high = joint_bounds(evidence.parts)
    size = max(float(np.linalg.norm(high - low)), 1e-6)
    T = camera.T_wc.copy()
    T[:3, 3] = 0.5 * (low + high) - camera.T_wc[:3, 2] * 0.6 * size / np.sin(np.radians(17.5))
    return camera.at(T)


def prediction_image(evidence: Evidence, joints: Sequence[PredictedJoint]) -> CaptionedImage:
    """Render the prediction next to the evidence, cropped around the object.

    Each frame of a video is compared with the position whose rendering is most similar. Without a
    video all joints are rendered closed, half open and open.
    """
    camera = camera_of(evidence)
    scene = PartScene(evidence.parts)
    joint_of = {joint.part: joint for joint in joints}
    sweep = [
        poses_at(evidence.parts, joint_of, float(share)) for share in np.linspace(0.0, 1.0, STEPS)
    ]
    ends = range(STEPS) if evidence.video is not None else ENDS
    poses = [sweep[k] for k in ends]
    crop = _around(scene, camera, poses)
    traces = part_traces(evidence.parts, sweep, camera)
    renderings = [
        crop(with_traces(scene.render_image(camera, T), traces, k))
        for k, T in zip(ends, poses, strict=True)
    ]
    size = (camera.width_px, camera.height_px)
    if evidence.video is not None:
        chosen = frame_indices(len(evidence.video))
        plain = [crop(scene.render_image(camera, T)) for T in poses]
        scale = np.array(size) / evidence.video.shape[2:0:-1]
        tracked = [trace * scale for trace in video_traces(evidence)]
        resized = [_resized(evidence.video[k], size) for k in chosen]
        similar = [_most_similar(crop(frame), plain) for frame in resized]
        frames = [
            crop(with_traces(frame, tracked, k)) for frame, k in zip(resized, chosen, strict=True)
        ]
        below = [renderings[k] for k in similar]
        rows = []
        for k in range(0, len(frames), COLUMNS):
            rows += [_row(frames[k : k + COLUMNS]), _row(below[k : k + COLUMNS])]
        caption = (
            "frames of the video, and the prediction below each row of frames; lines are traces of "
            "moving points"
        )
        return CaptionedImage(caption, png(_column(rows)))
    if evidence.image is None:
        return CaptionedImage("the prediction: closed, half open, open", png(_row(renderings)))
    image = crop(_resized(evidence.image, size))
    caption = "the image, and the prediction: closed, half open, open"
    return CaptionedImage(caption, png(_row([image, *renderings])))


def poses_at(
    parts: Sequence[PartMesh], joint_of: Mapping[str, PredictedJoint], share: float
) -> Array:
    """Return the motion (P, 4, 4) of each part at a share of all ranges, 0 lower, 1 upper."""
    found: dict[str, Array] = {}

    def of(name: str, seen: frozenset[str]) -> Array:
        if name not in found:
            joint = joint_of.get(name)
            if joint is None or name in seen:
                return np.eye(4)
            low, high = range_of(joint)
            above = np.eye(4) if joint.parent is None else of(joint.parent, seen | {name})
            found[name] = above @ joint.T_o(low + share * (high - low))
        return found[name]

    return np.stack([of(part.name, frozenset()) for part in parts])


def range_of(joint: PredictedJoint) -> tuple[float, float]:
    """Return the range of positions in which a joint is rendered [m or rad]."""
    if joint.lower is not None and joint.upper is not None:
        return joint.lower, joint.upper
    return 0.0, FULL_TURN_RAD if joint.kind == "continuous" else FAR_TURN_RAD


def _caption(evidence: Evidence, k: int, n: int) -> str:
    if evidence.times_s is None or len(evidence.times_s) <= k:
        return f"frame {k + 1} of {n}"
    return f"frame {k + 1} of {n}, at {float(evidence.times_s[k]):.2f} s"


def _resized(image: Pixels, size: tuple[int, int]) -> Pixels:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _around(scene: PartScene, camera: Camera, poses: Sequence[Array]) -> Callable[[Pixels], Pixels]:
    """Return a function that crops images to the parts in all poses and scales them down."""
    seen = np.zeros((camera.height_px, camera.width_px), dtype=np.bool_)
    for T in poses:
        seen |= scene.rasterize(camera, T).part_ids != NO_PART
    rows, columns = np.nonzero(seen)
    if not len(rows):
        return lambda image: scale_down(image, TILE_PX)
    margin = round(MARGIN * max(np.ptp(rows), np.ptp(columns))) + 1
    top, left = max(0, rows.min() - margin), max(0, columns.min() - margin)
    bottom, right = rows.max() + 1 + margin, columns.max() + 1 + margin
    return lambda image: scale_down(image[top:bottom, left:right], TILE_PX)


def _row(images: Sequence[Pixels]) -> Pixels:
    return np.concatenate(list(images), axis=1)


def _column(rows: Sequence[Pixels]) -> Pixels:
    """Stack rows, with shorter ones padded in white."""
    width = max(row.shape[1] for row in rows)
    padded = [
        np.pad(r, ((0, 0), (0, width - r.shape[1]), (0, 0)), constant_values=255) for r in rows
    ]
    return np.concatenate(padded, axis=0)


def _most_similar(frame: Pixels, images: Sequence[Pixels]) -> int:
    """Return the index of the image that differs least from a frame."""
    off = [np.abs(one.astype(np.float32) - frame.astype(np.float32)).mean() for one in images]
    return int(np.argmin(off))


def _with_axes(image: Pixels, camera: Camera, parts: Sequence[PartMesh]) -> Pixels:
    """Add arrows along x, y and z from the lowest, nearest corner of the object."""
    low, high = joint_bounds(parts)
    length = ARROW * float(np.linalg.norm(high - low))
    start = np.array([high[0], low[1], low[2]])
    uv, depth = camera.project(np.stack([start, *(start + length * np.eye(3))]))
    out = np.ascontiguousarray(image)
    if not (depth > 0.0).all():
        return out
    points = [(int(u), int(v)) for u, v in np.rint(uv)]
    for name, point in zip("xyz", points[1:], strict=True):
        cv2.arrowedLine(out, points[0], point, (0, 0, 0), 2, cv2.LINE_AA)
        cv2.putText(
            out, f"+{name}", point, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 2, cv2.LINE_AA
        )
    return out
