"""Mutated URDFs and meshes for the fuzzing of check-asset and its tests.

A mutant is plain data: numbers that select elements of a small object. A random number generator
can sample it, and hypothesis can shrink it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from lxml import etree

SEED = b"""<?xml version="1.0"?>
<robot name="seed">
  <material name="blue"><color rgba="0 0 0.8 1"/></material>
  <link name="body">
    <inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="8"/>
      <inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/></inertial>
    <visual><geometry><box size="0.4 0.4 0.4"/></geometry><material name="blue"/></visual>
    <collision><geometry><cylinder radius="0.2" length="0.4"/></geometry></collision>
  </link>
  <link name="drawer">
    <visual name="front"><origin xyz="0 0 0"/>
      <geometry><mesh filename="package://seed/meshes/tray.obj" scale="1 1 1"/></geometry></visual>
    <visual><geometry><box size="0.02 0.3 0.1"/></geometry></visual>
  </link>
  <link name="knob"><visual><geometry><sphere radius="0.02"/></geometry></visual></link>
  <link name="lid"><visual><origin xyz="-0.2 0 0"/>
    <geometry><box size="0.4 0.4 0.02"/></geometry></visual></link>
  <joint name="slide" type="prismatic">
    <parent link="body"/><child link="drawer"/><origin xyz="-0.22 0 0" rpy="0 0 0"/>
    <axis xyz="-1 0 0"/><limit lower="0" upper="0.3" effort="10" velocity="1"/>
    <dynamics damping="1" friction="0.1"/>
  </joint>
  <joint name="hold" type="fixed"><parent link="drawer"/><child link="knob"/></joint>
  <joint name="turn" type="revolute">
    <parent link="body"/><child link="lid"/><origin xyz="0.2 0 0.215"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1.5"/><mimic joint="slide" multiplier="2" offset="0"/>
  </joint>
