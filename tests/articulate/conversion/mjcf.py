"""Little MJCF objects, and how MuJoCo itself moves them, for tests of the reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from articulate.assets.asset import Asset
from articulate.formats.read_mjcf import read_mjcf
from articulate.formats.source_object import SourceJoint, SourceObject
from articulate.simulator import mujoco
from articulate.transforms import Array, pose

DRAWER = """<mujoco model="little">
  <compiler angle="radian"/>
  <default>
    <geom density="400"/>
    <default class="runner"><joint type="slide" axis="-1 0 0" range="0 0.3" damping="7"/></default>
  </default>
  <worldbody>
    <body name="carcass">
      <geom type="box" size="0.2 0.25 0.01" pos="0 0 0.01"/>
      <geom type="box" size="0.2 0.25 0.01" pos="0 0 0.39"/>
      <geom type="box" size="0.01 0.25 0.18" pos="0.19 0 0.2"/>
      <body name="drawer" pos="-0.19 0 0.2" childclass="runner">
        <joint name="slide" frictionloss="3" armature="0.2"/>
        <geom type="box" size="0.01 0.24 0.15"/>
        <geom type="box" size="0.16 0.2 0.01" pos="0.17 0 -0.1"/>
        <geom type="capsule" fromto="-0.05 -0.06 0 -0.05 0.06 0" size="0.008"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""


def model(body: str, *, head: str = "", compiler: str = 'angle="radian"') -> str:
    """An MJCF text around the content of its world."""
    return (
        f'<mujoco model="thing"><compiler {compiler}/>{head}<worldbody>{body}</worldbody></mujoco>'
    )


def moving(inside: str, *, joint: str = '<joint name="j"/>') -> str:
    """A fixed box with one moving body that holds ``inside``."""
    return (
        '<body name="base"><geom type="box" size=".1 .1 .1"/>'
        f'<body name="part" pos="0.2 0 0.3">{joint}{inside}</body></body>'
    )


BALL = '<geom type="sphere" size="0.05"/>'


def write(folder: Path, text: str, name: str = "thing.xml") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def read(folder: Path, text: str) -> SourceObject:
    return read_mjcf(write(folder, text))


def joint_of(source: SourceObject, name: str) -> SourceJoint:
    return next(joint for joint in source.joints if joint.name == name)


def has_message(source: SourceObject, words: str) -> bool:
    return any(words in message for message in source.repairs.messages)


def anchors(raw: mujoco.MjModel) -> dict[str, Array]:
    """Point of each body that its last hinge turns about, in its own frame."""
    out = {raw.body(b).name: np.zeros(3) for b in range(raw.nbody)}
    for j in range(raw.njnt):
        if int(raw.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_HINGE):
            out[raw.body(int(raw.jnt_bodyid[j])).name] = raw.jnt_pos[j]
    return out


def raw_poses(raw: mujoco.MjModel, q: dict[str, float]) -> dict[str, Array]:
    """Pose of each body in the world, moved to the point that it turns about."""
    data = mujoco.MjData(raw)
    for name, value in q.items():
        data.qpos[raw.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(raw, data)
    shift = anchors(raw)
    bodies = range(1, raw.nbody)
    named = {raw.body(b).name: b for b in bodies}
    return {
        name: pose(data.xpos[b], data.xmat[b].reshape(3, 3)) @ pose(shift[name])
        for name, b in named.items()
    }


def written_poses(asset: Asset, q: dict[str, float]) -> dict[str, Array]:
    """Pose of each link by the ``object.xml`` that was written."""
    made = mujoco.MjModel.from_xml_path(str(asset.folder / "object.xml"))
    data = mujoco.MjData(made)
    for name, value in q.items():
        data.qpos[made.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(made, data)
    out = {}
    for link in asset.links:
        b = made.body(link.name).id
        out[link.name] = pose(data.xpos[b], data.xmat[b].reshape(3, 3))
    return out


def states(source: SourceObject, count: int) -> list[dict[str, float]]:
    """Random joint states within the limits."""
    rng = np.random.default_rng(7)
    out = []
    for _ in range(count):
        q = {}
        for joint in source.joints:
            if joint.kind != "fixed":
                low = -1.0 if joint.lower is None else joint.lower
                high = 1.0 if joint.upper is None else joint.upper
                q[joint.name] = float(rng.uniform(low, high))
        out.append(q)
    return out
