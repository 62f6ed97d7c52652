"""The object with its joints in motion, as a recording that rerun opens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from articulate.files import atomic_write
from articulate.reconstruct.images import only, poses_at
from articulate.reconstruct.result import MakeRecord
from articulate.transforms import Ints, matrix_to_quat

STEPS = 30
"""Positions on the way from closed to open."""
STEP_S = 0.05


def write_recording(path: Path, story: MakeRecord) -> bool:
    """Write each joint in turn as a recording, whole or not at all; False without rerun."""
    try:
        import rerun  # heavy, and wanted for this alone
    except ImportError:  # of one of its own modules, too
        return False
    with atomic_write(path) as temporary:
        stream = rerun.RecordingStream("articulate", send_properties=False)
        stream.save(temporary)
        stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("program", rerun.TextDocument(story.program), static=True)
        for k, step in enumerate(story.prediction.trace):
            text = f"{step.title}\n{step.text}"
            stream.log(f"trace/{k:02d}", rerun.TextDocument(text), static=True)
        _log_question(rerun, stream, story)
        for mesh in story.given.meshes:
            corners: Ints = mesh.faces.reshape(-1)
            shape = rerun.Mesh3D(
                vertex_positions=mesh.vertices[corners],
                triangle_indices=np.arange(len(corners)).reshape(-1, 3),
                vertex_colors=mesh.rgb.repeat(3, axis=0),
            )
            stream.log(_entity(mesh.name), shape, static=True)
        _log_motion(rerun, stream, story)
        stream.flush()
        stream.disconnect()
    return True


def _entity(name: str) -> str:
    return f"world/{name.replace('/', '_')}"


def _log_question(rerun: Any, stream: Any, story: MakeRecord) -> None:
    question = story.question
    if question.image is not None:
        stream.log("question", rerun.Image(question.image), static=True)
    if question.video is not None and question.times_s is not None:
        for t, frame in zip(question.times_s, question.video, strict=True):
            stream.set_time("time", duration=float(t))
            stream.log("question", rerun.Image(frame).compress(jpeg_quality=80))


def _log_motion(rerun: Any, stream: Any, story: MakeRecord) -> None:
    tick = 0
    for joint in story.moving:
        for share in np.linspace(0.0, 1.0, STEPS):
            stream.set_time("time", duration=tick * STEP_S)
            poses = poses_at(story.given.meshes, only(story.held, joint.part), float(share))
            for mesh, T in zip(story.given.meshes, poses, strict=True):
                w, *xyz = matrix_to_quat(T[:3, :3])
                turned = rerun.Quaternion(xyzw=[*xyz, w])
                pose = rerun.Transform3D(translation=T[:3, 3], quaternion=turned)
                stream.log(_entity(mesh.name), pose)
            tick += 1