</robot>
"""
TEXTS = (
    "", " ", "0", "-1", "1", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e30", "1e5",
    "1e-9", "0 0 0", "1 1 1", "-1 2 0.5", "nan 0 0", "1e308 1e308 1e308", "1e-200 0 0", "0,1,0",
    "1 2", "1 2 3 4", "0x10", "1_0", "abc", "${x}", "$(find y)", "99999999999999999999999",
    "\u0664", "body", "drawer", "lid", "knob", "slide", "turn", "hold", "world", "blue", "fixed",
    "floating", "planar", "screw", "spherical", "continuous", "revolute", "prismatic",
    "../../../../etc/passwd", "/etc/passwd", "/", "package://", "package:///",
    "package://seed/meshes/", "file:///dev/zero", "meshes/TRAY.OBJ", "meshes\\tray.obj",
    "C:\\tray.obj", "meshes/tray.stl", "meshes/tray.dae", "meshes", "x" * 5000, "a/../b",
    "<&>\"'", "\u202etxt", "\x7f", "handle",
)  # fmt: skip
TAGS = ("link", "joint", "origin", "mesh", "box", "cylinder", "sphere", "capsule", "plane", "axis",
        "limit", "mimic", "inertial", "mass", "material", "texture", "visual", "collision",
        "geometry", "robot", "x:y")  # fmt: skip
KEYS = ("name", "type", "link", "xyz", "rpy", "size", "radius", "length", "filename", "scale",
        "lower", "upper", "value", "joint", "pitch", "rgba")  # fmt: skip
SNIPPETS = (
    b'<!DOCTYPE r [<!ENTITY a "b">]>', b"&a;", b"&#0;", b"&#x41;", b"<![CDATA[x]]>", b"<?pi x?>",
    b"<!-- -- -->", b'<?xml version="1.0" encoding="utf-16"?>', b"\0", b"\xff\xfe", b"<a:b/>",
    b"</robot>", b"</link>", b"<link/>", b"\xf0\x9f\x97\x84", b"<xi:include href='/etc/passwd'/>",
)  # fmt: skip
ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "cp037")
MESHES = (".obj", ".stl", ".ply", ".glb", ".dae", ".off")
TREE_KINDS = ("set", "set", "set", "tag", "key", "drop", "twice", "move")
"""Changes of an element; values are changed most often."""
BYTE_KINDS = ("cut", "flip", "insert", "remove")
MOST = 10_000
"""Places and choices are numbers up to this one, taken modulo what is there."""


@dataclass(frozen=True)
class Mutant:
    """Changes of the seed, by numbers that select places in it."""

    tree: tuple[tuple[str, int, int, int], ...]
    text: tuple[tuple[str, int, int], ...]
    encoding: str | None
    suffix: str
    mesh: tuple[tuple[str, int, int], ...]


def tray_bytes() -> dict[str, bytes]:
    """Return a tray of three plates in every format."""
    plates = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        for size, at in (
            ((0.02, 0.3, 0.1), (0.0, 0.0, 0.0)),
            ((0.3, 0.3, 0.01), (0.15, 0.0, -0.04)),
            ((0.3, 0.01, 0.1), (0.15, 0.14, 0.0)),
        )
    ]
    tray = trimesh.util.concatenate(plates)
    found = {suffix: tray.export(file_type=suffix[1:]) for suffix in MESHES}
    return {k: v.encode() if isinstance(v, str) else v for k, v in found.items()}


TRAYS = tray_bytes()


def changed_tree(content: bytes, changes: tuple[tuple[str, int, int, int], ...]) -> bytes:
    """Change elements and attributes of the document."""
    root = etree.fromstring(content)
    for kind, where, which, what in changes:
        elements = list(root.iter("*"))
        element = elements[where % len(elements)]
        parent = element.getparent()
        keys = sorted(element.attrib)
        if kind == "tag":
            element.tag = TAGS[what % len(TAGS)].replace(":", "_")
        elif kind == "set" and keys:
            value = TEXTS[what % len(TEXTS)]
            element.set(keys[which % len(keys)], "".join(c for c in value if c >= " "))
        elif kind == "key" and keys:
            value = element.attrib.pop(keys[which % len(keys)])
            element.set(KEYS[what % len(KEYS)], value)
        elif kind == "drop" and parent is not None:
            parent.remove(element)
        elif kind == "twice" and parent is not None:
            parent.append(etree.fromstring(etree.tostring(element)))
        elif kind == "move" and parent is not None:
            other = elements[what % len(elements)]
            if element not in other.iterancestors() and other is not element:
                other.append(element)
    return b'<?xml version="1.0"?>\n' + bytes(etree.tostring(root))


def changed_bytes(content: bytes, changes: tuple[tuple[str, int, int], ...]) -> bytes:
    """Change bytes of the file."""
    for kind, where, what in changes:
        at = where % (len(content) + 1)
        if kind == "cut":
            content = content[:at]
        elif kind == "flip" and content:
            at = min(at, len(content) - 1)
            content = content[:at] + bytes([what % 256]) + content[at + 1 :]
        elif kind == "insert":
            content = content[:at] + SNIPPETS[what % len(SNIPPETS)] + content[at:]
        elif kind == "remove":
            content = content[:at] + content[at + what % 40 :]
    return content


def write_mutant(mutant: Mutant, folder: Path) -> Path:
    """Write the mutant below ``folder`` and return the path of its URDF."""
    content = SEED.replace(b"tray.obj", b"tray" + mutant.suffix.encode())
    content = changed_bytes(changed_tree(content, mutant.tree), mutant.text)
    if mutant.encoding is not None:
        content = content.decode("utf-8", "replace").encode(mutant.encoding, "replace")
    mesh = changed_bytes(TRAYS[mutant.suffix], mutant.mesh)
    (folder / "seed" / "meshes").mkdir(parents=True)
    (folder / "seed" / "meshes" / f"tray{mutant.suffix}").write_bytes(mesh)
    path = folder / "seed" / "seed.urdf"
    path.write_bytes(content)
    return path


def sample_mutant(rng: np.random.Generator) -> Mutant:
    """Sample a mutant.

    Up to three changes of the tree; in a fifth of all some of the text, in a half some of the mesh.
    """

    def numbers(count: int) -> tuple[int, ...]:
        return tuple(int(x) for x in rng.integers(0, MOST + 1, count))

    def tree() -> tuple[str, int, int, int]:
        where, which, what = numbers(3)
        return str(rng.choice(TREE_KINDS)), where, which, what

    def some_bytes() -> tuple[str, int, int]:
        where, what = numbers(2)
        return str(rng.choice(BYTE_KINDS)), where, what

    return Mutant(
        tree=tuple(tree() for _ in range(rng.integers(0, 4))),
        text=tuple(some_bytes() for _ in range(rng.integers(1, 3) if rng.random() < 0.2 else 0)),
        encoding=str(rng.choice(ENCODINGS)) if rng.random() < 0.1 else None,
        suffix=str(rng.choice(MESHES)),
        mesh=tuple(some_bytes() for _ in range(rng.integers(1, 4) if rng.random() < 0.5 else 0)),
    )
