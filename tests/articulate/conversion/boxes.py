"""The smallest cabinet there is: two boxes and a slide, for tests that change one thing."""

from __future__ import annotations

from pathlib import Path

from articulate.assets.asset import Asset
from articulate.conversion import ConvertConfig, convert
from articulate.simulator import mujoco

TWO = """<?xml version="1.0"?>
<robot name="two">
  <link name="body">
    <visual><geometry><box size="0.4 0.4 0.4"/></geometry></visual>
  </link>
  <link name="drawer">
    <visual><geometry><box size="0.02 0.3 0.1"/></geometry></visual>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="body"/><child link="drawer"/>
    <origin xyz="-0.22 0 0"/><axis xyz="-1 0 0"/>
    <limit lower="0" upper="0.3"/>
  </joint>
</robot>
"""
"""A closed box whose front slides out along -x; without effort, velocity and inertia."""
LIMIT = '<limit lower="0" upper="0.3"/>'
AXIS = '<axis xyz="-1 0 0"/>'
BODY_BOX = '<box size="0.4 0.4 0.4"/>'


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    """The URDF with each first occurrence of the left text replaced by the right one."""
    text = TWO
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    folder.mkdir(exist_ok=True)
    path = folder / "two.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def made(folder: Path, *changes: tuple[str, str], config: ConvertConfig | None = None) -> Asset:
    """The asset of the changed URDF."""
    return convert(written(folder, *changes), folder / "out", config)


def loaded(asset: Asset) -> mujoco.MjModel:
    """The asset's MJCF as MuJoCo reads it."""
    return mujoco.MjModel.from_xml_path(str(asset.mjcf_path))


def repairs_text(asset: Asset) -> str:
    """All that was changed, a sentence a line."""
    return "\n".join(asset.repairs)
