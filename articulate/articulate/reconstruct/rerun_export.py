"""Recording of the object with moving joints, for rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import MissingError
from articulate.reconstruct.images import only_joint, poses_at
from articulate.reconstruct.result import MakeRecord
from articulate.render.rerun_recording import rerun_name, rerun_pose, rerun_recording
from articulate.transforms import Ints, matrix_to_quat

STEPS = 30
"""Positions from closed to open."""
STEP_S = 0.05


def write_recording(path: Path, record: MakeRecord) -> bool:
    """Write a recording in which each joint moves in turn; return False without rerun.

    The file is written atomically.
    """
    try:
        with rerun_recording(path) as (rerun, stream):
            stream.log("program", rerun.TextDocument(record.program), static=True)
            for k, step in enumerate(record.prediction.trace):
                text = f"{step.title}\n{step.text}"
                stream.log(f"trace/{k:02d}", rerun.TextDocument(text), static=True)
            _log_query(rerun, stream, record)
            for mesh in record.part_set.meshes:
                corners: Ints = mesh.faces.reshape(-1)
                shape = rerun.Mesh3D(
                    vertex_positions=mesh.vertices[corners],
                    triangle_indices=np.arange(len(corners)).reshape(-1, 3),
                    vertex_colors=mesh.rgb.repeat(3, axis=0),
                )
                stream.log(_entity(mesh.name), shape, static=True)
            _log_motion(rerun, stream, record)
    except MissingError:
        return False
    return True


def _entity(name: str) -> str:
    return f"world/{rerun_name(name)}"


def _log_query(rerun: Any, stream: Any, record: MakeRecord) -> None:
    query = record.query
    if query.image is not None:
        stream.log("query", rerun.Image(query.image), static=True)
    if query.video is not None and query.times_s is not None:
        for t, frame in zip(query.times_s, query.video, strict=True):
            stream.set_time("time", duration=float(t))
            stream.log("query", rerun.Image(frame).compress(jpeg_quality=80))


def _log_motion(rerun: Any, stream: Any, record: MakeRecord) -> None:
    step = 0
    for joint in record.moving:
        for share in np.linspace(0.0, 1.0, STEPS):
            stream.set_time("time", duration=step * STEP_S)
            poses = poses_at(
                record.part_set.meshes, only_joint(record.part_joints, joint.part), float(share)
            )
            for mesh, T in zip(record.part_set.meshes, poses, strict=True):
                pose = rerun_pose(rerun, T[:3, 3], matrix_to_quat(T[:3, :3]))
                stream.log(_entity(mesh.name), pose)
            step += 1
