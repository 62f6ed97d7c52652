"""Checks ``forward_kinematics`` and ``input_kinematics``: independent readers agree on poses.

The readers are yourdfpy and PyBullet on the canonical URDF, and yourdfpy or MuJoCo on the input
file. Each maps joint positions to link poses.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yourdfpy
from lxml import etree

from articulate.assets.asset import handle_frame
from articulate.assets.check_report import Check
from articulate.checks.model import Model, ObjectModel
from articulate.formats.read_source import format_of
from articulate.formats.reduce_mjcf import check_native, read_text
from articulate.simulator import mujoco
from articulate.suppress_output import suppress_output
from articulate.transforms import Array, inverse, normalised, pose, quat_to_matrix

STATES = 100
"""Random joint states that are compared."""
ALLOWED = 1e-6
"""Largest difference in position [m] and angle [rad]."""
NOTED_STATES = 5
"""Positions of each joint, from closed to open, in which asset.json is compared."""
JOINTS = ("joint", "freejoint")
"""Elements of an MJCF file that let a body move."""
BASE = -1
"""PyBullet's index of the root link."""

PoseReader = Callable[[Mapping[str, float]], dict[str, Array]]
"""From joint positions [m or rad] to poses (4, 4) of links, all in one frame."""


@dataclass(frozen=True, kw_only=True)
class InputFrame:
    """Scale and root frame that conversion applied to the input."""

    scale: float
    """Metres for one unit of the input."""
    T_os: Array
    """Pose of the input's root frame, already in metres, in the object frame (4, 4)."""


def check_forward_kinematics(model: ObjectModel) -> tuple[Check, ...]:
    """Compare the MJCF with yourdfpy and PyBullet on the URDF beside it, and with asset.json."""
    path = model.asset.folder / "object.urdf"
    checks = []
    for name, make in (("yourdfpy", yourdfpy_reader), ("PyBullet", bullet_reader)):
        try:
            checks.append(_compared(model, make(path), f"{name} on the canonical URDF"))
        except ModuleNotFoundError as error:
            message = f"not compared with {name}: {error.name} is not installed"
            checks.append(
                Check(name="forward_kinematics", outcome="not_applicable", message=message)
            )
        except Exception as error:  # noqa: BLE001  foreign readers raise anything
            message = f"{name} does not read the canonical URDF: {_line(error)}"
            checks.append(Check(name="forward_kinematics", outcome="failed", message=message))
    return (*checks, fk_noted(model))


def fk_noted(model: ObjectModel) -> Check:
    """Compare the MJCF with links, joints and handles of asset.json."""
    worst = 0.0
    wrong: list[tuple[str, str]] = []
    for link, what, error in _noted(model):
        worst = max(worst, error) if np.isfinite(error) else np.inf
        if not error <= ALLOWED:
            wrong.append((link, what))
    message = f"asset.json against MuJoCo: largest difference {worst:.2g} m or rad"
    if wrong:
        message += (
            f"; {len(wrong)} things lie elsewhere in object.xml, the first is {wrong[0][1]}: "
            "make both files agree"
        )
    return Check(
        name="forward_kinematics",
        outcome="failed" if wrong else "passed",
        subject=wrong[0][0] if wrong else "",
        measured=worst,
        allowed=ALLOWED,
        unit="m or rad",
        message=message,
    )


def _noted(model: ObjectModel) -> Iterator[tuple[str, str, float]]:
    """Link, words and difference [m or rad] of all that asset.json places.

    All joints but one are at 0 here, those that follow others as well: so asset.json means it.
    """
    asset = model.asset
    sites = {model.model.site(s).name: s for s in range(model.model.nsite)}
    data = model.data()
    _only(model, data, {})
    for link in asset.links:
        own = model.T_ol(data, link.name)
        stated = pose(link.pos_o, quat_to_matrix(link.quat_o))
        yield link.name, f"link {link.name} with its joints at 0", _difference(own, stated)
    for handle in asset.handles:
        if handle.name in sites:
            own = _site(model, data, sites[handle.name])
            stated = model.T_ol(data, handle.link) @ handle_frame(handle)
            yield handle.link, f"handle {handle.name}", _difference(own, stated)
    for joint in asset.joints:
        restrained_model = asset.handle_of(joint.name)
        for q in np.linspace(joint.closed, joint.open, NOTED_STATES):
            _only(model, data, {joint.name: float(q)})
            own = model.T_ol(data, joint.link)
            error = _difference(own, asset.T_ol(joint.name, q))
            yield joint.link, f"link {joint.link} with joint {joint.name} at {q:.3g}", error
            if restrained_model is not None and restrained_model.name in sites:
                own = _site(model, data, sites[restrained_model.name])
                error = _difference(own, asset.T_oh(joint.name, q))
                yield (
                    joint.link,
                    f"handle {restrained_model.name} with joint {joint.name} at {q:.3g}",
                    error,
                )


