"""Make an articulated object from one unsegmented mesh."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from articulate.conversion.metric_size import LONGEST_SIDE_M
from articulate.errors import UsageError, shorten
from articulate.preparation.store import check_out
from articulate.reconstruct.actors.protocol import (
    Evidence,
    PredictedJoint,
    Prediction,
    TraceStep,
)
from articulate.reconstruct.actors.semantic.actor import SemanticActor
from articulate.reconstruct.make import PredictionSource, make_predicted
from articulate.reconstruct.part_set import Front, PartSet
from articulate.reconstruct.query import Query
from articulate.reconstruct.result import MakeRequest, MakeResult
from articulate.reconstruct.scan.category_by_parts import category_by_parts
from articulate.reconstruct.scan.cavity import Built, build_parts
from articulate.reconstruct.scan.masks import read_masks, skin
from articulate.reconstruct.scan.panels import ENTIRE
from articulate.reconstruct.scan.part_proposal import PartProposal, scaled
from articulate.reconstruct.scan.propose import FoundParts, calibrated, propose_parts, rated
from articulate.reconstruct.scan.read_scan import (
    TURNS,
    Scan,
    ScanHints,
    groups_by_name,
    read_scan,
    scale_of,
    turned,
)
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.scan_parts import (
    BODY,
    distinct_names,
    names_of,
    parents_of,
    part_set_of,
    simplified,
)
from articulate.reconstruct.scan.solids import build_solids, is_closed
from articulate.reconstruct.scan.sweep import with_free_joints
from articulate.reconstruct.scan.view_parts import SEEN, add_view
from articulate.reconstruct.text.counts import counts_in
from articulate.render.camera import front_camera
from articulate.transforms import Ints

ACTOR = "scan"
LEAST_CONFIDENCE = 0.65
"""Parts with a lower confidence make the result doubtful."""
PLAIN, HANDLED = 0.5, 0.75
"""Weight of panels without handles and of knobs, and of a side that one panel covers; and of a side
that a panel with a handle covers."""
FILE_FRONT = 1.25
"""Weight of the front by the convention of the file."""
WIDER = 1.2
"""Weight of a front that is wider than the object is deep."""
IMPLIES_FRONT = frozenset({"Switch", "Toilet"})
"""Categories of which parts are found from their front only."""
EDGE = 0.25
"""Sides that are narrower than this share of depth and height are not the front."""
TOY_M = 0.25
"""An object of unknown category with doors or drawers is not smaller [m]."""
MASKS = "masks"
MIN_NAMED = 2
"""Fewest named meshes of a file whose names are used."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanParts:
    """Parts of a scan and their joints."""

    part_set: PartSet
    joints: tuple[PredictedJoint, ...]
    doubts: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    trace: tuple[TraceStep, ...] = ()


def make_scan(path: Path, request: MakeRequest, hints: ScanHints) -> MakeResult:
    """Find the parts and joints of one mesh, check the object, and write the folder.

    Args:
        path: Mesh file of one object.
        request: Settings; ``actor`` is not used.
        hints: Facts that the mesh does not contain.

    Raises:
        UsageError: The mesh cannot be read, or no part is found that can move.
    """
    check_out(request.out)
    start = time.monotonic()
    scan = read_scan(path, hints)
    found = scan_parts(scan, path, hints)
    prediction = Prediction(joints=found.joints, trace=found.trace)
    source = PredictionSource(
        query=Query(modality="text", description=f"the mesh {path.name}", text=hints.text),
        camera=front_camera(),
        actor=ACTOR,
        start=start,
        doubts=found.doubts,
        assumptions=found.assumptions,
    )
    return make_predicted(prediction, found.part_set, request, source)


def scan_parts(scan: Scan, path: Path, hints: ScanHints) -> ScanParts:
    """Return the parts and joints of a mesh: by masks, by names, or by its surface.

    Raises:
        UsageError: No part is found that can move.
    """
    if hints.masks is not None:
        masks = read_masks(hints.masks, scan, path)
        return _named_parts(sized_by_masks(scan, masks, hints), masks, MASKS, path)
    named = [(name, faces) for name, faces in groups_by_name(scan.mesh) if len(faces)]
    if len(named) >= MIN_NAMED:
        found = _named_parts(scan, named, "names of the file", path)
        if found.joints:
            return found
    return _found_parts(scan, path, hints)


