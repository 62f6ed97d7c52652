"""Checks ``joint_sweep``, ``authored_overlap`` and ``joint_sweep_random``.

Every joint must move through its range without interference of parts, measured by distance
queries on the collision shapes whatever contacts the engine excludes. The limit applies to the
depth beyond that with all joints closed: parts of real objects touch, and their shapes overlap
slightly, at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from articulate.assets.asset import Joint
from articulate.assets.check_report import Check, JointCheck
from articulate.checks.interference import LIMIT_M, Interference, JointSweep, Sweeper
from articulate.checks.model import ObjectModel

OTHERS_SAMPLES = 8
"""Random samples of the other joints for each joint."""
SAMPLE_STATES = 32
"""Largest number of states along one travel for each of them."""
MAX_RESAMPLES = 24
"""Samples of the others that are replaced because authored parts overlap."""
MAX_NEEDS = 3
"""Largest number of joints that another one may require to be open."""
ONLY_SHAPES = "; only the collision shapes overlap there: the conversion made them too large"
AUTHORED = "; the authored parts overlap there too: correct the limits, the axis or the mesh"


@dataclass(frozen=True, kw_only=True)
class Violation:
    """Travel of a joint with interferences."""

    joint: str
    """Joint that is moved."""
    others: Mapping[str, float]
    """Positions of the joints that are not closed [m or rad]."""
    sweep: JointSweep
    authored: tuple[tuple[str, str], ...]
    """Pairs of links whose authored parts overlap, too."""
    isolated: bool
    """True if all other joints are closed or open as required, not at random."""


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """Result of sweeping all joints of an object."""

    checks: tuple[Check, ...]
    joints: tuple[JointCheck, ...]
    violations: tuple[Violation, ...]


def sweep_joints(model: ObjectModel) -> SweepResult:
    """Sweep every joint, with the others closed and then at random positions.

    The check ``authored_overlap`` is added, failed, where the authored parts overlap in the same
    place: then the object itself is wrong and not its collision shapes.
    """
    asset = model.asset
    sweeper = Sweeper(model=model)
    followers = {f.joint: f.leader for f in model.followers}
    checks: list[Check] = []
    violations: list[Violation] = []
    joints: dict[str, JointCheck] = {}
    for name in model.free_joints:
        joint = asset.joint(name)
        sweep, needs = _needed(sweeper, joint)
        isolated, violation = _check_isolated(sweeper, joint, sweep, needs)
        checks += isolated
        passes = violation is None or len(violation.authored) == len(sweep.interferences)
        violations += [] if violation is None else [violation]
        if passes and len(model.free_joints) > 1:
            check, violation = _check_with_others(sweeper, joint, sweep, needs)
            checks.append(check)
            violations += [] if violation is None else [violation]
        joints[name] = JointCheck(
            name=name,
            kind=joint.kind,
            span=joint.span,
            lower=joint.lower,
            upper=joint.upper,
            swept=sweep.free,
            blocked=bool(sweep.interferences),
            needs=needs,
        )
    for name, joint_check in _locked(joints).items():
        checks.append(_deadlock(joint_check))
        joints[name] = replace(joint_check, blocked=True, swept=0.0)
    for joint in asset.joints:
        if joint.name in followers:
            leader = joints.get(_leader(joint.name, followers))
            joints[joint.name] = JointCheck(
                name=joint.name,
                kind=joint.kind,
                span=joint.span,
                lower=joint.lower,
                upper=joint.upper,
                swept=leader.swept if leader else 0.0,
                blocked=leader.blocked if leader else True,
                needs=leader.needs if leader else (),
            )
    joint_checks = tuple(joints[joint.name] for joint in asset.joints)
    return SweepResult(checks=tuple(checks), joints=joint_checks, violations=tuple(violations))


def _leader(name: str, followers: Mapping[str, str]) -> str:
    for _ in followers:
        name = followers.get(name, name)
    return name


def _needed(sweeper: Sweeper, joint: Joint) -> tuple[JointSweep, tuple[str, ...]]:
    """Sweep a joint, and find the joints that must be open for it.

    Another joint is opened only where the authored parts overlap as well: an overlap of shapes
    only is a fault of the shapes. Interferences that no other joint can change are kept.
    """
    isolated = sweep = sweeper.sweep(joint.name, {})
    opened: dict[str, float] = {}
    while len(opened) < MAX_NEEDS and _foreign(sweeper, sweep):
        stopper = _stopper(sweeper, joint, sweep, opened)
        if stopper is None:
            return isolated, ()
        opened[stopper.name] = stopper.open
        sweep = sweeper.sweep(joint.name, opened)
    if _foreign(sweeper, sweep):
        return isolated, ()
    for name in list(opened):
        fewer = {k: v for k, v in opened.items() if k != name}
        if fewer and not _foreign(sweeper, sweeper.sweep(joint.name, fewer)):
            opened = fewer
    return sweep, tuple(opened)


def _foreign(sweeper: Sweeper, sweep: JointSweep) -> list[Interference]:
    """Return the interferences that another joint could change."""
    return [
        interference for interference in sweep.interferences if not sweeper.is_own(interference)
    ]


def _stopper(
    sweeper: Sweeper, joint: Joint, sweep: JointSweep, opened: Mapping[str, float]
) -> Joint | None:
    """Return the joint that moves the blocking part, if there is one for every interference."""
    free = set(sweeper.model.free_joints)
    kept = set(sweeper.chains[joint.link]) | sweeper.moved_with(joint.name)
    stoppers = []
    for interference in _foreign(sweeper, sweep):
        chain = [c for c in sweeper.chains[interference.other] if c in free and c not in kept]
        if not chain or chain[-1] in opened or not sweeper.authored(interference):
            return None
        stoppers.append(chain[-1])
    return sweeper.model.asset.joint(stoppers[0])


def _locked(joints: Mapping[str, JointCheck]) -> dict[str, JointCheck]:
    """Return the joints that require each other to be open, so that none can move first."""
    waiting = dict(joints)
    while True:
        free = [j for j in waiting.values() if not set(j.needs) & set(waiting)]
        if not free:
            return waiting
        for joint in free:
            del waiting[joint.name]


def _deadlock(joint: JointCheck) -> Check:
    return Check(
        name="authored_overlap",
        outcome="failed",
        subject=joint.name,
        message=f"needs {' and '.join(joint.needs)} open, which needs this one open first: "
        "correct the limits or the axes",
    )


def _check_isolated(
    sweeper: Sweeper, joint: Joint, sweep: JointSweep, needs: Sequence[str]
) -> tuple[list[Check], Violation | None]:
    """Return the checks of a joint with the others closed, and the violation.

    Overlaps of authored parts are distinguished from those of collision shapes only.
    """
    authored = [
        interference for interference in sweep.interferences if sweeper.authored(interference)
    ]
    shapes = [interference for interference in sweep.interferences if interference not in authored]
    checks = []
    if shapes:
        checks.append(
            _failed("joint_sweep", shapes[0], f"{_description(shapes[0], joint)}{ONLY_SHAPES}")
        )
    if authored:
        text = f"{_description(authored[0], joint)}{AUTHORED}"
        checks.append(_failed("authored_overlap", authored[0], text))
    if not checks:
        extra = f"with {' and '.join(needs)} open" if needs else "with the others closed"
        checks.append(_passed("joint_sweep", joint, f"moves through its full range {extra}"))
    if not sweep.interferences:
        return checks, None
    violation = Violation(
        joint=joint.name,
        others={name: sweeper.model.asset.joint(name).open for name in needs},
        sweep=sweep,
        authored=tuple((interference.one, interference.other) for interference in authored),
        isolated=True,
    )
    return checks, violation


def _check_with_others(
    sweeper: Sweeper, joint: Joint, isolated: JointSweep, needs: Sequence[str]
) -> tuple[Check, Violation | None]:
    """Sweep a joint with the other joints at random positions.

    Interferences that only the joint itself determines, and those found before, do not count.
    """
    known = {(interference.one, interference.other) for interference in isolated.interferences}
    done = resampled = 0
    while done < OTHERS_SAMPLES and resampled < MAX_RESAMPLES:
        others = sweeper.model.random_joints(sweeper.rng)
        others = {k: v for k, v in others.items() if k in sweeper.model.free_joints}
        del others[joint.name]
        others.update({name: sweeper.model.asset.joint(name).open for name in needs})
        sweep = sweeper.sweep(joint.name, others, SAMPLE_STATES)
        new = [
            interference
            for interference in sweep.interferences
            if (interference.one, interference.other) not in known
            and not sweeper.is_own(interference)
        ]
        bad = [interference for interference in new if not sweeper.authored(interference)]
        if bad:
            text = f"with the others at random: {_description(bad[0], joint)}{ONLY_SHAPES}"
            sweep = replace(sweep, interferences=tuple(bad))
            violation = Violation(
                joint=joint.name, others=others, sweep=sweep, authored=(), isolated=False
            )
            return _failed("joint_sweep_random", bad[0], text), violation
        resampled += bool(new)
        done += not new
    again = (
        f"; {resampled} states in which authored parts overlap were sampled again"
        if resampled
        else ""
    )
    text = f"moves through its full range with the others at {done} random states{again}"
    check = _passed("joint_sweep_random", joint, text)
    if done:
        return check, None
    text = (
        f"in all of {resampled} random states of the others the authored parts themselves overlap"
    )
    return replace(check, outcome="not_applicable", measured=None, message=text), None


def _failed(name: str, interference: Interference, message: str) -> Check:
    return Check(
        name=name,
        outcome="failed",
        subject=interference.joint,
        measured=interference.excess_m,
        allowed=LIMIT_M,
        unit="m",
        message=message,
    )


def _passed(name: str, joint: Joint, message: str) -> Check:
    return Check(
        name=name,
        outcome="passed",
        subject=joint.name,
        measured=0.0,
        allowed=LIMIT_M,
        unit="m",
        message=message,
    )


def _description(worst: Interference, joint: Joint) -> str:
    """Describe an interference: parts, depth and position."""
    where = f"{worst.q[joint.name]:.3g} {'m' if joint.kind == 'slide' else 'rad'}"
    return (
        f"{worst.one} goes {1e3 * worst.excess_m:.1f} mm deeper into {worst.other} at {where} "
        "than at rest"
    )
