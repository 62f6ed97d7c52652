"""Read an SDF model, the format of Gazebo and Drake, into plain data.

Versions 1.4 to 1.12. Frame semantics: sdformat.org, "Pose frame semantics proposal" (1.7), and for
older versions the conversions that libsdformat applies to them. A link of the result has its
frame at the joint that moves it, with the orientation of the SDF link.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import trimesh

from articulate.errors import AssetError, quote
from articulate.formats.find_source import CONFIG, file_of_config, sdf_version
from articulate.formats.mesh_paths import resolve
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import (
    LARGEST,
    Rgba,
    SourceGeometry,
    SourceInertial,
    SourceJoint,
    SourceLink,
    SourceObject,
    check_counts,
)
from articulate.formats.xml_input import Element, child_of, children_of, read_markup, tag_of
from articulate.transforms import Array, inverse, pose, quat_to_matrix, rpy_to_matrix

KINDS = ("revolute", "continuous", "prismatic", "fixed", "screw")
MAX_FILES = 64
"""Most files that one model includes."""
MAX_NESTED = 8
"""Deepest nesting of models."""
MAX_FRAMES = 5_000
"""Most named frames of a model."""
WORLD, MODEL = "world", "__model__"
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


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """A named frame: a link, joint, frame or model."""

    relative_to: str
    T: Array
    """Pose in ``relative_to`` (4, 4)."""
    link: str
    """Link or frame that it is attached to; its own name for a link."""
    where: str


@dataclass(kw_only=True)
class _Content:
    """Elements of a model and of the models in it, with full names."""

    frames: dict[str, _Frame] = field(default_factory=dict)
    links: dict[str, tuple[Element, Path]] = field(default_factory=dict)
    joints: dict[str, tuple[Element, Path, str, int]] = field(default_factory=dict)
    """Element, file, scope and version by name."""


def read_sdf(path: Path) -> SourceObject:
    """Read the SDF file at ``path``: its one model, with the models that it includes.

    Raises:
        AssetError: It cannot be read, holds several models, or something that is not supported.
    """
    return _Reader(path).source()


class _Reader:
    """Collect the frames of a model, then resolve its links and joints."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.repairs = Repairs()
        self.files: dict[str, Path] = {}
        self.content = _Content()
        self.includes = 0
        self._poses: dict[str, Array] = {WORLD: np.eye(4)}

    def source(self) -> SourceObject:
        model, version = self.top_model()
        self.collect(model, self.path, version, scope="", parent="", depth=0)
        content = self.content
        geometries = sum(
            len(children_of(e, tag))
            for e, _ in content.links.values()
            for tag in ("visual", "collision")
        )
        check_counts(self.path, len(content.links), len(content.joints), geometries)
        if not content.links:
            raise AssetError(f"{self.path}: the model has no <link>")
        joints = [j for name in content.joints for j in self.joint(name)]
        moved = {j.child: (j, T) for j, T in joints}
        links = {
            name: self.link(name, moved[name][1] if name in moved else np.eye(4))
            for name in content.links
        }
        found = [self.placed(joint, moved) for joint, _ in joints]
        roots = {name: self.pose_of(name) for name in links if name not in moved}
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
                    where=str(self.path),
                )
                for name, T in roots.items()
            ]
        if len(roots) > 1:
            names = ", ".join(list(roots)[:4])
            self.repairs.add(f"links without a joint fixed to the world: {names}")
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", model.get("name") or self.path.stem)
        return SourceObject(
            name=name,
            path=self.path,
            links=links,
            joints=tuple(found),
            repairs=self.repairs,
            files=self.files,
        )

    def top_model(self) -> tuple[Element, int]:
        """Return the one model of the file and its minor version of SDF."""
        root = read_markup(self.path, self.repairs)
        if tag_of(root) != "sdf":
            raise AssetError(
                f"{self.path}: not SDF: its root element is <{tag_of(root)[:60]}>, <sdf> was "
                "expected"
            )
        models = children_of(root, "model")
        for world in children_of(root, "world"):
            included = children_of(world, "include")
            if included:
                raise AssetError(
                    f"{self.at(included[0], self.path)}: the world includes models; give the file "
                    "of one model"
                )
            models += children_of(world, "model")
        grounds = [model for model in models if _is_ground(model)]
        if grounds and len(grounds) < len(models):
            names = ", ".join((model.get("name") or "?") for model in grounds[:3])
            self.repairs.note(f"model {names}, the ground, left out")
            models = [model for model in models if model not in grounds]
        if len(models) != 1:
            names = ", ".join((model.get("name") or "?") for model in models[:4])
            count = f"{len(models)} models ({names})" if models else "no model"
            raise AssetError(f"{self.path}: holds {count}; give a file of one model")
        if _text(models[0], "static") in {"1", "true"}:
            self.repairs.note("the model is static in Gazebo: its joints are read all the same")
        return models[0], sdf_version(root)

    def at(self, element: Element, path: Path) -> str:
        return f"{path}:{element.sourceline}"

    def add(self, name: str, frame: _Frame) -> None:
        if name in self.content.frames or name == WORLD:
            raise AssetError(
                f"{frame.where}: a second link, joint or frame is called {quote(name)}"
            )
        if len(self.content.frames) >= MAX_FRAMES:
            raise AssetError(f"{frame.where}: more than {MAX_FRAMES} links, joints and frames")
        self.content.frames[name] = frame

    def collect(
        self, model: Element, path: Path, version: int, *, scope: str, parent: str, depth: int
    ) -> None:
        """Collect the frames, links and joints of a model and of the models in it.

        Args:
            model: The ``<model>``.
            path: File that it is in.
            version: Minor version of SDF in this file.
            scope: Prefix of its names, empty or ending in ``::``.
            parent: Scope of the model that contains it.
            depth: How many models contain it.
        """
        if depth > MAX_NESTED:
            raise AssetError(f"{self.at(model, path)}: models nested deeper than {MAX_NESTED}")
        if scope and model.get("placement_frame"):
            raise AssetError(
                f"{self.at(model, path)}: placement_frame of a nested model is not read; give its "
                "pose by the model frame"
            )
        links = children_of(model, "link")
        first = _name(links[0], path) if links else ""
        canonical = model.get("canonical_link") or first
        relative_to, T = self.pose_in(model, path, parent)
        if scope == "":
            relative_to = WORLD
        here = f"{scope}{MODEL}"
        where = self.at(model, path)
        self.add(here, _Frame(relative_to=relative_to, T=T, link=scope + canonical, where=where))
        for element in links:
            name = scope + _name(element, path)
            relative_to, T = self.pose_in(element, path, scope)
            at = self.at(element, path)
            self.add(name, _Frame(relative_to=relative_to or here, T=T, link=name, where=at))
            self.content.links[name] = (element, path)
        for element in children_of(model, "joint"):
            name = scope + _name(element, path)
            relative_to, T = self.pose_in(element, path, scope)
            child = scope + _text(element, "child")
            at = self.at(element, path)
            self.add(name, _Frame(relative_to=relative_to or child, T=T, link=child, where=at))
            self.content.joints[name] = (element, path, scope, version)
        for element in children_of(model, "frame"):
            name = scope + _name(element, path)
            attached = scope + (element.get("attached_to") or MODEL)
            relative_to, T = self.pose_in(element, path, scope)
            at = self.at(element, path)
            self.add(
                name, _Frame(relative_to=relative_to or attached, T=T, link=attached, where=at)
            )
        for element in children_of(model, "model"):
            self.collect(
                element,
                path,
                version,
                scope=f"{scope}{_name(element, path)}::",
                parent=scope,
                depth=depth + 1,
            )
        for element in children_of(model, "include"):
            self.include(element, path, scope, depth)

    def include(self, element: Element, path: Path, scope: str, depth: int) -> None:
        """Collect the model of another file as a model inside this one."""
        uri, at = _text(element, "uri"), self.at(element, path)
        self.includes += 1
        if self.includes > MAX_FILES:
            raise AssetError(f"{at}: more than {MAX_FILES} files are included")
        file = _included_file(uri, path)
        inside = list(self.path.resolve().parents)[:2][-1]
        if file is None or not file.resolve().is_relative_to(inside):
            raise AssetError(
                f"{at}: included model {quote(uri)} not found beside this model; put its folder "
                "there, or write one file with: gz sdf -p"
            )
        if element.get("merge") in {"1", "true"}:
            raise AssetError(f"{at}: merge of an included model is not read; write one file")
        self.files[uri] = file
        other = _Reader(file)
        other.repairs = self.repairs
        model, version = other.top_model()
        for key in ("pose", "name"):
            new = child_of(element, key)
            if new is not None:
                for old in children_of(model, key):
                    model.remove(old)
                model.insert(0, new)
        if element.get("placement_frame") or child_of(element, "placement_frame") is not None:
            model.set("placement_frame", "?")
        name = _text(model, "name") or _name(model, file)
        self.collect(model, file, version, scope=f"{scope}{name}::", parent=scope, depth=depth + 1)

    def pose_in(self, element: Element, path: Path, scope: str) -> tuple[str, Array]:
        """Return the frame that a ``<pose>`` is relative to, empty by default, and the pose."""
        found = child_of(element, "pose")
        if found is None:
            return (scope + MODEL if tag_of(element) == "model" else ""), np.eye(4)
        relative_to = found.get("relative_to") or found.get("frame") or ""
        if tag_of(element) == "model" and not relative_to:
            relative_to = MODEL
        numbers = self.numbers(found, path)
        if found.get("rotation_format") == "quat_xyzw":
            if len(numbers) != 7 or not any(numbers[3:]):
                raise AssetError(f"{self.at(found, path)}: <pose> needs 7 numbers, xyz and xyzw")
            x, y, z, w = numbers[3:]
            T = pose(np.array(numbers[:3]), quat_to_matrix(np.array([w, x, y, z])))
        elif not numbers:
            T = np.eye(4)
        elif len(numbers) != 6:
            raise AssetError(f"{self.at(found, path)}: <pose> has {len(numbers)} numbers, not 6")
        else:
            unit = math.pi / 180.0 if found.get("degrees") in {"1", "true"} else 1.0
            T = pose(np.array(numbers[:3]), rpy_to_matrix(unit * np.array(numbers[3:])))
        return (scope + relative_to if relative_to and relative_to != WORLD else relative_to), T

    def frame(self, name: str, where: str) -> _Frame:
        """Return a frame by its full name; that of a model by the name of the model."""
        frames = self.content.frames
        found = frames.get(name) or frames.get(f"{name}::{MODEL}")
        if found is None:
            raise AssetError(f"{where}: names {quote(name)}, which does not exist")
        return found

    def pose_of(self, name: str, where: str = "") -> Array:
        """Return the pose of a frame in the world (4, 4)."""
        chain: list[tuple[str, _Frame]] = []
        while name not in self._poses:
            frame = self.frame(name, where or str(self.path))
            if len(chain) > MAX_FRAMES:
                raise AssetError(f"{frame.where}: poses are relative to each other in a cycle")
            chain.append((name, frame))
            name, where = frame.relative_to, frame.where
        T = self._poses[name]
        for name, frame in reversed(chain):
            T = frame.T if np.array_equal(T, np.eye(4)) else T @ frame.T
            self._poses[name] = T
        return T

    def link_of(self, name: str, where: str) -> str:
        """Return the link that a frame is attached to."""
        for _ in range(MAX_FRAMES):
            if name in self.content.links or name == WORLD:
                return name
            name = self.frame(name, where).link
        raise AssetError(f"{where}: frames are attached to each other in a cycle")

    def joint(self, name: str) -> Iterator[tuple[SourceJoint, Array]]:
        """Yield a joint, and the pose of its frame in the child link (4, 4), if it is read."""
        element, path, scope, version = self.content.joints[name]
        where, kind = self.at(element, path), (element.get("type") or "").strip()
        if kind == "gearbox":
            self.repairs.note(f"gearbox {name} left out")
            return
        if kind not in KINDS:
            raise AssetError(
                f"{where}: joint {quote(name)} is of type {quote(kind)}; {', '.join(KINDS)} are "
                "accepted: write joints of several axes as several joints"
            )
        ends = []
        for key in ("parent", "child"):
            end = _text(element, key)
            if not end:
                raise AssetError(f"{where}: joint {quote(name)} lacks a parent or a child")
            ends.append(self.link_of(end if end == WORLD else scope + end, where))
        parent, child = ends
        if child == WORLD:
            raise AssetError(f"{where}: the child of joint {quote(name)} is the world")
        frame = self.frame(name, where)
        T_cj = frame.T
        if frame.relative_to != child:
            T_cj = inverse(self.pose_of(child, where)) @ self.pose_of(name, where)
        axis = child_of(element, "axis")
        limit = None if axis is None else child_of(axis, "limit")
        dynamics = None if axis is None else child_of(axis, "dynamics")
        lower, upper = (self.number(limit, key, path) for key in ("lower", "upper"))
        if kind == "revolute" and lower is None and upper is None:
            kind = "continuous"
        if self.number(dynamics, "spring_stiffness", path):
            self.repairs.add(f"spring of joint {name} left out")
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
            damping=self.number(dynamics, "damping", path),
            friction=self.number(dynamics, "friction", path),
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
            self.pose_of(name) @ _offset(moved[name][1]) if name in moved else self.pose_of(name)
            for name in (joint.parent, joint.child)
        )
        identity = np.array_equal(T_parent, np.eye(4))
        return replace(joint, T_pc=T_child if identity else inverse(T_parent) @ T_child)

    def axis(
        self, axis: Element, path: Path, scope: str, version: int, child: str, T_cj: Array
    ) -> tuple[float, float, float]:
        """Return the direction of an axis in the frame of the child link."""
        found = child_of(axis, "xyz")
        xyz = (0.0, 0.0, 1.0) if found is None else self.numbers(found, path)
        where = self.at(axis, path)
        if len(xyz) != 3:
            raise AssetError(f"{where}: <xyz> has {len(xyz)} numbers, not 3")
        frame = "" if found is None else (found.get("expressed_in") or "")
        in_model = _text(axis, "use_parent_model_frame") in {"1", "true"}
        if not frame and (version <= 4 or in_model):
            frame = MODEL
        if frame:
            R_frame = self.pose_of(scope + frame if frame != WORLD else frame, where)[:3, :3]
            R = self.pose_of(child, where)[:3, :3].T @ R_frame
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
                value = self.number(element, key, path)
                if value is None and element.get(key):
                    value = _float(element.get(key) or "")
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
        travel = self.number(element, "screw_thread_pitch", path)
        if travel is not None:
            return travel
        turns = self.number(element, "thread_pitch", path)  # rad for each metre, to the left
        return -2.0 * math.pi / turns if turns else None

    def link(self, name: str, T_lj: Array) -> SourceLink:
        """Return a link with its frame moved to the joint of pose ``T_lj`` (4, 4) in it."""
        element, path = self.content.links[name]
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
        relative_to, T = self.pose_in(element, path, scope)
        if relative_to and relative_to != link:
            T_frame = self.pose_of(relative_to, self.at(element, path))
            T = inverse(self.pose_of(link)) @ T_frame @ T
        return T if np.array_equal(T_jl, np.eye(4)) else T_jl @ T

    def geometry(
        self, element: Element, path: Path, scope: str, link: str, T_jl: Array
    ) -> SourceGeometry | None:
        """Return a visual or collision element; None where it is left out."""
        tag, where = tag_of(element), self.at(element, path)
        holder = child_of(element, "geometry")
        shapes = [] if holder is None else [e for e in holder if isinstance(e.tag, str)]
        kind = tag_of(shapes[0]).rsplit(":", 1)[-1] if shapes else "empty"
        if kind in {"empty", "plane", "heightmap", "image", "polyline"}:
            if kind != "empty":
                self.repairs.note(f"<{kind}> of a {tag} left out (line {element.sourceline})")
            return None
        shape = shapes[0]
        T_lg = self.pose_in_link(element, path, scope, link, T_jl)
        plain = "mesh"
        size: tuple[float, ...] = ()
        triangles = None
        if kind == "box":
            plain, size = "box", self.sizes(shape, path, "size", 3)
        elif kind == "sphere":
            plain, size = "sphere", self.sizes(shape, path, "radius", 1)
        elif kind in {"cylinder", "capsule", "cone"}:
            plain = kind
            size = (*self.sizes(shape, path, "radius", 1), *self.sizes(shape, path, "length", 1))
        elif kind == "ellipsoid":
            ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
            triangles = np.asarray(ball.triangles) * np.array(self.sizes(shape, path, "radii", 3))
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
        where, uri = self.at(shape, path), _text(shape, "uri")
        if not uri:
            raise AssetError(f"{where}: <mesh> without a <uri>")
        if child_of(shape, "submesh") is not None:
            raise AssetError(f"{where}: <submesh> is not read; save the submesh as its own file")
        factors = (1.0, 1.0, 1.0)
        scale = child_of(shape, "scale")
        if scale is not None:
            values = self.numbers(scale, path)
            if len(values) != 3 or any(abs(v) < 1e-9 for v in values):
                raise AssetError(f"{where}: <scale> {quote(scale.text or '')} flattens the mesh")
            factors = (values[0], values[1], values[2])
        if path != self.path:  # an included model: its files are looked for from its own folder
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
                texture = texture or _text(workflow, "albedo_map")
        if texture and path != self.path:
            with contextlib.suppress(AssetError):
                texture = str(resolve(texture, path).resolve())
        clear = self.number(element, "transparency", path) or 0.0
        for key in ("diffuse", "ambient"):
            colour = child_of(material, key)
            values = () if colour is None else self.numbers(colour, path)
            if len(values) in {3, 4}:
                red, green, blue, alpha = (min(max(v, 0.0), 1.0) for v in (*values, 1.0)[:4])
                return (red, green, blue, alpha * (1.0 - min(max(clear, 0.0), 1.0))), texture
        script = child_of(material, "script")
        name = "" if script is None else _text(script, "name")
        if name and name not in GAZEBO_COLOURS:
            self.repairs.note(f"material script {quote(name)} is not read: grey instead")
        return GAZEBO_COLOURS.get(name), texture

    def inertial(
        self, element: Element, path: Path, scope: str, link: str, T_jl: Array
    ) -> SourceInertial | None:
        found = child_of(element, "inertial")
        tensor = None if found is None else child_of(found, "inertia")
        mass = None if found is None else self.number(found, "mass", path)
        if found is None or tensor is None or mass is None or found.get("auto") in {"1", "true"}:
            return None
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        xx, xy, xz, yy, yz, zz = (self.number(tensor, key, path) or 0.0 for key in keys)
        return SourceInertial(
            mass=mass,
            T_li=self.pose_in_link(found, path, scope, link, T_jl),
            inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        )

    def sizes(self, shape: Element, path: Path, key: str, count: int) -> tuple[float, ...]:
        found = child_of(shape, key)
        values = () if found is None else self.numbers(found, path)
        if len(values) != count or min(values, default=0.0) <= 0.0:
            raise AssetError(
                f"{self.at(shape, path)}: <{tag_of(shape)}> needs <{key}> of {count} positive "
                f"number{'s' if count > 1 else ''}"
            )
        return values

    def number(self, element: Element | None, key: str, path: Path) -> float | None:
        """Return a number, or None where it is absent, not finite or as large as no limit."""
        found = None if element is None else child_of(element, key)
        if found is None:
            return None
        value = _float(found.text or "")
        if value is None:
            raise AssetError(
                f"{self.at(found, path)}: <{key}> is {quote((found.text or '').strip())}, not a "
                "number"
            )
        return value if abs(value) < LARGEST else None

    def numbers(self, element: Element, path: Path) -> tuple[float, ...]:
        """Return the numbers of an element, all finite and within the size of an object."""
        values = [_float(word) for word in (element.text or "").split()]
        if any(value is None or not abs(value) < 1e6 for value in values):
            raise AssetError(
                f"{self.at(element, path)}: <{tag_of(element)}> is "
                f"{quote((element.text or '').strip())}, not made of finite numbers"
            )
        return tuple(value for value in values if value is not None)


