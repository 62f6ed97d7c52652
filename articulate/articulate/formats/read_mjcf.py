"""Read an MJCF object into the same plain data as a URDF, with all of MuJoCo's defaults.

The file is reduced to shape, mass and motion (``reduce_mjcf``), MuJoCo resolves classes, angles
and frames in a child process (``read_mjcf_child``), and here bodies become links and joints.
Meshes stay files: they are loaded like those of a URDF.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from articulate.errors import AssetError, quote, shorten
from articulate.formats import read_mjcf_child
from articulate.formats.mesh_file import TEXTURES
from articulate.formats.mesh_paths import resolve
from articulate.formats.reduce_mjcf import MjcfText, read_text
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import (
    SourceGeometry,
    SourceInertial,
    SourceJoint,
    SourceLink,
    SourceObject,
    check_counts,
    free_name,
)
from articulate.formats.textures import mean_colour
from articulate.transforms import (
    Array,
    axis_angle_to_matrix,
    normalised,
    pose,
    quat_to_matrix,
)

TIME_S = 45.0
"""Time limit of MuJoCo's reading [s]."""
ARM_JOINTS = 5
"""This many actuated joints in series are a robot, not an object."""

# JSON from the child process.
Found = dict[str, Any]


def read_mjcf(path: Path) -> SourceObject:
    """Read the MJCF file at ``path``, which describes one object.

    Raises:
        AssetError: It cannot be read, MuJoCo does not accept it, or it holds no object but a
            scene or a robot.
    """
    text = read_text(path)
    return _Builder(text, describe_text(text)).source()


def describe_text(text: MjcfText) -> Found:
    """Return the bodies of ``text`` with joints and geoms, their poses resolved by MuJoCo.

    Raises:
        AssetError: MuJoCo does not accept it, crashes, or takes too long.
    """
    meshes = {}
    for name, reference in text.meshes.items():
        try:
            found = resolve(reference, text.path)
        except AssetError:
            continue  # reported where its geometry is needed
        meshes[text.mesh_file(name)] = str(found.resolve())
    out = run_child(text, meshes)
    if "error" in out:
        raise AssetError(f"{text.path}: MuJoCo does not accept it: {shorten(out['error'], 400)}")
    return out


