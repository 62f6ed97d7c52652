"""Collision shapes of a part: hollow where it is hollow, few, and boxes where they fit."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from articulate.formats.config import ConvertConfig
from articulate.formats.load_meshes import PartGeometry, Piece, joined
from articulate.formats.repairs import Repairs
from articulate.geometry.convex_decomposition import decompose
from articulate.geometry.convex_fit import Judged, fitted, hull, is_near, thick
from articulate.geometry.merge_shapes import (
    MAX_JOINED,
    merged,
    surface_tolerance,
    within_budget,
    without_hidden,
    without_spare,
)
from articulate.geometry.rays import NOTHING, Surface
from articulate.geometry.shapes import Shape, sample_surface
from articulate.geometry.shells import shell_shapes, staves
from articulate.geometry.time_budget import UNLIMITED, Budget
from articulate.transforms import Array

HANDLE_WORDS = re.compile(r"handle|(?<![a-z])k?nob|pull(?!ey)|grip", re.IGNORECASE)
"""What handles are called: sektion's ``door_left_nob``, PartNet's ``handle-12``."""
SMALL_M = 0.01
"""Components smaller than this are left out [m]; handles are kept down to 2 mm."""
SHOWN_AREA = 0.96
"""Share of a component's area that its facets must make up; the small rest, as much less as shapes
are to be finer, is left out."""
PANEL_M = 0.03
"""Panels up to this thickness are boxes in spite of recesses unless that is too coarse [m]."""
COMPACT_M = 0.07
"""Concave components up to this size collide as their hull unless that is too coarse [m]."""
FEW_ATOMS = 16
"""Up to so many facets of a component are put together by hand first."""
MAX_ATOMS = 64
"""Most facets of a component that are put together by hand instead of decomposing it."""
FINER = 2.0
"""What is to be finer is so by this factor, once for each time that it is named."""
LEAST_LEFT = 0.25
"""Handles, which are never joined, leave at least this share of the budget to the rest."""
MAX_HULLS = 16
"""Most convex parts of a decomposition, twice that where it is to be finer."""
MAX_STAVES = 32
"""Most parts of a surface that needs more than fit into the budget; where it is to be finer, as
many as may be."""
STAVES_NEAR = 0.6
"""They are taken without a decomposition if this share of them lies near the surface."""
TOL_M = (0.003, 0.010)
"""Least and largest distance of a shape's surface from what it stands for [m]."""
FINEST_TOL_M = 0.0011
"""However fine shapes are to be, they may stray by this much [m]: all have some thickness."""


def is_handle(name: str) -> bool:
    """Whether the names of a piece say that it is a handle."""
    return HANDLE_WORDS.search(name) is not None


def collision_shapes(
    geometry: PartGeometry,
    part: str,
    config: ConvertConfig,
    repairs: Repairs,
    hollow: Array = NOTHING,
    budget: Budget = UNLIMITED,
) -> tuple[Shape, ...]:
    """Convex shapes that stand for one part.

    Args:
        geometry: What it shows and touches with.
        part: Its name.
        config: How fine the shapes are to be.
        repairs: Takes what was changed.
        hollow: Points (H, 3) of its cavity that no shape may fill [m].
        budget: Time for it.

    Raises:
        OutOfTimeError: It takes longer.
    """
    seen = geometry.shown
    if not seen:
        return ()
    shapes: list[Shape] = []
    only_given = True
    for link in dict.fromkeys(p.link for p in (*geometry.visuals, *geometry.collisions)):
        visuals = [p for p in geometry.visuals if p.link == link]
        given = [p for p in geometry.collisions if p.link == link]
        chosen = visuals or given
        if visuals and given and not geometry.collides_as_seen:
            usual = fineness(part, config) == 1.0  # what is to be finer did not pass the proof
            from_given = _given(given, visuals) if usual else None
            if from_given is not None:
                shapes += from_given
                continue
            repairs.add(f"collision geometry of link {link} strays from what is seen: made anew")
        only_given = False
        for piece in by_element(chosen):
            shapes += piece_shapes(piece, part, config, repairs, hollow, budget)
    if not shapes:  # everything is small
        one = hull(thick(np.vstack([p.mesh.vertices for p in seen])), seen[0].name)
        return () if one is None else (one,)
    whole = Surface(joined([p.mesh for p in seen]), hollow)
    tol = max(tolerance(whole.mesh) / fineness(part, config), FINEST_TOL_M)
    plain = [s for s in shapes if not is_handle(s.piece)]
    handles = without_hidden([s for s in shapes if is_handle(s.piece)])
    wanted = round(fineness(part, config) * config.max_geoms)
    most = max(wanted - len(handles), round(LEAST_LEFT * wanted))
    if not only_given or len(plain) > most:  # what the file gives itself seals nothing
        plain = merged(plain, whole, tol)
    plain = without_hidden(plain)
    few = min(most, max(config.max_geoms - len(handles), 1))
    plain = without_spare(plain, whole.mesh, few, sure=fineness(part, config) > 1.0)
    strict = None if fineness(part, config) == 1.0 else whole
    return (*within_budget(plain, most, part, repairs, strict, few), *handles)


