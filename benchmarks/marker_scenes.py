"""Objects with markers, cameras and image sequences of :mod:`benchmarks.markers` and tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.assets.asset import Asset, Handle, Joint, Link, joint_motion
from articulate.markers.camera_calibration import CameraCalibration
from articulate.markers.detection import Detections
from articulate.markers.layout import SQUARE, Marker, MarkerLayout
from articulate.markers.synthetic_images import (
    ImageNoise,
    Occluder,
    Pixels,
    Plane,
    marker_plane,
    render_planes,
)
from articulate.render.camera import look_at
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import tool_pose
from articulate.transforms import Array, apply, axis_angle_to_matrix, inverse, pose

HD = CameraCalibration(
    camera="rendered",
    width_px=1280,
    height_px=720,
    matrix=((900.0, 0.0, 639.5), (0.0, 900.0, 359.5), (0.0, 0.0, 1.0)),
)
"""Camera of the accuracy figures: 1280x720 px, focal length 900 px, no distortion."""


FRONT = (1.0, 0.0, 0.0)
"""Normal of the front of the object."""


@dataclass(frozen=True, eq=False)
class MarkedObject:
    """Object with one joint, its marker layout and its pose before a camera."""

    asset: Asset
    joint: str
    layout: MarkerLayout
    T_wo: Array
    """Pose of the object in the base frame (4, 4) [m]."""
    T_wc: Array
    """Pose of the camera in the base frame (4, 4) [m]."""

    @property
    def T_co(self) -> Array:
        """Pose of the object in the camera frame (4, 4) [m]."""
        return inverse(self.T_wc) @ self.T_wo


def box_object(
    kind: Literal["slide", "hinge"], rng: np.random.Generator | None = None
) -> tuple[Asset, str]:
    """Return a cabinet with one drawer or one door that faces +x, and the name of its joint.

    Args:
        kind: Kind of the joint.
        rng: Generator of its size; None: the nominal one.
    """
    if rng is None:
        width, depth, height, travel = 0.5, 0.4, 0.7, 0.3
    else:
        width, depth = rng.uniform(0.35, 0.6), rng.uniform(0.3, 0.5)
        height, travel = rng.uniform(0.5, 0.9), rng.uniform(0.2, 0.35)
    front, half = 0.5 * depth, 0.5 * width
    body = Link(
        name="body",
        parent=None,
        pos_o=(0.0, 0.0, 0.0),
        quat_o=(1.0, 0.0, 0.0, 0.0),
        mass_kg=10.0,
        bounds_l=((-front, -half, 0.0), (front, half, height)),
    )
    part = Link(
        name="part",
        parent="body",
        pos_o=(0.0, 0.0, 0.0),
        quat_o=(1.0, 0.0, 0.0, 0.0),
        mass_kg=2.0,
        bounds_l=((front, -half, 0.35 * height), (front + 0.02, half, 0.75 * height)),
    )
    if kind == "slide":
        axis, pivot, far = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), travel
        handle_y = 0.0
    else:
        axis, pivot, far = (0.0, 0.0, 1.0), (front, half, 0.0), 1.5
        handle_y = -half + 0.06
    joint = Joint(
        name="part_joint",
        kind=kind,
        link="part",
        parent="body",
        axis_o=axis,
        pivot_o=pivot,
        lower=0.0,
        upper=far,
        closed=0.0,
        open=far,
        closed_rule="lower",
    )
    handle = Handle(
        name="handle",
        link="part",
        joint=joint.name,
        pos_l=(front + 0.05, handle_y, 0.6 * height),
        normal_l=(1.0, 0.0, 0.0),
        along_l=(0.0, 1.0, 0.0) if kind == "slide" else (0.0, 0.0, 1.0),
        extent=(0.12, 0.02, 0.02),
        kind="bar",
        source="name",
    )
    asset = Asset(
        name="box",
        category="StorageFurniture",
        links=(body, part),
        joints=(joint,),
        handles=(handle,),
        bounds_o=((-front, -half, 0.0), (front + 0.02, half, height)),
    )
    return asset, joint.name


def _plain(values: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return (x, y, z)


def marked_object(
    kind: Literal["slide", "hinge"],
    seed: int | None = None,
    *,
    size_m: float = 0.04,
    distance_m: float = 0.75,
) -> MarkedObject:
    """Return an object with a marker on its body and one on its part, seen from the side.

    Args:
        kind: Kind of the joint.
        seed: Seed of sizes, marker positions and camera; None: nominal ones.
        size_m: Side of the markers [m].
        distance_m: Distance of the camera from the markers [m].
    """
    rng = None if seed is None else np.random.default_rng(seed)
    asset, joint = box_object(kind, rng)
    jitter = np.zeros(8) if rng is None else rng.uniform(-1.0, 1.0, 8)
    _, high = asset.bounds_o
    front = high[0] - 0.02
    z = 0.6 * high[2] + 0.02 * jitter[0]
    on_part = (front + 0.02, 0.5 * high[1] + 0.02 * jitter[1], z)
    on_body = (front, 0.45 * high[1] + 0.02 * jitter[2], 0.88 * high[2])
    if kind == "hinge":
        on_part = (front + 0.02, 0.35 * high[1] + 0.02 * jitter[1], z)
    layout = MarkerLayout(
        markers=(
            Marker(id=0, link="body", size_m=size_m, center_m=_plain(on_body), normal=FRONT),
            Marker(id=1, link="part", size_m=size_m, center_m=_plain(on_part), normal=FRONT),
        )
    )
    yaw = np.pi + 0.2 * jitter[3]
    T_wo = pose(
        (0.9 + 0.05 * jitter[4], 0.05 * jitter[5], -0.1), axis_angle_to_matrix((0, 0, 1), yaw)
    )
    middle_o = 0.5 * (np.array(on_body) + np.array(on_part)) + np.array((0.08, 0.0, 0.0))
    middle_w = T_wo[:3, :3] @ middle_o + T_wo[:3, 3]
    azimuth, elevation = 0.75 + 0.2 * jitter[6], 0.55 + 0.2 * jitter[7]
    direction_o = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    eye_w = middle_w + distance_m * (T_wo[:3, :3] @ direction_o)
    return MarkedObject(asset, joint, layout, T_wo, look_at(eye_w, middle_w))


def marker_planes(thing: MarkedObject, q: float, layout: MarkerLayout | None = None) -> list[Plane]:
    """Return the prints in the camera frame with the joint at ``q`` [m or rad].

    Args:
        thing: Object, camera and joint.
        q: Position of the joint.
        layout: True layout, if the object's own has errors of measurement.
    """
    layout = layout or thing.layout
    joint = thing.asset.joint(thing.joint)
    motion = joint_motion(joint, q) @ inverse(joint_motion(joint, joint.closed))
    planes = []
    for marker in layout.markers:
        moved = motion if marker.link == joint.link else np.eye(4)
        planes.append(marker_plane(layout.dictionary, marker, thing.T_co @ moved @ marker.T_om()))
    return planes


def projected_corners(
    thing: MarkedObject, q: float, rng: np.random.Generator, *, sigma_px: float = 0.1
) -> Detections:
    """Return the corners (4, 2) of each marker by identifier, with noise [px], without an image.

    Args:
        thing: Object, camera and joint.
        q: Position of the joint [m or rad].
        rng: Generator of the noise.
        sigma_px: Standard deviation of the noise of a coordinate [px].
    """
    out: Detections = {}
    for marker, plane in zip(thing.layout.markers, marker_planes(thing, q), strict=True):
        exact = HD.projected(apply(plane.T_cp, marker.size_m * SQUARE))
        out[marker.id] = exact + sigma_px * rng.normal(size=(4, 2))
    return out


def render_object(
    thing: MarkedObject,
    q: float,
    rng: np.random.Generator,
    *,
    calibration: CameraCalibration = HD,
    noise: ImageNoise | None = None,
    covered: tuple[int, ...] = (),
) -> Pixels:
    """Return a gray image (H, W) of the markers, values 0 to 255.

    Args:
        thing: Object, camera and joint.
        q: Position of the joint [m or rad].
        rng: Generator of background and noise.
        calibration: Intrinsics of the camera.
        noise: Imperfections of the image; None: the defaults.
        covered: Identifiers of markers that something covers by half.
    """
    planes = marker_planes(thing, q)
    occluders = []
    for marker, plane in zip(thing.layout.markers, planes, strict=True):
        if marker.id in covered:
            corners = plane.T_cp[:3, 3] + 0.03 * (
                plane.T_cp[:3, 0] * np.array([[0.0], [1.2], [1.2], [0.0]])
                + plane.T_cp[:3, 1] * np.array([[1.2], [1.2], [-1.2], [-1.2]])
            )
            occluders.append(Occluder(calibration.projected(corners)))
    return render_planes(calibration, planes, rng, noise=noise, occluders=occluders)


def reach(q: Array, pos_w: Array) -> Array:
    """Return joint angles (7,) [rad] with the tool at ``pos_w`` (3,) [m]; any orientation.

    The search begins at ``q`` (7,), then at random angles.

    Raises:
        ValueError: The position is out of reach: the arm would not hold the handle.
    """
    low, high = PANDA.bounds()
    steps = 1e-6 * np.concatenate([np.zeros((1, 7)), np.eye(7)])
    rng = np.random.default_rng(0)
    for _ in range(20):
        for _ in range(60):
            reached = tool_pose(PANDA, q + steps)[:, :3, 3]
            error = pos_w - reached[0]
            if np.linalg.norm(error) < 1e-5:
                return q
            J = (reached[1:] - reached[0]).T / 1e-6
            error *= min(1.0, 0.1 / float(np.linalg.norm(error)))
            q = np.clip(q + J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(3), error), low, high)
        q = rng.uniform(low, high)
    raise ValueError(f"the handle is out of reach by {np.linalg.norm(error):.4f} m")
