"""Kinds of planted defects, each with its least size and the checks that name it.

A defect changes ``object.xml`` or a mesh in a copy of an asset folder. It returns the affected
links and joints with their descendants; none if the asset has nothing to damage in this way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from lxml import etree

from articulate.assets.asset import Asset, Joint
from articulate.checks.model import ObjectModel
from articulate.checks.surface import is_near, sample
from articulate.simulator import mujoco
from articulate.transforms import inverse, pose

TURN_RAD = np.radians(5.0)
"""Least angle of a defect [rad]."""
SHARE = 0.02
"""Least length of a defect, as a share of the object's diagonal."""
SEEN_M = 1e-3
"""A mesh that is mirrored or enlarged strays by at least this [m] ..."""
SEEN = 0.05
"""... on this share of its surface: a round pot looks the same in a mirror."""

SHOWS = 0.02
"""A mesh that is damaged shows at least this share of its link's area by itself."""
ON_M = 1e-4
"""Distance to another mesh within which a surface counts as hidden [m]."""
POINTS = 500
"""Sample points on a mesh for that measurement."""
MET_M = 0.005
"""A box in the way is met by at least this deep [m]."""

Names = tuple[str, ...]
"""Links and joints that a defect concerns; empty if it was not planted."""


@dataclass(frozen=True)
class Damaged:
    """A copy of an asset that is being damaged."""

    folder: Path
    asset: Asset
    tree: Any

    @property
    def diagonal(self) -> float:
        """Of the closed object [m]."""
        return float(np.linalg.norm(np.subtract(*self.asset.bounds_o)))

    @property
    def root(self) -> Any:
        """Body element of the fixed part."""
        return self.tree.getroot().find("worldbody/body")

    def joint(self, *, kind: str | None = None, limited: bool = False) -> Any | None:
        """Return the first joint of a body, optionally of a kind or with a range."""
        for joint in self.tree.iterfind(".//body/joint"):
            if kind in (None, joint.get("type")) and (not limited or joint.get("range")):
                return joint
        return None

    def moving(self) -> Iterator[Any]:
        """Bodies that a joint moves and that can touch something."""
        for body in self.tree.iter("body"):
            if body.find("joint") is not None and colliders(body):
                yield body

    def largest(self) -> tuple[Any, Path] | None:
        """Return the visual geom with the largest visible surface, and its mesh file.

        Surfaces on another mesh of the same link do not count. None shows enough
        where that is less than ``SHOWS`` of the area of its link's meshes.
        """
        best, most = None, 0.0
        for body in self.tree.iter("body"):
            visuals = [
                (geom, path, np.asarray(trimesh.load_mesh(path, process=False).triangles))
                for geom in body.findall("geom")
                if geom.get("class") == "visual"
                and (path := self.folder / "meshes" / f"{geom.get('mesh')}.obj").is_file()
            ]
            areas = [float(trimesh.triangles.area(triangles).sum()) for _, _, triangles in visuals]
            for k in np.argsort(areas)[::-1]:
                if areas[k] <= most:
                    break
                others = np.concatenate(
                    [np.zeros((0, 3, 3)), *(s[2] for s in visuals[:k] + visuals[k + 1 :])]
                )
                hidden = is_near(sample(visuals[k][2], POINTS)[0], others, ON_M)
                area = areas[k] * float((~hidden).mean())
                if area > most and area >= SHOWS * sum(areas):
                    best, most = visuals[k][:2], area
        return best


def colliders(body: Any) -> list[Any]:
    """Collision geoms of a body."""
    return [g for g in body.findall("geom") if g.get("class") == "collision"]


def carried(body: Any) -> Names:
    """Return a body, its joint and all their descendants."""
    return tuple(str(e.get("name")) for e in body.iter("body", "joint"))


def numbers(element: Any, name: str, default: str) -> np.ndarray:
    """Return an attribute as numbers."""
    return np.array([float(v) for v in element.get(name, default).split()])


def write(element: Any, name: str, values: Any) -> None:
    """Numbers as an attribute."""
    element.set(name, " ".join(f"{v:.9g}" for v in np.atleast_1d(values)))


