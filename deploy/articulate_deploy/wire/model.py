"""Models of the arm that clients request: a shared library (protocol 5), a URDF (protocol 10)."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from articulate.robot.kinematics import DH, FLANGE_Z_M
from articulate_deploy.wire.limits import FR3_LIMITS
from articulate_deploy.wire.physics import INERTIA

SOURCE = Path(__file__).with_name("model.c")
"""Source of the shared library."""
COMPILERS = ("cc", "gcc", "clang")
"""Names of C compilers, the first that exists is used."""
_LINK_MASS_KG = 2.0
"""Mass of every link in the URDF [kg]; clients use it for their own model only."""


@cache
def model_library() -> bytes | None:
    """Return the shared library for Linux on x64, compiled once; None without a C compiler."""
    compiler = next((path for name in COMPILERS if (path := shutil.which(name))), None)
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "model.so"
        command = [compiler, "-shared", "-fPIC", "-O2", "-o", str(out), str(SOURCE), "-lm"]
        done = subprocess.run(command, capture_output=True, check=False)
        return out.read_bytes() if done.returncode == 0 else None


def robot_urdf() -> str:
    """Return the URDF of the simulated FR3, without meshes."""
    e, limits = FR3_LIMITS.envelope, FR3_LIMITS
    assert e is not None
    lines = ['<?xml version="1.0"?>', '<robot name="fr3">', _link(0)]
    for i, (a, d, alpha) in enumerate(DH):
        xyz = f"{a:.6g} {-np.sin(alpha) * d:.6g} {np.cos(alpha) * d:.6g}"
        lines += [
            f'  <joint name="fr3_joint{i + 1}" type="revolute">',
            f'    <parent link="link{i}"/>',
            f'    <child link="link{i + 1}"/>',
            f'    <origin rpy="{alpha:.12g} 0 0" xyz="{xyz}"/>',
            '    <axis xyz="0 0 1"/>',
            f'    <limit effort="{limits.tau_max[i]:g}" velocity="{limits.dq_max[i]:g}" '
            f'lower="{e.q_low[i]:g}" upper="{e.q_high[i]:g}"/>',
            f'    <position_based_velocity_limits velocity_offset="{e.offset[i]:g}" '
            f'deceleration_limit="{e.deceleration[i]:g}"/>',
            "  </joint>",
            _link(i + 1),
        ]
    lines += [
        '  <joint name="fr3_flange" type="fixed">',
        '    <parent link="link7"/>',
        '    <child link="link8"/>',
        f'    <origin rpy="0 0 0" xyz="0 0 {FLANGE_Z_M:g}"/>',
        "  </joint>",
        '  <link name="link8"/>',
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _link(i: int) -> str:
    inertia = INERTIA[max(i - 1, 0)] * 0.01
    return (
        f'  <link name="link{i}">\n    <inertial>\n'
        '      <origin rpy="0 0 0" xyz="0 0 0"/>\n'
        f'      <mass value="{_LINK_MASS_KG:g}"/>\n'
        f'      <inertia ixx="{inertia:.6g}" ixy="0" ixz="0" iyy="{inertia:.6g}" iyz="0" '
        f'izz="{inertia:.6g}"/>\n    </inertial>\n  </link>'
    )