def run_child(text: MjcfText, meshes: dict[str, str]) -> Found:
    """Return the result of ``read_mjcf_child``, run in a process with limits.

    Raises:
        AssetError: It crashes or takes too long.
    """
    with tempfile.TemporaryDirectory(prefix="articulate-") as folder:
        job, result = Path(folder) / "job.json", Path(folder) / "result.json"
        job.write_text(json.dumps({"text": text.text, "meshes": meshes}), encoding="utf-8")
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
        command = [sys.executable, "-P", str(Path(read_mjcf_child.__file__).resolve())]
        try:
            done = subprocess.run(  # our own script, a list of arguments
                [*command, str(job), str(result)],
                timeout=TIME_S,
                capture_output=True,
                env=environment,
                cwd=folder,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise AssetError(
                f"{text.path}: MuJoCo took more than {TIME_S:g} s to read it; simplify it"
            ) from None
        if done.returncode != 0 or not result.is_file():
            raise AssetError(
                f"{text.path}: MuJoCo's reader stopped (exit {done.returncode}); "
                "the file is damaged or too large"
            )
        out: Found = json.loads(result.read_text(encoding="utf-8"))
        return out


class _Builder:
    """Convert bodies to links and joints."""

    def __init__(self, text: MjcfText, found: Found) -> None:
        self.text = text
        self.repairs = text.repairs
        self.found = found
        self.bodies: dict[str, Found] = {body["name"]: body for body in found["bodies"]}
        self.links: dict[str, SourceLink] = {}
        self.joints: list[SourceJoint] = []
        self.T_lb: dict[str, Array] = {}
        """Pose of each body in the frame of its link."""
        self.fixed: dict[str, float] = {}
        """Joints that an equality fixes in one position."""
        self.mimics: dict[str, tuple[str, float, float]] = {}
        self.colours: dict[str, tuple[float, float, float, float]] = {}
        self.images: dict[str, Path] = {}
        """Textures in use, by reference."""

    def source(self) -> SourceObject:
        self.tidy()
        self.couplings()
        self.ties()
        apply_rules(self.found, self.repairs)
        self.classify_geoms()
        geometries = sum(2 * len(body["geoms"]) for body in self.bodies.values())
        joints = sum(len(body["joints"]) for body in self.bodies.values())
        check_counts(self.text.path, len(self.bodies), joints, geometries)
        root = self.root()
        for name, body in self.bodies.items():
            if name not in self.T_lb:
                self.connect(body)
        for name, T_lb in self.T_lb.items():
            if name == root or self.bodies[name]["parent"] is not None:
                self.links[name] = self.link(self.bodies[name], T_lb)
        if "masses_error" in self.found:
            self.repairs.add(
                "masses by geometry are not known from MuJoCo "
                f"({quote(self.found['masses_error'])})"
            )
        return SourceObject(
            name=self.text.name,
            path=self.text.path,
            links=self.links,
            joints=tuple(self.joints),
            repairs=self.repairs,
            files={**self.text.files, **self.images},
        )

    def tidy(self) -> None:
        """Leave out bodies that only mark a pose; reject what is not one object."""
        for body in list(self.bodies.values()):
            if body["mocap"] or body["parent"] not in self.bodies:
                self.repairs.note(f"body {body['name']} is a mocap body: left out")
                del self.bodies[body["name"]]
        free = [b for b in self.bodies.values() if any(j["kind"] == "free" for j in b["joints"])]
        if len(free) > 1:
            names = ", ".join(b["name"] for b in free[:4])
            raise AssetError(
                f"{self.text.path}: a scene with {len(free)} free bodies ({names}), not one "
                "object; give a file for each of them"
            )
        for body in free:
            body["joints"] = []
            self.repairs.add(f"body {body['name']} is free to move: fixed at its pose")
        for body in self.bodies.values():
            for joint in body["joints"]:
                if joint["kind"] == "ball":
                    raise AssetError(
                        f"{self.at(joint)}: joint {quote(joint['name'])} is a ball joint; "
                        "hinge and slide are accepted: write it as hinges"
                    )
        self.reject_robots()

    def reject_robots(self) -> None:
        driven: dict[str, int] = {}
        for body in self.bodies.values():
            own = sum(j["name"] in self.text.driven for j in body["joints"])
            driven[body["name"]] = own + driven.get(body["parent"], 0)
        name, most = max(driven.items(), key=lambda item: item[1])
        if most >= ARM_JOINTS:
            raise AssetError(
                f"{self.text.path}: holds a robot ({most} actuated joints in series up to {name}), "
                "not one object; give the file of the object only"
            )

    def couplings(self) -> None:
        """Convert equalities between joints to mimic joints."""
        joints = {j["name"]: j for b in self.bodies.values() for j in b["joints"]}
        for equality in self.found["joint_equalities"]:
            name, leader, poly = equality["joint"], equality["leader"], equality["poly"]
            if name not in joints:
                continue
            offset = joints[name]["ref"] + poly[0]
            if not leader:
                self.fixed[name] = offset
                self.repairs.add(f"joint {name} is fixed at {offset:g} by an equality")
            elif leader not in joints or any(poly[2:]):
                self.repairs.add(f"coupling of joint {name} to {leader} is not linear: left out")
            elif self.follows(leader, name):
                self.repairs.add(
                    f"coupling of joint {name} to {leader} left out: {leader} follows {name}"
                )
            else:
                slope = poly[1]
                self.mimics[name] = (leader, slope, offset - slope * joints[leader]["ref"])
        for name, (leader, slope, offset) in list(self.mimics.items()):
            only = [leader] == [m[0] for m in self.mimics.values() if m[0] == leader]
            kinds = (joints[name]["kind"], joints[leader]["kind"])
            led = leader in self.mimics
            if only and slope and not led and kinds == ("hinge", "slide"):
                # The hinge that drives a slide, such as a knob, is the one that is operated.
                del self.mimics[name]
                self.mimics[leader] = (name, 1.0 / slope, -offset / slope)
                self.repairs.note(f"joint {leader} follows {name}, which turns it")

    def follows(self, name: str, leader: str) -> bool:
        """Return whether a joint is ``leader`` or follows it, directly or through others."""
        while name != leader and name in self.mimics:
            name = self.mimics[name][0]
        return name == leader

    def ties(self) -> None:
        """Reject welds and connections between moving bodies; leave out all others.

        Raises:
            AssetError: An active one closes a chain of moving bodies.
        """
        movers: dict[str, tuple[str, ...]] = {}
        for name, body in self.bodies.items():
            own = tuple(j["name"] for j in body["joints"] if j["name"] not in self.fixed)
            movers[name] = movers.get(body["parent"], ()) + own
        for tie in self.found["ties"]:
            one, two = tie["bodies"]
            held = one in movers and two in movers and movers[one] != movers[two]
            if tie["active"] and held:
                where = self.text.lines["equality", tie["name"]]
                raise AssetError(
                    f"{where}: a constraint ties body {one!r} to {two!r}, which moves against it; "
                    "only couplings of joints are read: write it as <joint> in <equality>, or "
                    'leave it out with active="false"'
                )
        if self.found["ties"]:
            self.repairs.note(f"{len(self.found['ties'])} constraints between bodies left out")

    def at(self, joint: Found) -> str:
        return self.text.lines.get(("joint", joint["name"]), str(self.text.path))

    def classify_geoms(self) -> None:
        """Set whether each geom is visible, and leave out those that have no use.

        A geom is visible if it is not transparent and in a group that viewers show. Group 0 of a
        body with visual geoms in group 1 is for contact only, as in robosuite's and LIBERO's
        objects.
        """
        geoms = [g for b in self.bodies.values() for g in b["geoms"]]
        for body in self.bodies.values():
            looks = any(g["group"] == 1 for g in body["geoms"])
            for geom in body["geoms"]:
                geom["colour"] = self.colour(geom)
                clear = geom["colour"] is not None and geom["colour"][3] <= 0.0
                contact = looks and geom["group"] == 0 and geom["collides"]
                geom["seen"] = not (
                    clear or contact or geom["group"] >= read_mjcf_child.VISIBLE_GROUPS
                )
        markers = [g for g in geoms if not g["seen"] and not g["collides"]]
        if markers and len(markers) < len(geoms):
            self.repairs.note(
                f"{len(markers)} geoms that are neither visible nor colliding left out"
            )
        for kind, what in (("plane", "plane, the ground,"), ("hfield", "height field")):
            if any(g["kind"] == kind for g in geoms):
                self.repairs.note(f"a {what} left out")
        for body in self.bodies.values():
            body["geoms"] = [
                g
                for g in body["geoms"]
                if g["kind"] not in {"plane", "hfield"} and (g["seen"] or g["collides"])
            ]

    def root(self) -> str:
        """Make the root link, upright in the world, of the first body with geometry or branches."""
        children: dict[str, list[Found]] = {}
        for body in self.bodies.values():
            if body["name"] != "world":
                children.setdefault(body["parent"], []).append(body)
        name, T = "world", np.eye(4)
        while not self.bodies[name]["geoms"] and len(children.get(name, ())) == 1:
            child = children[name][0]
            if child["joints"]:
                break
            self.T_lb[name] = T
            name, T = child["name"], T @ _pose(child)
        for above in self.T_lb:
            self.bodies[above]["parent"] = None
        self.T_lb[name] = T
        return name

    def connect(self, body: Found) -> None:
        """Connect a body to its parent, by helper links where it has several joints."""
        name, parent = body["name"], body["parent"]
        T = self.T_lb[parent] @ _pose(body)
        if not body["joints"]:
            where = self.text.lines.get(("body", name), str(self.text.path))
            self.joints.append(
                SourceJoint(
                    name=f"{name}_fixed",
                    kind="fixed",
                    parent=parent,
                    child=name,
                    T_pc=T,
                    where=where,
                )
            )
            self.T_lb[name] = np.eye(4)
            return
        anchor = np.zeros(3)
        for index, joint in enumerate(body["joints"]):
            if joint["kind"] == "hinge":
                anchor = np.array(joint["pos"])
            last = index == len(body["joints"]) - 1
            helper = free_name(f"{name}_{joint['name']}", {**self.bodies, **self.links})
            child = name if last else helper
            if not last:
                self.links[child] = SourceLink(name=child)
            T_pc = T @ pose(anchor)
            self.joints.append(self.joint(joint, parent, child, T_pc))
            parent, T = child, pose(-anchor)
        self.T_lb[name] = T

    def joint(self, joint: Found, parent: str, child: str, T_pc: Array) -> SourceJoint:
        name, hinge = joint["name"], joint["kind"] == "hinge"
        axis = np.array(joint["axis"])
        fixed = self.fixed.get(name)
        T_pc = T_pc @ _moved(hinge, axis, (0.0 if fixed is None else fixed) - joint["ref"])
        low, high = joint["range"]
        bounded = low != high
        if bounded and joint["limited"] == 0:
            self.repairs.add(f"joint {name} has a range but limited=false: limited to its range")
        if joint["stiffness"] > 0.0:
            self.repairs.add(f"spring of joint {name} left out")
        kind = "prismatic" if not hinge else "revolute" if bounded else "continuous"
        return SourceJoint(
            name=name,
            kind=kind if fixed is None else "fixed",
            parent=parent,
            child=child,
            T_pc=T_pc,
            axis=(float(axis[0]), float(axis[1]), float(axis[2])),
            lower=low if bounded else None,
            upper=high if bounded else None,
            damping=joint["damping"],
            friction=joint["friction"],
            armature=joint["armature"],
            mimic=self.mimics.get(name),
            where=self.at(joint),
        )

    def link(self, body: Found, T_lb: Array) -> SourceLink:
        made = [(geom, self.geometry(geom, T_lb)) for geom in body["geoms"]]
        return SourceLink(
            name=body["name"],
            visuals=tuple(shape for geom, shape in made if geom["seen"]),
            collisions=tuple(shape for geom, shape in made if geom["collides"]),
            inertial=_inertial(body["inertial"], T_lb),
        )

    def geometry(self, geom: Found, T_lb: Array) -> SourceGeometry:
        name, where = self.text.geoms[geom["index"]]
        T_lg = T_lb @ _pose(geom)
        kind, size = geom["kind"], geom["size"]
        if kind == "mesh":
            return self.mesh(geom, name, where, T_lg)
        if kind == "ellipsoid":
            ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
            triangles = np.asarray(ball.triangles) * np.array(size)
            return SourceGeometry(
                kind="mesh",
                name=name,
                T_lg=T_lg,
                triangles=triangles,
                rgba=geom["colour"],
                where=where,
            )
        sizes = {
            "box": [2.0 * s for s in size],
            "sphere": size[:1],
            "capsule": [size[0], 2.0 * size[1]],
            "cylinder": [size[0], 2.0 * size[1]],
        }
        return SourceGeometry(
            kind=kind,
            name=name,
            T_lg=T_lg,
            size=tuple(sizes[kind]),
            rgba=geom["colour"],
            where=where,
        )

    def mesh(self, geom: Found, name: str, where: str, T_lg: Array) -> SourceGeometry:
        """Return a mesh in its frame: MuJoCo moves it by refpos, turns by refquat, then scales."""
        mesh = self.found["meshes"].get(geom["mesh"])
        if mesh is None:
            raise AssetError(
                f"{where}: mesh {quote(geom['mesh'])} is not defined; add it to <asset>"
            )
        scale = np.array(mesh["scale"])
        turned = quat_to_matrix(mesh["refquat"]).T
        origin = turned @ np.array(mesh["refpos"])
        if mesh["vertices"] is not None:
            corners = (np.array(mesh["vertices"]).reshape(-1, 3) @ turned.T - origin) * scale
            triangles = _triangles(corners, mesh["faces"], where)
            return SourceGeometry(
                kind="mesh",
                name=name,
                T_lg=T_lg,
                triangles=triangles,
                rgba=geom["colour"],
                where=where,
            )
        if np.ptp(scale) > 0.0 and not np.allclose(turned, np.eye(3)):
            raise AssetError(
                f"{where}: mesh {quote(geom['mesh'])} has refquat and a scale that "
                "differs by axis; give one factor, or turn the mesh in its file"
            )
        return SourceGeometry(
            kind="mesh",
            name=name,
            T_lg=T_lg @ pose(-scale * origin, turned),
            filename=self.text.meshes[geom["mesh"]],
            scale=(float(scale[0]), float(scale[1]), float(scale[2])),
            rgba=geom["colour"],
            where=where,
        )

    def colour(self, geom: Found) -> tuple[float, float, float, float] | None:
        """Return the colour of a geom, else of its material and texture, else None."""
        rgba = geom["rgba"]
        material = geom["material"]
        if not np.allclose(rgba, read_mjcf_child.PLAIN) or material not in self.found["materials"]:
            own = not np.allclose(rgba, read_mjcf_child.PLAIN)
            return (rgba[0], rgba[1], rgba[2], rgba[3]) if own else None
        if material not in self.colours:
            shade = self.found["materials"][material]
            image = self.text.textures.get(material)
            tint = (1.0, 1.0, 1.0) if image is None else self.tint(image)
            red, green, blue = (c * t for c, t in zip(shade[:3], tint, strict=True))
            self.colours[material] = (red, green, blue, shade[3])
        return self.colours[material]

    def tint(self, image: str) -> tuple[float, float, float]:
        """Return the mean colour of a texture; white where it cannot be read."""
        try:
            path = resolve(image, self.text.path)
        except AssetError:
            self.repairs.note(f"texture {quote(image)} not found: plain colour instead")
            return (1.0, 1.0, 1.0)
        self.images[image] = path
        try:
            colour = mean_colour(path)
        except AssetError as error:
            self.repairs.note(f"{error}: plain colour instead")
            return (1.0, 1.0, 1.0)
        self.repairs.note(TEXTURES)
        return colour


def _pose(found: Found) -> Array:
    return pose(np.array(found["pos"]), quat_to_matrix(found["quat"]))


def _moved(hinge: bool, axis: Array, q: float) -> Array:
    axis = normalised(axis)
    return pose(np.zeros(3), axis_angle_to_matrix(axis, q)) if hinge else pose(q * axis)


def _inertial(found: Found | None, T_lb: Array) -> SourceInertial | None:
    if found is None or found["mass"] <= 2.0 * read_mjcf_child.TINY:
        return None
    return SourceInertial(
        mass=found["mass"],
        T_li=T_lb @ _pose(found),
        inertia=tensor(found),
    )


def _triangles(corners: Array, faces: list[int], where: str) -> Array:
    """Return corners (N, 3, 3) of the faces, or of the convex hull where there are none."""
    index = np.array(faces, dtype=np.int64).reshape(-1, 3)
    if len(index) == 0:
        try:
            return np.asarray(trimesh.PointCloud(corners).convex_hull.triangles)
        except (ValueError, RuntimeError, AttributeError) as error:
            raise AssetError(
                f"{where}: no convex hull of its vertices ({shorten(error)})"
            ) from None
    if index.min() < 0 or index.max() >= len(corners):
        raise AssetError(f"{where}: a face names a vertex that does not exist")
    return corners[index]


def tensor(inertial: Found) -> Array:
    """Return the inertia (3, 3) about the centre of mass [kg m2]."""
    xx, yy, zz, xy, xz, yz = inertial["full"]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def apply_rules(found: Found, repairs: Repairs) -> None:
    """Bound masses and inertias from below and give them their total, as MuJoCo's compiler does.

    The world has no mass. The total is not applied where the mass of a body is not known.

    Args:
        found: Result of the child process; the masses in it are changed.
        repairs: Receives a sentence for each change.
    """
    rules = found["rules"]
    bodies = [body for body in found["bodies"] if body["parent"] != body["name"]]
    heavy = [body for body in bodies if body["inertial"] is not None]
    if max(rules["mass"], rules["inertia"]) > 0.0:
        _bound(heavy, rules["mass"], rules["inertia"], repairs)
    total = rules["total"]
    if total <= 0.0:
        return
    unknown = [
        body["name"]
        for body in bodies
        if body["inertial"] is None and any(_weighs(geom) for geom in body["geoms"])
    ]
    before = sum(body["inertial"]["mass"] for body in heavy)
    if unknown or before <= 0.0:
        names = ", ".join(unknown[:3]) or "all bodies"
        repairs.add(f"settotalmass={total:g} left out: the mass of {names} is not known")
        return
    for body in heavy:
        _scale(body["inertial"], total / before)
    repairs.add(f"masses scaled from {before:.4g} to {total:.4g} kg, the settotalmass of the file")


def _bound(bodies: list[Found], mass: float, inertia: float, repairs: Repairs) -> None:
    for body in bodies:
        own = body["inertial"]
        values, axes = np.linalg.eigh(tensor(own))
        if own["mass"] >= mass and values[0] >= inertia * (1.0 - 1e-9):
            continue
        own["mass"] = max(own["mass"], mass)
        bounded = (axes * np.maximum(values, inertia)) @ axes.T
        own["full"] = [float(bounded[k]) for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        repairs.add(f"mass and inertia of body {body['name']} raised to boundmass or boundinertia")


def _scale(inertial: Found, factor: float) -> None:
    inertial["mass"] *= factor
    inertial["full"] = [factor * value for value in inertial["full"]]


def _weighs(geom: Found) -> bool:
    return not geom["massless"] and geom["kind"] not in {"plane", "hfield"}