def across(axis: np.ndarray) -> np.ndarray:
    """Return a unit vector at right angles to ``axis``."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    out = np.cross(axis, other)
    return np.asarray(out / np.linalg.norm(out))


def axis_tilted(d: Damaged) -> Names:
    if (joint := d.joint()) is None:
        return ()
    axis = numbers(joint, "axis", "0 0 1")
    write(joint, "axis", np.cos(TURN_RAD) * axis + np.sin(TURN_RAD) * across(axis))
    return carried(joint.getparent())


def axis_reversed(d: Damaged) -> Names:
    if (joint := d.joint()) is None:
        return ()
    write(joint, "axis", -numbers(joint, "axis", "0 0 1"))
    return carried(joint.getparent())


def pivot_moved(d: Damaged) -> Names:
    if (joint := d.joint(kind="hinge")) is None:
        return ()
    direction = SHARE * d.diagonal * across(numbers(joint, "axis", "0 0 1"))
    write(joint, "pos", numbers(joint, "pos", "0 0 0") + direction)
    return carried(joint.getparent())


def limits_swapped(d: Damaged) -> Names:
    if (joint := d.joint(limited=True)) is None:
        return ()
    low, high = numbers(joint, "range", "0 0")
    write(joint, "range", (high, low))
    joint.set("limited", "false")  # what MuJoCo makes of it in a URDF
    return carried(joint.getparent())


def limits_absent(d: Damaged) -> Names:
    if (joint := d.joint(limited=True)) is None:
        return ()
    del joint.attrib["range"]
    return carried(joint.getparent())


def range_wider(d: Damaged) -> Names:
    if (joint := d.joint(limited=True)) is None:
        return ()
    low, high = numbers(joint, "range", "0 0")
    write(joint, "range", (low, high + 0.1 * (high - low)))
    return carried(joint.getparent())


def range_in_degrees(d: Damaged) -> Names:
    if (joint := d.joint(kind="hinge", limited=True)) is None:
        return ()
    write(joint, "range", np.degrees(numbers(joint, "range", "0 0")))
    return carried(joint.getparent())


def type_changed(d: Damaged) -> Names:
    if (joint := d.joint(limited=True)) is None:
        return ()
    joint.set("type", "hinge" if joint.get("type") == "slide" else "slide")
    return carried(joint.getparent())


def sealed(d: Damaged) -> Names:
    """Replace the collision shapes of the link with most shapes by one box around it."""
    body = max(d.tree.iter("body"), key=lambda b: len(colliders(b)))
    own = colliders(body)
    if len(own) < 4:
        return ()
    low, high = np.array(d.asset.link(str(body.get("name"))).bounds_l)
    for geom in own[1:]:
        body.remove(geom)
    own[0].attrib.pop("mesh", None)
    own[0].attrib.pop("quat", None)
    own[0].set("type", "box")
    write(own[0], "pos", (low + high) / 2.0)
    write(own[0], "size", np.maximum((high - low) / 2.0, 0.001))
    return (str(body.get("name")),)


def blocked(d: Damaged) -> Names:
    """Add a box of the fixed body in the middle of the travel of a part.

    It is at the centre of the largest shape of the half-open part that does not overlap the
    closed part: an overlap from the beginning does not block the travel.
    """
    follow = {e.get("joint1") for e in d.tree.iterfind("equality/joint")}
    free = (j for j in d.asset.joints if j.lower is not None and j.name not in follow)
    if (joint := next(free, None)) is None:
        return ()
    low, high = np.array(d.asset.link(joint.link).bounds_l)
    half = max(SHARE * d.diagonal, 0.25 * float((high - low).min()))
    place = _blocking_position(d, joint, half)
    if place is None:
        return ()
    geom = etree.SubElement(d.root, "geom", {"class": "collision", "type": "box", "name": "plug"})
    write(geom, "pos", place)
    write(geom, "size", np.full(3, half))
    return carried(d.root)


def _blocking_position(d: Damaged, joint: Joint, half: float) -> np.ndarray | None:
    """Return the centre (3,) of a box that hits the half-open part and not the closed [m]."""
    spec = mujoco.MjSpec.from_file(str(d.asset.mjcf_path))
    root = spec.body(d.asset.links[0].name)
    root.add_geom(name="plug", type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3, pos=[1, 2, 3])
    model = ObjectModel(d.asset, spec.compile())
    m, plug, data = model.model, model.model.geom("plug").id, model.data()
    geoms = model.collision_geoms(joint.link)

    def depth(place: np.ndarray, share: float) -> float:
        m.geom_pos[plug] = place
        model.set_joints(data, {joint.name: joint.closed + share * joint.span})
        away = [mujoco.mj_geomDistance(m, data, plug, int(g), 1.0, None) for g in geoms]
        return -float(min(away))

    for geom in sorted(geoms.tolist(), key=lambda g: -float(m.geom_rbound[g])):
        model.set_joints(data, {joint.name: joint.closed + 0.5 * joint.span})
        body = model.bodies[model.root]
        T_ow = inverse(pose(data.xpos[body], data.xmat[body].reshape(3, 3)))
        place = T_ow[:3, :3] @ data.geom_xpos[geom] + T_ow[:3, 3]
        if depth(place, 0.0) <= 0.0 and depth(place, 0.5) >= MET_M:
            return np.asarray(place)
    return None


def stray_collider(d: Damaged) -> Names:
    """Add a shape in empty space, a quarter of the size of its link."""
    body = max(d.tree.iter("body"), key=lambda b: len(colliders(b)))
    low, high = np.array(d.asset.link(str(body.get("name"))).bounds_l)
    geom = etree.SubElement(body, "geom", {"class": "collision", "type": "box", "name": "stray"})
    write(geom, "size", np.maximum((high - low) / 4.0, 0.01))
    write(geom, "pos", high + 0.5 * (high - low))
    return (str(body.get("name")),)


def colliders_lost(d: Damaged) -> Names:
    if (body := next(d.moving(), None)) is None:
        return ()
    for geom in colliders(body):
        body.remove(geom)
    return carried(body)


def mass_doubled(d: Damaged) -> Names:
    inertial = next(d.tree.iter("inertial"))
    write(inertial, "mass", 2.0 * numbers(inertial, "mass", "1"))
    return (str(inertial.getparent().get("name")),)


def inertia_wrong(d: Damaged) -> Names:
    inertial = next(d.tree.iter("inertial"))
    write(inertial, "fullinertia", 2.0 * numbers(inertial, "fullinertia", "1 1 1 0 0 0"))
    return (str(inertial.getparent().get("name")),)


def centre_moved(d: Damaged) -> Names:
    inertial = next(d.tree.iter("inertial"))
    moved = numbers(inertial, "pos", "0 0 0") + np.array([SHARE * d.diagonal, 0.0, 0.0])
    write(inertial, "pos", moved)
    return (str(inertial.getparent().get("name")),)


def _vertices(path: Path, change: Callable[[np.ndarray], np.ndarray], *, flip: bool) -> bool:
    """Change the corners of a mesh; return False if it would look the same as before."""
    lines = path.read_text().splitlines()
    at = [i for i, line in enumerate(lines) if line.startswith("v ")]
    points = np.array([[float(v) for v in lines[i].split()[1:4]] for i in at])
    changed = change(points)
    before = np.asarray(trimesh.load_mesh(path, process=False).triangles)
    after = sample(change(before.reshape(-1, 3)).reshape(-1, 3, 3), POINTS)[0]
    if float((~is_near(after, before, SEEN_M)).mean()) < SEEN:
        return False
    for i, point in zip(at, changed, strict=True):
        lines[i] = "v " + " ".join(f"{v:.9g}" for v in point)
    if flip:
        for i, line in enumerate(lines):
            if line.startswith("f "):
                lines[i] = "f " + " ".join(reversed(line.split()[1:]))
    path.write_text("\n".join(lines) + "\n")
    return True


def mesh_mirrored(d: Damaged) -> Names:
    """About the first axis along which the mirrored mesh looks otherwise."""
    if (found := d.largest()) is None:
        return ()
    geom, path = found
    planted = any(
        _vertices(path, lambda p, k=k: p * (1.0 - 2.0 * np.eye(3)[k]), flip=True)  # type: ignore[misc]
        for k in range(3)
    )
    return (str(geom.getparent().get("name")),) if planted else ()


def mesh_scaled(d: Damaged) -> Names:
    if (found := d.largest()) is None:
        return ()
    geom, path = found
    planted = _vertices(path, lambda p: 1.05 * p, flip=False)
    return (str(geom.getparent().get("name")),) if planted else ()


def visual_lost(d: Damaged) -> Names:
    if (found := d.largest()) is None:
        return ()
    body = found[0].getparent()
    body.remove(found[0])
    return (str(body.get("name")),)


def _first_leaf(d: Damaged) -> Any | None:
    """Return the first body below the root that has no children."""
    return next((b for b in d.tree.iterfind(".//body/body") if not b.findall("body")), None)


def link_lost(d: Damaged) -> Names:
    """With the contact pairs and equalities that name it, so that the engine loads the rest."""
    if (body := _first_leaf(d)) is None:
        return ()
    names = carried(body)
    body.getparent().remove(body)
    for pair in d.tree.xpath("//contact/* | //equality/*"):
        if {pair.get(key) for key in ("body1", "body2", "joint1", "joint2")} & set(names):
            pair.getparent().remove(pair)
    return names


def link_moved(d: Damaged) -> Names:
    body = next(d.tree.iterfind(".//body/body"), None)
    if body is None:
        return ()
    direction = np.array([SHARE * d.diagonal, 0.0, 0.0])
    write(body, "pos", numbers(body, "pos", "0 0 0") + direction)
    return carried(body)


def stuck(d: Damaged) -> Names:
    if (joint := d.joint()) is None:
        return ()
    write(joint, "frictionloss", 200.0)
    return carried(joint.getparent())


def sluggish(d: Damaged) -> Names:
    if (joint := d.joint()) is None:
        return ()
    write(joint, "damping", 1000.0)
    return carried(joint.getparent())


def sprung(d: Damaged) -> Names:
    """Add a spring that pulls the part open."""
    if (joint := d.joint(limited=True)) is None:
        return ()
    known = d.asset.joint(str(joint.get("name")))
    write(joint, "springref", known.open)
    write(joint, "stiffness", 60.0 / max(abs(known.span), 1e-3))
    return carried(joint.getparent())


@dataclass(frozen=True)
class Kind:
    """A kind of defect."""

    apply: Callable[[Damaged], Names]
    named_by: Names
    """Checks that name the defect; others find only its effects."""


POSES = ("forward_kinematics", "input_kinematics")
MOTION = ("settling", "opening", "closing")

KINDS: dict[str, Kind] = {
    "axis tilted by 5 degrees": Kind(axis_tilted, POSES),
    "axis reversed": Kind(axis_reversed, POSES),
    "pivot moved by 2 % of the diagonal": Kind(pivot_moved, POSES),
    "limits swapped, read as none": Kind(limits_swapped, ("joint_limits",)),
    "limits absent": Kind(limits_absent, ("joint_limits",)),
    "range 10 % wider": Kind(range_wider, ("joint_limits",)),
    "range in degrees": Kind(range_in_degrees, ("joint_limits",)),
    "slide for hinge or hinge for slide": Kind(type_changed, ("joint_limits", *POSES)),
    "sealed by a box": Kind(sealed, ("cavities", "collision_coverage")),
    "travel blocked by a box": Kind(
        blocked, ("joint_sweep", "authored_overlap", "opening", "closing")
    ),
    "stray collision shape": Kind(stray_collider, ("collision_coverage",)),
    "collision shapes of a part lost": Kind(colliders_lost, ("collision_coverage",)),
    "mass doubled": Kind(mass_doubled, ("inertia",)),
    "inertia doubled": Kind(inertia_wrong, ("inertia",)),
    "centre of mass moved by 2 % of the diagonal": Kind(centre_moved, ("inertia",)),
    "mesh mirrored": Kind(mesh_mirrored, ("visual_fidelity",)),
    "mesh 5 % larger": Kind(mesh_scaled, ("visual_fidelity",)),
    "visual lost": Kind(visual_lost, ("visual_fidelity",)),
    "link lost": Kind(link_lost, ("loads",)),
    "link moved by 2 % of the diagonal": Kind(link_moved, POSES),
    "dry friction of 200 N or Nm": Kind(stuck, ("joint_limits", *MOTION)),
    "damping of 1000 N s/m or Nm s/rad": Kind(sluggish, ("joint_limits", *MOTION)),
    "spring of 60 N or Nm that opens": Kind(sprung, MOTION),
}
"""Planted defects with their least size."""