def _included_file(uri: str, path: Path) -> Path | None:
    """Return the SDF file of an included model, which is beside the folder of the model."""
    text = uri.strip().removeprefix("file://")
    name = text.removeprefix("model://").strip("/")
    bases = [path.parent, path.parent.parent]
    for base in bases if name and ".." not in Path(name).parts and "\0" not in name else []:
        folder = base / name
        if folder.is_file():
            return folder
        if (folder / CONFIG).is_file():
            return file_of_config(folder / CONFIG)
        if (folder / "model.sdf").is_file():
            return folder / "model.sdf"
    return None


def _offset(T: Array) -> Array:
    """Return the translation of a pose (4, 4) without its rotation."""
    return pose(T[:3, 3])


def _is_ground(model: Element) -> bool:
    """Return whether all geometry of a model is planes."""
    found = [e for e in model.iter() if tag_of(e) == "geometry"]
    return bool(found) and all(child_of(e, "plane") is not None for e in found)


def _name(element: Element, path: Path) -> str:
    name = (element.get("name") or "").strip()
    if not name:
        raise AssetError(f"{path}:{element.sourceline}: <{tag_of(element)}> without a name")
    if name == WORLD or name.startswith("__"):
        raise AssetError(f"{path}:{element.sourceline}: the name {quote(name)} is reserved")
    return name


def _text(element: Element, key: str) -> str:
    found = child_of(element, key)
    return "" if found is None else (found.text or "").strip()


def _float(word: str) -> float | None:
    try:
        return float(word.replace("_", "?"))
    except ValueError:
        return None
