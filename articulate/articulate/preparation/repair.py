"""Repairs that need measuring: shapes cut back and limits shortened until parts pass each other.

Where parts meet on a joint's way, two things are sound. What the collision shapes have too much is
cut away, as long as what is seen stays covered. And where the parts meet as authored, deeper than a
cut can mend, the way ends there: no real part goes through another one. Where too little of the way
would be left, all stays as it is, and the proof refuses it: no cut opens a way through a wall, and
none leaves slices so thin that they pass one unnoticed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.checks.force import FORCE_N, Pull, pull_of
from articulate.checks.interference import LIMIT_M, MAX_STATES, Interference, Sweeper
from articulate.checks.model import ObjectModel
from articulate.checks.sweep import DRAW_STATES, Violation, sweep_joints
from articulate.conversion.write_asset import Body, Mimic, mesh_files, mjcf
from articulate.geometry.shapes import Shape
from articulate.geometry.time_budget import UNLIMITED, Budget, OutOfTimeError
from articulate.preparation.trim_colliders import APART_M, Offer, Part, carved, cut_back
from articulate.simulator import mujoco
from articulate.transforms import Array, inverse

ROUNDS = 6
"""So often is everything swept again after repairs."""
AIM_M = 0.001
"""A cut leaves this much of an overlap, beyond that at rest [m]."""
MOST_PLANES = 16
"""Nothing is carved round shapes with more faces than this."""
TRIES = 12
"""Cuts at one state before it is given up."""
LEAST_WAY = 0.5
"""A shortened joint keeps at least this share of its way ..."""
LEAST_TURN = math.radians(75.0)
"""... or, if it is a hinge, this much [rad]."""
SLOW_S = 1.5
"""Damping alone may make the whole way take this long [s]."""
MOST_FRICTION = 0.5
"""Dry friction may take this share of what a hand gives."""
HALVINGS = 5
"""The step in which parts begin to meet is halved so often to find where."""
MOST_WEIGHT = 0.8
"""Weight and dry friction together may take this share of what a hand gives."""
LEAST_MASS = 0.4
"""A part that is balanced keeps at least this share of its mass."""
WEIGHINGS = 9
"""Positions along a way at which the weight is taken."""
DIGITS = 4
"""Shortened limits are rounded inwards to this many decimals."""


@dataclass(frozen=True, kw_only=True)
class RepairResult:
    """An object after repairs."""

    asset: Asset
    bodies: tuple[Body, ...]
    repairs: tuple[str, ...]
    """What was changed, one sentence each; none if nothing was."""
    model: ObjectModel
    """It compiled, with what it shows."""
    cut: frozenset[str] = frozenset()
    """Links of which shapes were cut back."""
    stuck: frozenset[str] = frozenset()
    """Links that still go into each other on some way."""


def repair_joints(
    asset: Asset,
    bodies: Sequence[Body],
    mimics: Sequence[Mimic],
    model: ObjectModel,
    budget: Budget = UNLIMITED,
) -> RepairResult:
    """Repair what stands in the way of joints.

    Args:
        asset: The object.
        bodies: Its bodies as they were written.
        mimics: Joints that follow others.
        model: The object compiled, with what it shows.
        budget: Time for cuts; what is not done by then is left alone.
    """
    bench = RepairSession(asset=asset, bodies=bodies, mimics=mimics, budget=budget)
    for name in model.free_joints:
        pull = pull_of(asset, model, name)
        bench.ease(pull)
        bench.balance(pull, model)
    for _ in range(ROUNDS):
        faults = sweep_joints(model).faults
        changed = False
        for fault in faults:
            changed |= bench.mend(fault, model)
        if not changed:
            break
        model = bench.model(shown=True)
    met = {name for f in faults for m in f.way.meetings for name in (m.one, m.other)}
    return replace(bench.done(model), stuck=frozenset(met))


@dataclass(frozen=True, kw_only=True)
class _Reached:
    """How far along a way shapes could be cut back."""

    ends: tuple[float, float]
    """Lowest and highest position without a meeting [m or rad]."""
    whole: bool
    """Whether that is the whole way."""
    barred: bool
    """Whether what ends it are parts that meet as authored, everywhere it ends."""
    states: Mapping[str, tuple[Any, ...]]
    """The parts, cut so far."""


class RepairSession:
    """An object under repair.

    Args:
        asset: The object.
        bodies: Its bodies as converted.
        mimics: Joints that follow others.
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
        self._shown = {
            body.name: np.concatenate(
                [np.zeros((0, 3, 3)), *(piece.mesh.triangles for piece in body.visuals)]
            )
            for body in bodies
        }
        self._authored: set[tuple[str, str]] = set()
        """Pairs of links of the fault in hand that meet as authored."""
        self._barred = False
        """Whether the parts meet as authored where they were to be cut last."""
        self._shortened: dict[str, str] = {}
        self._sparing: dict[str, tuple[dict[str, tuple[Any, ...]], Violation]] = {}
        """By joint: what was before as little as had to be was cut on its way, and why."""
        self._eased: list[str] = []

    def ease(self, pull: Pull) -> None:
        """Lower damping and dry friction against which a hand could not open a joint in time."""
        joint = pull.joint
        if pull.way <= 0.0 or pull.effort <= 0.0:
            return
        units = ("N s/m", "N") if joint.kind == "slide" else ("Nm s/rad", "Nm")
        damping = min(joint.damping, SLOW_S * pull.effort / pull.way)
        friction = min(joint.frictionloss, MOST_FRICTION * pull.effort)
        for what, old, new, unit in (
            ("damping", joint.damping, damping, units[0]),
            ("dry friction", joint.frictionloss, friction, units[1]),
        ):
            if new < old:
                self._eased.append(
                    f"{what} of joint {joint.name} lowered from {old:.4g} to {new:.4g} {unit}: "
                    f"{FORCE_N:g} N at {pull.where} would not open it in time"
                )
        if (damping, friction) != (joint.damping, joint.frictionloss):
            self._set(replace(joint, damping=damping, frictionloss=friction))

    def balance(self, pull: Pull, model: ObjectModel) -> None:
        """Lower the masses that a joint carries where a hand could not move their weight.

        Doors that fall open and seats that are lifted are balanced by springs, which no file
        tells of. Masses that the source gives are left as they are.

        Args:
            pull: What the hand does to the joint.
            model: The object, for its weight.
        """
        carried = carried_by(self.asset, pull.joint.link)
        joint = self.asset.joint(pull.joint.name)
        weight = weight_on(model, joint)
        most = MOST_WEIGHT * pull.effort - joint.frictionloss
        if weight <= max(most, 0.0) or any(self.parts[n].body.inertial.from_source for n in carried):
            return
        share = most / weight
        if share < LEAST_MASS:
            return
        before = after = 0.0
        for name in carried:
            part = self.parts[name]
            own = part.body.inertial
            lighter = replace(own, mass_kg=share * own.mass_kg, inertia_p=share * own.inertia_p)
            part.body = replace(part.body, inertial=lighter)
            before, after = before + own.mass_kg, after + lighter.mass_kg
        unit = "N" if joint.kind == "slide" else "Nm"
        self._eased.append(
            f"mass that joint {joint.name} carries lowered from {before:.3g} to {after:.3g} kg, as "
            f"if a spring balanced it: its weight asks for {weight:.3g} {unit}, and {FORCE_N:g} N "
            f"at {pull.where} give {pull.effort:.3g} {unit}"
        )

    def mend(self, fault: Violation, model: ObjectModel) -> bool:
        """Repair one fault; whether anything was changed.

        Args:
            fault: What meets, and where.
            model: The object as it is now.
        """
        deep = {
            (meeting.one, meeting.other)
            for meeting in fault.way.meetings
            if (meeting.one, meeting.other) in fault.authored and self._is_deep(meeting)
        }
        if (
            deep
            and fault.alone
            and (
                self._shorten(fault, deep, model)
                or self._shorten(fault, deep, model, deep=True)  # what is left of it may be cut
            )
        ):
            return True
        if self._cut(fault):
            return True
        met = set(fault.authored)
        ended = bool(met) and fault.alone and self._shorten(fault, met, model)
        return ended or self._cut_apart(fault.joint)

    def _is_deep(self, meeting: Interference) -> bool:
        """Whether two parts meet deeper than their shapes may stray from what they show."""
        near = max(self.parts[name].near_m for name in (meeting.one, meeting.other))
        return meeting.excess_m > near

    def _shorten(
        self,
        fault: Violation,
        pairs: set[tuple[str, str]],
        model: ObjectModel,
        *,
        deep: bool = False,
    ) -> bool:
        """End the way of a joint where any of ``pairs`` of links meets; False if little is left.

        Where ``deep``, it ends only where they meet deeper than a cut can mend.
        """
        meets = self._is_deep if deep else _is_met
        return self._end(fault.joint, reach(Sweeper(model=model), fault, pairs, meets), pairs)

    def _end(
        self, name: str, ends: tuple[float, float], pairs: Collection[tuple[str, str]]
    ) -> bool:
        """End the way of a joint at ``ends`` [m or rad]; False if little is left of it."""
        joint = self.asset.joint(name)
        low, high = ends
        lower, upper = _range(joint)
        low, high = max(low, lower), min(high, upper)
        scale = 10.0**DIGITS
        if low > lower:
            low = math.ceil(low * scale) / scale
        if high < upper:
            high = math.floor(high * scale) / scale
        closed = min(max(joint.closed, low), high)
        far = min(max(joint.open, low), high)
        way = abs(far - closed)
        enough = way >= LEAST_WAY * abs(joint.span)
        if joint.kind == "hinge":
            enough = enough or way >= LEAST_TURN
        if not enough or low >= high or (low, high) == (lower, upper):
            return False
        self._set(replace(joint, lower=low, upper=high, closed=closed, open=far))
        others = sorted({other for _, other in pairs})
        unit = "m" if joint.kind == "slide" else "rad"
        before = "turned without end" if joint.lower is None else f"{lower:.4g} to {upper:.4g}"
        self._shortened[joint.name] = (
            f"way of joint {joint.name} shortened to {low:.4g} to {high:.4g} {unit} "
            f"(was {before}): beyond it the part goes into {' and '.join(others)}, as authored"
        )
        return True

    def _set(self, joint: Joint) -> None:
        joints = tuple(joint if j.name == joint.name else j for j in self.asset.joints)
        self.asset = replace(self.asset, joints=joints)
        part = self.parts[joint.link]
        part.body = replace(part.body, joint=joint)

    def _cut(self, fault: Violation) -> bool:
        """Cut shapes back along a way until nothing meets there; else leave all as it is.

        As little as has to be is tried first, then cuts after which two shapes do not meet at
        all: many small ones can cost more than one that ends it. Where neither goes all the way,
        for the parts meet as authored beyond, and enough was cleared, the way ends there.
        """
        self._authored = set(fault.authored)
        before = self._states()
        tried = []
        for whole in (False, True):
            count = sum(part.cut_count for part in self.parts.values())
            try:
                reached = self._cut_along(fault, whole=whole)
            except OutOfTimeError:
                self._restore(before)
                return False
            if reached.whole:
                if not whole:
                    self._sparing.setdefault(fault.joint, (before, fault))
                return sum(part.cut_count for part in self.parts.values()) > count
            tried.append(reached)
            self._restore(before)
        best = max(tried, key=lambda reached: reached.ends[1] - reached.ends[0])
        wall = best.barred and fault.alone and bool(fault.authored)
        if not (wall and self._end(fault.joint, best.ends, fault.authored)):
            return False
        self._restore(best.states)
        return True

    def _cut_apart(self, joint: str) -> bool:
        """Take sparing cuts along a joint's way back and cut its shapes apart instead.

        They leave less of an overlap at rest, beside which what is left on the way may be too much.
        Cuts of other joints since then are gone with them, to be made again in the next round.
        """
        if joint not in self._sparing:
            return False
        now, (before, fault) = self._states(), self._sparing.pop(joint)
        self._restore(before)
        self._authored = set(fault.authored)
        with suppress(OutOfTimeError):
            if self._cut_along(fault, whole=True).whole:
                return True
        self._restore(now)
        return False

    def _states(self) -> dict[str, tuple[Any, ...]]:
        """All parts as they are now, to come back to with :meth:`_restore`."""
        return {name: part.state() for name, part in self.parts.items()}

    def _restore(self, states: Mapping[str, tuple[Any, ...]]) -> None:
        """Go back to earlier states, which stay as they are."""
        for name, (*lists, gone, cuts, count, removed_m3) in states.items():
            fresh = map(list, lists)
            self.parts[name].restore((*fresh, set(gone), set(cuts), count, removed_m3))

    def _cut_along(self, fault: Violation, *, whole: bool) -> _Reached:
        """Cut shapes back along a way, as far as that goes."""
        most = MAX_STATES if fault.alone else DRAW_STATES
        start = Sweeper(model=self.model())
        pairs = {(meeting.one, meeting.other) for meeting in fault.way.meetings}
        ends, stops = [start.model.closed[fault.joint]], []
        sweeper = self._sweeper_of(pairs)
        for positions in start.positions(fault.joint, most):
            for q in positions.tolist():
                before = self._states()
                at = {**fault.others, fault.joint: q}
                found = self._cut_at(sweeper, fault.joint, at, pairs, whole=whole)
                if found is None:
                    self._restore(before)
                    sweeper = self._sweeper_of(pairs)
                    stops.append(self._barred)
                    break
                sweeper = found
                ends.append(q)
            if stops and not all(stops):
                break
        return _Reached(
            ends=(min(ends), max(ends)),
            whole=not stops,
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
        whole: bool,
    ) -> Sweeper | None:
        """Cut shapes of ``pairs`` of links back in one state.

        Returns:
            The sweeper for the result, or None if the links would lose too much.
        """
        self._barred = False
        for _ in range(TRIES):
            self._budget.check()
            met = [m for m in sweeper.meetings(joint, q) if (m.one, m.other) in pairs]
            if not met:
                return sweeper
            touched: set[int] = set()
            for meeting in sorted(met, key=lambda m: -m.excess_m):
                geoms = {meeting.overlap.one, meeting.overlap.other}
                if touched & geoms:
                    continue
                if not self._cut_one(meeting, sweeper, whole=whole):
                    return None
                touched |= geoms
            for part in self.parts.values():
                part.tidy()
            sweeper = self._sweeper_of(pairs)
        return None

    def _sweeper_of(self, pairs: set[tuple[str, str]]) -> Sweeper:
        """A sweeper of the object as it is now in which only links of ``pairs`` have shapes."""
        model = self.model(touching={name for pair in pairs for name in pair})
        return Sweeper(model=model, shown=self._shown)

    def _cut_one(self, meeting: Interference, sweeper: Sweeper, *, whole: bool) -> bool:
        """Cut one of two shapes back, where its link loses least of what covers it.

        Where neither can lose as much, both are cut by half. Nothing is bared where the parts
        meet as authored.
        """
        self._barred = sweeper.surfaces.cross(sweeper.data, meeting.overlap)
        met = self._barred or (meeting.one, meeting.other) in self._authored
        way_out_w = np.asarray(meeting.overlap.way_out_w)
        one, other = (meeting.one, meeting.overlap.one), (meeting.other, meeting.overlap.other)
        sides = ((one, other, -way_out_w), (other, one, way_out_w))
        depth_m = meeting.excess_m - AIM_M
        offers: list[tuple[Part, Offer]] = []
        for own, their, toward_w in sides:
            part, index = self.parts[own[0]], _index(sweeper.model, own[1])
            rests = self._rests(sweeper, part.shapes[index], own[1], their)
            offers += [(part, part.offer(index, rest)) for rest in rests]
            if not whole:
                offers.append(self._shaved(sweeper, own, toward_w, depth_m))
        allowed = [
            (part, offer) for part, offer in offers if offer.allowed and not (met and offer.bared)
        ]
        if allowed:
            part, offer = min(
                allowed, key=lambda o: (round(o[1].lost, 3), len(o[1].rest), o[1].removed_m3)
            )
            part.take(offer)
            return True
        halves = [self._shaved(sweeper, own, way, depth_m / 2.0) for own, _, way in sides]
        if not all(offer.allowed and not (met and offer.bared) for _, offer in halves):
            return False
        for part, offer in halves:
            part.take(offer)
        return True

    def _shaved(
        self, sweeper: Sweeper, own: tuple[str, int], toward_w: Array, depth_m: float
    ) -> tuple[Part, Offer]:
        """The part of a link, and what cutting one of its geoms back by a plane would cost."""
        part, index = self.parts[own[0]], _index(sweeper.model, own[1])
        rest = cut_back(part.shapes[index], _turn(sweeper, own[1]).T @ toward_w, depth_m)
        return part, part.offer(index, () if rest is None else (rest,))

    def _rests(
        self, sweeper: Sweeper, shape: Shape, geom: int, other: tuple[str, int]
    ) -> list[tuple[Shape, ...]]:
        """What can be left of ``shape`` so that it does not reach the ``other`` one at all.

        One convex shape, cut by a plane along an axis of either; or several round the other.
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
        if len(planes) <= MOST_PLANES:
            turned = planes[:, :3] @ T[:3, :3].T
            offset = planes[:, 3] - turned @ T[:3, 3]
            rests.append(carved(shape, np.column_stack([turned, offset])))
        return rests

    def model(self, *, shown: bool = False, touching: Collection[str] | None = None) -> ObjectModel:
        """The object as it is now, compiled.

        Args:
            shown: With what it shows.
            touching: The links that get their shapes; None: all.
        """
        bodies = [part.done() for part in self.parts.values()]
        if touching is not None:
            bodies = [b if b.name in touching else replace(b, shapes=()) for b in bodies]
        if not shown:
            bodies = [replace(body, visuals=()) for body in bodies]
        text = mjcf(self.asset.name, bodies, (), (), self.mimics)
        files = {f"meshes/{name}": content for name, content in mesh_files(bodies).items()}
        spec = mujoco.MjSpec.from_string(text, assets=files)
        return ObjectModel(self.asset, spec.compile())

    def done(self, model: ObjectModel) -> RepairResult:
        """The object with all that was changed; ``model`` is it compiled."""
        repairs = [*self._eased, *self._shortened.values()]
        links = []
        for link in self.asset.links:
            part = self.parts[link.name]
            mass_kg = part.body.inertial.mass_kg
            share = 0.0
            if part.cuts:
                whole = sum(shape.volume for shape in part.body.shapes)
                share = part.removed_m3 / max(whole, 1e-12)
                repairs.append(
                    f"part {link.name}: {len(part.cuts)} collision shapes cut back where parts "
                    f"pass each other, by {share:.1%} of the volume of all"
                )
            links.append(replace(link, collisions=len(part.shapes), mass_kg=mass_kg, trimmed=share))
        return RepairResult(
            asset=replace(self.asset, links=tuple(links)),
            bodies=tuple(part.done() for part in self.parts.values()),
            repairs=tuple(repairs),
            model=model,
            cut=frozenset(name for name, part in self.parts.items() if part.cuts),
        )


def carried_by(asset: Asset, link: str) -> list[str]:
    """``link`` and all links that hang on it, at any remove."""
    found = [link]
    for name in found:
        found += [other.name for other in asset.links if other.parent == name]
    return found


def weight_on(model: ObjectModel, joint: Joint) -> float:
    """Largest effort of gravity on a joint along its way, the others closed [N or Nm]."""
    data, effort = model.data(), np.zeros(model.model.nv)
    most = 0.0
    for q in np.linspace(joint.closed, joint.open, WEIGHINGS):
        model.set_joints(data, {joint.name: float(q)})
        mujoco.mj_comPos(model.model, data)
        mujoco.mj_comVel(model.model, data)
        mujoco.mj_rne(model.model, data, 0, effort)
        most = max(most, abs(float(effort[model.dof_address(joint.name)])))
    return most


def _is_met(meeting: Interference) -> bool:
    """Whether two parts meet deeper than the proof allows."""
    return meeting.excess_m > LIMIT_M


def reach(
    sweeper: Sweeper,
    fault: Violation,
    pairs: set[tuple[str, str]],
    counts: Callable[[Interference], bool] = _is_met,
) -> tuple[float, float]:
    """How far the joint of a fault goes from closed before ``pairs`` of links meet [m or rad].

    Args:
        sweeper: The object.
        fault: Its joint, and where the other ones stand.
        pairs: Names of links.
        counts: Whether a meeting of theirs ends the way.
    """

    def meets(q: float) -> bool:
        met = sweeper.meetings(fault.joint, {**fault.others, fault.joint: q})
        return any((m.one, m.other) in pairs and counts(m) for m in met)

    closed = sweeper.model.closed[fault.joint]
    ends = [closed]
    for positions in sweeper.positions(fault.joint, MAX_STATES):
        free = closed
        for q in positions.tolist():
            if meets(q):
                for _ in range(HALVINGS):
                    middle = (free + q) / 2.0
                    free, q = (free, middle) if meets(middle) else (middle, q)
                break
            free = q
        ends.append(free)
    return min(ends), max(ends)


def _range(joint: Joint) -> tuple[float, float]:
    """Limits of a joint [m or rad]; one turn from closed if it has none."""
    if joint.lower is None or joint.upper is None:
        return joint.closed - 2.0 * math.pi, joint.closed + 2.0 * math.pi
    return joint.lower, joint.upper


def _turn(sweeper: Sweeper, geom: int) -> Array:
    """Rotation (3, 3) of the link of ``geom`` in the world."""
    body = int(sweeper.model.model.geom_bodyid[geom])
    return np.asarray(sweeper.data.xmat[body].reshape(3, 3))


def _index(model: ObjectModel, geom: int) -> int:
    """Which shape of its body ``geom`` is; its name ends with that."""
    return int(model.model.geom(geom).name.rsplit("_", 1)[1])