def _found_parts(scan: Scan, path: Path, hints: ScanHints) -> ScanParts:
    """Find the parts on the surface of the mesh."""
    scan, proposals = find_parts(scan, hints)
    view = None
    if hints.view is not None:
        view = add_view(scan.mesh, proposals, hints.view, smooth=scan.smooth)
        proposals = list(view.parts)
    if not proposals:
        raise UsageError(
            f"{shorten(path.name)}: no door, drawer or lid was found on the surface; give --masks "
            "with the part of each triangle, or a mesh whose parts are named"
        )
    proposals = with_free_joints(scan.mesh, calibrated(proposals))
    if hints.text:
        proposals = rated(proposals, counts_in(hints.text))
    names = distinct_names([proposal.kind for proposal in proposals])
    parents = parents_of(proposals, names)
    joints = tuple(
        proposal.predicted(name, parents[name])
        for name, proposal in zip(names, proposals, strict=True)
    )
    built = _built(scan, proposals, names)
    text = "; ".join(
        f"{name}: {proposal.joint}, {', '.join(proposal.evidence) or 'by its shape'}"
        for name, proposal in zip(names, proposals, strict=True)
    )
    doubts = [
        f"{name} is uncertain ({proposal.confidence:.2f}: {', '.join(proposal.evidence)})"
        for name, proposal in zip(names, proposals, strict=True)
        if proposal.confidence < LEAST_CONFIDENCE
    ]
    sure = any(p.kind == "screen" or p.evidence[:1] == (SEEN,) for p in proposals)
    if scan.smooth and not sure:
        doubts.append("the mesh is one smooth surface, on which few parts have a border")
    return ScanParts(
        part_set=_part_set(scan, built, path),
        joints=joints,
        doubts=(*doubts, *(view.doubts if view else ())),
        assumptions=(*scan.assumptions, *built.notes),
        trace=(
            *(view.trace if view else ()),
            TraceStep(title="parts on the surface", text=text),
        ),
    )


def _built(scan: Scan, proposals: Sequence[PartProposal], names: Sequence[str]) -> Built:
    """Return body and parts; solid ones for the closed shell of a scanner."""
    solids = build_solids(scan.mesh, proposals, names, BODY) if scan.smooth else None
    return solids or build_parts(scan.mesh, proposals, names, BODY)


def _part_set(scan: Scan, built: Built, path: Path) -> PartSet:
    """Return the built parts, with fewer triangles for the dense mesh of a scanner."""
    meshes = [built.body, *built.parts]
    return part_set_of(
        scan.name, simplified(meshes) if scan.smooth else meshes, path.name, scan.category
    )


def find_parts(scan: Scan, hints: ScanHints) -> tuple[Scan, list[PartProposal]]:
    """Return the scan with its front at +x, and the parts on its surface.

    The front is the side with the most evidence of parts. An object whose parts imply its category
    gets the size that is usual for it.
    """
    counts = counts_in(hints.text) if hints.text else None
    best: tuple[float, Front, FoundParts] | None = None
    for front in TURNS if hints.front == "auto" else TURNS[:1]:
        mesh = turned(scan.mesh, front)
        if hints.front == "auto" and mesh.size[1] < EDGE * min(mesh.size[0], mesh.size[2]):
            continue  # the edge of a room door or window
        found = propose_parts(mesh, counts, smooth=scan.smooth)
        if found.category in IMPLIES_FRONT:
            best = (1.0, front, found)
            break
        score = _front_score(found.parts) * (WIDER if mesh.size[1] >= mesh.size[0] else 1.0)
        if front == TURNS[0]:
            score *= FILE_FRONT
        else:  # perhaps a side of the body
            covering = [part for part in found.parts if _covers(mesh, part)]
            if covering:
                score *= HANDLED if any(part.handles for part in covering) else PLAIN
        if found.parts and (best is None or score > best[0]):
            best = (score, front, found)
    if best is None:
        return scan, []
    _, front, found = best
    mesh = turned(scan.mesh, front)
    scale, category, notes = _size_by_parts(scan, mesh, found, hints)
    if front != TURNS[0]:
        notes = (*notes, f"the front faces {front}; --front changes this")
    proposals = [scaled(proposal, scale) for proposal in found.parts]
    mesh = mesh.transformed(np.eye(3), scale, np.zeros(3))
    return replace(scan, mesh=mesh, category=category, assumptions=notes), proposals