def _only(model: ObjectModel, data: Any, q: Mapping[str, float]) -> None:
    """Put the joints at ``q`` [m or rad] and all others at 0, wherever their leaders are."""
    for name in model.joints:
        data.qpos[model.qpos_address(name)] = q.get(name, 0.0)
    mujoco.mj_kinematics(model.model, data)


def _site(model: ObjectModel, data: Any, site: int) -> Array:
    """Pose (4, 4) of a site in the object frame."""
    root = model.bodies[model.root]
    T_wo = pose(data.xpos[root], data.xmat[root].reshape(3, 3))
    return inverse(T_wo) @ pose(data.site_xpos[site], data.site_xmat[site].reshape(3, 3))


def check_input_kinematics(
    model: ObjectModel, source: Path, frame: InputFrame
) -> tuple[Check, ...]:
    """Compare the MJCF with the input that it was made from, where it can be read as it is.

    Args:
        model: The asset.
        source: URDF or MJCF that went in.
        frame: Scale and root frame, which conversion may choose.
    """
    readers = {".xml": (("MuJoCo", mujoco_reader),)}.get(
        source.suffix.lower(), (("yourdfpy", yourdfpy_reader), ("MuJoCo", mujoco_reader))
    )
    for name, make in readers:
        try:
            reader = make(source)
        except Exception as error:  # noqa: BLE001  the input may be anything
            reason = f"{name}: {_line(error)}"
            continue
        return (_compared_input(model, reader, frame, f"{name} on the input"),)
    message = f"the input cannot be read as it is ({reason})"
    return (Check(name="input_kinematics", outcome="not_applicable", message=message),)


def yourdfpy_reader(path: Path) -> PoseReader:
    """Read a URDF with yourdfpy; poses are in the frame of its first root link."""
    with _quiet_log("yourdfpy"):
        robot = yourdfpy.URDF.load(str(path), load_meshes=False, load_collision_meshes=False)
    unknown = _below(robot.robot.joints, {"floating", "planar"})
    for joint in robot.robot.joints:
        # It multiplies positions with the axis of the file; the standard requires a unit vector.
        joint.axis = normalised(joint.axis)
    _follow_the_first(robot.robot.joints)
    _release_without_leader(robot.robot.joints)
    with _quiet_log("yourdfpy"):  # again, with the changed mimic joints
        robot = yourdfpy.URDF(robot.robot, load_meshes=False, load_collision_meshes=False)
    moving = set(robot.actuated_joint_names)
    restrained_model = {j.name: float(j.limit.lower) for j in robot.robot.joints if _is_held(j)}
    links = [link.name for link in robot.robot.links if link.name not in unknown]

    def poses(q: Mapping[str, float]) -> dict[str, Array]:
        q = {**restrained_model, **q}
        robot.update_cfg({name: float(q[name]) for name in moving if name in q})
        return {name: np.asarray(robot.get_transform(name)) for name in links}

    return poses


def _follow_the_first(joints: Sequence[Any]) -> None:
    """Resolve chains of mimic joints, which yourdfpy does not move."""
    mimics = {joint.name: joint.mimic for joint in joints if joint.mimic is not None}
    for mimic in mimics.values():
        seen = set()
        while mimic.joint in mimics and mimic.joint not in seen:
            seen.add(mimic.joint)
            further = mimics[mimic.joint]
            mimic.offset += mimic.multiplier * further.offset
            mimic.multiplier *= further.multiplier
            mimic.joint = further.joint


def _release_without_leader(joints: Sequence[Any]) -> None:
    """Make mimic joints independent whose leader does not move, as conversion does."""
    turning = {"revolute", "continuous", "prismatic"}
    leaders = {joint.name for joint in joints if joint.type in turning and not _is_held(joint)}
    for joint in joints:
        if joint.mimic is not None and joint.mimic.joint not in leaders:
            joint.mimic = None


def _is_held(joint: Any) -> bool:
    """Return whether a joint has a single position, which need not be 0."""
    bounded = joint.type in {"revolute", "prismatic"} and joint.limit is not None
    return bounded and joint.limit.lower is not None and joint.limit.lower == joint.limit.upper


