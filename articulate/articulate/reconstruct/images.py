"""Pictures for the trace: what was given, and the object closed and opened."""

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

SHOWN_PX = 240
"""Width of one picture in a row."""
SHOWN = 6
"""Frames in a row."""
TURN_SHOWN_RAD = float(np.pi / 2)
"""A joint without limits is shown turned by this."""


def frames_row(clip: Pixels) -> bytes:
    """Some frames of a clip (T, H, W, 3) side by side, as PNG."""
    keep = np.unique(np.linspace(0, len(clip) - 1, SHOWN).round().astype(int))
    return png(np.concatenate([_small(clip[k]) for k in keep], axis=1))


def view_of(meshes: Sequence[PartMesh], held: Mapping[str, PredictedJoint]) -> Camera:
    """A camera that sees the whole object, closed and opened."""
    boxes = [joint_bounds(meshes)]
    for share in (0.5, 1.0):
        poses = poses_at(meshes, held, share)
        boxes.append(joint_bounds([m.moved(T) for m, T in zip(meshes, poses, strict=True)]))
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    camera = front_camera(320, 240)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    away = -camera.T_wc[:3, 2]
    T = camera.T_wc.copy()
    T[:3, 3] = middle + away * 0.5 * size / np.sin(0.5 * np.radians(35.0))
    return camera.at(T)


def poses_at(meshes: Sequence[PartMesh], held: Mapping[str, PredictedJoint], share: float) -> Array:
    """What every joint at ``share`` of its way from 0 does to each part (P, 4, 4)."""
    found: dict[str, Array] = {}

    def of(name: str) -> Array:
        if name not in found:
            joint = held.get(name)
            if joint is None or joint.parent is None:
                found[name] = pose(np.zeros(3))
            else:
                found[name] = of(joint.parent) @ joint.T_o(share * far_end(joint))
        return found[name]

    return np.stack([of(mesh.name) for mesh in meshes])


def far_end(joint: PredictedJoint) -> float:
    """The limit that is farther from where the part was given."""
    if joint.lower is None or joint.upper is None:
        return 0.0 if joint.kind in {"fixed", "prismatic"} else TURN_SHOWN_RAD
    return joint.upper if abs(joint.upper) >= abs(joint.lower) else joint.lower


def opening(
    meshes: Sequence[PartMesh], held: Mapping[str, PredictedJoint], camera: Camera
) -> bytes:
    """A PNG: parts in colours of their own, then the object closed, half open and open."""
    scene = PartScene(meshes)
    pictures = [segmentation_image(scene.rasterize(camera), len(meshes))]
    for share in (0.0, 0.5, 1.0):
        pictures.append(scene.render_image(camera, poses_at(meshes, held, share)))
    return png(np.concatenate([_small(p) for p in pictures], axis=1))


def only(held: Mapping[str, PredictedJoint], part: str) -> dict[str, PredictedJoint]:
    """The same joints, all but that of ``part`` at rest."""
    return {
        name: joint
        if name == part
        else PredictedJoint(part=name, parent=joint.parent, kind="fixed")
        for name, joint in held.items()
    }


def _small(picture: Pixels) -> Pixels:
    height = max(1, round(picture.shape[0] * SHOWN_PX / picture.shape[1]))
    return np.asarray(
        cv2.resize(picture, (SHOWN_PX, height), interpolation=cv2.INTER_AREA), dtype=np.uint8
    )
