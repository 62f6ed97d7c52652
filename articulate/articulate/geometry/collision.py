"""Collision shapes of a part: few convex shapes, boxes where they fit, cavities left free."""

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
from articulate.geometry.convex_fit import ShapeDistance, fitted, hull, is_near, thick
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
"""Names of handles, such as sektion's ``door_left_nob`` and PartNet's ``handle-12``."""
SMALL_M = 0.01
"""Size below which components are left out [m]; handles are kept down to 2 mm."""
FACET_AREA = 0.96
"""Fraction of a component's area that its facets must cover; less is left out of finer shapes."""
PANEL_M = 0.03
"""Thickness up to which panels with recesses become boxes at the usual fineness [m]."""
COMPACT_M = 0.07
"""Size up to which concave components become their hull at the usual fineness [m]."""
FEW_ATOMS = 16
"""Facets of a component up to which they are merged before anything else is tried."""
MAX_ATOMS = 64
"""Most facets of a component that are merged instead of decomposing it."""
FINER = 2.0
"""Factor of fineness for each time that a part is listed in ``ConvertConfig.finer``."""
LEAST_LEFT = 0.25
"""Least fraction of the shape budget that handles, which are never merged, leave to the rest."""
MAX_HULLS = 16
"""Most convex parts of a decomposition, multiplied by the fineness."""
MAX_STAVES = 32
"""Most patches of a surface that needs more shapes than the budget has, at the usual fineness."""
STAVES_NEAR = 0.6
"""Fraction of the patches near the surface above which no decomposition is tried."""
TOL_M = (0.003, 0.010)
"""Least and largest distance of a shape's surface from the visual surface [m]."""
FINEST_TOL_M = 0.0011
"""Least tolerance at any fineness [m]: all shapes have some thickness."""


def is_handle(name: str) -> bool:
    """Return whether the names of a piece are those of a handle."""
    return HANDLE_WORDS.search(name) is not None


def collision_shapes(
    geometry: PartGeometry,
    part: str,
    config: ConvertConfig,
    repairs: Repairs,
    hollow: Array = NOTHING,
    budget: Budget = UNLIMITED,
) -> tuple[Shape, ...]:
    """Approximate a part by convex shapes.

    Args:
        geometry: Visual and collision geometry of the part [m].
        part: Name of the part.
        config: Options; ``max_geoms``, ``finer`` and ``decompose`` are used.
        repairs: Receives the changes.
        hollow: Points of its cavity (H, 3) that no shape may fill [m].
        budget: Processor time.

    Raises:
        OutOfTimeError: The budget is spent.
    """
    seen = geometry.visible
    if not seen:
        return ()
    shapes: list[Shape] = []
    only_source = True
    for link in dict.fromkeys(p.link for p in (*geometry.visuals, *geometry.collisions)):
        visuals = [p for p in geometry.visuals if p.link == link]
        stated = [p for p in geometry.collisions if p.link == link]
        chosen = visuals or stated
        if visuals and stated and not geometry.collides_as_seen:
            usual = fineness(part, config) == 1.0  # finer shapes follow failed checks
            from_source = _source_shapes(stated, visuals) if usual else None
            if from_source is not None:
                shapes += from_source
                continue
            repairs.add(
                f"collision geometry of link {link} differs from the visual geometry: replaced"
            )
        only_source = False
        for piece in by_element(chosen):
            shapes += piece_shapes(piece, part, config, repairs, hollow, budget)
    if not shapes:  # everything is small
        one = hull(thick(np.vstack([p.mesh.vertices for p in seen])), seen[0].name)
        return () if one is None else (one,)
    surface = Surface(joined([p.mesh for p in seen]), hollow)
    tol = max(tolerance(surface.mesh) / fineness(part, config), FINEST_TOL_M)
    plain = [s for s in shapes if not is_handle(s.piece)]
    handles = without_hidden([s for s in shapes if is_handle(s.piece)])
    wanted = round(fineness(part, config) * config.max_geoms)
    most = max(wanted - len(handles), round(LEAST_LEFT * wanted))
    if not only_source or len(plain) > most:  # shapes of the file close no cavity
        plain = merged(plain, surface, tol)
    plain = without_hidden(plain)
    few = min(most, max(config.max_geoms - len(handles), 1))
    plain = without_spare(plain, surface.mesh, few, sure=fineness(part, config) > 1.0)
    strict = None if fineness(part, config) == 1.0 else surface
    return (*within_budget(plain, most, part, repairs, strict, few), *handles)


def fineness(part: str, config: ConvertConfig) -> float:
    """Return the factor by which the shapes of ``part`` should be finer than usual."""
    return FINER ** config.finer.count(part)


