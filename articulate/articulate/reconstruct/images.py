"""Images of the trace: frames of the video, and the object closed and open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from articulate.reconstruct.actors.protocol import Pixels, PredictedJoint
from articulate.render.camera import Camera, front_camera
from articulate.render.image import png
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.scene import PartScene, segmentation_image
from articulate.transforms import Array, pose

TILE_PX = 240
"""Width of one image in a row."""
FRAMES = 6
"""Frames in a row."""
OPEN_TURN_RAD = float(np.pi / 2)
"""Rendered position of an open joint without limits."""


def frames_row(video: Pixels) -> bytes:
    """Return frames of a video (T, H, W, 3) side by side, as PNG."""
    keep = np.unique(np.linspace(0, len(video) - 1, FRAMES).round().astype(int))
    return png(np.concatenate([_small(video[k]) for k in keep], axis=1))


def view_camera(meshes: Sequence[PartMesh], part_joints: Mapping[str, PredictedJoint]) -> Camera:
    """Create a camera that sees the entire object, closed and open."""
    boxes = [joint_bounds(meshes)]
    for share in (0.5, 1.0):
        poses = poses_at(meshes, part_joints, share)
        boxes.append(joint_bounds([m.moved(T) for m, T in zip(meshes, poses, strict=True)]))
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    camera = front_camera(320, 240)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    away = -camera.T_wc[:3, 2]
    T = camera.T_wc.copy()
    T[:3, 3] = middle + away * 0.5 * size / np.sin(0.5 * np.radians(35.0))
    return camera.at(T)


def poses_at(
    meshes: Sequence[PartMesh], part_joints: Mapping[str, PredictedJoint], share: float
) -> Array:
    """Return the motion (P, 4, 4) of each part with all joints at a share of their travel."""
    found: dict[str, Array] = {}

    def of(name: str) -> Array:
        if name not in found:
            joint = part_joints.get(name)
            if joint is None or joint.parent is None:
                found[name] = pose(np.zeros(3))
            else:
                found[name] = of(joint.parent) @ joint.T_o(share * far_end(joint))
        return found[name]

    return np.stack([of(mesh.name) for mesh in meshes])


def far_end(joint: PredictedJoint) -> float:
    """Return the limit that is farther from 0 [m or rad]."""
    if joint.lower is None or joint.upper is None:
        return 0.0 if joint.kind in {"fixed", "prismatic"} else OPEN_TURN_RAD
    return joint.upper if abs(joint.upper) >= abs(joint.lower) else joint.lower


def opening_row(
    meshes: Sequence[PartMesh], part_joints: Mapping[str, PredictedJoint], camera: Camera
) -> bytes:
    """Return a PNG: parts in distinct colours, then the object closed, half open and open."""
    scene = PartScene(meshes)
    images = [segmentation_image(scene.rasterize(camera), len(meshes))]
    for share in (0.0, 0.5, 1.0):
        images.append(scene.render_image(camera, poses_at(meshes, part_joints, share)))
    return png(np.concatenate([_small(image) for image in images], axis=1))


def only_joint(part_joints: Mapping[str, PredictedJoint], part: str) -> dict[str, PredictedJoint]:
    """Return the joints with all but that of ``part`` fixed."""
    return {
        name: joint
        if name == part
        else PredictedJoint(part=name, parent=joint.parent, kind="fixed")
        for name, joint in part_joints.items()
    }


def _small(image: Pixels) -> Pixels:
    height = max(1, round(image.shape[0] * TILE_PX / image.shape[1]))
    return np.asarray(
        cv2.resize(image, (TILE_PX, height), interpolation=cv2.INTER_AREA), dtype=np.uint8
    )
