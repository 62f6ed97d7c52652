"""Collision shapes of a part: hollow where it is hollow, few, and boxes where they fit."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from articulate.convert.config import ConvertConfig
from articulate.convert.decompose import decompose
from articulate.convert.fit import box_shares, fitted, hull, is_near, thick
from articulate.convert.mesh import PartGeometry, Piece, joined
from articulate.convert.repairs import Repairs
from articulate.convert.shapes import Shape, sample_surface
from articulate.convert.shells import PLANES, shell_shapes
from articulate.transforms import Array

HANDLE_WORDS = re.compile(r"handle|(?<![a-z])k?nob|pull(?!ey)|grip", re.IGNORECASE)
"""What handles are called: sektion's ``door_left_nob``, PartNet's ``handle-12``."""
SMALL_M = 0.01
"""Components smaller than this are left out [m]; handles are kept down to 2 mm."""
SHOWN_AREA = 0.96
"""Share of a component's area that its facets must make up; the small rest is left out."""
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
MAX_HULLS = 16
"""Most convex parts of a decomposition, twice that where it is to be finer."""
SPARE_LEAST = 0.97
"""Share of what is seen that stays covered when shapes over the budget are left out."""
SPARE_SAMPLES = 2000
"""Points that decide about it."""
MAX_REFUSED = 300
"""After this many pairs that cannot be joined the rest is left as it is."""
HOPEFUL_SHARE = 0.25
"""Two shapes are joined only if this share of their common upright box lies near the surface."""
TOL_M = (0.003, 0.010)
"""Least and largest distance of a shape's surface from what it stands for [m]."""


def is_handle(name: str) -> bool:
    """Whether the names of a piece say that it is a handle."""
    return HANDLE_WORDS.search(name) is not None


def collision_shapes(
    geometry: PartGeometry, part: str, config: ConvertConfig, repairs: Repairs
) -> tuple[Shape, ...]:
    """Convex shapes that stand for one part."""
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
            from_given = _given(given, visuals)
            if from_given is not None:
                shapes += from_given
                continue
            repairs.add(f"collision geometry of link {link} strays from what is seen: made anew")
        only_given = False
        for piece in by_element(chosen):
            shapes += piece_shapes(piece, part, config, repairs)
    if not shapes:  # everything is small
        one = hull(thick(np.vstack([p.mesh.vertices for p in seen])), seen[0].name)
        return () if one is None else (one,)
    tol = tolerance(joined([p.mesh for p in seen])) / fineness(part, config)
    plain = [s for s in shapes if not is_handle(s.piece)]
    handles = without_hidden([s for s in shapes if is_handle(s.piece)])
    budget = round(fineness(part, config) * config.max_geoms) - len(handles)
    if not only_given or len(plain) > budget:  # what the file gives itself seals nothing
        plain = merged(plain, joined([p.mesh for p in seen]), tol)
    plain = without_hidden(plain)
    plain = without_spare(plain, joined([p.mesh for p in seen]), budget)
    return (*within_budget(plain, budget, part, repairs), *handles)


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


def surface_tolerance(mesh: trimesh.Trimesh) -> float:
    """How far shapes may lie from what is seen, as the proof judges it [m]."""
    return max(0.003, 0.01 * float(mesh.scale))


def piece_shapes(piece: Piece, part: str, config: ConvertConfig, repairs: Repairs) -> list[Shape]:
    """Convex shapes for one visual or collision element."""
    if piece.primitive is not None:
        return [_from_primitive(piece)]
    handle = is_handle(piece.name)
    tol = tolerance(piece.mesh, handle=handle) / fineness(part, config)
    least = 0.2 * SMALL_M if handle else SMALL_M
    if float(np.ptp(piece.mesh.vertices, axis=0).max()) < least:
        return []
    panel_m = 0.0 if handle or fineness(part, config) > 1.0 else PANEL_M
    whole = fitted(piece.mesh.vertices, piece.mesh, tol, piece.name, panel_m=panel_m)
    if whole is not None:
        return [whole]
    shapes: list[Shape] = []
    for component in components(piece.mesh):
        if float(np.ptp(component.vertices, axis=0).max()) < least:
            continue
        shape = fitted(component.vertices, component, tol, piece.name, panel_m=panel_m)
        shapes += (
            [shape] if shape is not None else _concave(component, tol, piece, part, config, repairs)
        )
    return merged(shapes, piece.mesh, tol)


