"""Play back a recorded episode: as a rerun recording or in MuJoCo's viewer."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.render.canvas import GEOM_GROUPS
from articulate.render.rerun_recording import rerun_name, rerun_pose, rerun_recording
from articulate.render.viewer import open_viewer
from articulate.simulator import mujoco
from articulate.transforms import Array

PAUSE_S = 1.0
"""Pause between two repetitions in the viewer [s]."""


@dataclass(frozen=True, kw_only=True)
class EpisodePlayback:
    """One recorded episode of a policy, one row for each control step."""

    title: str
    """Task, object and joint."""
    reason: str
    """Termination reason, one of :data:`articulate.task.episode_monitor.REASONS`."""
    model: mujoco.MjModel
    """Model to render, with the randomization of this episode applied."""
    qpos: Array
    """Joint positions of the model (T, nq) [m or rad]."""
    step_s: float
    """Control period [s]."""
    curves: Mapping[str, Array]
    """Curves over the control steps (T,), by names with units."""
    write_video: Callable[[Path], Path]
    """Write a video of the episode to a path and return that path."""


def write_rerun(path: Path, play: EpisodePlayback) -> Path:
    """Write an episode as a rerun recording (``.rrd``) and return its path.

    Raises:
        MissingError: rerun-sdk is not installed.
    """
    model, data = play.model, mujoco.MjData(play.model)
    with rerun_recording(path) as (rerun, stream):
        stream.log("title", rerun.TextDocument(f"{play.title}: {play.reason}"), static=True)
        for i in _visible_geoms(model):
            _log_geom(rerun, stream, model, i)
        for k, q in enumerate(play.qpos):
            stream.set_time("time", duration=k * play.step_s)
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            for b in range(1, model.nbody):
                pose = rerun_pose(rerun, data.xpos[b], data.xquat[b])
                stream.log(f"world/{_name(model, b)}", pose)
            for name, values in play.curves.items():
                stream.log(f"curves/{name}", rerun.Scalars(float(values[k])))
    return path


def _visible_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the visible geoms, without planes, which are infinite."""
    seen = np.isin(model.geom_group, GEOM_GROUPS) & (model.geom_rgba[:, 3] > 0.0)
    seen &= model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    return [int(i) for i in np.flatnonzero(seen)]


def _name(model: mujoco.MjModel, body: int) -> str:
    return rerun_name(model.body(body).name) or f"body_{body}"


def _log_geom(rerun: Any, stream: Any, model: mujoco.MjModel, i: int) -> None:
    """Log one geom as a child of its body."""
    kind, size = int(model.geom_type[i]), model.geom_size[i]
    rgba = (255 * _colour(model, i)).astype(np.uint8)
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_MESH:
        k = int(model.geom_dataid[i])
        v, f = int(model.mesh_vertadr[k]), int(model.mesh_faceadr[k])
        shape = rerun.Mesh3D(
            vertex_positions=model.mesh_vert[v : v + int(model.mesh_vertnum[k])],
            triangle_indices=model.mesh_face[f : f + int(model.mesh_facenum[k])],
            albedo_factor=rgba,
        )
    elif kind == types.mjGEOM_BOX:
        shape = rerun.Boxes3D(half_sizes=[size], colors=[rgba], fill_mode="solid")
    else:  # spheres, capsules and cylinders as ellipsoids
        half = size if kind == types.mjGEOM_ELLIPSOID else (size[0], size[0], size[1] or size[0])
        shape = rerun.Ellipsoids3D(half_sizes=[half], colors=[rgba], fill_mode="solid")
    body = int(model.geom_bodyid[i])
    path = f"world/{_name(model, body)}/geom_{i}" if body else f"world/geom_{i}"
    pose = rerun_pose(rerun, model.geom_pos[i], model.geom_quat[i])
    stream.log(path, pose, shape, static=True)


def _colour(model: mujoco.MjModel, i: int) -> Array:
    k = int(model.geom_matid[i])
    return np.asarray(model.mat_rgba[k] if k >= 0 else model.geom_rgba[i], dtype=np.float64)


def show_in_viewer(play: EpisodePlayback) -> None:
    """Show an episode in a loop in MuJoCo's viewer until its window is closed.

    Raises:
        MissingError: There is no display.
    """
    data = mujoco.MjData(play.model)
    with open_viewer(play.model, data) as window:
        while window.is_running():
            for q in play.qpos:
                begin = time.monotonic()
                data.qpos[:] = q
                mujoco.mj_forward(play.model, data)
                window.sync()
                time.sleep(max(0.0, play.step_s - (time.monotonic() - begin)))
                if not window.is_running():
                    return
            time.sleep(PAUSE_S)