def fineness(part: str, config: ConvertConfig) -> float:
    """How many times finer than usual the shapes of ``part`` are to be."""
    return FINER ** config.finer.count(part)


def by_element(pieces: list[Piece]) -> list[Piece]:
    """One piece for each element of the source, materials put together, handles kept apart."""
    groups: dict[tuple[str, bool], list[Piece]] = {}
    for piece in pieces:
        groups.setdefault((piece.element, is_handle(piece.name)), []).append(piece)
    out = []
    for group in groups.values():
        mesh = group[0].mesh
        if len(group) > 1:
            mesh = joined([p.mesh for p in group])
            mesh.merge_vertices(digits_vertex=6)
        out.append(replace(group[0], mesh=mesh))
    return out


def tolerance(mesh: trimesh.Trimesh, *, handle: bool = False) -> float:
    """How far a shape may stray from ``mesh`` [m]."""
    low, high = TOL_M
    return low if handle else float(np.clip(0.015 * mesh.scale, low, high))


def piece_shapes(
    piece: Piece,
    part: str,
    config: ConvertConfig,
    repairs: Repairs,
    hollow: Array = NOTHING,
    budget: Budget = UNLIMITED,
) -> list[Shape]:
    """Convex shapes for one visual or collision element."""
    budget.check()
    if piece.primitive is not None:
        return [_from_primitive(piece)]
    handle = is_handle(piece.name)
    tol = max(tolerance(piece.mesh, handle=handle) / fineness(part, config), FINEST_TOL_M)
    least = 0.2 * SMALL_M if handle else SMALL_M / fineness(part, config)
    if float(np.ptp(piece.mesh.vertices, axis=0).max()) < least:
        return []
    panel_m = 0.0 if handle or fineness(part, config) > 1.0 else PANEL_M
    surface = Surface(piece.mesh, hollow)
    whole = fitted(piece.mesh.vertices, surface, tol, piece.name, panel_m=panel_m)
    if whole is not None:
        return [whole]
    shapes: list[Shape] = []
    for component in components(piece.mesh, least):
        own = Surface(component, hollow)
        shape = fitted(component.vertices, own, tol, piece.name, panel_m=panel_m)
        if shape is not None:
            shapes.append(shape)
        else:
            shapes += _concave(own, tol, piece, part, config, repairs, budget)
    return merged(shapes, surface, tol)


def components(mesh: trimesh.Trimesh, least_m: float = 0.0) -> list[trimesh.Trimesh]:
    """Connected components by shared corners, without those smaller than ``least_m`` [m]."""
    labels = trimesh.graph.connected_component_labels(
        np.vstack([mesh.faces[:, :2], mesh.faces[:, 1:]]), node_count=len(mesh.vertices)
    )
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    groups = labels[faces[:, 0]]
    order = np.argsort(groups, kind="stable")
    found = []
    for some in np.split(order, np.flatnonzero(np.diff(groups[order])) + 1):
        used, index = _used(vertices, faces[some])
        if float(np.ptp(used, axis=0).max()) >= least_m:
            found.append(trimesh.Trimesh(used, index, process=False))
    return found


