"""Mutated URDFs and meshes: an asset or one line, never a traceback, nothing elsewhere."""

from __future__ import annotations

import math
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st
from lxml import etree

from articulate.asset import load_asset
from articulate.convert import ConvertConfig, convert
from articulate.errors import ArticulateError

TIME_S = 60
"""Longest time of one conversion [s]."""
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
  <link name="lid"><visual><geometry><box size="0.4 0.4 0.02"/></geometry></visual></link>
  <joint name="slide" type="prismatic">
    <parent link="body"/><child link="drawer"/><origin xyz="-0.22 0 0" rpy="0 0 0"/>
    <axis xyz="-1 0 0"/><limit lower="0" upper="0.3" effort="10" velocity="1"/>
    <dynamics damping="1" friction="0.1"/>
  </joint>
  <joint name="hold" type="fixed"><parent link="drawer"/><child link="knob"/></joint>
  <joint name="turn" type="revolute">
    <parent link="body"/><child link="lid"/><origin xyz="0 0 0.21"/><axis xyz="0 1 0"/>
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

NUMBER = st.integers(0, 10_000)
TREE = st.tuples(
    st.sampled_from(["set", "set", "set", "tag", "key", "drop", "twice", "move"]),
    NUMBER,
    NUMBER,
    NUMBER,
)
BYTES = st.tuples(st.sampled_from(["cut", "flip", "insert", "remove"]), NUMBER, NUMBER)


@dataclass(frozen=True)
class Mutant:
    """What is done to the seed, by numbers that name places in it."""

    tree: tuple[tuple[str, int, int, int], ...]
    text: tuple[tuple[str, int, int], ...]
    encoding: str | None
    suffix: str
    mesh: tuple[tuple[str, int, int], ...]


MUTANTS = st.builds(
    Mutant,
    tree=st.lists(TREE, max_size=4).map(tuple),
    text=st.one_of(st.just(()), st.lists(BYTES, max_size=2).map(tuple)),
    encoding=st.one_of(st.none(), st.none(), st.none(), st.sampled_from(ENCODINGS)),
    suffix=st.sampled_from(MESHES),
    mesh=st.one_of(st.just(()), st.lists(BYTES, max_size=3).map(tuple)),
)


def tray_bytes() -> dict[str, bytes]:
    """A tray of three plates in every format."""
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


@contextmanager
def at_most(seconds: int) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def everything_in(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*")}


def check(mutant: Mutant) -> None:
    """Convert one mutant; anything but an asset or an error of ours fails."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name)
        path = write_mutant(mutant, folder)
        before = everything_in(folder)
        out = folder / "made" / "out"
        config = ConvertConfig(decompose=False)
        try:
            with at_most(TIME_S):
                asset = convert(path, out, config)
        except ArticulateError as error:
            line = str(error)
        else:
            line = ""
        if line:
            event("refused")
            assert "\n" not in line
            assert len(line) < 8000
            assert everything_in(folder) - before <= {"made"}
            return
        event("converted")
        assert {p.split("/")[0] for p in everything_in(folder) - before} == {"made"}
        assert [p.name for p in (folder / "made").iterdir()] == ["out"]
        assert load_asset(out) == asset
        model = mujoco.MjModel.from_xml_path(str(asset.mjcf_path))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert np.isfinite(data.xpos).all()
        assert np.isfinite(model.body_mass).all()
        for joint in asset.joints:
            assert math.isfinite(joint.span)
            assert np.linalg.norm(joint.axis_o) == pytest.approx(1.0)


@given(MUTANTS)
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
def test_mutants_give_an_asset_or_one_line(mutant: Mutant) -> None:
    check(mutant)


@pytest.mark.slow
@given(MUTANTS)
@settings(
    max_examples=int(os.environ.get("ARTICULATE_FUZZ", "2000")),
    suppress_health_check=list(HealthCheck),
)
def test_two_thousand_mutants_give_an_asset_or_one_line(mutant: Mutant) -> None:
    check(mutant)


def test_the_seed_itself_is_converted_in_every_format(tmp_path: Path) -> None:
    for suffix in MESHES:
        folder = tmp_path / suffix[1:]
        folder.mkdir()
        path = write_mutant(Mutant((), (), None, suffix, ()), folder)
        asset = convert(path, folder / "out", ConvertConfig(decompose=False))
        assert [joint.name for joint in asset.joints] == ["slide", "turn"]
        assert asset.link("drawer").visuals == 3
