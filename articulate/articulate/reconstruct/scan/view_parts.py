"""Parts and joints of a scan from a video or image of the object: the camera is fitted to the mesh.

The front panels that the image shows are lifted to the mesh where its surface shows none. In a
video, the motion of every part and panel is compared with the frames, as with known parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.reconstruct.actors.protocol import (
    GOOD_ENOUGH,
    Evidence,
    JointKind,
    PredictedJoint,
    TraceStep,
)
from articulate.reconstruct.actors.registry import make_actor
from articulate.reconstruct.fitting.front_network import FrontPart, find_parts, front_square
from articulate.reconstruct.fitting.front_panels import PANELS
from articulate.reconstruct.fitting.propose import object_mask
from articulate.reconstruct.query import Query
from articulate.reconstruct.scan.fronts import Front, all_fronts, front_of, moved_front
from articulate.reconstruct.scan.panels import Panel, handles_of, overlap
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.registration import Registration, register
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.scan_parts import BODY, distinct_names, simplified
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.render.image import png
from articulate.render.raster import Pixels
from articulate.render.scene import PartScene
from articulate.transforms import Array

VIDEO_ACTOR = "geometric-video"
LEAST_OVERLAP = 0.75
"""Least overlap of the outlines of mesh and object; below it the video shows something else."""
REVERSED = 0.03
"""A video whose last frame fits the mesh better by this cost closes the object."""
COVERED = 0.3
"""A panel of which more belongs to a part is no further candidate."""
FILLED = 0.6
"""Least share of the rectangle of a panel that its faces cover."""
SKIN = 0.05
"""Depth of the surface of a panel that is lifted from an image, as a share of the diagonal."""
FACING = 0.5
"""Least component of the normal of a face that belongs to a front."""
SEEN = "it moves in the video"
IN_IMAGE = "a panel in the image"
SEEN_CONFIDENCE, IMAGE_CONFIDENCE = 0.9, 0.5
STILL = 0.02
"""Motion against the opening direction that is noise, as a share of the range."""
LEVEL = 0.8
"""Component of an axis above which it has this direction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewParts:
    """Parts of a scan after a video or image of it."""

    parts: tuple[PartProposal, ...]
    doubts: tuple[str, ...]
    trace: tuple[TraceStep, ...]


def add_view(
    mesh: ScanMesh, found: Sequence[PartProposal], query: Query, *, smooth: bool = False
) -> ViewParts:
    """Add to the parts of a scan what an image or video of the closed object shows.

    Args:
        mesh: The object; its front is +x.
        found: Parts that were found on its surface.
        query: Video that begins or ends with the object closed, or image of the closed object.
        smooth: The mesh is one smooth surface, of which few parts have a border.
    """
    try:
        image, placed, query = _registered(_coarse(mesh) if smooth else mesh, query)
    except UsageError as error:  # no object is found in the image
        doubt = f"{query.description} is not used: {error}"
        return ViewParts(parts=tuple(found), doubts=(doubt,), trace=())
    step = _registration_step(mesh, image, placed)
    if placed.overlap < LEAST_OVERLAP:
        doubt = (
            f"{query.description} does not show the mesh (overlap of the outlines "
            f"{placed.overlap:.0%}); use one that shows the entire object, closed"
        )
        return ViewParts(parts=tuple(found), doubts=(doubt,), trace=(step,))
    parts = Segmentation(mesh)
    from_image: list[PartProposal] = []
    if smooth or not found:
        from_image = _image_panels(parts, image, placed)
        found = [part for part in found if not _overlaps(part, from_image)]
    panels = [*from_image, *_further_panels(parts, [*found, *from_image])]
    if query.video is None:
        return ViewParts(parts=(*found, *from_image), doubts=(), trace=(step,))
    candidates = [*found, *panels]
    moved, doubts, steps = _moved_in_video(mesh, candidates, query, placed)
    kept = [*found, *from_image]
    if moved is not None:
        chosen = candidates[moved[0]]
        kept = [moved[1] if part is chosen else part for part in kept]
        if chosen not in kept and moved[1] not in kept:
            kept.append(moved[1])
    return ViewParts(parts=tuple(kept), doubts=doubts, trace=(step, *steps))


