"""Moving the joints of an object and asking which parts go through each other."""

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
"""Deeper beyond rest than this, one part goes through another [m]."""
STEP_M = 0.003
"""The farthest point of a part moves by at most this from one state to the next [m] ..."""
MAX_STATES = 400
"""... unless that makes more states than this along one way."""

RATE_STATES = 65
"""Positions of a leader in which the speed of a follower, a polynomial, is looked at."""


@dataclass(frozen=True, kw_only=True)
class Interference:
    """A state in which a moving part lies too deep in another one."""

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
class Way:
    """What a joint met on its way through its range."""

    free: float
    """Share of the way before the first meeting."""
    ends: tuple[float, float]
    """Lowest and highest position that can be reached from closed without one [m or rad]."""
    deepest_m: float
    """Greatest depth beyond rest, counted from 2 mm on; 0 without a meeting [m]."""
    meetings: tuple[Interference, ...] = ()
    """The deepest for each pair of links, deepest first."""


@dataclass(kw_only=True)
class _Group:
    """Links that move as one while a joint moves, and geoms that they can meet."""

    ones: Ints
    others: Ints


@dataclass(kw_only=True)
class Sweeper:
    """Moves joints of one object and asks what meets."""

    model: ObjectModel
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    shown: dict[str, Array] = field(default_factory=dict)
    """Triangles (F, 3, 3) [m] of links whose surfaces the model does not have."""

    def __post_init__(self) -> None:
        self.shapes = Shapes(self.model)
        self.surfaces = Surfaces(self.model, self.shapes, self.shown)
        self.data = self.model.data()
        self.chains = chains(self.model.asset)
        self.groups = {name: self._groups(name) for name in self.model.free_joints}
        everything = self.shapes.geoms(set(self.chains))
        self.rest_m: dict[tuple[int, str], float] = {}  # of a geom in another link
        for found in self.shapes.overlaps(self.data, everything, everything, least_m=0.0):
            key = (found.one, self.shapes.link_of[found.other])
            self.rest_m[key] = max(self.rest_m.get(key, 0.0), found.depth_m)

    def moved_with(self, joint: str) -> set[str]:
        """``joint`` and the joints that follow it."""
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
        """Ways from closed to each end of the range, one turn if it has none [m or rad]."""
        closed = self.model.closed[joint]
        low, high = self.model.limits(joint)
        ends = [low, high]
        if not self.model.model.jnt_limited[self.model.joints[joint]]:
            ends = [closed + 2.0 * math.pi]
        reach = self._reach(joint)
        out = []
        for end in ends:
            way = abs(end - closed) * reach
            if way > 1e-6:
                count = int(np.clip(math.ceil(min(way / STEP_M, most)), 2, most))
                out.append(np.linspace(closed, end, count + 1)[1:])
        return out

    def _reach(self, joint: str) -> float:
        """How far the farthest point moves for one unit of the joint [m per m or rad].

        Those that follow it may be faster than what it moves itself.
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
                ways = np.sum([rates[name] * self._levers(name, ones) for name in moved], axis=0)
                fastest = max(fastest, float(ways.max(initial=0.0)))
        return fastest

    def _levers(self, joint: str, geoms: Ints) -> Array:
        """How far the farthest point of each geom moves for one unit of the joint (N,)."""
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
        """Greatest speed of ``joint`` and of those that follow it, for one unit of its own."""
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

    def meetings(self, joint: str, q: Mapping[str, float]) -> list[Interference]:
        """Parts that lie too deep in each other with the joints at ``q``, others closed."""
        self.model.set_joints(self.data, q)
        out = []
        for group in self.groups[joint]:
            for found in self.shapes.overlaps(self.data, group.ones, group.others, least_m=LIMIT_M):
                other = self.shapes.link_of[found.other]
                excess = found.depth_m - self.rest_m.get((found.one, other), 0.0)
                if excess > LIMIT_M:
                    one = self.shapes.link_of[found.one]
                    met = Interference(
                        excess_m=excess,
                        overlap=found,
                        one=one,
                        other=other,
                        joint=joint,
                        q=dict(q),
                    )
                    out.append(met)
        return out

    def way(self, joint: str, others: Mapping[str, float], most: int = MAX_STATES) -> Way:
        """What ``joint`` meets with the ``others`` where they are said to be, the rest closed."""
        worst: dict[tuple[str, str], Interference] = {}
        total = 0
        ends = [self.model.closed[joint]]
        for positions in self.positions(joint, most):
            blocked = False
            for q in positions:
                met = self.meetings(joint, {**others, joint: float(q)})
                for meeting in met:
                    key = (meeting.one, meeting.other)
                    if key not in worst or meeting.excess_m > worst[key].excess_m:
                        worst[key] = meeting
                blocked = blocked or bool(met)
                if not blocked:
                    ends.append(float(q))
            total += len(positions)
        found = sorted(worst.values(), key=lambda m: -m.excess_m)
        return Way(
            free=(len(ends) - 1) / total if total else 1.0,
            ends=(min(ends), max(ends)),
            deepest_m=found[0].excess_m if found else 0.0,
            meetings=tuple(found),
        )

    def authored(self, meeting: Interference) -> bool:
        """Whether the authored surfaces of two links cross as well in the state of a meeting.

        Looked at is every place where their shapes meet at least half as deep as there.
        """
        found = self.meetings(meeting.joint, meeting.q)
        same = [m for m in found if (m.one, m.other) == (meeting.one, meeting.other)]
        return any(
            self.surfaces.cross(self.data, m.overlap)
            for m in same
            if m.excess_m >= meeting.excess_m / 2.0
        )

    def is_own(self, meeting: Interference) -> bool:
        """Whether nothing but the joint itself decides how the two links lie."""
        between = set(self.chains[meeting.one]) ^ set(self.chains[meeting.other])
        return between <= self.moved_with(meeting.joint)


def chains(asset: Asset) -> dict[str, tuple[str, ...]]:
    """Joints between the root and each link, outermost last."""
    by_link = {joint.link: joint for joint in asset.joints}
    out: dict[str, tuple[str, ...]] = {}
    for link in asset.links:
        joint = by_link.get(link.name)
        parent = out.get(link.parent or "", ())
        out[link.name] = (*parent, joint.name) if joint is not None else parent
    return out
