"""Read an SDF model, the format of Gazebo and Drake, into plain data.

Versions 1.4 to 1.12. A link of the result has its frame at the joint that moves it, with the
orientation of the SDF link.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from articulate.errors import AssetError, quote
from articulate.formats.mesh_paths import resolve
from articulate.formats.repairs import Repairs
from articulate.formats.sdf_model import MODEL, WORLD, SdfModel, float_of, text_of
from articulate.formats.source_object import (
    Rgba,
    SourceGeometry,
    SourceInertial,
    SourceJoint,
    SourceLink,
    SourceObject,
    check_counts,
)
from articulate.formats.xml_input import Element, child_of, children_of, tag_of
from articulate.transforms import Array, inverse, pose

KINDS = ("revolute", "continuous", "prismatic", "fixed", "screw")
GAZEBO_COLOURS: dict[str, Rgba] = {
    "Gazebo/Red": (1.0, 0.0, 0.0, 1.0),
    "Gazebo/Green": (0.0, 1.0, 0.0, 1.0),
    "Gazebo/Blue": (0.0, 0.0, 1.0, 1.0),
    "Gazebo/Yellow": (1.0, 1.0, 0.0, 1.0),
    "Gazebo/Orange": (1.0, 0.5088, 0.0468, 1.0),
    "Gazebo/White": (1.0, 1.0, 1.0, 1.0),
    "Gazebo/Grey": (0.7, 0.7, 0.7, 1.0),
    "Gazebo/DarkGrey": (0.175, 0.175, 0.175, 1.0),
    "Gazebo/Black": (0.0, 0.0, 0.0, 1.0),
    "Gazebo/Wood": (0.6, 0.45, 0.3, 1.0),
}
"""Diffuse colours of Gazebo's plain materials; the mean of its image for the last."""


def read_sdf(path: Path) -> SourceObject:
    """Read the SDF file at ``path``: its one model, with the models that it includes.

    Raises:
        AssetError: It cannot be read, holds several models, or something that is not supported.
    """
    return _Builder(SdfModel(path, Repairs())).source()