def _coarse(mesh: ScanMesh) -> ScanMesh:
    """Return a dense mesh with fewer triangles."""
    (part,) = simplified([mesh.part(BODY, np.arange(len(mesh.faces)))])
    return ScanMesh(
        vertices=part.vertices,
        faces=part.faces,
        rgb=part.rgb,
        group=np.zeros(len(part.faces), dtype=np.int64),
    )


def _registered(mesh: ScanMesh, query: Query) -> tuple[Pixels, Registration, Query]:
    """Return the image in which the object is closed, its camera, and the video from there on."""
    if query.video is None or query.times_s is None:
        assert query.image is not None
        return query.image, register(mesh, query.image, object_mask(query.image, None)), query
    first, last = (
        register(mesh, image, object_mask(image, None)) for image in query.video[[0, -1]]
    )
    if last.cost < first.cost - REVERSED:
        backwards = replace(
            query, video=query.video[::-1].copy(), times_s=query.times_s[-1] - query.times_s[::-1]
        )
        return query.video[-1], last, backwards
    return query.video[0], first, query


def _further_panels(parts: Segmentation, found: Sequence[PartProposal]) -> list[PartProposal]:
    """Return the front panels that belong to no part, as doors."""
    covered = _faces_of(parts.mesh, found)
    panels = []
    for front in all_fronts(parts):
        panel = moved_front(parts, front, "revolute", "left", "a panel of the front")
        if covered[panel.faces].mean() < COVERED:
            panels.append(replace(panel, faces=panel.faces[~covered[panel.faces]]))
            covered[panel.faces] = True
    return panels


def _image_panels(parts: Segmentation, image: Pixels, placed: Registration) -> list[PartProposal]:
    """Return the openable parts that the image shows in the front."""
    mesh, view = parts.mesh, parts.view
    low, high = mesh.bounds
    seen = view.depth[np.isfinite(view.depth)]
    front = float(np.median(seen)) if len(seen) else float(high[0])
    corners = np.array(
        [[front, low[1], high[2]], [front, high[1], high[2]], [front, high[1], low[2]],
         [front, low[1], low[2]]]
    )  # fmt: skip
    uv, depth = placed.camera.project(corners)
    if not (depth > 0.0).all():
        return []
    square, _ = front_square(image, uv)
    panels = []
    for part in find_parts(square, float(mesh.size[1] / mesh.size[2])):
        rect = low[[1, 2, 1, 2]] + mesh.size[[1, 2, 1, 2]] * [
            part.left, part.bottom, part.right, part.top
        ]  # fmt: skip
        panel = _lifted(parts, rect, front)
        if panel is not None:
            panels.append(_image_panel(parts, front_of(parts, panel), part))
    return panels


def _overlaps(part: PartProposal, panels: Sequence[PartProposal]) -> bool:
    """Return whether a front panel overlaps one of others."""
    return part.panel is not None and any(
        other.panel is not None and overlap(part.panel, other.panel) > COVERED for other in panels
    )


def _lifted(parts: Segmentation, rect: Array, front: float) -> Panel | None:
    """Return the surface in a rectangle of the front as a panel; None if it does not fill it."""
    mesh = parts.mesh
    centres = mesh.triangles.mean(axis=1)
    inside = (centres[:, 1:] > rect[:2]).all(axis=1) & (centres[:, 1:] < rect[2:]).all(axis=1)
    inside &= centres[:, 0] > front - SKIN * mesh.diagonal
    facing = inside & (mesh.normals[:, 0] > FACING)
    covered = float((mesh.areas * mesh.normals[:, 0])[facing].sum())
    area = float(np.prod(rect[2:] - rect[:2]))
    if covered < FILLED * area:
        return None
    surface = float(np.median(centres[facing, 0]))
    rows, columns = parts.view.window(rect)
    depth = parts.view.depth[rows, columns]
    return Panel(
        rect=rect,
        front=surface,
        back=surface - 0.02 * mesh.diagonal,
        own=np.flatnonzero(inside),
        fill=min(1.0, covered / area),
        thin=True,
        score=1.0,
        handles=handles_of(mesh, parts.view, rect, depth, surface),
    )


