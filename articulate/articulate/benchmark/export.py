"""Export evidence as files, for actors that run elsewhere: parts, video or image, camera, labels.

::

    question_0000/parts/part_00.glb …   triangles and colours, in the frame o
    question_0000/labels.json           label of each part
    question_0000/video.mp4             or image.png; neither without a camera
    question_0000/camera.json           intrinsics [px] and pose in o, OpenCV's axes
    key.json                            object and parts of each question: not for actors
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.evidence import cases_of
from articulate.benchmark.truth import TrueObject
from articulate.files import atomic_write, write_bytes, write_json
from articulate.reconstruct.actors.protocol import Evidence
from articulate.render.camera import Camera
from articulate.render.joint_video import Video
from articulate.render.parts import PartMesh


def write_questions(
    subjects: Iterable[TrueObject], config: BenchmarkConfig, folder: Path
) -> list[Path]:
    """Write the questions of several objects with their key, and return the folders."""
    key: dict[str, object] = {}
    folders: list[Path] = []
    for subject in subjects:
        for case in cases_of(subject, config):
            name = f"question_{len(folders):04d}"
            write_evidence(case.evidence, folder / name)
            key[name] = {
                "object": subject.object_id,
                "case": case.name,
                "parts": dict(case.names),
            }
            folders.append(folder / name)
    write_json(folder / "key.json", key)
    return folders


def write_evidence(evidence: Evidence, folder: Path) -> Path:
    """Write evidence into ``folder`` and return the folder."""
    for part in evidence.parts:
        write_bytes(folder / "parts" / f"{part.name}.glb", glb(part))
    write_json(folder / "labels.json", dict(evidence.labels))
    if evidence.video is not None and evidence.times_s is not None:
        Video(frames=evidence.video, times_s=evidence.times_s).write(folder / "video.mp4")
    if evidence.image is not None:
        with atomic_write(folder / "image.png") as path:
            Image.fromarray(evidence.image).save(path, "PNG")
    if evidence.camera is not None:
        write_json(folder / "camera.json", _camera(evidence.camera))
    return folder


def glb(part: PartMesh) -> bytes:
    """Encode a part as a GLB with vertex colours and without its name."""
    corners = part.vertices[part.faces].reshape(-1, 3)
    colours = np.rint(255.0 * part.rgb).astype(np.uint8).repeat(3, axis=0)
    mesh = trimesh.Trimesh(
        corners,
        np.arange(len(corners)).reshape(-1, 3),
        vertex_colors=np.concatenate([colours, np.full((len(colours), 1), 255, np.uint8)], axis=1),
        process=False,
    )
    mesh.merge_vertices()
    content: bytes = mesh.export(file_type="glb")
    return content


def _camera(camera: Camera) -> dict[str, object]:
    return {
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "fx_px": camera.fx_px,
        "fy_px": camera.fy_px,
        "cx_px": camera.cx_px,
        "cy_px": camera.cy_px,
        "T_oc": camera.T_wc.tolist(),
    }
