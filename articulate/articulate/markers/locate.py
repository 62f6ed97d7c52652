"""Pose of an object in the base frame of the robot, from markers in one or more images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import UsageError
from articulate.markers.camera_calibration import CameraCalibration, CameraPose
from articulate.markers.detection import Detections, MarkerDetector, Pixels
from articulate.markers.layout import MarkerLayout
from articulate.markers.tracker import ObjectTracker, describe_visibility
from articulate.task.floor_pose import FloorPose, ObjectLocation
from articulate.transforms import Array

MAX_LEAN_RAD = 0.12
"""Largest rotation of the object's vertical axis that is explained by errors [rad]."""
MAX_SPREAD_M = 0.02
"""Largest standard deviation of the position over the images [m]."""


def locate_object(
    images: Sequence[tuple[str, Pixels]],
    asset: Asset,
    joint: str,
    layout: MarkerLayout,
    calibration: CameraCalibration,
    camera_pose: CameraPose,
) -> ObjectLocation:
    """Return the pose of an object at rest and the position of a joint.

    Args:
        images: Names and images (H, W) or (H, W, 3), values 0 to 255, all of one scene.
        asset: Object.
        joint: Joint with markers on its part.
        layout: Markers on the object.
        calibration: Intrinsics of the camera.
        camera_pose: Pose of the camera in the base frame.

    Raises:
        UsageError: No marker is visible, the images disagree, or the object is not upright.
    """
    tracker = ObjectTracker(asset, joint, layout, calibration)
    detector = MarkerDetector(layout.dictionary)
    found: list[tuple[Array, float | None]] = []
    seen: set[int] = set()
    for name, image in images:
        calibration.check_image(image.shape[0], image.shape[1], name)
        detections: Detections = detector.detect(image)
        seen |= set(detections)
        tracker.reset()
        measured = tracker.process_detections(detections, 0.0)
        if measured is not None:
            found.append((camera_pose.T_wc @ measured.T_co, measured.q))
    if not found:
        raise UsageError(_missing(seen, layout, tracker, len(images)))
    poses = np.stack([T_wo for T_wo, _ in found])
    position = np.median(poses[:, :3, 3], axis=0)
    spread = float(np.linalg.norm(poses[:, :3, 3].std(axis=0)))
    if spread > MAX_SPREAD_M:
        raise UsageError(
            f"{asset.name}: its position differs by {1000 * spread:.0f} mm between the images; the "
            "object and the camera must be at rest"
        )
    up = poses[:, :3, 2].mean(axis=0)
    lean = float(np.arctan2(np.hypot(up[0], up[1]), up[2]))
    if lean > MAX_LEAN_RAD:
        raise UsageError(
            f"{asset.name}: measured {np.degrees(lean):.0f} degrees from upright; check the "
            "normals of the layout and the pose of the camera"
        )
    yaws = np.exp(1j * np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    yaw = float(np.angle(yaws.mean()))
    positions = [q for _, q in found if q is not None]
    x, y, z = (round(float(v), 4) for v in position)
    return ObjectLocation(
        object=asset.name,
        pose=FloorPose(x_m=x, y_m=y, yaw_deg=round(float(np.degrees(yaw)), 2), z_m=z),
        camera=calibration.camera,
        images=len(found),
        spread_m=round(spread, 5),
        spread_deg=round(float(np.degrees(np.angle(yaws / yaws.mean()).std())), 3),
        lean_deg=round(float(np.degrees(lean)), 2),
        joints={joint: round(float(np.median(positions)), 4)} if positions else {},
    )


def _missing(seen: set[int], layout: MarkerLayout, tracker: ObjectTracker, images: int) -> str:
    """Return the reason why the object was not found in any image."""
    known = sorted(seen & set(layout.ids))
    unknown = sorted(seen - set(layout.ids))
    if not seen:
        return (
            f"no marker of dictionary {layout.dictionary} in {images} images; check light, focus, "
            "and the dictionary of the layout"
        )
    if not known:
        return (
            f"markers {', '.join(map(str, unknown[:8]))} are visible, but none is in the layout "
            f"({', '.join(map(str, layout.ids))}); check their identifiers"
        )
    state = describe_visibility(tracker.visibility, layout)
    return (
        f"the object cannot be determined in {images} images: {state}; a marker on the body is "
        "needed, and all markers must be where the layout has them"
    )