def _front_score(parts: Sequence[PartProposal]) -> float:
    """Return the evidence that a side with ``parts`` is the front: the sum of confidences.

    The sides and the back of furniture have panels too, but no handles.
    """
    score = 0.0
    for part in parts:
        plain = part.kind == "knob" or (part.panel is not None and not part.handles)
        if part.kind != "wheel":
            score += (PLAIN if plain else 1.0) * part.confidence
    return score


def _covers(mesh: ScanMesh, proposal: PartProposal) -> bool:
    """Return whether a panel covers nearly the entire front."""
    if proposal.panel is None:
        return False
    sides = proposal.panel[2:] - proposal.panel[:2]
    return bool((sides > ENTIRE * mesh.size[1:]).all())


def _size_by_parts(
    scan: Scan, mesh: ScanMesh, found: FoundParts, hints: ScanHints
) -> tuple[float, str, tuple[str, ...]]:
    """Return the factor to the usual size, the category that the parts imply, and assumptions."""
    notes = scan.assumptions
    if scan.category != "unknown":
        return 1.0, scan.category, notes
    if found.category != "unknown":
        height_m = None if hints.height_m is None else float(mesh.size[2])
        scale, reason = scale_of(mesh, found.category, height_m)
        notes = (*notes, f"the parts are those of a {found.category}")
        return scale, found.category, (*notes, reason) if scale != 1.0 else notes
    longest = float(mesh.size.max())
    if longest < TOY_M and hints.height_m is None:
        usual = LONGEST_SIDE_M["StorageFurniture"]
        notes = (*notes, f"it is too small for furniture: its longest side is set to {usual:g} m")
        return usual / longest, "unknown", notes
    return 1.0, "unknown", notes


def sized_by_masks(scan: Scan, masks: Sequence[tuple[str, Ints]], hints: ScanHints) -> Scan:
    """Return the scan in the usual size of the category that its masked parts imply."""
    found = FoundParts(category=category_by_parts(scan.mesh, [name for name, _ in masks]))
    if found.category == "unknown":
        return scan
    scale, category, notes = _size_by_parts(scan, scan.mesh, found, hints)
    mesh = scan.mesh.transformed(np.eye(3), scale, np.zeros(3))
    return replace(scan, mesh=mesh, category=category, assumptions=notes)


def _named_parts(
    scan: Scan,
    named: Sequence[tuple[str, Ints]],
    origin: str,
    path: Path,
) -> ScanParts:
    """Return parts whose names imply their joints."""
    names = names_of([name for name, _ in named])
    rest = np.ones(len(scan.mesh.faces), dtype=bool)
    meshes = []
    for name, (_, faces) in zip(names, named, strict=True):
        rest[faces] = False
        meshes.append(scan.mesh.part(name, faces))
    if rest.any():
        meshes.insert(0, scan.mesh.part(BODY, np.flatnonzero(rest)))
    part_set = part_set_of(scan.name, meshes, path.name, scan.category)
    if len(meshes) < 2:
        return ScanParts(part_set=part_set, joints=())
    prediction = _by_names(scan, part_set)
    notes: tuple[str, ...] = ()
    if origin == MASKS:
        by_name = {joint.part: joint for joint in prediction.joints if joint.kind != "fixed"}
        closed = scan.smooth and is_closed(scan.mesh)
        skins = [
            skin(scan.mesh, faces, by_name.get(name), closed=closed)
            for name, (_, faces) in zip(names, named, strict=True)
        ]
        built = _built(scan, skins, names)
        part_set, notes = _part_set(scan, built, path), built.notes
        prediction = _by_names(scan, part_set)  # with the sides and trays that were built
    moving = any(joint.kind != "fixed" for joint in prediction.joints)
    step = TraceStep(title=f"parts by {origin}", text=", ".join(names))
    return ScanParts(
        part_set=part_set,
        joints=prediction.joints if moving else (),
        assumptions=(*scan.assumptions, *notes),
        trace=(step, *prediction.trace),
    )


def _by_names(scan: Scan, part_set: PartSet) -> Prediction:
    """Return the joints that the names of parts imply."""
    evidence = Evidence(
        modality="text",
        parts=part_set.meshes,
        labels=part_set.labels,
        text=scan.category if scan.category != "unknown" else scan.name.replace("_", " "),
    )
    return SemanticActor().predict(evidence)
