"""Move the joints of an object and find interferences of its parts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from articulate.assets.asset import Asset
from articulate.checks.distances import Overlap, Shapes
from articulate.checks.model import ObjectModel
from articulate.checks.visual_collision import Surfaces
from articulate.transforms import Array, Ints

LIMIT_M = 0.002
"""Depth beyond that at rest above which parts interfere [m]."""
STEP_M = 0.003
"""The farthest point of a part moves by at most this from one state to the next [m] ..."""
MAX_STATES = 400
"""... unless that makes more states than this along one way."""

RATE_STATES = 65
"""Positions of a leader at which the speed of a mimic joint, a polynomial, is evaluated."""


@dataclass(frozen=True, kw_only=True)
class Interference:
    """State in which a moving part penetrates another one too deeply."""

    excess_m: float
    """Depth beyond that at rest [m]."""
    overlap: Overlap
    one: str
    """Link of the first geom, which the joint moves."""
    other: str
    """Link of the second geom."""
    joint: str
    """Joint that is moved."""
    q: Mapping[str, float]
    """Positions of the joints that are not closed [m or rad]."""


@dataclass(frozen=True, kw_only=True)
class JointSweep:
    """Interferences of a joint on its travel."""

    free: float
    """Fraction of the travel before the first interference."""
    ends: tuple[float, float]
    """Lowest and highest position that closed reaches without one [m or rad]."""
    deepest_m: float
    """Largest depth beyond rest, if above 2 mm; 0 without interference [m]."""
    interferences: tuple[Interference, ...] = ()
    """The deepest for each pair of links, deepest first."""


@dataclass(kw_only=True)
class _Group:
    """Links that move together with a joint, and geoms that they can hit."""

    ones: Ints
    others: Ints


@dataclass(kw_only=True)
class Sweeper:
    """Moves joints of one object and finds interferences."""

    model: ObjectModel
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    visual_triangles: dict[str, Array] = field(default_factory=dict)
    """Triangles (F, 3, 3) [m] of links whose surfaces the model does not have."""

    def __post_init__(self) -> None:
        self.shapes = Shapes(self.model)
        self.surfaces = Surfaces(self.model, self.shapes, self.visual_triangles)
        self.data = self.model.data()
        self.chains = chains(self.model.asset)
        self.groups = {name: self._groups(name) for name in self.model.free_joints}
        everything = self.shapes.geoms(set(self.chains))
        self.rest_m: dict[tuple[int, str], float] = {}  # of a geom in another link
        for found in self.shapes.overlaps(self.data, everything, everything, least_m=0.0):
            key = (found.one, self.shapes.link_of[found.other])
            self.rest_m[key] = max(self.rest_m.get(key, 0.0), found.depth_m)

    def moved_with(self, joint: str) -> set[str]:
        """Return ``joint`` and its mimic joints."""
        moved = {joint}
        for follower in self.model.followers:
            if follower.leader in moved:
                moved.add(follower.joint)
        return moved

    def _groups(self, joint: str) -> list[_Group]:
        moved = self.moved_with(joint)
        by_sign: dict[frozenset[str], set[str]] = {}
        for link, chain in self.chains.items():
            by_sign.setdefault(frozenset(chain) & moved, set()).add(link)
        still = by_sign.pop(frozenset(), set())
        groups = []
        for links in by_sign.values():
            groups.append(_Group(ones=self.shapes.geoms(links), others=self.shapes.geoms(still)))
            still = still | links
        return groups

    def positions(self, joint: str, most: int) -> list[Array]:
        """Return positions from closed to each end of the range, or one turn [m or rad]."""
        closed = self.model.closed[joint]
        low, high = self.model.limits(joint)
        ends = [low, high]
        if not self.model.model.jnt_limited[self.model.joints[joint]]:
            ends = [closed + 2.0 * math.pi]
        reach = self._reach(joint)
        out = []
        for end in ends:
            sweep = abs(end - closed) * reach
            if sweep > 1e-6:
                count = int(np.clip(math.ceil(min(sweep / STEP_M, most)), 2, most))
                out.append(np.linspace(closed, end, count + 1)[1:])
        return out

    def _reach(self, joint: str) -> float:
        """Return the motion of the farthest point per unit of the joint [m per m or rad].

        Mimic joints may move faster than the joint.
        """
        self.model.set_joints(self.data, {})
        geoms = np.concatenate([group.ones for group in self.groups[joint]])
        is_slide = self.model.asset.joint(joint).kind == "slide"
        fastest = 1.0 if is_slide else float(self._levers(joint, geoms).max(initial=0.0))
        rates = self._rates(joint)
        if len(rates) == 1:
            return fastest
        for link, chain in self.chains.items():
            moved = [name for name in chain if name in rates]
            if moved:
                ones = self.shapes.geoms({link})
                speeds = np.sum([rates[name] * self._levers(name, ones) for name in moved], axis=0)
                fastest = max(fastest, float(speeds.max(initial=0.0)))
        return fastest

    def _levers(self, joint: str, geoms: Ints) -> Array:
        """Return the motion (N,) of the farthest point of each geom per unit of the joint [m]."""
        m = self.model.model
        if self.model.asset.joint(joint).kind == "slide":
            return np.ones(len(geoms))
        index = self.model.joints[joint]
        body = int(m.jnt_bodyid[index])
        turn = self.data.xmat[body].reshape(3, 3)
        pivot_w = self.data.xpos[body] + turn @ m.jnt_pos[index]
        axis_w = turn @ m.jnt_axis[index]
        offset = np.cross(self.data.geom_xpos[geoms] - pivot_w, axis_w)
        return np.asarray(np.linalg.norm(offset, axis=1) + m.geom_rbound[geoms])

    def _rates(self, joint: str) -> dict[str, float]:
        """Return the largest speeds of ``joint`` and its mimic joints relative to ``joint``."""
        low, high = self.model.limits(joint)
        places = {joint: np.linspace(low, high, RATE_STATES)}
        rates = {joint: np.ones(RATE_STATES)}
        for follower in self.model.followers:
            if follower.leader in places:
                line = np.polynomial.Polynomial(follower.coefficients)
                at = places[follower.leader]
                places[follower.joint] = line(at)
                rates[follower.joint] = rates[follower.leader] * line.deriv()(at)
        return {name: float(np.abs(rate).max()) for name, rate in rates.items()}

    def interferences(self, joint: str, q: Mapping[str, float]) -> list[Interference]:
        """Return interferences with the joints at ``q`` [m or rad], others closed."""
        self.model.set_joints(self.data, q)
        out = []
        for group in self.groups[joint]:
            for found in self.shapes.overlaps(self.data, group.ones, group.others, least_m=LIMIT_M):
                other = self.shapes.link_of[found.other]
                excess = found.depth_m - self.rest_m.get((found.one, other), 0.0)
                if excess > LIMIT_M:
                    one = self.shapes.link_of[found.one]
                    found_one = Interference(
                        excess_m=excess,
                        overlap=found,
                        one=one,
                        other=other,
                        joint=joint,
                        q=dict(q),
                    )
                    out.append(found_one)
        return out

    def sweep(self, joint: str, others: Mapping[str, float], most: int = MAX_STATES) -> JointSweep:
        """Sweep ``joint`` with the ``others`` at the given positions, the rest closed."""
        worst: dict[tuple[str, str], Interference] = {}
        total = 0
        ends = [self.model.closed[joint]]
        for positions in self.positions(joint, most):
            blocked = False
            for q in positions:
                met = self.interferences(joint, {**others, joint: float(q)})
                for interference in met:
                    key = (interference.one, interference.other)
                    if key not in worst or interference.excess_m > worst[key].excess_m:
                        worst[key] = interference
                blocked = blocked or bool(met)
                if not blocked:
                    ends.append(float(q))
            total += len(positions)
        found = sorted(worst.values(), key=lambda m: -m.excess_m)
        return JointSweep(
            free=(len(ends) - 1) / total if total else 1.0,
            ends=(min(ends), max(ends)),
            deepest_m=found[0].excess_m if found else 0.0,
            interferences=tuple(found),
        )

    def authored(self, interference: Interference) -> bool:
        """Return whether the authored surfaces of two links cross in the state of an interference.

        All places where their shapes overlap at least half as deep are searched.
        """
        found = self.interferences(interference.joint, interference.q)
        same = [m for m in found if (m.one, m.other) == (interference.one, interference.other)]
        return any(
            self.surfaces.cross(self.data, m.overlap)
            for m in same
            if m.excess_m >= interference.excess_m / 2.0
        )

    def is_own(self, interference: Interference) -> bool:
        """Return whether only the joint itself determines the relative pose of the two links."""
        between = set(self.chains[interference.one]) ^ set(self.chains[interference.other])
        return between <= self.moved_with(interference.joint)


def chains(asset: Asset) -> dict[str, tuple[str, ...]]:
    """Return the joints between the root and each link, outermost last."""
    by_link = {joint.link: joint for joint in asset.joints}
    out: dict[str, tuple[str, ...]] = {}
    for link in asset.links:
        joint = by_link.get(link.name)
        parent = out.get(link.parent or "", ())
        out[link.name] = (*parent, joint.name) if joint is not None else parent
    return out