class _Builder:
    """Convert the links and joints of a model to plain data."""

    def __init__(self, model: SdfModel) -> None:
        self.model = model

    def source(self) -> SourceObject:
        element, version = self.model.top_model()
        self.model.collect(element, self.model.path, version, scope="", parent="", depth=0)
        content = self.model.content
        geometries = sum(
            len(children_of(e, tag))
            for e, _ in content.links.values()
            for tag in ("visual", "collision")
        )
        check_counts(self.model.path, len(content.links), len(content.joints), geometries)
        if not content.links:
            raise AssetError(f"{self.model.path}: the model has no <link>")
        joints = [j for name in content.joints for j in self.joint(name)]
        moved = {j.child: (j, T) for j, T in joints}
        links = {
            name: self.link(name, moved[name][1] if name in moved else np.eye(4))
            for name in content.links
        }
        found = [self.placed(joint, moved) for joint, _ in joints]
        roots = {name: self.model.pose_of(name) for name in links if name not in moved}
        uses_world = any(joint.parent == WORLD for joint in found)
        upright = len(roots) == 1 and np.array_equal(next(iter(roots.values())), np.eye(4))
        if uses_world or not upright:
            links = {WORLD: SourceLink(name=WORLD), **links}
            found += [
                SourceJoint(
                    name=f"{name}_world",
                    kind="fixed",
                    parent=WORLD,
                    child=name,
                    T_pc=T,
                    where=str(self.model.path),
                )
                for name, T in roots.items()
            ]
        if len(roots) > 1:
            names = ", ".join(list(roots)[:4])
            self.model.repairs.add(f"links without a joint fixed to the world: {names}")
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", element.get("name") or self.model.path.stem)
        return SourceObject(
            name=name,
            path=self.model.path,
            links=links,
            joints=tuple(found),
            repairs=self.model.repairs,
            files=self.model.files,
        )

    def joint(self, name: str) -> Iterator[tuple[SourceJoint, Array]]:
        """Yield a joint, and the pose of its frame in the child link (4, 4), if it is read."""
        element, path, scope, version = self.model.content.joints[name]
        where, kind = self.model.at(element, path), (element.get("type") or "").strip()
        if kind == "gearbox":
            self.model.repairs.note(f"gearbox {name} left out")
            return
        if kind not in KINDS:
            raise AssetError(
                f"{where}: joint {quote(name)} is of type {quote(kind)}; {', '.join(KINDS)} are "
                "accepted: write joints of several axes as several joints"
            )
        ends = []
        for key in ("parent", "child"):
            end = text_of(element, key)
            if not end:
                raise AssetError(f"{where}: joint {quote(name)} lacks a parent or a child")
            ends.append(self.model.link_of(end if end == WORLD else scope + end, where))
        parent, child = ends
        if child == WORLD:
            raise AssetError(f"{where}: the child of joint {quote(name)} is the world")
        frame = self.model.frame(name, where)
        T_cj = frame.T
        if frame.relative_to != child:
            T_cj = inverse(self.model.pose_of(child, where)) @ self.model.pose_of(name, where)
        axis = child_of(element, "axis")
        limit = None if axis is None else child_of(axis, "limit")
        dynamics = None if axis is None else child_of(axis, "dynamics")
        lower, upper = (self.model.number(limit, key, path) for key in ("lower", "upper"))
        if kind == "revolute" and lower is None and upper is None:
            kind = "continuous"
        if self.model.number(dynamics, "spring_stiffness", path):
            self.model.repairs.add(f"spring of joint {name} left out")
        joint = SourceJoint(
            name=name,
            kind=kind,
            parent=parent,
            child=child,
            T_pc=np.eye(4),
            axis=(0.0, 0.0, 1.0)
            if axis is None
            else self.axis(axis, path, scope, version, child, T_cj),
            lower=lower,
            upper=upper,
            damping=self.model.number(dynamics, "damping", path),
            friction=self.model.number(dynamics, "friction", path),
            mimic=None if axis is None else self.mimic(axis, path, scope),
            pitch=self.pitch(element, path),
            where=where,
        )
        yield joint, np.eye(4) if kind == "fixed" else T_cj

    def placed(
        self, joint: SourceJoint, moved: Mapping[str, tuple[SourceJoint, Array]]
    ) -> SourceJoint:
        """Return the joint with the pose of its child in its parent, each at its joint."""
        T_parent, T_child = (
            self.model.pose_of(name) @ _offset(moved[name][1])
            if name in moved
            else self.model.pose_of(name)
            for name in (joint.parent, joint.child)
        )
        identity = np.array_equal(T_parent, np.eye(4))
        return replace(joint, T_pc=T_child if identity else inverse(T_parent) @ T_child)

    def axis(
        self, axis: Element, path: Path, scope: str, version: int, child: str, T_cj: Array
    ) -> tuple[float, float, float]:
        """Return the direction of an axis in the frame of the child link."""
        found = child_of(axis, "xyz")
        xyz = (0.0, 0.0, 1.0) if found is None else self.model.numbers(found, path)
        where = self.model.at(axis, path)
        if len(xyz) != 3:
            raise AssetError(f"{where}: <xyz> has {len(xyz)} numbers, not 3")
        frame = "" if found is None else (found.get("expressed_in") or "")
        in_model = text_of(axis, "use_parent_model_frame") in {"1", "true"}
        if not frame and (version <= 4 or in_model):
            frame = MODEL
        if frame:
            R_frame = self.model.pose_of(scope + frame if frame != WORLD else frame, where)[:3, :3]
            R = self.model.pose_of(child, where)[:3, :3].T @ R_frame
        else:
            R = T_cj[:3, :3]
        direction = R @ np.array(xyz)
        return (float(direction[0]), float(direction[1]), float(direction[2]))

    def mimic(self, axis: Element, path: Path, scope: str) -> tuple[str, float, float] | None:
        """Return leading joint, multiplier and offset, of SDF 1.11 or Drake."""
        for element in axis:
            if tag_of(element).rsplit(":", 1)[-1] != "mimic" or not element.get("joint"):
                continue
            values = []
            for key, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0)):
                value = self.model.number(element, key, path)
                if value is None and element.get(key):
                    value = float_of(element.get(key) or "")
                values.append(default if value is None else value)
            multiplier, offset, reference = values
            return (
                scope + (element.get("joint") or ""),
                multiplier,
                offset - multiplier * reference,
            )
        return None

    def pitch(self, element: Element, path: Path) -> float | None:
        """Return the travel of a screw for one turn, to the right."""
        travel = self.model.number(element, "screw_thread_pitch", path)
        if travel is not None:
            return travel
        turns = self.model.number(element, "thread_pitch", path)  # rad for each metre, to the left
        return -2.0 * math.pi / turns if turns else None

    def link(self, name: str, T_lj: Array) -> SourceLink:
        """Return a link with its frame moved to the joint of pose ``T_lj`` (4, 4) in it."""
        element, path = self.model.content.links[name]
        scope = name[: name.rfind("::") + 2] if "::" in name else ""
        T_jl = inverse(_offset(T_lj)) if T_lj[:3, 3].any() else np.eye(4)
        shapes = []
        for tag in ("visual", "collision"):
            found = (self.geometry(e, path, scope, name, T_jl) for e in children_of(element, tag))
            shapes.append(tuple(shape for shape in found if shape is not None))
        inertial = self.inertial(element, path, scope, name, T_jl)
        return SourceLink(name=name, visuals=shapes[0], collisions=shapes[1], inertial=inertial)

    def pose_in_link(
        self, element: Element, path: Path, scope: str, link: str, T_jl: Array
    ) -> Array:
        relative_to, T = self.model.pose_in(element, path, scope)
        if relative_to and relative_to != link:
            T_frame = self.model.pose_of(relative_to, self.model.at(element, path))
            T = inverse(self.model.pose_of(link)) @ T_frame @ T
        return T if np.array_equal(T_jl, np.eye(4)) else T_jl @ T

    def geometry(
        self, element: Element, path: Path, scope: str, link: str, T_jl: Array
    ) -> SourceGeometry | None:
        """Return a visual or collision element; None where it is left out."""
        tag, where = tag_of(element), self.model.at(element, path)
        holder = child_of(element, "geometry")
        shapes = [] if holder is None else [e for e in holder if isinstance(e.tag, str)]
        kind = tag_of(shapes[0]).rsplit(":", 1)[-1] if shapes else "empty"
        if kind in {"empty", "plane", "heightmap", "image", "polyline"}:
            if kind != "empty":
                self.model.repairs.note(f"<{kind}> of a {tag} left out (line {element.sourceline})")
            return None
        shape = shapes[0]
        T_lg = self.pose_in_link(element, path, scope, link, T_jl)
        plain = "mesh"
        size: tuple[float, ...] = ()
        triangles = None
        if kind == "box":
            plain, size = "box", self.model.sizes(shape, path, "size", 3)
        elif kind == "sphere":
            plain, size = "sphere", self.model.sizes(shape, path, "radius", 1)
        elif kind in {"cylinder", "capsule", "cone"}:
            plain = kind
            size = (
                *self.model.sizes(shape, path, "radius", 1),
                *self.model.sizes(shape, path, "length", 1),
            )
        elif kind == "ellipsoid":
            ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
            triangles = np.asarray(ball.triangles) * np.array(
                self.model.sizes(shape, path, "radii", 3)
            )
        elif kind != "mesh":
            raise AssetError(
                f"{where}: geometry <{kind[:60]}> is not known; box, sphere, cylinder, capsule, "
                "cone, ellipsoid and mesh are accepted"
            )
        if kind == "cone":
            cone = trimesh.creation.cone(radius=size[0], height=size[1])
            triangles = np.asarray(cone.triangles) - [0.0, 0.0, size[1] / 2]
            plain, size = "mesh", ()
        uri, scale = self.mesh(shape, path) if kind == "mesh" else ("", (1.0, 1.0, 1.0))
        rgba, texture = self.material(element, path)
        return SourceGeometry(
            kind=plain,  # type: ignore[arg-type]  # one of the kinds above
            name=(element.get("name") or "").strip(),
            T_lg=T_lg,
            size=size,
            filename=uri,
            scale=scale,
            triangles=triangles,
            rgba=None if texture else rgba,
            texture=texture,
            where=where,
        )

    def mesh(self, shape: Element, path: Path) -> tuple[str, tuple[float, float, float]]:
        """Return the URI of a mesh, from the folder of the main file, and its scale."""
        where, uri = self.model.at(shape, path), text_of(shape, "uri")
        if not uri:
            raise AssetError(f"{where}: <mesh> without a <uri>")
        if child_of(shape, "submesh") is not None:
            raise AssetError(f"{where}: <submesh> is not read; save the submesh as its own file")
        factors = (1.0, 1.0, 1.0)
        scale = child_of(shape, "scale")
        if scale is not None:
            values = self.model.numbers(scale, path)
            if len(values) != 3 or any(abs(v) < 1e-9 for v in values):
                raise AssetError(f"{where}: <scale> {quote(scale.text or '')} flattens the mesh")
            factors = (values[0], values[1], values[2])
        if (
            path != self.model.path
        ):  # an included model: its files are looked for from its own folder
            try:
                uri = str(resolve(uri, path).resolve())
            except AssetError as error:
                raise AssetError(f"{where}: {error}") from None
        return uri, factors

    def material(self, element: Element, path: Path) -> tuple[Rgba | None, str]:
        """Return the colour of a visual, and its image if it has one."""
        material = child_of(element, "material")
        if material is None:
            return None, ""
        texture = ""
        for pbr in children_of(material, "pbr"):
            for workflow in pbr:
                texture = texture or text_of(workflow, "albedo_map")
        if texture and path != self.model.path:
            with contextlib.suppress(AssetError):
                texture = str(resolve(texture, path).resolve())
        clear = self.model.number(element, "transparency", path) or 0.0
        for key in ("diffuse", "ambient"):
            colour = child_of(material, key)
            values = () if colour is None else self.model.numbers(colour, path)
            if len(values) in {3, 4}:
                red, green, blue, alpha = (min(max(v, 0.0), 1.0) for v in (*values, 1.0)[:4])
                return (red, green, blue, alpha * (1.0 - min(max(clear, 0.0), 1.0))), texture
        script = child_of(material, "script")
        name = "" if script is None else text_of(script, "name")
        if name and name not in GAZEBO_COLOURS:
            self.model.repairs.note(f"material script {quote(name)} is not read: grey instead")
        return GAZEBO_COLOURS.get(name), texture

    def inertial(
        self, element: Element, path: Path, scope: str, link: str, T_jl: Array
    ) -> SourceInertial | None:
        found = child_of(element, "inertial")
        tensor = None if found is None else child_of(found, "inertia")
        mass = None if found is None else self.model.number(found, "mass", path)
        if found is None or tensor is None or mass is None or found.get("auto") in {"1", "true"}:
            return None
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        xx, xy, xz, yy, yz, zz = (self.model.number(tensor, key, path) or 0.0 for key in keys)
        return SourceInertial(
            mass=mass,
            T_li=self.pose_in_link(found, path, scope, link, T_jl),
            inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        )


def _offset(T: Array) -> Array:
    """Return the translation of a pose (4, 4) without its rotation."""
    return pose(T[:3, 3])