def bullet_reader(path: Path) -> PoseReader:
    """Read a URDF with PyBullet; poses are in its world frame."""
    with suppress_output():
        import pybullet  # announces itself below Python

        client = pybullet.connect(pybullet.DIRECT)
        robot = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
        count = pybullet.getNumJoints(robot, physicsClientId=client)
        info = [pybullet.getJointInfo(robot, j, physicsClientId=client) for j in range(count)]
        base = pybullet.getBodyInfo(robot, physicsClientId=client)[0].decode()
    joints = {entry[1].decode(): j for j, entry in enumerate(info)}
    links = {entry[12].decode(): j for j, entry in enumerate(info)}

    def poses(q: Mapping[str, float]) -> dict[str, Array]:
        for name, j in joints.items():
            if name in q:
                pybullet.resetJointState(robot, j, float(q[name]), physicsClientId=client)
        options = {"computeForwardKinematics": True, "physicsClientId": client}
        states = pybullet.getLinkStates(robot, list(links.values()), **options) if links else ()
        found = {n: _bullet_pose(s[4], s[5]) for n, s in zip(links, states, strict=True)}
        centre = pybullet.getBasePositionAndOrientation(robot, physicsClientId=client)
        local = pybullet.getDynamicsInfo(robot, BASE, physicsClientId=client)[3:5]
        found[base] = _bullet_pose(*centre) @ inverse(_bullet_pose(*local))
        return found

    weakref.finalize(poses, pybullet.disconnect, physicsClientId=client)
    return poses


def mujoco_reader(path: Path) -> PoseReader:
    """Read a file with MuJoCo; poses are those of bodies, at their joints.

    The unit of angles, where the file names none, and names that it does not give are those that
    conversion found: the question is where things lie.
    """
    model, bodies, joints = _read(path)
    data = mujoco.MjData(model)
    names = {name: b for b, name in enumerate(bodies) if b > 0}
    addresses = {name: int(model.jnt_qposadr[j]) for j, name in enumerate(joints)}
    for e in range(model.neq):  # joints that are held in one position, which need not be 0
        fixed = int(model.eq_type[e]) == int(mujoco.mjtEq.mjEQ_JOINT) and model.eq_obj2id[e] < 0
        if fixed and model.eq_active0[e]:
            data.qpos[model.jnt_qposadr[model.eq_obj1id[e]]] += model.eq_data[e][0]
    # A URDF has the frame of a link on its joint, so that is where conversion puts it.
    T_bl = {n: pose(_anchor(model, b)) for n, b in names.items()}

    def poses(q: Mapping[str, float]) -> dict[str, Array]:
        for name, position in q.items():
            if name in addresses:
                data.qpos[addresses[name]] = position
        mujoco.mj_kinematics(model, data)
        return {
            n: pose(data.xpos[b], data.xmat[b].reshape(3, 3)) @ T_bl[n] for n, b in names.items()
        }

    return poses


def _read(path: Path) -> tuple[Model, list[str], list[str]]:
    """Compile a file and return the names of its bodies and joints."""
    if format_of(path) != "mjcf":
        model = mujoco.MjModel.from_xml_path(str(path))
        return model, *_own_names(model)
    check_native(path)
    known = etree.fromstring(read_text(path).text)
    spec = mujoco.MjSpec.from_file(str(path))
    if known.find("compiler").get("angle") == "radian":
        spec.compiler.degree = False
    model = spec.compile()
    return model, *(_names_in(known, model) or _own_names(model))


def _own_names(model: Model) -> tuple[list[str], list[str]]:
    """Return the names of bodies and joints; unnamed joints are named after their body."""
    bodies = [str(model.body(b).name) for b in range(model.nbody)]
    owners = [bodies[int(b)] for b in model.jnt_bodyid]
    joints = [str(model.joint(j).name or f"{owners[j]}_joint") for j in range(model.njnt)]
    return bodies, joints


def _names_in(known: Any, model: Model) -> tuple[list[str], list[str]] | None:
    """Return names of bodies and joints by their order in ``known``; None if the order differs.

    Args:
        known: Root element of what conversion read, where everything has a name.
        model: The same file as MuJoCo reads it.
    """
    elements = list(known.iter("body"))
    bodies = ["world", *(body.get("name") for body in elements)]
    own: dict[Any, list[str]] = {body: [] for body in elements}
    for joint in known.iter(*JOINTS):
        owner = next(joint.iterancestors("body"), None)
        if owner is not None:  # in defaults and equalities there is none
            own[owner].append(joint.get("name") or "")
    joints = [name for body in elements for name in own[body]]
    places = [b for b, body in enumerate(elements, 1) for _ in own[body]]
    if len(bodies) != model.nbody or places != model.jnt_bodyid.tolist():
        return None
    names = [str(model.body(b).name) for b in range(model.nbody)]
    same = all(own in {"", name} for own, name in zip(names, bodies, strict=True))
    return (bodies, joints) if same else None


