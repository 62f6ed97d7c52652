"""A cupboard of boxes for tests of the studio."""

from __future__ import annotations

from pathlib import Path

URDF = """<robot name="cupboard">
  <link name="body">
    <visual><origin xyz="0 0 0.4"/><geometry><box size="0.4 0.6 0.8"/></geometry></visual>
    <collision><origin xyz="0 0 0.4"/><geometry><box size="0.4 0.6 0.8"/></geometry></collision>
  </link>
  <link name="door">
    <inertial><origin xyz="0 -0.3 0.4"/><mass value="5"/><inertia ixx="0.416833" ixy="0" ixz="0"
      iyy="0.266833" iyz="0" izz="0.150167"/></inertial>
    <visual name="panel"><origin xyz="0 -0.3 0.4"/>
      <geometry><box size="0.02 0.6 0.8"/></geometry></visual>
    <visual name="knob"><origin xyz="-0.03 -0.55 0.4"/>
      <geometry><box size="0.04 0.02 0.02"/></geometry></visual>
    <collision><origin xyz="0 -0.3 0.4"/><geometry><box size="0.02 0.6 0.8"/></geometry></collision>
    <collision><origin xyz="-0.03 -0.55 0.4"/>
      <geometry><box size="0.04 0.02 0.02"/></geometry></collision>
  </link>
  <joint name="hinge" type="revolute">
    <origin xyz="-0.21 0.3 0"/><parent link="body"/><child link="door"/>
    <axis xyz="0 0 -1"/><limit lower="0" upper="1.5" effort="10" velocity="2"/>
  </joint>
</robot>
"""


def write_cupboard(folder: Path) -> Path:
    """Write the cupboard; its door is at x = -0.22 to -0.2 and hinged at y = 0.3."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "cupboard.urdf"
    path.write_text(URDF, encoding="utf-8")
    return path
