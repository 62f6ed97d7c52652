"""Write a generated object: from a proposal to a folder with a checked asset and a trace.

::

    ObjectProposal ─► URDF ─► CheckReport ─► folder
"""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from articulate.conversion.provenance import ORIGIN_FILE
from articulate.files import copy_writable, write_json
from articulate.library.procedural.categories import LICENCE
from articulate.library.procedural.materials import Material
from articulate.library.procedural.truth import joints_of, origins
from articulate.library.procedural.urdf import Part, write_urdf
from articulate.page import Page, Tile
from articulate.preparation.batch import Batch, Item
from articulate.preparation.store import check_out, export
from articulate.reconstruct.actors.protocol import JointKind, PredictedJoint
from articulate.reconstruct.images import frames_row, only_joint, opening_row, view_camera
from articulate.reconstruct.link_meshes import HALF_TURN
from articulate.reconstruct.part_set import category_words
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.query import Query
from articulate.reconstruct.result import (
    MADE_FILE,
    PROGRAM_FOLDER,
    TRACE_FILE,
    MakeRequest,
    MakeResult,
    Verdict,
)
from articulate.reconstruct.trace import MAX_JOINTS, SUMMARY, add_checks, add_steps
from articulate.render.image import png
from articulate.render.parts import PartMesh
from articulate.transforms import Array

SOURCE = "articulate make"
MIN_CONFIDENCE = 0.35
"""A proposal with a lower confidence makes the result doubtful."""


def make_object(
    query: Query, proposal: ObjectProposal, request: MakeRequest, *, proposal_s: float = 0.0
) -> MakeResult:
    """Write the URDF of a proposal, check it, and write the folder with its trace.

    Nothing is written unless the check has ended.

    Args:
        query: Input of the user.
        proposal: Object for it.
        request: Folder of the result and settings.
        proposal_s: Time that the proposal took [s].

    Raises:
        UsageError: The folder cannot be written.
    """
    check_out(request.out)
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        source = work / "object"
        urdf = write_urdf(proposal.name, proposal.parts, source, proposal.palette)
        origin = {"source": f"{SOURCE}: {query.description}", "licence": LICENCE}
        write_json(source / ORIGIN_FILE, {**origin, "category": proposal.category})
        written = time.monotonic()
        batch = Batch(
            out=work / "asset",
            cache=request.cache,
            options={},
            limit_s=request.limit_s,
            single=True,
        )
        check_report = batch.one(Item(name=urdf.stem, file=urdf)).check_report
        checked = time.monotonic()
        doubts = _doubts(proposal)
        verdict: Verdict = "doubtful" if doubts else "passed"
        reasons = list(doubts)
        if not check_report.is_usable:
            # The folder of the check is temporary; its path means nothing later.
            lasting = [re.sub(r"\S*/(?=\S+\.urdf: )", "", text) for text in check_report.reasons]
            verdict = "undecided" if check_report.verdict == "undecided" else "rejected"
            reasons = [*lasting, *doubts]
            copy_writable(source, work / "asset" / PROGRAM_FOLDER)  # to be corrected
        result = MakeResult(
            verdict=verdict,
            reasons=tuple(reasons),
            out=request.out,
            joints=tuple(predicted_joints(proposal)),
            check_report=check_report,
            rating=None,
            seconds=proposal_s + checked - start,
            program=False,
            category=proposal.category,
            confidence=round(proposal.confidence, 3),
            evidence=proposal.evidence,
            assumptions=proposal.assumptions,
        )
        seconds = {
            "proposal": proposal_s,
            "URDF": written - start,
            "checks": checked - written,
        }
        _write_trace(_Pages(query=query, proposal=proposal, seconds=seconds), result, work)
        seconds["trace"] = time.monotonic() - checked
        result = replace(result, seconds=proposal_s + time.monotonic() - start)
        write_json(work / "asset" / MADE_FILE, result.content())
        export(work / "asset", request.out)
    return result


def predicted_joints(proposal: ObjectProposal) -> list[PredictedJoint]:
    """Return the joints of a proposal in the frame of its asset: z up, the front towards -x."""
    return [
        PredictedJoint(
            part=joint.link,
            parent=joint.parent,
            kind=_kind(proposal.parts, joint.link),
            axis_o=joint.axis_o,
            pivot_o=joint.pivot_o,
            lower=joint.lower,
            upper=joint.upper,
            confidence=proposal.confidence,
        )
        for joint in joints_of(proposal.parts)
    ]


def part_meshes(parts: Sequence[Part], palette: Mapping[str, Material]) -> tuple[PartMesh, ...]:
    """Return the visual meshes of parts, closed, with a colour for each face.

    Args:
        parts: Links, parents before children.
        palette: Materials by name.
    """
    at = origins(parts)
    return tuple(_mesh(part, at[part.name], palette) for part in parts)