def _anchor(model: Model, body: int) -> Array:
    """Return the position (3,) of the last hinge of ``body`` in its frame [m]; 0 without one."""
    first = int(model.body_jntadr[body])
    joints = range(first, first + int(model.body_jntnum[body]))
    hinges = [j for j in joints if int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_HINGE)]
    return np.array(model.jnt_pos[hinges[-1]]) if hinges else np.zeros(3)


def _compared(model: ObjectModel, reader: PoseReader, who: str) -> Check:
    """Run the check ``forward_kinematics`` against one reader of the canonical URDF."""
    names = [link.name for link in model.asset.links]
    error = np.zeros((0, len(names)))
    for q, own in _states(model):
        theirs = reader(q)
        lost = [name for name in names if name not in theirs]
        if lost:
            message = f"{who} knows no link {', '.join(lost[:3])}"
            return Check(
                name="forward_kinematics", outcome="failed", subject=lost[0], message=message
            )
        T_root = inverse(theirs[model.root])
        row = [_difference(own[n], T_root @ theirs[n]) for n in names]
        error = np.vstack([error, row])
    return _check_of("forward_kinematics", model, names, error, who)


def _compared_input(model: ObjectModel, reader: PoseReader, frame: InputFrame, who: str) -> Check:
    """Run the check ``input_kinematics``; positions of slides and links are scaled first."""
    unit = {j.name: frame.scale if j.kind == "slide" else 1.0 for j in model.asset.joints}
    known = reader({})
    names = [x.name for x in model.asset.links if x.parent is not None and x.name in known]
    if not names:
        message = f"{who}: no moving link has kept its name"
        return Check(name="input_kinematics", outcome="not_applicable", message=message)
    error = np.zeros((0, len(names)))
    for q, own in _states(model):
        theirs = reader({name: value / unit.get(name, 1.0) for name, value in q.items()})
        row = []
        for name in names:
            T_sl = np.array(theirs[name])
            T_sl[:3, 3] *= frame.scale
            row.append(_difference(own[name], frame.T_os @ T_sl))
        error = np.vstack([error, row])
    who = f"{who}, {len(names)} of {len(model.asset.links) - 1} moving links"
    return _check_of("input_kinematics", model, names, error, who)


def _states(model: ObjectModel) -> Iterator[tuple[dict[str, float], dict[str, Array]]]:
    """Yield random joint positions with link poses of the MJCF; one state if nothing moves."""
    rng = np.random.default_rng(0)
    data = model.data()
    for _ in range(STATES if model.asset.joints else 1):
        q = model.random_joints(rng)
        model.set_joints(data, q)
        yield q, {link.name: model.T_ol(data, link.name) for link in model.asset.links}


def _difference(one: Array, other: Array) -> float:
    """Return the larger of the distance [m] and the angle [rad] between two poses (4, 4)."""
    distance = float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
    chord = float(np.linalg.norm(one[:3, :3] - other[:3, :3])) / np.sqrt(8.0)
    return float(np.maximum(distance, 2.0 * np.arcsin(np.minimum(chord, 1.0))))  # NaN stays NaN


def _check_of(name: str, model: ObjectModel, names: list[str], error: Array, who: str) -> Check:
    """Make a check of ``error`` (states, links) [m or rad]; it names the first deviating link."""
    worst = error.max(axis=0, initial=0.0)
    largest = float(worst.max(initial=0.0))
    states = f"{len(error)} joint states against {who}"
    wrong = [link for link, value in zip(names, worst, strict=True) if not value <= ALLOWED]
    message = f"{states}: largest difference {largest:.2g} m or rad"
    if wrong:
        joint = next((j.name for j in model.asset.joints if j.link == wrong[0]), "the root")
        message += (
            f"; {len(wrong)} links deviate, the first is {wrong[0]}, moved by {joint}: "
            "compare its origin, axis and limits with the input"
        )
    return Check(
        name=name,
        outcome="failed" if wrong else "passed",
        subject=wrong[0] if wrong else "",
        measured=largest,
        allowed=ALLOWED,
        unit="m or rad",
        message=message,
    )


def _below(joints: Sequence[Any], kinds: set[str]) -> set[str]:
    """Return all descendants of joints of ``kinds``."""
    found = {j.child for j in joints if j.type in kinds}
    while True:
        further = {j.child for j in joints if j.parent in found} - found
        if not further:
            return found
        found |= further


def _bullet_pose(pos: Sequence[float], quat_xyzw: Sequence[float]) -> Array:
    return pose(np.array(pos), quat_to_matrix(np.roll(np.array(quat_xyzw), 1)))


def _line(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


@contextmanager
def _quiet_log(name: str) -> Iterator[None]:
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)
