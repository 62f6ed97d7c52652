"""A small object that tests can read: a body with a drawer, a door with a knob, and a frozen flap.

In the frame of the URDF the front is -x, as in PartNet-Mobility.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

from articulate.benchmark.dataset import IndexDataset
from articulate.benchmark.truth import TrueJoint, TrueObject
from articulate.reconstruct.actors.protocol import ActorAttempt, Evidence, Prediction, Verdict
from articulate.transforms import pose

BOX = '<visual><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></visual>'
LINKS = {
    "link_0": ("0 0 1.0", "1.0 1.2 1.0"),
    "link_1": ("-0.1 0 0.9", "0.6 1.0 0.3"),
    "link_2": ("0 -0.3 0", "0.05 0.6 0.5"),
    "link_3": ("-0.06 -0.5 0", "0.08 0.06 0.06"),
    "link_4": ("0 0 0.15", "0.04 0.4 0.3"),
}
JOINTS = """
<joint name="up" type="fixed"><parent link="base"/><child link="link_0"/>
  <origin xyz="0 0 0"/></joint>
<joint name="j1" type="prismatic"><parent link="link_0"/><child link="link_1"/>
  <origin xyz="-0.6 0 0.3"/><axis xyz="-1 0 0"/><limit lower="0" upper="0.5"/></joint>
<joint name="j2" type="revolute"><parent link="link_0"/><child link="link_2"/>
  <origin xyz="-0.55 0.6 0.8"/><axis xyz="0 0 1"/><limit lower="-1.4" upper="0"/></joint>
<joint name="j3" type="continuous"><parent link="link_2"/><child link="link_3"/>
  <origin xyz="0 0 0"/><axis xyz="1 0 0"/></joint>
<joint name="j4" type="fixed"><parent link="link_0"/><child link="link_4"/>
  <origin xyz="0.55 0 0.6"/></joint>
"""
SEMANTICS = """link_0 heavy cabinet_body
link_1 slider translation_drawer
link_2 hinge rotation_door
link_3 hinge knob
link_4 hinge flap_2
"""
TRUTH = [
    {
        "link": "link_1",
        "type": "prismatic",
        "axis": [-1, 0, 0],
        "origin": [-0.6, 0, 0.3],
        "lower": 0.0,
        "upper": 0.5,
        "status": "agrees",
    },
    {
        "link": "link_2",
        "type": "revolute",
        "axis": [0, 0, 1],
        "origin": [-0.55, 0.6, 0.8],
        "lower": -1.4,
        "upper": 0.0,
        "status": "agrees",
    },
    {
        "link": "link_3",
        "type": "continuous",
        "axis": [1, 0, 0],
        "origin": [-0.55, 0.1, 0.8],
        "lower": None,
        "upper": None,
        "status": "agrees",
    },
    {
        "link": "link_4",
        "type": "revolute",
        "axis": [0, 1, 0],
        "origin": [0.55, 0.0, 0.6],
        "lower": 0.0,
        "upper": 1.0,
        "status": "frozen",
    },
]


def write_index(folder: Path, names: tuple[str, ...] = ("cupboard_77",)) -> Path:
    """Write objects that are alike, and the index that states their joints."""
    entries = []
    for name in names:
        home = folder / "objects" / name
        home.mkdir(parents=True)
        links = [
            f'<link name="{link}">{BOX.format(xyz=xyz, size=size)}</link>'
            for link, (xyz, size) in LINKS.items()
        ]
        text = f'<robot name="r"><link name="base"/>{"".join(links)}{JOINTS}</robot>'
        (home / "mobility.urdf").write_text(text)
        (home / "semantics.txt").write_text(SEMANTICS)
        entries.append(
            {
                "id": name,
                "path": f"objects/{name}/mobility.urdf",
                "category": "StorageFurniture",
                "truth": "mobility_v2",
                "truth_joints": TRUTH,
            }
        )
    entries.append({"id": "other", "path": "nowhere.urdf", "truth": "mobility_v2_disagrees"})
    path = folder / "assets.json"
    path.write_text(json.dumps({"assets": entries}))
    return path


def cupboard(folder: Path) -> TrueObject:
    """The object, read."""
    path = write_index(folder)
    return IndexDataset(path, folder).load("cupboard_77")


@dataclass(frozen=True)
class Oracle:
    """An actor that knows the truth; parts are told by their size."""

    subject: TrueObject
    name: str = "oracle"

    def names(self, evidence: Evidence) -> dict[str, str]:
        """Neutral name of each part, by its true one."""
        out = {}
        for true in self.subject.parts:
            for part in evidence.parts:
                if len(part.vertices) == len(true.vertices):
                    moved = part.vertices - part.centre - (true.vertices - true.centre)
                    if abs(moved).max() < 1e-9:
                        out[true.name] = part.name
        return out

    def said(self, evidence: Evidence, joint: TrueJoint):
        """The true joint in neutral names."""
        names = self.names(evidence)
        return replace(joint.joint, part=names[joint.joint.part], parent=None)

    def predict(self, evidence: Evidence) -> Prediction:
        """The truth."""
        joints = tuple(self.said(evidence, joint) for joint in self.subject.joints)
        names = self.names(evidence)
        placements = {names[p.name]: pose(p.centre) for p in self.subject.parts}
        return Prediction(joints=joints, placements={} if evidence.placed else placements)


def attempt(joints, rating: float) -> ActorAttempt:
    """A turn of the loop."""
    return ActorAttempt(joints=tuple(joints), verdict=Verdict(failure="joint_axis", rating=rating))