def _used(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    index, inverse = np.unique(faces, return_inverse=True)
    return vertices[index], inverse.reshape(-1, 3)


def _concave(
    surface: Surface,
    tol: float,
    piece: Piece,
    part: str,
    config: ConvertConfig,
    repairs: Repairs,
    budget: Budget,
) -> list[Shape]:
    """Shapes for a concave component: facets put together, else a decomposition."""
    mesh = surface.mesh
    if fineness(part, config) == 1.0 and float(np.ptp(mesh.vertices, axis=0).max()) <= COMPACT_M:
        one = hull(thick(mesh.vertices), piece.name)
        return [] if one is None else [one]
    most = round(fineness(part, config) * config.max_geoms)
    atoms = _facets(mesh, 1.0 - (1.0 - SHOWN_AREA) / fineness(part, config))
    if 0 < len(atoms) <= FEW_ATOMS:
        shapes = _of_facets(atoms, surface, tol, piece.name)
        if 0 < len(shapes) <= most:
            return shapes
    judged = surface_tolerance(mesh)
    enough: list[Shape] | None = None
    finest = judged if is_handle(piece.name) else min(tol, judged)
    judged = judged if fineness(part, config) == 1.0 else finest
    for near in dict.fromkeys((judged, finest)):  # too many are more if finer still
        shells = shell_shapes(mesh, near, piece.name, 2 * most, surface.hollow, budget)
        shells = None if shells is None else merged(shells, surface, near)
        if shells is None or len(shells) > most:
            break
        enough = shells
    if enough is not None:
        return enough
    if len(atoms) > FEW_ATOMS:
        shapes = _of_facets(atoms, surface, tol, piece.name)
        if 0 < len(shapes) <= most:
            return shapes
    if config.decompose:
        split = _split(surface, tol, piece, part, config, budget)
        if split is not None:
            return split
    one = hull(thick(mesh.vertices), piece.name)
    repairs.add(f"part {part}: a concave piece ({piece.name.strip()}) collides as its convex hull")
    return [] if one is None else [one]


def _split(
    surface: Surface, tol: float, piece: Piece, part: str, config: ConvertConfig, budget: Budget
) -> list[Shape] | None:
    """Shapes for a component that needs more of them than there may be.

    They stray, then. Patches of the surface are made of it in a moment, a decomposition takes
    its time and pays only where patches stray much.
    """
    times = fineness(part, config)
    budget.check()
    judged = surface_tolerance(surface.mesh)
    most = MAX_STAVES if times == 1.0 else times * config.max_geoms
    near = judged / times
    patches = staves(surface.mesh, near, piece.name, round(most), surface.hollow, budget)
    if patches is None or (times == 1.0 and _near_share(patches, surface, judged) < STAVES_NEAR):
        hulls = decompose(
            surface.mesh,
            1.2 * tol,
            round(MAX_HULLS * times),
            time_s=config.decompose_s,
            cache_dir=config.cache_dir,
        )
        if hulls is not None:
            found = [
                fitted(points, surface, tol, piece.name)
                or hull(thick(points, tol, surface.hollow), piece.name)
                for points in hulls
            ]
            return merged([s for s in found if s is not None], surface, tol)
    return None if patches is None else merged(patches, surface, judged)


def _near_share(shapes: list[Shape], surface: Surface, tol: float) -> float:
    """Share of the surfaces of ``shapes`` that lies at most ``tol`` [m] above ``surface``."""
    area = np.array([float(shape.mesh.area) for shape in shapes])
    near = np.array([Judged(shape, surface).first_share(tol) for shape in shapes])
    return float((area * near).sum() / max(area.sum(), 1e-12))


def _of_facets(
    atoms: list[trimesh.Trimesh], surface: Surface, tol: float, piece: str
) -> list[Shape]:
    """Shapes of the facets of a component, put together where that fits; none if too many."""
    shapes: list[Shape] = []
    for facet in atoms:
        found = _flat_shapes(facet, tol, piece, surface.hollow)
        if found is None or len(shapes) + len(found) > MAX_JOINED:
            return []
        shapes += found
    return merged(shapes, surface, tol)


def _facets(mesh: trimesh.Trimesh, shown: float = SHOWN_AREA) -> list[trimesh.Trimesh]:
    """Groups of adjacent coplanar triangles, each as a mesh; single triangles included.

    Those that make up the share ``shown`` of the area; none at all if they are more than can be
    put together.
    """
    grouped = [np.asarray(f) for f in mesh.facets]
    single = np.setdiff1d(np.arange(len(mesh.faces)), np.concatenate(grouped) if grouped else [])
    groups = [*grouped, *[np.array([i]) for i in single]]
    area_faces = np.asarray(mesh.area_faces)
    areas = np.array([area_faces[group].sum() for group in groups])
    order = np.argsort(-areas, kind="stable")
    share = np.cumsum(areas[order]) / areas.sum()
    kept = order[: int(np.searchsorted(share, shown)) + 1]
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if len(kept) > MAX_ATOMS:
        return []
    return [trimesh.Trimesh(*_used(vertices, faces[groups[k]]), process=False) for k in kept]


def _flat_shapes(
    facet: trimesh.Trimesh, tol: float, piece: str, hollow: Array
) -> list[Shape] | None:
    """Shapes of one facet; None if they are too many to be joined."""
    surface = Surface(facet, hollow)
    shape = fitted(facet.vertices, surface, tol, piece)
    if shape is not None:
        return [shape]
    patches = shell_shapes(facet, tol, piece, MAX_ATOMS, hollow)
    if patches is not None:
        return merged(patches, surface, tol)
    if len(facet.faces) > MAX_JOINED:
        return None
    triangles = [hull(thick(triangle, tol, hollow), piece) for triangle in facet.triangles]
    return [t for t in triangles if t is not None]


def _given(given: list[Piece], visuals: list[Piece]) -> list[Shape] | None:
    """Shapes of the source's own collision geometry, if they follow what is seen."""
    seen = joined([p.mesh for p in visuals])
    handle = any(is_handle(p.name) for p in visuals)
    tol = tolerance(seen, handle=handle)
    shapes: list[Shape] = []
    for piece in given:
        if piece.primitive is not None:
            shapes.append(_from_primitive(piece))
            continue
        for component in components(piece.mesh):
            shape = fitted(component.vertices, Surface(component), tol, piece.name)
            if shape is None:
                return None
            shapes.append(shape)
    if not shapes:
        return None
    surface = Surface(seen)
    if not all(is_near(shape, surface, 2.0 * tol) for shape in shapes):
        return None
    points, _ = sample_surface(seen, 400)
    outside = np.min([shape.outside(points) for shape in shapes], axis=0)
    told = any(is_handle(s.piece) for s in shapes)  # elements that say themselves what they are
    names = " ".join(dict.fromkeys(p.name for p in visuals if not (told and is_handle(p.name))))
    ok = float(np.mean(outside <= tol)) >= 0.95
    named = [s if is_handle(s.piece) else replace(s, piece=names) for s in shapes]
    return named if ok else None


def _from_primitive(piece: Piece) -> Shape:
    element = piece.primitive
    if element is None:
        raise ValueError("a mesh is no primitive")
    if element.kind == "box":
        half = (element.size[0] / 2.0, element.size[1] / 2.0, element.size[2] / 2.0)
        return Shape(kind="box", T_ps=element.T_lg, half=half, piece=piece.name)
    if element.kind == "cylinder":
        radius, length = element.size
        half = (radius, radius, length / 2.0)
        return Shape(kind="cylinder", T_ps=element.T_lg, half=half, piece=piece.name)
    if element.kind == "sphere":
        radius = element.size[0]
        half = (radius, radius, radius)
        return Shape(kind="sphere", T_ps=element.T_lg, half=half, piece=piece.name)
    shape = hull(np.asarray(piece.mesh.vertices), piece.name)
    if shape is None:
        raise ValueError("a capsule has volume")
    return shape
