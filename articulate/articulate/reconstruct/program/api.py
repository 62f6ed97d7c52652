"""Functions of programs in the parent process: poses of parts and their joints.

The calls come from a process that runs an untrusted program. Every argument is checked here again,
whatever that process has checked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from articulate.assets.asset import Quat, Vec3
from articulate.errors import AssetError, nearest
from articulate.reconstruct.program.arguments import (
    format_value,
    least_zero,
    limits,
    named,
    number,
    unit,
    vector,
)
from articulate.reconstruct.program.contact_distance import (
    Hull,
    bullet_depth,
    contact_along,
    has_bullet,
)
from articulate.reconstruct.program.language import FUNCTIONS, PLACEMENTS
from articulate.reconstruct.program.materials import DEFAULT, MATERIALS
from articulate.reconstruct.program.placement import TABLE, centred, shift
from articulate.reconstruct.program.program_parts import Parts
from articulate.reconstruct.program.result import (
    JointKind,
    ObjectJoint,
    ObjectPart,
    PlacementRecord,
    ProgramObject,
)
from articulate.reconstruct.program.values import InvalidValueError
from articulate.transforms import (
    Array,
    apply,
    axis_angle_to_matrix,
    inverse,
    matrix_to_quat,
    pose,
    rpy_to_matrix,
)

MAX_CALLS = 4_000
MAX_SNAPS = 200
"""Most placements with contact in a run."""
MAX_POINTS = 256
"""Most points that ``vertices`` gives."""
MAX_FRAMES = 400
MAX_PENETRATION = 0.002
"""Largest penetration that PyBullet may find, as a share of the part's size."""


