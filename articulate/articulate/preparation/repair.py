"""Trim collision shapes and shorten limits until the parts of an object pass each other.

Where parts interfere on the travel of a joint, two repairs are sound. Excess collision volume is
cut away, as long as the visible surface stays covered. And where the authored parts overlap, deeper
than a cut can correct, the travel ends there, as no real part passes through another one. If too
little of the travel would remain, nothing is changed and the checks reject the object. No cut opens
a passage through a wall, and none leaves slices so thin that they pass a wall unnoticed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.checks.force import FORCE_N, Pull, pull_of
from articulate.checks.interference import MAX_STATES, Interference, Sweeper
from articulate.checks.model import ObjectModel
from articulate.checks.sweep import SAMPLE_STATES, Violation, sweep_joints
from articulate.conversion.write_asset import Body, Mimic, mesh_files, mjcf
from articulate.geometry.shapes import Shape
from articulate.geometry.time_budget import UNLIMITED, Budget, OutOfTimeError
from articulate.preparation.joint_travel import (
    exceeds_limit,
    joint_range,
    links_carried_by,
    reach,
    weight_on,
)
from articulate.preparation.trim_colliders import APART_M, Cut, Part, carved, cut_back
from articulate.simulator import mujoco
from articulate.transforms import Array, inverse

ROUNDS = 6
"""Largest number of rounds of sweeping and repairing."""
AIM_M = 0.001
"""Overlap beyond that at rest that a cut leaves [m]."""
MAX_PLANES = 16
"""Shapes with more faces than this are not carved out of others."""
TRIES = 12
"""Largest number of cuts in one state."""
MIN_TRAVEL_SHARE = 0.5
"""A shortened joint keeps at least this fraction of its travel ..."""
MIN_TURN = math.radians(75.0)
"""... or, if it is a hinge, this much [rad]."""
SLOW_S = 1.5
"""Longest time of the full travel against damping only [s]."""
MAX_FRICTION = 0.5
"""Largest dry friction as a fraction of the applied effort."""
MAX_WEIGHT = 0.8
"""Largest weight and dry friction together as a fraction of the applied effort."""
MIN_MASS = 0.4
"""A part whose mass is reduced keeps at least this fraction of it."""
DIGITS = 4
"""Shortened limits are rounded inwards to this many decimals."""


@dataclass(frozen=True, kw_only=True)
class RepairResult:
    """An object after repairs."""

    asset: Asset
    bodies: tuple[Body, ...]
    repairs: tuple[str, ...]
    """Changes, one sentence each; empty if nothing was changed."""
    model: ObjectModel
    """Compiled object with its visual geometry."""
    cut: frozenset[str] = frozenset()
    """Links whose shapes were trimmed."""
    stuck: frozenset[str] = frozenset()
    """Links that still interfere on the travel of a joint."""


def repair_joints(
    asset: Asset,
    bodies: Sequence[Body],
    mimics: Sequence[Mimic],
    model: ObjectModel,
    budget: Budget = UNLIMITED,
) -> RepairResult:
    """Repair interferences, friction and weight that keep joints from moving.

    Args:
        asset: Object to repair.
        bodies: Its bodies as converted.
        mimics: Mimic joints.
        model: Compiled object with its visual geometry.
        budget: Time for cuts; no cut begins after it.
    """
    session = RepairSession(asset=asset, bodies=bodies, mimics=mimics, budget=budget)
    for name in model.free_joints:
        pull = pull_of(asset, model, name)
        session.relax(pull)
        session.reduce_masses(pull, model)
    for _ in range(ROUNDS):
        violations = sweep_joints(model).violations
        changed = False
        for violation in violations:
            changed |= session.repair(violation, model)
        if not changed:
            break
        model = session.model(with_visuals=True)
    stuck = {name for f in violations for m in f.sweep.interferences for name in (m.one, m.other)}
    return replace(session.result(model), stuck=frozenset(stuck))


@dataclass(frozen=True, kw_only=True)
class _Cleared:
    """Part of a travel that cuts could clear."""

    ends: tuple[float, float]
    """Lowest and highest position without interference [m or rad]."""
    complete: bool
    """True if that is the full travel."""
    barred: bool
    """True if overlaps of authored parts end it, at all its ends."""
    states: Mapping[str, tuple[Any, ...]]
    """States of the parts with these cuts."""


class RepairSession:
    """State of an object while it is repaired.

    Args:
        asset: Object to repair.
        bodies: Its bodies as converted.
        mimics: Mimic joints.
        budget: Time for cuts.
    """

    def __init__(
        self,
        *,
        asset: Asset,
        bodies: Sequence[Body],
        mimics: Sequence[Mimic],
        budget: Budget = UNLIMITED,
    ) -> None:
        self.asset = asset
        self._budget = budget
        self.parts = {body.name: Part(body) for body in bodies}
        self.mimics = mimics
        self._visual_triangles = {
            body.name: np.concatenate(
                [np.zeros((0, 3, 3)), *(piece.mesh.triangles for piece in body.visuals)]
            )
            for body in bodies
        }
        self._authored: set[tuple[str, str]] = set()
        """Pairs of links of the current violation whose authored parts overlap."""
        self._barred = False
        """True if authored parts overlap at the last attempted cut."""
        self._shortened: dict[str, str] = {}
        self._before_cuts: dict[str, tuple[dict[str, tuple[Any, ...]], Violation]] = {}
        """By joint: states before minimal cuts on its travel, and the violation."""
        self._relaxed: list[str] = []

    def relax(self, pull: Pull) -> None:
        """Lower damping and dry friction that keep the reference force from opening a joint."""
        joint = pull.joint
        if pull.travel <= 0.0 or pull.effort <= 0.0:
            return
        units = ("N s/m", "N") if joint.kind == "slide" else ("Nm s/rad", "Nm")
        damping = min(joint.damping, SLOW_S * pull.effort / pull.travel)
        friction = min(joint.frictionloss, MAX_FRICTION * pull.effort)
        for quantity, old, new, unit in (
            ("damping", joint.damping, damping, units[0]),
            ("dry friction", joint.frictionloss, friction, units[1]),
        ):
            if new < old:
                self._relaxed.append(
                    f"{quantity} of joint {joint.name} lowered from {old:.4g} to {new:.4g} {unit}: "
                    f"{FORCE_N:g} N at {pull.where} would not open it in time"
                )
        if (damping, friction) != (joint.damping, joint.frictionloss):
            self._set(replace(joint, damping=damping, frictionloss=friction))

    def reduce_masses(self, pull: Pull, model: ObjectModel) -> None:
        """Lower the masses that a joint carries if the reference force cannot move their weight.

        Doors that fall open and seats that are lifted are balanced by springs, which files do not
        describe. Masses from the source are not changed.

        Args:
            pull: Reference force on the joint.
            model: Compiled object.
        """
        carried = links_carried_by(self.asset, pull.joint.link)
        joint = self.asset.joint(pull.joint.name)
        weight = weight_on(model, joint)
        limit = MAX_WEIGHT * pull.effort - joint.frictionloss
        if weight <= max(limit, 0.0) or any(
            self.parts[n].body.inertial.from_source for n in carried
        ):
            return
        share = limit / weight
        if share < MIN_MASS:
            return
        before = after = 0.0
        for name in carried:
            part = self.parts[name]
            own = part.body.inertial
            lighter = replace(own, mass_kg=share * own.mass_kg, inertia_p=share * own.inertia_p)
            part.body = replace(part.body, inertial=lighter)
            before, after = before + own.mass_kg, after + lighter.mass_kg
        unit = "N" if joint.kind == "slide" else "Nm"
        self._relaxed.append(
            f"mass that joint {joint.name} carries lowered from {before:.3g} to {after:.3g} kg, as "
            f"if a spring balanced it: its weight requires {weight:.3g} {unit}, and {FORCE_N:g} N "
            f"at {pull.where} give {pull.effort:.3g} {unit}"
        )

    def repair(self, violation: Violation, model: ObjectModel) -> bool:
        """Repair one violation; return whether anything was changed.

        Args:
            violation: Interfering parts and positions.
            model: Compiled object in its current state.
        """
        deep = {
            (interference.one, interference.other)
            for interference in violation.sweep.interferences
            if (interference.one, interference.other) in violation.authored
            and self._is_deep(interference)
        }
        if (
            deep
            and violation.isolated
            and (
                self._shorten(violation, deep, model)
                or self._shorten(violation, deep, model, deep=True)  # the remainder may be cut
            )
        ):
            return True
        if self._cut(violation):
            return True
        pairs = set(violation.authored)
        ended = bool(pairs) and violation.isolated and self._shorten(violation, pairs, model)
        return ended or self._cut_apart(violation.joint)

    def _is_deep(self, interference: Interference) -> bool:
        """Return whether an overlap exceeds the tolerance between shapes and visual surface."""
        near = max(self.parts[name].near_m for name in (interference.one, interference.other))
        return interference.excess_m > near

    def _shorten(
        self,
        violation: Violation,
        pairs: set[tuple[str, str]],
        model: ObjectModel,
        *,
        deep: bool = False,
    ) -> bool:
        """End the travel of a joint where ``pairs`` of links interfere; False if little remains.

        With ``deep`` it ends only where they overlap deeper than a cut can correct.
        """
        counts = self._is_deep if deep else exceeds_limit
        return self._end(
            violation.joint, reach(Sweeper(model=model), violation, pairs, counts), pairs
        )

    def _end(
        self, name: str, ends: tuple[float, float], pairs: Collection[tuple[str, str]]
    ) -> bool:
        """End the travel of a joint at ``ends`` [m or rad]; False if too little of it remains."""
        joint = self.asset.joint(name)
        low, high = ends
        lower, upper = joint_range(joint)
        low, high = max(low, lower), min(high, upper)
        scale = 10.0**DIGITS
        if low > lower:
            low = math.ceil(low * scale) / scale
        if high < upper:
            high = math.floor(high * scale) / scale
        closed = min(max(joint.closed, low), high)
        far = min(max(joint.open, low), high)
        travel = abs(far - closed)
        enough = travel >= MIN_TRAVEL_SHARE * abs(joint.span)
        if joint.kind == "hinge":
            enough = enough or travel >= MIN_TURN
        if not enough or low >= high or (low, high) == (lower, upper):
            return False
        self._set(replace(joint, lower=low, upper=high, closed=closed, open=far))
        others = sorted({other for _, other in pairs})
        unit = "m" if joint.kind == "slide" else "rad"
        before = "turned without end" if joint.lower is None else f"{lower:.4g} to {upper:.4g}"
        self._shortened[joint.name] = (
            f"travel of joint {joint.name} shortened to {low:.4g} to {high:.4g} {unit} "
            f"(was {before}): beyond it the part goes into {' and '.join(others)}, as authored"
        )
        return True

    def _set(self, joint: Joint) -> None:
        joints = tuple(joint if j.name == joint.name else j for j in self.asset.joints)
        self.asset = replace(self.asset, joints=joints)
        part = self.parts[joint.link]
        part.body = replace(part.body, joint=joint)

    def _cut(self, violation: Violation) -> bool:
        """Trim shapes along a travel until nothing interferes, or change nothing.

        Minimal cuts are tried first, then cuts that separate two shapes completely, as
        many small cuts can cost more than a single one. Where neither clears the full travel
        because authored parts overlap further on, the travel ends there if enough is cleared.
        """
        self._authored = set(violation.authored)
        before = self._states()
        tried = []
        for separate in (False, True):
            count = sum(part.cut_count for part in self.parts.values())
            try:
                reached = self._cut_along(violation, separate=separate)
            except OutOfTimeError:
                self._restore(before)
                return False
            if reached.complete:
                if not separate:
                    self._before_cuts.setdefault(violation.joint, (before, violation))
                return sum(part.cut_count for part in self.parts.values()) > count
            tried.append(reached)
            self._restore(before)
        best = max(tried, key=lambda reached: reached.ends[1] - reached.ends[0])
        wall = best.barred and violation.isolated and bool(violation.authored)
        if not (wall and self._end(violation.joint, best.ends, violation.authored)):
            return False
        self._restore(best.states)
        return True

    def _cut_apart(self, joint: str) -> bool:
        """Undo minimal cuts along the travel of a joint and separate its shapes instead.

        Minimal cuts reduce the overlap at rest, relative to which the remaining overlap may be too
        deep. Later cuts for other joints are undone as well and made again in the next round.
        """
        if joint not in self._before_cuts:
            return False
        now, (before, violation) = self._states(), self._before_cuts.pop(joint)
        self._restore(before)
        self._authored = set(violation.authored)
        with suppress(OutOfTimeError):
            if self._cut_along(violation, separate=True).complete:
                return True
        self._restore(now)
        return False

    def _states(self) -> dict[str, tuple[Any, ...]]:
        """Return the states of all parts, for :meth:`_restore`."""
        return {name: part.state() for name, part in self.parts.items()}

    def _restore(self, states: Mapping[str, tuple[Any, ...]]) -> None:
        """Restore earlier states, which are copied."""
        for name, (*lists, empty, cuts, count, removed_m3) in states.items():
            fresh = map(list, lists)
            self.parts[name].restore((*fresh, set(empty), set(cuts), count, removed_m3))

    def _cut_along(self, violation: Violation, *, separate: bool) -> _Cleared:
        """Trim shapes along a travel as far as possible."""
        most = MAX_STATES if violation.isolated else SAMPLE_STATES
        start = Sweeper(model=self.model())
        pairs = {
            (interference.one, interference.other) for interference in violation.sweep.interferences
        }
        ends, stops = [start.model.closed[violation.joint]], []
        sweeper = self._sweeper_of(pairs)
        for positions in start.positions(violation.joint, most):
            for q in positions.tolist():
                before = self._states()
                at = {**violation.others, violation.joint: q}
                found = self._cut_at(sweeper, violation.joint, at, pairs, separate=separate)
                if found is None:
                    self._restore(before)
                    sweeper = self._sweeper_of(pairs)
                    stops.append(self._barred)
                    break
                sweeper = found
                ends.append(q)
            if stops and not all(stops):
                break
        return _Cleared(
            ends=(min(ends), max(ends)),
            complete=not stops,
            barred=bool(stops) and all(stops),
            states=self._states(),
        )

    def _cut_at(
        self,
        sweeper: Sweeper,
        joint: str,
        q: Mapping[str, float],
        pairs: set[tuple[str, str]],
        *,
        separate: bool,
    ) -> Sweeper | None:
        """Trim shapes of ``pairs`` of links in one state.

        Returns:
            Sweeper of the result, or None if the links would lose too much.
        """
        self._barred = False
        for _ in range(TRIES):
            self._budget.check()
            found = [m for m in sweeper.interferences(joint, q) if (m.one, m.other) in pairs]
            if not found:
                return sweeper
            touched: set[int] = set()
            for interference in sorted(found, key=lambda m: -m.excess_m):
                geoms = {interference.overlap.one, interference.overlap.other}
                if touched & geoms:
                    continue
                if not self._cut_one(interference, sweeper, separate=separate):
                    return None
                touched |= geoms
            for part in self.parts.values():
                part.remove_empty()
            sweeper = self._sweeper_of(pairs)
        return None

    def _sweeper_of(self, pairs: set[tuple[str, str]]) -> Sweeper:
        """Return a sweeper of the current object in which only links of ``pairs`` have shapes."""
        model = self.model(touching={name for pair in pairs for name in pair})
        return Sweeper(model=model, visual_triangles=self._visual_triangles)

    def _cut_one(self, interference: Interference, sweeper: Sweeper, *, separate: bool) -> bool:
        """Trim the one of two shapes whose link loses least coverage; return whether it was cut.

        If neither can lose as much, both are cut by half. Nothing is bared where authored
        parts overlap.
        """
        self._barred = sweeper.surfaces.cross(sweeper.data, interference.overlap)
        overlap = self._barred or (interference.one, interference.other) in self._authored
        separation_w = np.asarray(interference.overlap.separation_w)
        one, other = (
            (interference.one, interference.overlap.one),
            (interference.other, interference.overlap.other),
        )
        sides = ((one, other, -separation_w), (other, one, separation_w))
        depth_m = interference.excess_m - AIM_M
        candidates: list[tuple[Part, Cut]] = []
        for own, their, toward_w in sides:
            part, index = self.parts[own[0]], _index(sweeper.model, own[1])
            rests = self._remainders(sweeper, part.shapes[index], own[1], their)
            candidates += [(part, part.evaluate(index, rest)) for rest in rests]
            if not separate:
                candidates.append(self._shaved(sweeper, own, toward_w, depth_m))
        allowed = [
            (part, cut) for part, cut in candidates if cut.allowed and not (overlap and cut.bared)
        ]
        if allowed:
            part, cut = min(
                allowed, key=lambda o: (round(o[1].lost, 3), len(o[1].rest), o[1].removed_m3)
            )
            part.apply(cut)
            return True
        halves = [self._shaved(sweeper, own, away, depth_m / 2.0) for own, _, away in sides]
        if not all(cut.allowed and not (overlap and cut.bared) for _, cut in halves):
            return False
        for part, cut in halves:
            part.apply(cut)
        return True

    def _shaved(
        self, sweeper: Sweeper, own: tuple[str, int], toward_w: Array, depth_m: float
    ) -> tuple[Part, Cut]:
        """Evaluate a planar cut of a geom by ``depth_m``, and return it with its part."""
        part, index = self.parts[own[0]], _index(sweeper.model, own[1])
        rest = cut_back(part.shapes[index], _turn(sweeper, own[1]).T @ toward_w, depth_m)
        return part, part.evaluate(index, () if rest is None else (rest,))

    def _remainders(
        self, sweeper: Sweeper, shape: Shape, geom: int, other: tuple[str, int]
    ) -> list[tuple[Shape, ...]]:
        """Return possible remainders of ``shape`` that do not reach the ``other`` shape.

        Either one convex shape, cut by a plane along an axis of either, or several around the
        other.
        """
        theirs = self.parts[other[0]].shapes[_index(sweeper.model, other[1])]
        model, data = sweeper.model, sweeper.data
        own = sweeper.shapes.link_of[geom]
        T = inverse(model.T_ol(data, own)) @ model.T_ol(data, other[0])
        corners = theirs.corners @ T[:3, :3].T + T[:3, 3]
        rests: list[tuple[Shape, ...]] = []
        axes = np.concatenate([shape.T_ps[:3, :3], T[:3, :3] @ theirs.T_ps[:3, :3]], axis=1).T
        for normal in np.concatenate([axes, -axes]):
            depth_m = float((shape.corners @ normal).max() - (corners @ normal).min()) + APART_M
            if APART_M < depth_m < float(np.ptp(shape.corners @ normal)):
                rest = cut_back(shape, normal, depth_m)
                rests.append(() if rest is None else (rest,))
        planes = theirs.planes
        if len(planes) <= MAX_PLANES:
            turned = planes[:, :3] @ T[:3, :3].T
            offset = planes[:, 3] - turned @ T[:3, 3]
            rests.append(carved(shape, np.column_stack([turned, offset])))
        return rests

    def model(
        self, *, with_visuals: bool = False, touching: Collection[str] | None = None
    ) -> ObjectModel:
        """Compile the object in its current state.

        Args:
            with_visuals: Include the visual geometry.
            touching: Links with collision shapes; None: all.
        """
        bodies = [part.trimmed_body() for part in self.parts.values()]
        if touching is not None:
            bodies = [b if b.name in touching else replace(b, shapes=()) for b in bodies]
        if not with_visuals:
            bodies = [replace(body, visuals=()) for body in bodies]
        text = mjcf(self.asset.name, bodies, (), (), self.mimics)
        files = {f"meshes/{name}": content for name, content in mesh_files(bodies).items()}
        spec = mujoco.MjSpec.from_string(text, assets=files)
        return ObjectModel(self.asset, spec.compile())

    def result(self, model: ObjectModel) -> RepairResult:
        """Return the repaired object; ``model`` is the compiled object."""
        repairs = [*self._relaxed, *self._shortened.values()]
        links = []
        for link in self.asset.links:
            part = self.parts[link.name]
            mass_kg = part.body.inertial.mass_kg
            share = 0.0
            if part.cuts:
                total = sum(shape.volume for shape in part.body.shapes)
                share = part.removed_m3 / max(total, 1e-12)
                repairs.append(
                    f"part {link.name}: {len(part.cuts)} collision shapes trimmed where parts "
                    f"pass each other, by {share:.1%} of their total volume"
                )
            links.append(replace(link, collisions=len(part.shapes), mass_kg=mass_kg, trimmed=share))
        return RepairResult(
            asset=replace(self.asset, links=tuple(links)),
            bodies=tuple(part.trimmed_body() for part in self.parts.values()),
            repairs=tuple(repairs),
            model=model,
            cut=frozenset(name for name, part in self.parts.items() if part.cuts),
        )


def _turn(sweeper: Sweeper, geom: int) -> Array:
    """Return the rotation (3, 3) of the link of ``geom`` in the world."""
    body = int(sweeper.model.model.geom_bodyid[geom])
    return np.asarray(sweeper.data.xmat[body].reshape(3, 3))


def _index(model: ObjectModel, geom: int) -> int:
    """Return the index of the shape ``geom`` in its body, which its name ends with."""
    return int(model.model.geom(geom).name.rsplit("_", 1)[1])
