"""Clause: every joint goes through its range without parts going through each other.

By distance queries on the collision shapes, whatever the engine leaves out. What counts is how
much deeper a shape lies in another part than it does with everything closed: parts of real
objects touch, and their shapes overlap a little, while they are at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from articulate.assets.asset import Joint
from articulate.assets.check_report import Check, JointCheck
from articulate.checks.interference import LIMIT_M, Interference, Sweeper, JointSweep
from articulate.checks.model import ObjectModel

OTHERS_SAMPLES = 8
"""Draws of the other joints for each joint."""
SAMPLE_STATES = 32
"""Most states along one way for each of them."""
MAX_RESAMPLES = 24
"""So often are the others drawn again where authored parts meet."""
MAX_NEEDS = 3
"""So many joints may have to be open before another one can move."""
ONLY_SHAPES = "; only the collision shapes meet there: the conversion made them too large"
AUTHORED = "; the authored parts meet there too: mend the limits, the axis or the mesh"


@dataclass(frozen=True, kw_only=True)
class Violation:
    """A way on which parts meet that should not."""

    joint: str
    """Joint that is moved."""
    others: Mapping[str, float]
    """Positions of the joints that are not closed [m or rad]."""
    sweep: JointSweep
    authored: tuple[tuple[str, str], ...]
    """Pairs of links that meet as authored, too."""
    isolated: bool
    """Whether all other joints stand where they have to."""


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """What sweeping the joints of an object brought to light."""

    checks: tuple[Check, ...]
    joints: tuple[JointCheck, ...]
    violations: tuple[Violation, ...]


def sweep_joints(model: ObjectModel) -> SweepResult:
    """Clauses ``sweep_joints``, ``sweep_authored`` and ``sweep_random``, and how far each joint went.

    ``sweep_authored`` appears, failed, where the authored parts meet in the same place: then the
    object itself is at fault and not its shapes.
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
    """The way of a joint, and the joints that had to be opened for it.

    Another joint is opened only where the authored parts meet as well: shapes alone that
    meet are a fault of the shapes. What no other joint can change is left as it is.
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
    """The meetings that another joint could change."""
    return [interference for interference in sweep.interferences if not sweeper.is_own(interference)]


def _stopper(sweeper: Sweeper, joint: Joint, sweep: JointSweep, opened: Mapping[str, float]) -> Joint | None:
    """The joint that moves what is in the way, if there is one for every meeting."""
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
    """The joints that need each other open, so that none of them can be the first."""
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
        "mend the limits or the axes",
    )


def _check_isolated(
    sweeper: Sweeper, joint: Joint, sweep: JointSweep, needs: Sequence[str]
) -> tuple[list[Check], Violation | None]:
    """Clauses about a joint on its own, and what is at fault.

    What the authored parts do themselves is told apart from what the shapes make of them.
    """
    authored = [interference for interference in sweep.interferences if sweeper.authored(interference)]
    shapes = [interference for interference in sweep.interferences if interference not in authored]
    checks = []
    if shapes:
        checks.append(_failed("joint_sweep", shapes[0], f"{_words(shapes[0], joint)}{ONLY_SHAPES}"))
    if authored:
        text = f"{_words(authored[0], joint)}{AUTHORED}"
        checks.append(_failed("authored_overlap", authored[0], text))
    if not checks:
        extra = f"with {' and '.join(needs)} open" if needs else "with the others closed"
        checks.append(_passed("joint_sweep", joint, f"goes through its whole range {extra}"))
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
    """The same with the other joints anywhere in their ranges.

    What nothing but the joint itself decides, and what it met ``isolated``, does not count again.
    """
    known = {(interference.one, interference.other) for interference in isolated.interferences}
    done = redrawn = 0
    while done < OTHERS_SAMPLES and redrawn < MAX_RESAMPLES:
        others = sweeper.model.random_joints(sweeper.rng)
        others = {k: v for k, v in others.items() if k in sweeper.model.free_joints}
        del others[joint.name]
        others.update({name: sweeper.model.asset.joint(name).open for name in needs})
        sweep = sweeper.sweep(joint.name, others, SAMPLE_STATES)
        new = [
            interference
            for interference in sweep.interferences
            if (interference.one, interference.other) not in known and not sweeper.is_own(interference)
        ]
        bad = [interference for interference in new if not sweeper.authored(interference)]
        if bad:
            text = f"with the others at random: {_words(bad[0], joint)}{ONLY_SHAPES}"
            sweep = replace(sweep, interferences=tuple(bad))
            violation = Violation(joint=joint.name, others=others, sweep=sweep, authored=(), isolated=False)
            return _failed("joint_sweep_random", bad[0], text), violation
        redrawn += bool(new)
        done += not new
    again = f"; {redrawn} states in which authored parts meet were drawn again" if redrawn else ""
    text = f"goes through its whole range with the others at {done} random states{again}"
    check = _passed("joint_sweep_random", joint, text)
    if done:
        return check, None
    text = f"in all of {redrawn} random states of the others the authored parts themselves meet"
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


def _words(worst: Interference, joint: Joint) -> str:
    """What meets what, and where."""
    where = f"{worst.q[joint.name]:.3g} {'m' if joint.kind == 'slide' else 'rad'}"
    return (
        f"{worst.one} goes {1e3 * worst.excess_m:.1f} mm deeper into {worst.other} at {where} "
        "than at rest"
    )