class Builder:
    """State of one run.

    Args:
        parts: Parts of the program.
        check_time: Called during long computations; raises after the time limit.
    """

    def __init__(self, parts: Parts, check_time: Callable[[], None] = lambda: None) -> None:
        self.parts = parts
        self.check_time = check_time
        self.T_wp: dict[str, Array] = {name: np.eye(4) for name in parts}
        """Pose of each part and frame in the world."""
        self.frames: list[str] = []
        self.settled: set[str] = set()
        """Parts that the program has placed: they are obstacles for others."""
        self.joints: dict[str, ObjectJoint] = {}
        """Joints by child."""
        self.placed_at: dict[str, str] = {}
        """Parent of the last placement, by child."""
        self.materials: dict[str, str] = {}
        self.placed: list[PlacementRecord] = []
        self.notes: list[str] = []
        self.chosen_root: str | None = None
        self.calls = self.snaps = 0
        self._answers: dict[str, Callable[..., Any]] = {
            "parts": self.list_parts, "box": self.box, "corners": self.corners,
            "vertices": self.vertices, "place": self.place, "move": self.move,
            "rotate": self.rotate, "place_relative_to": self.place_relative_to,
            "frame": self.frame, "root": self.root, "material": self.material,
            "fixed": self.fixed, "revolute": self.revolute, "continuous": self.continuous,
            "prismatic": self.prismatic, "mimic": self.mimic,
        }  # fmt: skip

    def answer(self, name: object, arguments: object) -> Any:
        """Call the function ``name`` and return its result as JSON values.

        Raises:
            InvalidValueError: The call is invalid; the message is for the program's author.
        """
        self.calls += 1
        if self.calls > MAX_CALLS:
            raise InvalidValueError(f"more than {MAX_CALLS} calls; shorten the program")
        if not isinstance(name, str) or name not in FUNCTIONS or not isinstance(arguments, dict):
            raise InvalidValueError("no function of the language")
        if set(arguments) != set(FUNCTIONS[name].names):
            raise InvalidValueError(f"write {FUNCTIONS[name].line(name)}")
        try:
            return self._answers[name](**arguments)
        except AssetError as error:  # a mesh that cannot be read
            raise InvalidValueError(str(error)) from None

    # Queries

    def list_parts(self) -> list[str]:
        """Return the names of all parts."""
        return list(self.parts)

    def box(self, part: Any) -> list[list[float]]:
        """Return lowest and highest corner in the world."""
        points = self._hull(self._part(part)).points
        return [points.min(axis=0).tolist(), points.max(axis=0).tolist()]

    def corners(self, part: Any) -> list[list[float]]:
        """Return the corners of the box."""
        low, high = self.box(part)
        return [
            [x, y, z]
            for x in (low[0], high[0])
            for y in (low[1], high[1])
            for z in (low[2], high[2])
        ]

    def vertices(self, part: Any) -> list[list[float]]:
        """Return corners of the convex hull, at most ``MAX_POINTS``, spread over its sides."""
        points = self._hull(self._part(part)).points
        if len(points) > MAX_POINTS:
            k = np.arange(MAX_POINTS) + 0.5  # directions of Fibonacci's sphere
            z, turn = 1.0 - 2.0 * k / MAX_POINTS, np.pi * (1.0 + 5.0**0.5) * k
            r = np.sqrt(1.0 - z * z)
            directions = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
            points = points[np.unique((points @ directions.T).argmax(axis=0))]
        found: list[list[float]] = points.tolist()
        return found

    # Poses

    def place(self, part: Any, position: Any, rpy: Any) -> None:
        """Set the pose of the part's frame."""
        name = self._free(part)
        self.T_wp[name] = pose(vector(position, "position"), rpy_to_matrix(vector(rpy, "rpy")))

    def move(self, part: Any, by: Any) -> None:
        """Move a part by a vector."""
        name = self._free(part)
        self.T_wp[name] = pose(vector(by, "by")) @ self.T_wp[name]

    def rotate(self, part: Any, axis: Any, angle: Any, pivot: Any) -> None:
        """Rotate a part about an axis through a point."""
        name = self._free(part)
        turn = axis_angle_to_matrix(unit(axis), number(angle, "angle"))
        at = np.mean(self.box(part), axis=0) if pivot is None else vector(pivot, "pivot")
        self.T_wp[name] = pose(at) @ pose(np.zeros(3), turn) @ pose(-at) @ self.T_wp[name]

    def place_relative_to(
        self, child: Any, parent: Any, placement: Any, clearance: Any, snap: Any, align: Any
    ) -> None:
        """Place the child at a side of the parent, up to contact if ``snap``."""
        name, other = self._free(child), self._part(parent)
        if name == other:
            raise InvalidValueError("a part cannot be placed relative to itself")
        if placement not in PLACEMENTS:
            raise InvalidValueError(
                f"placement {format_value(placement)} is not known; "
                f"there are: {', '.join(PLACEMENTS)}"
            )
        gap, side = number(clearance, "clearance"), TABLE[str(placement)]
        if not isinstance(snap, bool) or not isinstance(align, bool):
            raise InvalidValueError("snap and align are True or False")
        before = self.T_wp[name]
        own, its = np.array(self.box(name)), np.array(self.box(other))
        shift_m = centred(own, its, side) if align else np.zeros(3)
        touches, checked = False, tuple[str, ...]()
        if side is not None:
            shift_m[side.axis] = shift(side, own, its, gap)
        self.T_wp[name] = pose(shift_m) @ before
        if side is not None and snap:
            touches, checked = self._snap(name, other, placement, gap)
        moved = (self.T_wp[name] @ inverse(before))[:3, 3]
        self.placed_at[name] = other
        self.placed.append(
            PlacementRecord(
                child=name,
                parent=other,
                placement=placement,
                clearance=gap,
                moved_m=_three(moved),
                touches=touches,
                checked_by=checked,
            )
        )

    def _snap(
        self, name: str, parent: str, placement: str, gap: float
    ) -> tuple[bool, tuple[str, ...]]:
        """Move the child along the axis of the placement until it touches something."""
        self.snaps += 1
        if self.snaps > MAX_SNAPS:
            raise InvalidValueError(f"more than {MAX_SNAPS} placements with snap; write snap=False")
        side = TABLE[placement]
        assert side is not None
        own, its = np.array(self.box(name)), np.array(self.box(parent))
        # Outside: from the parent's face inwards. Inside: from the parent's centre to its face.
        toward = side.sign if side.inside else -side.sign
        start = shift(side, own, its, 0.0)
        reach = float(its[1, side.axis] - its[0, side.axis])
        if side.inside:
            start += -toward * max((reach - float((own[1] - own[0])[side.axis])) / 2.0, 0.0)
            reach = abs(start - shift(side, own, its, 0.0))
        step = np.zeros(3)
        step[side.axis] = start
        self.T_wp[name] = pose(step) @ self.T_wp[name]
        self.check_time()
        hulls = [h.moved(self.T_wp[name]) for h in self.parts[name].hulls]
        obstacles = self._obstacles(name, parent)
        contact = contact_along(hulls, obstacles, side.axis, toward, self.check_time)
        if contact.overlaps:
            self.notes.append(
                f"{name} already overlaps something where its motion to {parent} begins"
            )
        touches = contact.distance_m is not None and contact.distance_m <= reach + 1e-9
        if touches and contact.distance_m is not None:
            travel_m = contact.distance_m - gap
        else:
            self.notes.append(f"{name} touches nothing {placement} {parent}: placed at its box")
            travel_m = (reach if side.inside else 0.0) - gap
        step[side.axis] = toward * travel_m
        self.T_wp[name] = pose(step) @ self.T_wp[name]
        checked = (
            "sweep",
            *self._check_with_bullet(name, side.axis, -toward, obstacles, gap, contact.overlaps),
        )
        return touches, checked

    def _check_with_bullet(
        self, name: str, axis: int, back: int, obstacles: Array, gap: float, overlaps: bool
    ) -> tuple[str, ...]:
        """Check the result with PyBullet and move the child back if it penetrates too far."""
        if overlaps or gap < 0.0 or not len(obstacles) or not has_bullet():
            return ()
        self.check_time()
        hulls = [h.moved(self.T_wp[name]) for h in self.parts[name].hulls]
        size = float(np.linalg.norm(np.ptp(np.concatenate([h.points for h in hulls]), axis=0)))
        depth = bullet_depth(hulls, obstacles)
        if depth > MAX_PENETRATION * size:
            step = np.zeros(3)
            step[axis] = back * depth
            self.T_wp[name] = pose(step) @ self.T_wp[name]
            self.notes.append(
                f"{name} penetrates something by {depth:.4f} m in PyBullet: moved back"
            )
        return ("pybullet",)

    def _obstacles(self, name: str, parent: str) -> Array:
        """Return the triangles (M, 3, 3) of the parent and of placed parts, in the world."""
        found = [
            apply(self.T_wp[other], part.triangles)
            for other, part in self.parts.items()
            if other != name and (other == parent or other in self.settled)
        ]
        return np.concatenate(found) if found else np.zeros((0, 3, 3))

    # Joints

    def frame(self, name: Any) -> str:
        """Add a link without geometry."""
        label = named(name)
        if label in self.T_wp:
            raise InvalidValueError(f"{format_value(name)} is already used; choose another name")
        if len(self.frames) >= MAX_FRAMES:
            raise InvalidValueError(f"at most {MAX_FRAMES} frames are accepted")
        self.frames.append(label)
        self.T_wp[label] = np.eye(4)
        return label

    def root(self, part: Any) -> None:
        """Set the part that does not move."""
        name = self._part(part)
        if name in self.joints:
            raise InvalidValueError(
                f"{name} is the child of joint {self.joints[name].name}: no root"
            )
        self.chosen_root = name

    def material(self, part: Any, material: Any) -> None:
        """Set the material of a part."""
        if not isinstance(material, str) or material not in MATERIALS:
            raise InvalidValueError(
                f"material {format_value(material)} is not known; there are: {', '.join(MATERIALS)}"
            )
        self.materials[self._part(part)] = material

    def fixed(self, child: Any, parent: Any, name: Any) -> str:
        """Add a fixed joint."""
        return self._join("fixed", child, parent, name)

    def revolute(
        self, child: Any, parent: Any, axis: Any, pivot: Any, lower: Any, upper: Any, name: Any,
        damping: Any, friction: Any,
    ) -> str:  # fmt: skip
        """Add a hinge with limits [rad]."""
        low, high = limits(lower, upper)
        if low is not None and high is not None and max(-low, high) > 4.0 * math.pi:
            raise InvalidValueError(
                "limits of a hinge are in radians; write radians(90) for degrees"
            )
        return self._join(
            "revolute", child, parent, name, axis_w=_three(unit(axis)),
            pivot_w=_three(vector(pivot, "pivot")), lower=low, upper=high,
            damping=least_zero(damping, "damping"), friction=least_zero(friction, "friction"),
        )  # fmt: skip

    def continuous(
        self, child: Any, parent: Any, axis: Any, pivot: Any, name: Any, damping: Any, friction: Any
    ) -> str:
        """Add a hinge without limits."""
        return self._join(
            "continuous", child, parent, name, axis_w=_three(unit(axis)),
            pivot_w=_three(vector(pivot, "pivot")),
            damping=least_zero(damping, "damping"), friction=least_zero(friction, "friction"),
        )  # fmt: skip

    def prismatic(
        self, child: Any, parent: Any, axis: Any, lower: Any, upper: Any, pivot: Any, name: Any,
        damping: Any, friction: Any,
    ) -> str:  # fmt: skip
        """Add a slide with limits [m]."""
        low, high = limits(lower, upper)
        return self._join(
            "prismatic", child, parent, name, axis_w=_three(unit(axis)),
            pivot_w=None if pivot is None else _three(vector(pivot, "pivot")),
            lower=low, upper=high,
            damping=least_zero(damping, "damping"), friction=least_zero(friction, "friction"),
        )  # fmt: skip

    def mimic(self, follower: Any, leader: Any, multiplier: Any, offset: Any) -> None:
        """Couple a joint to another one."""
        by_name = {joint.name: child for child, joint in self.joints.items()}
        for joint in (follower, leader):
            if not isinstance(joint, str) or joint not in by_name:
                raise InvalidValueError(
                    f"joint {format_value(joint)} is not known{_near(joint, by_name)}"
                )
        seen, at = {follower}, leader
        while at is not None:
            if at in seen:
                raise InvalidValueError("these joints would follow each other in a cycle")
            seen.add(at)
            ahead = self.joints[by_name[at]].mimic
            at = None if ahead is None else ahead[0]
        joints = [self.joints[by_name[joint]] for joint in (follower, leader)]
        if any(joint.kind == "fixed" for joint in joints):
            raise InvalidValueError("a fixed joint cannot follow or lead")
        numbers = number(multiplier, "multiplier"), number(offset, "offset")
        fields = {**vars(joints[0]), "mimic": (leader, *numbers)}
        self.joints[joints[0].child] = ObjectJoint(**fields)

    def _join(self, kind: JointKind, child: Any, parent: Any, name: Any, **what: Any) -> str:
        below, above = self._part(child), self._part(parent)
        if below in self.joints:
            raise InvalidValueError(
                f"{below} is the child of joint {self.joints[below].name} already"
            )
        if below == self.chosen_root:
            raise InvalidValueError(f"{below} is the root; it has no joint")
        at: str | None = above
        while at is not None:
            if at == below:
                raise InvalidValueError(f"{above} is below {below}: the joints would form a cycle")
            at = self.joints[at].parent if at in self.joints else None
        names = {joint.name for joint in self.joints.values()}
        label = f"{below}_joint" if name is None else named(name)
        if label in names:
            raise InvalidValueError(
                f"a joint is called {format_value(label)} already; choose another name"
            )
        self.joints[below] = ObjectJoint(name=label, kind=kind, child=below, parent=above, **what)
        return label

    # Result

    def built(self, layers: tuple[str, ...]) -> ProgramObject:
        """Return the object; parts without a joint are fixed."""
        names = list(self.T_wp)
        free = [name for name in names if name not in self.joints]
        root = self.chosen_root or next((n for n in free if n not in self.placed_at), free[0])
        joints = dict(self.joints)
        used = {joint.name for joint in joints.values()}
        for name in free:
            if name == root:
                continue
            parent = self._support(name, root, joints)
            self.notes.append(f"{name} has no joint: fixed to {parent}")
            label = _unused(f"{name}_joint", used)
            joints[name] = ObjectJoint(name=label, kind="fixed", child=name, parent=parent)
        parts = tuple(
            ObjectPart(
                name=name,
                pos_w=_three(self.T_wp[name][:3, 3]),
                quat_w=_four(matrix_to_quat(self.T_wp[name][:3, :3])),
                material=self.materials.get(name, DEFAULT),
                geometry=name in self.parts,
            )
            for name in names
        )
        ordered = tuple(joints[name] for name in names if name in joints)
        return ProgramObject(
            root=root, parts=parts, joints=ordered, placed=tuple(self.placed),
            notes=tuple(dict.fromkeys(self.notes)), layers=layers,
        )  # fmt: skip

    def _support(self, name: str, root: str, joints: dict[str, ObjectJoint]) -> str:
        """Return the parent of a part without a joint: where it was placed, unless cyclic."""
        support = self.placed_at.get(name, root)
        at: str | None = support
        while at is not None:
            if at == name:
                return root
            at = joints[at].parent if at in joints else None
        return support

    # Arguments

    def _part(self, name: Any) -> str:
        if not isinstance(name, str) or name not in self.T_wp:
            hint = _near(name, list(self.T_wp)[:60])
            raise InvalidValueError(f"part {format_value(name)} is not known{hint}")
        return name

    def _free(self, name: Any) -> str:
        """Return the part if it can still be moved."""
        part = self._part(name)
        for joint in self.joints.values():
            if part in {joint.child, joint.parent}:
                raise InvalidValueError(
                    f"{part} belongs to joint {joint.name}: place it before joining"
                )
        self.settled.add(part)
        return part

    def _hull(self, name: str) -> Hull:
        if name not in self.parts or not self.parts[name].pieces:
            raise InvalidValueError(f"{name} has no geometry, so it has no box")
        self.check_time()  # the hull of a large mesh takes seconds
        return self.parts[name].hull.moved(self.T_wp[name])


def _near(name: Any, known: Iterable[str]) -> str:
    return nearest(name[:60], known) if isinstance(name, str) else ""


def _three(value: Array) -> Vec3:
    return (float(value[0]), float(value[1]), float(value[2]))


def _four(value: Array) -> Quat:
    return (float(value[0]), float(value[1]), float(value[2]), float(value[3]))


def _unused(name: str, used: set[str]) -> str:
    while name in used:
        name += "_"
    used.add(name)
    return name