def by_element(pieces: list[Piece]) -> list[Piece]:
    """Merge the materials of each element of the source into one piece; keep handles apart."""
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
    """Return the largest distance between a shape and ``mesh`` [m]."""
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
    """Approximate one visual or collision element by convex shapes.

    Args:
        piece: The element, in the frame of its part [m].
        part: Name of the part.
        config: Options; ``finer``, ``max_geoms`` and ``decompose`` are used.
        repairs: Receives the changes.
        hollow: Points of a cavity (H, 3) that no shape may fill [m].
        budget: Processor time.
    """
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
    single = fitted(piece.mesh.vertices, surface, tol, piece.name, panel_m=panel_m)
    if single is not None:
        return [single]
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
    """Split a mesh by shared corners; leave out components smaller than ``least_m`` [m]."""
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
    """Shapes for a concave component: merged facets or patches, else a decomposition."""
    mesh = surface.mesh
    if fineness(part, config) == 1.0 and float(np.ptp(mesh.vertices, axis=0).max()) <= COMPACT_M:
        one = hull(thick(mesh.vertices), piece.name)
        return [] if one is None else [one]
    most = round(fineness(part, config) * config.max_geoms)
    atoms = _facets(mesh, 1.0 - (1.0 - FACET_AREA) / fineness(part, config))
    if 0 < len(atoms) <= FEW_ATOMS:
        shapes = _of_facets(atoms, surface, tol, piece.name)
        if 0 < len(shapes) <= most:
            return shapes
    coarsest = surface_tolerance(mesh)
    enough: list[Shape] | None = None
    finest = coarsest if is_handle(piece.name) else min(tol, coarsest)
    coarsest = coarsest if fineness(part, config) == 1.0 else finest
    for near in dict.fromkeys((coarsest, finest)):  # finer needs even more shapes
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
    """Shapes for a component that needs more of them than the budget has.

    They exceed the tolerance. Patches of the surface are fast; a decomposition is slow and used
    only where patches are far from the surface.
    """
    times = fineness(part, config)
    budget.check()
    coarsest = surface_tolerance(surface.mesh)
    most = MAX_STAVES if times == 1.0 else times * config.max_geoms
    near = coarsest / times
    patches = staves(surface.mesh, near, piece.name, round(most), surface.hollow, budget)
    if patches is None or (times == 1.0 and _near_share(patches, surface, coarsest) < STAVES_NEAR):
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
    return None if patches is None else merged(patches, surface, coarsest)


def _near_share(shapes: list[Shape], surface: Surface, tol: float) -> float:
    """Fraction of the surfaces of ``shapes`` at most ``tol`` [m] above ``surface``."""
    area = np.array([float(shape.mesh.area) for shape in shapes])
    near = np.array([ShapeDistance(shape, surface).first_share(tol) for shape in shapes])
    return float((area * near).sum() / max(area.sum(), 1e-12))


def _of_facets(
    atoms: list[trimesh.Trimesh], surface: Surface, tol: float, piece: str
) -> list[Shape]:
    """Merge the facets of a component into shapes; none if they are too many."""
    shapes: list[Shape] = []
    for facet in atoms:
        found = _flat_shapes(facet, tol, piece, surface.hollow)
        if found is None or len(shapes) + len(found) > MAX_JOINED:
            return []
        shapes += found
    return merged(shapes, surface, tol)


def _facets(mesh: trimesh.Trimesh, fraction: float = FACET_AREA) -> list[trimesh.Trimesh]:
    """Return groups of adjacent coplanar triangles, each as a mesh; single triangles included.

    The largest that cover ``fraction`` of the area; none if they are more than can be merged.
    """
    grouped = [np.asarray(f) for f in mesh.facets]
    single = np.setdiff1d(np.arange(len(mesh.faces)), np.concatenate(grouped) if grouped else [])
    groups = [*grouped, *[np.array([i]) for i in single]]
    area_faces = np.asarray(mesh.area_faces)
    areas = np.array([area_faces[group].sum() for group in groups])
    order = np.argsort(-areas, kind="stable")
    share = np.cumsum(areas[order]) / areas.sum()
    kept = order[: int(np.searchsorted(share, fraction)) + 1]
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if len(kept) > MAX_ATOMS:
        return []
    return [trimesh.Trimesh(*_used(vertices, faces[groups[k]]), process=False) for k in kept]


def _flat_shapes(
    facet: trimesh.Trimesh, tol: float, piece: str, hollow: Array
) -> list[Shape] | None:
    """Shapes of one facet; None if they are too many to be merged."""
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


def _source_shapes(stated: list[Piece], visuals: list[Piece]) -> list[Shape] | None:
    """Shapes of the collision geometry in the source, if they follow the visual geometry."""
    seen = joined([p.mesh for p in visuals])
    handle = any(is_handle(p.name) for p in visuals)
    tol = tolerance(seen, handle=handle)
    shapes: list[Shape] = []
    for piece in stated:
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
    has_handle = any(is_handle(s.piece) for s in shapes)  # collision elements with telling names
    names = " ".join(
        dict.fromkeys(p.name for p in visuals if not (has_handle and is_handle(p.name)))
    )
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
