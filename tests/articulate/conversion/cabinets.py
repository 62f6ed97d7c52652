"""Small cabinets written by the tests, as people write URDFs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh


def box(size: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    """A box with full sides ``size`` round ``at`` [m]."""
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))


def tray() -> trimesh.Trimesh:
    """A drawer 0.36 deep, 0.40 wide, 0.12 high, open above, its front at x = 0, in one file."""
    return trimesh.util.concatenate(
        [
            box((0.016, 0.40, 0.14), (0.008, 0.0, 0.07)),
            box((0.34, 0.38, 0.01), (0.18, 0.0, 0.015)),
            box((0.34, 0.01, 0.10), (0.18, 0.185, 0.06)),
            box((0.34, 0.01, 0.10), (0.18, -0.185, 0.06)),
            box((0.01, 0.38, 0.10), (0.345, 0.0, 0.06)),
        ]
    )


def bar() -> trimesh.Trimesh:
    """A bar handle in front of the drawer, 12 mm thick, 30 mm clear behind it."""
    return trimesh.util.concatenate(
        [
            box((0.012, 0.14, 0.012), (-0.036, 0.0, 0.08)),
            box((0.030, 0.012, 0.012), (-0.015, 0.06, 0.08)),
            box((0.030, 0.012, 0.012), (-0.015, -0.06, 0.08)),
        ]
    )


def carcass() -> trimesh.Trimesh:
    """An open box 0.4 deep, 0.45 wide, 0.5 high, front at x = 0.016."""
    return trimesh.util.concatenate(
        [
            box((0.4, 0.016, 0.5), (0.216, 0.217, 0.25)),
            box((0.4, 0.016, 0.5), (0.216, -0.217, 0.25)),
            box((0.4, 0.418, 0.016), (0.216, 0.0, 0.492)),
            box((0.4, 0.418, 0.016), (0.216, 0.0, 0.008)),
            box((0.016, 0.418, 0.468), (0.408, 0.0, 0.25)),
        ]
    )


def door() -> trimesh.Trimesh:
    """A door leaf in its own frame: hinge on z through the origin, leaf towards -y."""
    return box((0.016, 0.41, 0.26), (-0.008, -0.205, 0.0))


def knob() -> trimesh.Trimesh:
    """A round knob near the free edge of the door, in front of it."""
    mesh = trimesh.creation.cylinder(radius=0.014, height=0.03, sections=24)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    mesh.apply_translation((-0.031, -0.37, 0.05))
    return mesh


CABINET = """<?xml version="1.0"?>
<robot name="little">
  <link name="body">
    <visual><geometry><mesh filename="package://little/meshes/body.obj"/></geometry></visual>
    <collision><geometry><mesh filename="package://little/meshes/body.obj"/></geometry></collision>
  </link>
  <link name="drawer">
    <visual><geometry><mesh filename="package://little/meshes/tray.stl"/></geometry></visual>
  </link>
  <link name="drawer_handle">
    <visual><geometry><mesh filename="package://little/meshes/bar.ply"/></geometry></visual>
  </link>
  <link name="door">
    <visual><geometry><mesh filename="package://little/meshes/door.glb"/></geometry></visual>
    <visual name="knob"><geometry><mesh filename="meshes/knob.obj"/></geometry></visual>
  </link>
  <joint name="drawer_joint" type="prismatic">
    <parent link="body"/><child link="drawer"/>
    <origin xyz="0 0 0.33"/><axis xyz="-1 0 0"/>
    <limit lower="0" upper="0.3" effort="10" velocity="1"/>
  </joint>
  <joint name="fix" type="fixed"><parent link="drawer"/><child link="drawer_handle"/></joint>
  <joint name="door_joint" type="revolute">
    <parent link="body"/><child link="door"/>
    <origin xyz="0.016 0.205 0.17"/><axis xyz="0 0 1"/>
    <limit lower="-1.6" upper="0" effort="10" velocity="1"/>
  </joint>
</robot>
"""
"""A carcass with a drawer above and a door below; the front looks along -x."""


def write_cabinet(folder: Path, urdf: str = CABINET) -> Path:
    """The cabinet in ``folder/little``; returns the path of its URDF."""
    folder = folder / "little"
    (folder / "meshes").mkdir(parents=True)
    for name, mesh in {
        "body.obj": carcass(),
        "tray.stl": tray(),
        "bar.ply": bar(),
        "door.glb": door(),
        "knob.obj": knob(),
    }.items():
        mesh.export(folder / "meshes" / name)
    path = folder / "little.urdf"
    path.write_text(urdf)
    return path
