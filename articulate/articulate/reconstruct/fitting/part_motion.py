"""Explain the point tracks of a video by one joint of a fitted object.

The object is rendered with the joint at several positions. Between key frames, points on the moving
part are predicted to move with the joint, all others to rest. The sequence of positions with the
least error follows by dynamic programming (Viterbi).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.protocol import JointKind
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.render.scene import PartScene
from articulate.transforms import Array, apply, axis_angle_to_matrix, pose

STATES = 9
"""Positions of the joint that are compared."""
STEPS = 10
"""Pairs of successive key frames."""
MOST_POINTS = 700
"""Points of a pair of frames."""
WORK_PX = 200
"""Longest side of the images in which the object is rendered [px]."""
TOLERANCE_SHARE, TOLERANCE_PX = 0.5, 0.8
"""Error at which a prediction is no better than none: a share of the motion, plus a constant."""
NOISE_PX, LARGEST_PX = 0.8, 12.0
"""Motion up to which points count as resting, and from which they count equally [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Flow:
    """Points (N, 2) in one key frame and in the next [px]."""

    here: Array
    there: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class JointMotion:
    """A joint of a fitted object, in its frame (front at +x, z up)."""

    part: str
    """Name of the moving part."""
    kind: JointKind
    axis: Array
    """Unit axis (3,), positive when it opens."""
    pivot: Array
    """A point on the axis (3,)."""
    span: float
    """Far end of opening [rad or unit of the object]."""
    fitted: float
    """Position in the image to which the object is fitted [rad or unit of the object]."""
    moves: tuple[str, ...]
    """Names of all parts that move along, the part itself first."""

    def transform(self, position: float) -> Array:
        """Return the motion (4, 4) of the part from its closed pose."""
        if self.kind == "prismatic":
            return pose(position * self.axis)
        turn = axis_angle_to_matrix(self.axis, position)
        return pose(self.pivot - turn @ self.pivot, turn)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionMatch:
    """Agreement of a joint with the tracks."""

    cost: float
    """Error over that of a resting object, in [0, 1]."""
    positions: Array
    """Position of the joint at each key frame (``STEPS`` + 1,) [rad or unit of the object]."""


def flows_of(uv: Array, visible: NDArray[np.bool_], size_px: tuple[int, int]) -> tuple[Flow, ...]:
    """Return the motion of tracks between key frames, at the working resolution.

    Args:
        uv: Pixels (T, N, 2), without the motion of the camera.
        visible: Visibility (T, N).
        size_px: Width and height of the frames [px].
    """
    scale = WORK_PX / max(size_px)
    keys = np.unique(np.linspace(0, len(uv) - 1, STEPS + 1).round().astype(int))
    flows = []
    for first, second in itertools.pairwise(keys):
        names = np.flatnonzero(visible[first] & visible[second])
        names = names[:: max(1, -(-len(names) // MOST_POINTS))]
        flows.append(Flow(here=scale * uv[first, names], there=scale * uv[second, names]))
    return tuple(flows)


def match_motion(
    meshes: Sequence[PartMesh], joint: JointMotion, camera: Camera, flows: Sequence[Flow]
) -> MotionMatch:
    """Compare the motion of a joint with the tracks.

    Args:
        meshes: Parts of the object, closed, in its frame.
        joint: Joint of one of them.
        camera: Camera of the frame to which the tracks are stabilised.
        flows: Motion of the tracks.
    """
    camera = camera.scaled(WORK_PX / max(camera.width_px, camera.height_px))
    scene = PartScene(meshes)
    moving = [k for k, mesh in enumerate(meshes) if mesh.name in joint.moves]
    positions = np.linspace(0.0, joint.span, STATES)
    transforms = np.stack([joint.transform(float(q)) for q in positions])
    poses = np.broadcast_to(np.eye(4), (len(meshes), 4, 4)).copy()
    views = []
    for T in transforms:
        poses[moving] = T
        seen = scene.rasterize(camera, poses)
        views.append((np.isin(seen.part_ids, moving), seen.depth_m.astype(np.float64)))
    relative = transforms[None] @ np.linalg.inv(transforms)[:, None]
    costs = np.stack([_costs(flow, views, relative, camera) for flow in flows])
    resting = sum(float(_resting(flow).sum()) for flow in flows)
    path, total = _best_path(costs)
    return MotionMatch(cost=total / max(resting, 1e-9), positions=positions[path])


def _weights(motion: Array) -> Array:
    """Return the weight of each motion (..., 2): its length above the noise, up to a limit."""
    return np.asarray(np.clip(np.linalg.norm(motion, axis=-1) - NOISE_PX, 0.0, LARGEST_PX))


def _costs(
    flow: Flow, views: Sequence[tuple[NDArray[np.bool_], Array]], relative: Array, camera: Camera
) -> Array:
    """Return the error of each pair of positions (S, S) for one pair of frames."""
    seen = flow.there - flow.here
    resting = _resting(flow)
    at = np.rint(flow.here).astype(int)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < camera.width_px) & (at[:, 1] < camera.height_px)
    u, v = at[:, 0].clip(0, camera.width_px - 1), at[:, 1].clip(0, camera.height_px - 1)
    out = np.empty(relative.shape[:2])
    for k, (mask, depth) in enumerate(views):
        on = inside & mask[v, u]
        out[k] = resting[~on].sum()
        if on.any():
            points = camera.unproject(flow.here[on], depth[v[on], u[on]])
            there, _ = camera.project(np.stack([apply(T, points) for T in relative[k]]))
            out[k] += _errors(seen[on][None], np.nan_to_num(there - flow.here[on])).sum(axis=1)
    return out


def _resting(flow: Flow) -> Array:
    """Return the errors (N,) of predicting that no point moves."""
    return _errors(flow.there - flow.here, np.zeros_like(flow.here))


def _errors(seen: Array, predicted: Array) -> Array:
    """Return the weighted errors (...,) of predicted motions (..., 2)."""
    weight = np.maximum(_weights(seen), _weights(predicted))
    off = np.linalg.norm(seen - predicted, axis=-1)
    return np.asarray(weight * np.minimum(off / (TOLERANCE_SHARE * weight + TOLERANCE_PX), 1.0))


def _best_path(costs: Array) -> tuple[NDArray[np.int64], float]:
    """Return the sequence of states (T + 1,) with the least sum of costs (T, S, S)."""
    total = np.zeros(costs.shape[1])
    back = np.empty(costs.shape[:2], dtype=np.int64)
    for t, step in enumerate(costs):
        through = total[:, None] + step
        back[t] = through.argmin(axis=0)
        total = through.min(axis=0)
    path = [int(total.argmin())]
    for choice in back[::-1]:
        path.append(int(choice[path[-1]]))
    return np.array(path[::-1]), float(total.min())