def components(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Connected components by shared corners."""
    labels = trimesh.graph.connected_component_labels(
        np.vstack([mesh.faces[:, :2], mesh.faces[:, 1:]]), node_count=len(mesh.vertices)
    )
    groups = labels[mesh.faces[:, 0]]
    return [
        trimesh.Trimesh(*_used(mesh.vertices, mesh.faces[groups == label]), process=False)
        for label in np.unique(groups)
    ]


def _used(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    index, inverse = np.unique(faces, return_inverse=True)
    return vertices[index], inverse.reshape(-1, 3)


def _concave(
    mesh: trimesh.Trimesh,
    tol: float,
    piece: Piece,
    part: str,
    config: ConvertConfig,
    repairs: Repairs,
) -> list[Shape]:
    """Shapes for a concave component: facets put together, else a decomposition."""
    if fineness(part, config) == 1.0 and float(np.ptp(mesh.vertices, axis=0).max()) <= COMPACT_M:
        one = hull(thick(mesh.vertices), piece.name)
        return [] if one is None else [one]
    most = round(fineness(part, config) * config.max_geoms)
    atoms = _facets(mesh)
    if len(atoms) <= FEW_ATOMS:
        shapes = _of_facets(atoms, mesh, tol, piece.name)
        if 0 < len(shapes) <= most:
            return shapes
    judged = surface_tolerance(mesh)
    for near in dict.fromkeys((min(tol, judged), judged)):
        shells = shell_shapes(mesh, near, piece.name, 2 * most)
        if shells is not None:
            shells = merged(shells, mesh, near)
            if len(shells) <= most:
                return shells
    if FEW_ATOMS < len(atoms) <= MAX_ATOMS:
        shapes = _of_facets(atoms, mesh, tol, piece.name)
        if 0 < len(shapes) <= most:
            return shapes
    if config.decompose:
        hulls = decompose(
            mesh,
            1.2 * tol,
            round(MAX_HULLS * fineness(part, config)),
            time_s=config.decompose_s,
            cache_dir=config.cache_dir,
        )
        if hulls is not None:
            found = [
                fitted(points, mesh, tol, piece.name) or hull(thick(points, tol), piece.name)
                for points in hulls
            ]
            return merged([s for s in found if s is not None], mesh, tol)
    one = hull(thick(mesh.vertices), piece.name)
    repairs.add(f"part {part}: a concave piece ({piece.name.strip()}) collides as its convex hull")
    return [] if one is None else [one]


def _of_facets(
    atoms: list[trimesh.Trimesh], mesh: trimesh.Trimesh, tol: float, piece: str
) -> list[Shape]:
    """Shapes of the facets of a component, put together where that fits."""
    return merged([s for facet in atoms for s in _flat_shapes(facet, mesh, tol, piece)], mesh, tol)


def _facets(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Groups of adjacent coplanar triangles, each as a mesh; single triangles included."""
    grouped = [np.asarray(f) for f in mesh.facets]
    single = np.setdiff1d(np.arange(len(mesh.faces)), np.concatenate(grouped) if grouped else [])
    groups = [*grouped, *[np.array([i]) for i in single]]
    areas = np.array([mesh.area_faces[group].sum() for group in groups])
    order = np.argsort(-areas, kind="stable")
    share = np.cumsum(areas[order]) / areas.sum()
    kept = order[: int(np.searchsorted(share, SHOWN_AREA)) + 1]
    return [
        trimesh.Trimesh(*_used(mesh.vertices, mesh.faces[groups[k]]), process=False) for k in kept
    ]


def _flat_shapes(
    facet: trimesh.Trimesh, mesh: trimesh.Trimesh, tol: float, piece: str
) -> list[Shape]:
    shape = fitted(facet.vertices, facet, tol, piece)
    if shape is not None:
        return [shape]
    patches = shell_shapes(facet, tol, piece, MAX_ATOMS)
    if patches is not None:
        return merged(patches, facet, tol)
    triangles = [hull(thick(triangle, tol), piece) for triangle in facet.triangles]
    return [t for t in triangles if t is not None]


def merged(shapes: list[Shape], surface: trimesh.Trimesh, tol: float) -> list[Shape]:
    """Fewer shapes: neighbours are joined as long as the result stays near ``surface``."""
    shapes = list(shapes)
    if len(shapes) > 3 * MAX_ATOMS:
        return shapes
    refused: set[tuple[Shape, Shape]] = set()
    while len(refused) < MAX_REFUSED:
        joined = _join_one(shapes, surface, tol, refused)
        if joined is None:
            return shapes
        shapes = joined
    return shapes


def _join_one(
    shapes: list[Shape], surface: trimesh.Trimesh, tol: float, refused: set[tuple[Shape, Shape]]
) -> list[Shape] | None:
    """The shapes with the first pair joined that can be, smallest common box first."""
    if len(shapes) < 2:
        return None
    low = np.array([s.bounds[0] for s in shapes])
    high = np.array([s.bounds[1] for s in shapes])
    apart = (low[:, None] > high[None] + 2.0 * tol).any(axis=-1)
    pairs = np.argwhere(np.triu(~(apart | apart.T), 1))
    open_pairs = [(i, j) for i, j in pairs.tolist() if (shapes[i], shapes[j]) not in refused]
    if not open_pairs:
        return None
    index = np.array(open_pairs)
    boxes = np.stack(
        [
            np.minimum(low[index[:, 0]], low[index[:, 1]]),
            np.maximum(high[index[:, 0]], high[index[:, 1]]),
        ],
        axis=1,
    )
    hopeful = box_shares(boxes, surface, tol) >= HOPEFUL_SHARE
    for k in np.argsort(np.prod(boxes[:, 1] - boxes[:, 0], axis=1), kind="stable"):
        one, two = (shapes[v] for v in open_pairs[k])
        if hopeful[k]:
            points = np.vstack([one.corners, two.corners])
            shape = fitted(points, surface, tol, one.piece, turned=False)
            if shape is not None:
                return [*[s for s in shapes if s is not one and s is not two], shape]
        refused.add((one, two))
    return None


def without_hidden(shapes: list[Shape]) -> list[Shape]:
    """The shapes that do not lie inside a single other one."""
    kept: list[Shape] = []
    for shape in sorted(shapes, key=lambda s: -s.volume):
        if not any(float(other.outside(shape.corners).max()) < 1e-3 for other in kept):
            kept.append(shape)
    return kept


def without_spare(shapes: list[Shape], surface: trimesh.Trimesh, budget: int) -> list[Shape]:
    """At most ``budget`` shapes, as long as those left out stand for next to nothing alone.

    Trims and rims lie close to panels: what they cover of ``surface`` is covered twice.
    """
    if len(shapes) <= budget:
        return shapes
    points, _ = sample_surface(surface, SPARE_SAMPLES)
    near = PLANES * surface_tolerance(surface)
    covers = np.array([shape.outside(points) <= near for shape in shapes])
    count = covers.sum(axis=0)
    kept = list(range(len(shapes)))
    while len(kept) > budget:
        alone = (covers[kept] & (count == 1)).mean(axis=1)
        least = int(np.argmin(alone))
        if float((count > 0).mean() - alone[least]) < SPARE_LEAST:
            break
        count = count - covers[kept[least]]
        del kept[least]
    return [shapes[k] for k in kept]


def within_budget(
    shapes: list[Shape], budget: int, part: str, repairs: Repairs
) -> tuple[Shape, ...]:
    """At most ``budget`` shapes: pairs whose common hull adds least volume are joined."""
    shapes = list(shapes)
    before = len(shapes)
    while len(shapes) > max(budget, 1):
        shapes = _cheapest_join(shapes)
    if len(shapes) < before:
        repairs.add(f"part {part}: {before} collision shapes joined to {len(shapes)}")
    return tuple(shapes)


def _cheapest_join(shapes: list[Shape]) -> list[Shape]:
    """The shapes with the pair joined whose common upright box adds least volume."""
    low = np.array([s.bounds[0] for s in shapes])
    high = np.array([s.bounds[1] for s in shapes])
    size = np.prod(high - low, axis=1)
    common = np.prod(np.maximum(high[:, None], high) - np.minimum(low[:, None], low), axis=-1)
    added = common - size[:, None] - size[None]
    added[np.tril_indices(len(shapes))] = np.inf
    i, j = (int(k) for k in np.unravel_index(np.argmin(added), added.shape))
    joint = hull(np.vstack([shapes[i].corners, shapes[j].corners]), shapes[i].piece)
    rest = [s for k, s in enumerate(shapes) if k not in (i, j)]
    return [*rest, joint] if joint is not None else [*rest, shapes[i]]


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
            shape = fitted(component.vertices, component, tol, piece.name)
            if shape is None:
                return None
            shapes.append(shape)
    if not shapes:
        return None
    if not all(is_near(shape, seen, 2.0 * tol) for shape in shapes):
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