def _image_panel(parts: Segmentation, front: Front, part: FrontPart) -> PartProposal:
    """Return a lifted panel with the joint that the image shows."""
    kind, side = PANELS[part.kind]
    joint: JointKind = "prismatic" if kind == "drawer" else "revolute"
    proposal = moved_front(parts, front, joint, side, IN_IMAGE)
    return proposal.with_confidence(IMAGE_CONFIDENCE)


def _moved_in_video(
    mesh: ScanMesh, candidates: Sequence[PartProposal], query: Query, placed: Registration
) -> tuple[tuple[int, PartProposal] | None, tuple[str, ...], tuple[TraceStep, ...]]:
    """Return the candidate that moves in a video with its joint, doubts and the trace."""
    names = distinct_names([part.kind for part in candidates])
    rest = np.flatnonzero(~_faces_of(mesh, candidates))
    meshes = [mesh.part(name, part.faces) for name, part in zip(names, candidates, strict=True)]
    if not meshes or not len(rest):
        return None, (_no_motion(query),), ()
    evidence = Evidence(
        modality="video",
        parts=tuple(simplified([mesh.part(BODY, rest), *meshes])),
        labels={name: name for name in (BODY, *names)},
        video=query.video,
        times_s=query.times_s,
        camera=placed.camera,
    )
    prediction = make_actor(VIDEO_ACTOR).predict(evidence)
    moving = [joint for joint in prediction.joints if joint.kind != "fixed"]
    if not moving or moving[0].part == BODY:
        return None, (_no_motion(query),), prediction.trace
    if prediction.verdict is not None and not prediction.verdict.rating > GOOD_ENOUGH:
        doubt = (
            f"the motion in {query.description} is not explained: "
            f"{prediction.verdict.reason or 'no reason'}"
        )
        return None, (doubt,), prediction.trace
    k = names.index(moving[0].part)
    return (k, seen_joint(candidates[k], moving[0])), (), prediction.trace


def _no_motion(query: Query) -> str:
    return (
        f"no part of the mesh explains the motion in {query.description}; record it with the "
        "camera at rest and the object closed at the beginning"
    )


def seen_joint(part: PartProposal, joint: PredictedJoint) -> PartProposal:
    """Return a part with the joint of a video, positive when it opens."""
    axis = np.asarray(joint.axis_o, dtype=np.float64)
    low, high = joint.lower or 0.0, joint.upper or 0.0
    if high < -low:
        axis, low, high = -axis, -high, -low
    if joint.kind == part.joint:
        high = max(high, part.upper)
    kind, hollow = part.kind, part.hollow
    if part.panel is not None:
        slides = joint.kind == "prismatic"
        kind = "drawer" if slides else "door" if abs(axis[2]) > LEVEL else "flap"
        hollow = hollow or joint.kind != part.joint
    elif joint.kind != part.joint:
        kind = "part"
    return replace(
        part,
        kind=kind,
        joint=joint.kind,
        axis=axis,
        pivot=np.asarray(joint.pivot_o, dtype=np.float64),
        lower=low if -low > STILL * high else 0.0,
        upper=high,
        confidence=min(SEEN_CONFIDENCE, joint.confidence),
        evidence=(SEEN,),
        hollow=hollow,
    )


def _faces_of(mesh: ScanMesh, parts: Sequence[PartProposal]) -> NDArray[np.bool_]:
    """Return which faces belong to a part (F,), boolean."""
    mask = np.zeros(len(mesh.faces), dtype=np.bool_)
    for part in parts:
        mask[part.faces] = True
    return mask


def _registration_step(mesh: ScanMesh, image: Pixels, placed: Registration) -> TraceStep:
    """Return the fitted mesh over the image, for the trace page."""
    scene = PartScene([mesh.part(BODY, np.arange(len(mesh.faces)))])
    seen = scene.rasterize(placed.camera).face_ids >= 0
    shaded = image.copy()
    shaded[seen] = (0.6 * shaded[seen] + 0.4 * np.array([220, 40, 40])).astype(np.uint8)
    return TraceStep(
        title="Mesh in the image",
        text="The camera is fitted to outline and edges of the mesh.",
        figures={"overlap of the outlines": round(placed.overlap, 3)},
        images={"Fitted mesh": png(shaded)},
    )