def _doubts(proposal: ObjectProposal) -> list[str]:
    doubts = list(proposal.doubts)
    if proposal.confidence < MIN_CONFIDENCE and not doubts:
        doubts.append(f"the confidence is low ({proposal.confidence:.2f})")
    return doubts


def _kind(parts: Sequence[Part], name: str) -> JointKind:
    motion = next(part.motion for part in parts if part.name == name)
    assert motion is not None
    return motion.kind


def _mesh(part: Part, origin: Array, palette: Mapping[str, Material]) -> PartMesh:
    vertices, faces, rgb, first = [], [], [], 0
    for own in part.shapes:
        colour = np.asarray(palette[own.material].rgba[:3])
        for solid in own.solids:
            corners, triangles = solid.mesh()
            vertices.append(corners + origin)
            faces.append(np.asarray(triangles) + first)
            rgb.append(np.tile(colour, (len(triangles), 1)))
            first += len(corners)
    return PartMesh(
        name=part.name,
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces).astype(np.int64),
        rgb=np.concatenate(rgb),
    )


@dataclass(frozen=True, kw_only=True)
class _Pages:
    """Content of the trace page."""

    query: Query
    proposal: ObjectProposal
    seconds: Mapping[str, float]


def _write_trace(content: _Pages, result: MakeResult, work: Path) -> None:
    query, proposal = content.query, content.proposal
    page = Page(f"Reconstruction of {proposal.name}", SUMMARY[result.verdict])
    page.tiles(
        Tile(
            value=result.verdict,
            label="verdict",
            tone="good" if result.verdict == "passed" else "bad",
        ),
        Tile(value=category_words(proposal.category), label="category"),
        Tile(value=len(result.joints), label="moving joints"),
        Tile(value=round(proposal.confidence, 2), label="confidence"),
        Tile(value=result.check_report.verdict, label="verdict of check-asset"),
    )
    for reason in result.reasons:
        page.text(f"Reason: {reason}.")
    page.section("Input", f"{query.description[:1].upper()}{query.description[1:]}.")
    if query.video is not None:
        page.png(frames_row(query.video), f"The video, {len(query.video)} frames")
    if query.image is not None:
        page.png(png(query.image), "The image")
    if query.text and query.modality != "text":
        page.text(f"Text: {query.text}")
    add_steps(page, proposal.trace)
    _add_object(page, result, proposal)
    add_checks(page, result, content.seconds)
    page.footer("articulate make", {})
    page.save(work / "asset" / TRACE_FILE)


def _add_object(page: Page, result: MakeResult, proposal: ObjectProposal) -> None:
    """Add assumptions, joints with their evidence, and images of the object closed and open."""
    page.section("The object")
    if proposal.assumptions:
        rows = [(text,) for text in proposal.assumptions]
        page.table(["assumption"], rows, "Values that the query does not give")
    rows_joints = [
        (
            joint.part,
            joint.parent,
            joint.kind,
            ", ".join(f"{v + 0.0:.3f}" for v in joint.axis_o),
            joint.lower,
            joint.upper,
            proposal.evidence.get(joint.part, ""),
        )
        for joint in result.joints
    ]
    page.table(
        ["part", "parent", "type", "axis", "lower", "upper", "evidence"],
        rows_joints,
        "Joints in metres and radians; at 0 the object is closed",
    )
    meshes, joints = _front_view(proposal)
    camera = view_camera(meshes, joints)
    order = "parts in distinct colours; closed; half open; open"
    page.png(opening_row(meshes, joints, camera), f"All joints: {order}")
    if 1 < len(joints) <= MAX_JOINTS:
        for name, joint in joints.items():
            image = opening_row(meshes, only_joint(joints, name), camera)
            page.png(image, f"{name} ({joint.kind}): {order}")


def _front_view(
    proposal: ObjectProposal,
) -> tuple[tuple[PartMesh, ...], dict[str, PredictedJoint]]:
    """Return meshes and joints with the front towards +x, as the renderer expects."""
    meshes = tuple(
        replace(mesh, vertices=mesh.vertices @ HALF_TURN.T)
        for mesh in part_meshes(proposal.parts, proposal.palette)
    )
    at = origins(proposal.parts)
    joints: dict[str, PredictedJoint] = {}
    for joint in predicted_joints(proposal):
        pivot, axis = HALF_TURN @ at[joint.part], HALF_TURN @ np.asarray(joint.axis_o)
        joints[joint.part] = replace(
            joint,
            pivot_o=(float(pivot[0]), float(pivot[1]), float(pivot[2])),
            axis_o=(float(axis[0]), float(axis[1]), float(axis[2])),
        )
    return meshes, joints
