"""An episode to be watched: as a recording for rerun, or in MuJoCo's own window."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import MissingError
from articulate.files import atomic_write
from articulate.render.canvas import GEOM_GROUPS
from articulate.simulator import mujoco
from articulate.transforms import Array

APPLICATION = "articulate"
PAUSE_S = 1.0
"""Between two showings in a window [s]."""


@dataclass(frozen=True, kw_only=True)
class Play:
    """What a policy did in one episode, tick by tick."""

    title: str
    """Task, object and joint."""
    reason: str
    """How it ended: one of :data:`articulate.task.episode_monitor.REASONS`."""
    model: mujoco.MjModel
    """What is drawn, as it was in this episode."""
    qpos: Array
    """Positions of the model (T, nq)."""
    tick_s: float
    """Time between two rows [s]."""
    series: Mapping[str, Array]
    """Curves over the ticks (T,), by names with units."""
    film: Callable[[Path], Path]
    """Writes a clip of it."""


def write_rrd(path: Path, play: Play) -> Path:
    """Write ``play`` as a recording that rerun opens, whole or not at all, and return its path.

    Raises:
        MissingError: rerun-sdk is not installed.
    """
    try:
        import rerun  # heavy, and wanted for this alone
    except ImportError:
        raise MissingError(
            f"{path}: .rrd needs rerun-sdk, which is not installed; "
            'run: pip install "articulate-robots[watch]", or end --out in .mp4'
        ) from None
    model, data = play.model, mujoco.MjData(play.model)
    with atomic_write(path) as temporary:
        stream = rerun.RecordingStream(APPLICATION, send_properties=False)
        stream.save(temporary)
        stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("title", rerun.TextDocument(f"{play.title}: {play.reason}"), static=True)
        for i in _drawn(model):
            _log_geom(rerun, stream, model, i)
        for k, q in enumerate(play.qpos):
            stream.set_time("time", duration=k * play.tick_s)
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            for b in range(1, model.nbody):
                w, *xyz = data.xquat[b]
                pose = rerun.Transform3D(
                    translation=data.xpos[b], quaternion=rerun.Quaternion(xyzw=[*xyz, w])
                )
                stream.log(f"world/{_name(model, b)}", pose)
            for name, values in play.series.items():
                stream.log(f"curves/{name}", rerun.Scalars(float(values[k])))
        stream.flush()
        stream.disconnect()
    return path


def _drawn(model: mujoco.MjModel) -> list[int]:
    """Geoms that are drawn: the visible ones, without planes, which have no end."""
    seen = np.isin(model.geom_group, GEOM_GROUPS) & (model.geom_rgba[:, 3] > 0.0)
    seen &= model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    return [int(i) for i in np.flatnonzero(seen)]


def _name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name.replace("/", "_") or f"body_{body}"


def _log_geom(rerun: Any, stream: Any, model: mujoco.MjModel, i: int) -> None:
    """One geom below its body, which moves it."""
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
    else:  # spheres, capsules, cylinders: near enough
        half = size if kind == types.mjGEOM_ELLIPSOID else (size[0], size[0], size[1] or size[0])
        shape = rerun.Ellipsoids3D(half_sizes=[half], colors=[rgba], fill_mode="solid")
    body = int(model.geom_bodyid[i])
    path = f"world/{_name(model, body)}/geom_{i}" if body else f"world/geom_{i}"
    w, *xyz = model.geom_quat[i]
    pose = rerun.Transform3D(
        translation=model.geom_pos[i], quaternion=rerun.Quaternion(xyzw=[*xyz, w])
    )
    stream.log(path, pose, shape, static=True)


def _colour(model: mujoco.MjModel, i: int) -> Array:
    k = int(model.geom_matid[i])
    return np.asarray(model.mat_rgba[k] if k >= 0 else model.geom_rgba[i], dtype=np.float64)


def show(play: Play) -> None:
    """Show ``play`` again and again in MuJoCo's window, until it is closed.

    Raises:
        MissingError: There is no display.
    """
    displays = [name for name in ("DISPLAY", "WAYLAND_DISPLAY") if os.environ.get(name)]
    if sys.platform == "linux" and not displays:
        raise MissingError(
            "--viewer: there is no display here (DISPLAY is not set); leave it out to get a clip"
        )
    import mujoco.viewer  # noqa: TID251  # GLFW; wanted for this alone

    data = mujoco.MjData(play.model)
    with mujoco.viewer.launch_passive(play.model, data) as window:
        while window.is_running():
            for q in play.qpos:
                begin = time.monotonic()
                data.qpos[:] = q
                mujoco.mj_forward(play.model, data)
                window.sync()
                time.sleep(max(0.0, play.tick_s - (time.monotonic() - begin)))
                if not window.is_running():
                    return
            time.sleep(PAUSE_S)
