# ruff: noqa: E501  # tables of one row a line
"""Tables of hostile changes of each kind of file."""

from __future__ import annotations

import json
import os
import pickle  # noqa: TID251  # to make a hostile file
import struct
import zlib
from pathlib import Path

from tests.hostile.writers import (
    BOX,
    ENTITIES,
    EXTERNAL,
    JUNK,
    KINDS,
    LONG,
    YAML_BOMB,
    Change,
    data,
    edited,
    gif_of,
    in_json,
    jpeg_of,
    npz_of,
    png_of,
    replaced,
    sparse,
    text,
    triangle_gltf,
    zip_of,
)

X = "x" * LONG
NUMBERS = {"NaN": "nan", "infinity": "inf", "1e308": "1e308", "long number": "9" * LONG}
XML_TEXTS = {
    "deep elements": "<{root}>" + "<a>" * 100_000 + "</a>" * 100_000 + "</{root}>",
    "entities": ENTITIES + "<{root} name='&e11;'/>",
    "external entity": EXTERNAL + "<{root}>&e;</{root}>",
    "long root": f"<{X}/>",
    "no elements": "<{root}/>",
    "attributes": "<{root} " + " ".join(f'a{k}="1"' for k in range(100_000)) + "/>",
    "many comments": "<{root}>" + "<!--x-->" * 300_000 + "</{root}>",
}
JSON_TEXTS = {
    "list": "[]",
    "null": "null",
    "deep object": '{"a":' * 100_000 + "1" + "}" * 100_000,
    "NaN": '{"schema": NaN}',
    "1e999": '{"schema": 1e999}',
    "duplicate key": '{"a": 1, "a": 2}',
    "long key": json.dumps({X: 1}),
    "long value": json.dumps({"schema": X}),
    "long integer": '{"schema": ' + "9" * LONG + "}",
    "lone surrogate": '{"schema": "\\ud800"}',
}
YAML_TEXTS = {
    "aliases": YAML_BOMB,
    "list": "- 1\n- 2\n",
    "python object": "!!python/object/apply:os.system ['touch OWNED']\n",
    "deep flow": "a: " + "[" * 10_000,
    "long key": f"{X}: 1\n",
    "long value": f"limit: {X}\n",
    "NaN": "limit: .nan\n",
    "itself": "&a [*a]\n",
    "merge": "a: &a {b: 1}\n<<: *a\n",
    "base 60": "limit: " + "1:" * LONG + "1\n",
}

URDF_CHANGES: dict[str, Change] = {
    "100,000 links": edited(("</robot>", '<link name="l"/>' * 100_000 + "</robot>")),
    "100,000 joints": edited((
        "</robot>",
        "".join(
            f'<link name="l{k}"/><joint name="j{k}" type="revolute"><parent link="body"/>'
            f'<child link="l{k}"/><limit lower="0" upper="1"/></joint>'
            for k in range(100_000)
        )
        + "</robot>",
    )),
    "chain of 20,000 links": edited((
        "</robot>",
        "".join(
            f'<link name="l{k}"/><joint name="j{k}" type="fixed"><parent link="'
            f'{"body" if k == 0 else f"l{k - 1}"}"/><child link="l{k}"/></joint>'
            for k in range(20_000)
        )
        + "</robot>",
    )),
    "cyclic joints": edited((
        "</robot>",
        '<joint name="k" type="fixed"><parent link="door"/><child link="body"/></joint></robot>',
    )),
    "joint to itself": edited(('<parent link="body"/>', '<parent link="door"/>')),
    "two parents": edited((
        "</robot>",
        '<link name="c"/><joint name="k" type="fixed"><parent link="c"/><child link="door"/>'
        "</joint></robot>",
    )),
    "long names": edited(('link name="door"', f'link name="{X}"'), ('child link="door"', f'child link="{X}"'), ('joint name="slide"', f'joint name="{X}y"')),
    "long type": edited(('type="prismatic"', f'type="{X}"')),
    "unknown parent with a long name": edited(('parent link="body"', f'parent link="{X}"')),
    "200,000 visuals": edited((BOX, BOX + "</visual>" + f"<visual>{BOX}</visual>" * 200_000 + "<visual>" + BOX)),
    "zero axis": edited(('axis xyz="1 0 0"', 'axis xyz="0 0 0"')),
    "mimic of itself": edited(("</joint>", '<mimic joint="slide"/></joint>')),
    "mimic of a long name": edited(("</joint>", f'<mimic joint="{X}"/></joint>')),
    "xacro include": edited(("<link", '<xacro:include xmlns:xacro="http://x" filename="../secret"/><link')),
    "control characters": edited(('name="door"', 'name="do\x01or"')),
    "line breaks in names": edited(('link name="door"', 'link name="do&#10;or"'), ('child link="door"', 'child link="do&#10;or"')),
    "a million numbers": edited(('xyz="0.5 0 0"', f'xyz="{"0 " * 1_000_000}"')),
    **{f"{k} in the origin": edited(('xyz="0.5 0 0"', f'xyz="{v} 0 0"')) for k, v in NUMBERS.items()},
    **{f"{k} in the size": edited(('size="0.4 0.4 0.4"', f'size="{v} 1 1"')) for k, v in NUMBERS.items()},
    **{f"{k} in the axis": edited(('axis xyz="1 0 0"', f'axis xyz="{v} 0 0"')) for k, v in NUMBERS.items()},
}  # fmt: skip
MESH_NAMES = {
    "path upwards": "../secret",
    "path upwards as a mesh": "../../../../../../etc/passwd.obj",
    "absolute path": "/etc/passwd",
    "file address": "file:///etc/passwd",
    "package upwards": "package://../../etc/passwd",
    "web address": "http://127.0.0.1:9/a.obj",
    "backslashes": "..\\..\\secret.obj",
    "device": "/dev/zero",
    "terminal": "/dev/stdin",
    "memory of the process": "/proc/self/mem",
    "long name": X + ".obj",
    "folders": "a/" * 5000 + "b.obj",
    "control characters": "a&#10;b&#9;c.obj",
    "the URDF itself": "object.urdf",
    "unknown format": "door.exe",
    "empty name": "",
}
"""Names of meshes that are not accepted."""


def _mjcf(old: str, new: str) -> Change:
    return edited((old, new))


def _head(content: str) -> Change:
    return edited(("<worldbody>", f"{content}<worldbody>"))


def _body(content: str) -> Change:
    return edited(("</worldbody>", f"{content}</worldbody>"))


def _only(content: str, head: str = "") -> Change:
    return text(f"<mujoco>{head}<worldbody><body>{content}</body></worldbody></mujoco>")


GEOM = '<geom type="mesh" mesh="m"/>'
MJCF_CHANGES: dict[str, Change] = {
    "includes itself": _head('<include file="object.xml"/>'),
    "includes a file outside": _head('<include file="../secret"/>'),
    "includes a device": _head('<include file="/dev/zero"/>'),
    "includes a long name": _head(f'<include file="{X}"/>'),
    "mesh outside": edited(("<worldbody>", '<asset><mesh name="m" file="../secret"/></asset><worldbody>'), ("</worldbody>", GEOM + "</worldbody>")),
    "mesh of a device": edited(("<worldbody>", '<asset><mesh name="m" file="/dev/zero"/></asset><worldbody>'), ("</worldbody>", GEOM + "</worldbody>")),
    "mesh with a long name": edited(("<worldbody>", f'<asset><mesh name="m" file="{X}.obj"/></asset><worldbody>'), ("</worldbody>", GEOM + "</worldbody>")),
    "mesh of numbers that are none": edited(("<worldbody>", '<asset><mesh name="m" vertex="nan 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody>'), ("</worldbody>", GEOM + "</worldbody>")),
    "mesh of a million vertices": edited(("<worldbody>", f'<asset><mesh name="m" vertex="{"0 1 2 " * 1_000_000}"/></asset><worldbody>'), ("</worldbody>", GEOM + "</worldbody>")),
    "built-in mesh": edited(("<worldbody>", '<asset><mesh name="m" builtin="torus" params="100000 100000 1"/></asset><worldbody>'), ("</worldbody>", GEOM + "</worldbody>")),
    "height field": _only('<geom type="hfield" hfield="h"/>', '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'),
    "replicate": _body('<replicate count="1000000000" offset="1 0 0"><geom size="1"/></replicate>'),
    "nested replicate": _body('<replicate count="99" offset="1 0 0">' * 8 + '<geom size="1"/>' + "</replicate>" * 8),
    "composite": _only('<composite type="grid" count="10000 10000 1" spacing="1"><geom size="1"/></composite>'),
    "flexible grid": _only('<flexcomp name="f" type="grid" count="10000 10000 10" spacing="1 1 1"/>'),
    "90,000 bodies": _body("<body/>" * 90_000),
    "100,000 bodies": _body("<body/>" * 100_000),
    "100,000 joints": _mjcf("<joint", '<joint type="slide"/>' * 100_000 + "<joint"),
    "100,000 geoms": _body('<geom size="1"/>' * 100_000),
    "deep bodies": _body("<body>" * 5000 + "</body>" * 5000),
    "deep defaults": _head("<default>" + '<default class="a">' * 5000 + "</default>" * 5001),
    "unknown class": _mjcf("<joint", '<joint class="' + X + '"'),
    "ball": _mjcf('type="slide"', 'type="ball"'),
    "long type": _mjcf('type="slide"', f'type="{X}"'),
    "long name": edited(('name="door"', f'name="{X}"'), ('name="slide"', f'name="{X}"')),
    "zero axis": _mjcf('axis="1 0 0"', 'axis="0 0 0"'),
    "attached model": _head('<asset><model name="a" file="object.xml"/></asset>'),
    "frames": _body("<frame>" * 3000 + '<geom size="1"/>' + "</frame>" * 3000),
    "negative size": _mjcf('size="0.2 0.2 0.2"', 'size="-1 -1 -1"'),
    **{f"{k} in the position": _mjcf('pos="0.5 0 0"', f'pos="{v} 0 0"') for k, v in NUMBERS.items()},
    **{f"{k} in the size": _mjcf('size="0.2 0.2 0.2"', f'size="{v} 1 1"') for k, v in NUMBERS.items()},
    **{f"{k} in the range": _mjcf('range="0 0.3"', f'range="0 {v}"') for k, v in NUMBERS.items() if k != "1e308"},
    **{f"{k} in the mass": _mjcf('mass="1"', f'mass="{v}"') for k, v in NUMBERS.items() if k != "1e308"},
}  # fmt: skip


def _sdf_shapes(content: str) -> Change:
    return edited(*[("<box><size>0.4 0.4 0.4</size></box>", content)] * 3)


SDF_CHANGES: dict[str, Change] = {
    "includes itself": edited(("</model>", "<include><uri>object.sdf</uri></include></model>")),
    "includes a file outside": edited(("</model>", "<include><uri>../secret</uri></include></model>")),
    "mesh outside": _sdf_shapes("<mesh><uri>../secret</uri></mesh>"),
    "mesh of a device": _sdf_shapes("<mesh><uri>/dev/zero</uri></mesh>"),
    "mesh with a long name": _sdf_shapes(f"<mesh><uri>{X}.obj</uri></mesh>"),
    "100,000 links": edited(("</model>", '<link name="l"/>' * 100_000 + "</model>")),
    "nested models": edited(("</model></sdf>", "<model name='m'>" * 5000 + "</model>" * 5001 + "</sdf>")),
    "cyclic frames": edited(("<pose>0.5 0 0 0 0 0</pose>", "<pose relative_to='door'>0 0 0 0 0 0</pose>")),
    "cyclic joints": edited(("<parent>body</parent>", "<parent>door</parent>")),
    "long name": edited(('<link name="door"', f'<link name="{X}"'), ("<child>door</child>", f"<child>{X}</child>")),
    "unknown child": edited(("<child>door</child>", f"<child>{X}</child>")),
    "height map": _sdf_shapes("<heightmap><uri>../secret</uri></heightmap>"),
    "two models": edited(("<sdf version=\"1.9\">", "<sdf version=\"1.9\"><model name='a'/>")),
    **{f"{k} in the pose": edited(("<pose>0.5", f"<pose>{v}")) for k, v in NUMBERS.items()},
    **{f"{k} in the size": edited(("<size>0.4", f"<size>{v}")) for k, v in NUMBERS.items()},
}  # fmt: skip


def _gltf(**changes: object) -> Change:
    return replaced(lambda path: triangle_gltf(path.parent, path.name, **changes))


def _accessor(**changes: object) -> Change:
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", **changes}
    return _gltf(accessors=[{k: v for k, v in accessor.items() if v is not None}])


CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
MESH_CHANGES: dict[str, dict[str, Change]] = {
    ".obj": {
        "faces out of range": text(CUBE + "f 1 2 999999999\n"),
        "negative faces": text(CUBE + "f -9 -10 -11\n"),
        "NaN": text("v nan nan nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "infinity": text("v inf 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "1e308": text("v 1e308 0 0\nv -1e308 1e308 0\nv 0 1 1e308\nf 1 2 3\n"),
        "no faces": text(CUBE * 1000),
        "a million points": text("v 0 0 0\n" * 3_000_000),
        "100,000 materials": text(CUBE + "".join(f"usemtl {k}\nf 1 2 3\n" for k in range(100_000))),
        "long material": text(f"mtllib {X}\nusemtl {X}\n" + CUBE + "f 1 2 3\n" + "f a b c\n"),
        "many faces": text(CUBE + "f 1 2 3\nf 2 3 4\n" * 2_000_000),
    },
    ".stl": {
        "count of 4e9": data(bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50)),
        "count of 0": data(bytes(80) + struct.pack("<I", 0)),
        "NaN": data(bytes(80) + struct.pack("<I", 1) + struct.pack("<12f", *[float("nan")] * 12) + b"\0\0"),
        "text of a long name": text(f"solid {X}\nfacet normal 0 0 1\n" + "x" * LONG),
        "4,000,000 triangles": replaced(lambda path: sparse(path, 84 + 50 * 4_000_000, bytes(80) + struct.pack("<I", 4_000_000))),
    },
    ".dae": {
        "entities": text(ENTITIES + "<COLLADA>&e11;</COLLADA>"),
        "external entity": text(EXTERNAL + "<COLLADA>&e;</COLLADA>"),
        "deep nodes": text("<COLLADA><library_visual_scenes>" + "<node>" * 50_000 + "</node>" * 50_000 + "</library_visual_scenes></COLLADA>"),
        "other XML": text("<svg/>"),
        "count of 1e9": text('<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><library_geometries><geometry id="g"><mesh><source id="s"><float_array id="f" count="1000000000">0</float_array></source></mesh></geometry></library_geometries></COLLADA>'),
    },
    ".glb": {
        "accessor of 1e9": _accessor(count=10**9, bufferView=None),
        "sparse accessor of 1e9": _accessor(count=10**9, bufferView=None, sparse={"count": 1}),
        "accessor of 1e30": _accessor(count=10**30),
        "negative accessor": _accessor(count=-5),
        "buffer outside": _gltf(buffers=[{"uri": "../secret", "byteLength": 36}]),
        "buffer of a device": _gltf(buffers=[{"uri": "/dev/zero", "byteLength": 36}]),
        "cyclic nodes": _gltf(nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}]),
        "node of itself": _gltf(nodes=[{"mesh": 0, "children": [0]}]),
        "doubling nodes": _gltf(nodes=[*({"children": [k + 1, k + 1]} for k in range(40)), {"mesh": 0}]),
        "NaN in a matrix": _gltf(nodes=[{"mesh": 0, "matrix": [float("nan")] * 16}]),
        "100,000 nodes": _gltf(nodes=[{"mesh": 0}] * 100_000),
        "lists in place of objects": _gltf(meshes=[[]], nodes=[[]], accessors=[[]]),
        "text in place of lists": _gltf(meshes=X, nodes=X),
        "chunk longer than the file": data(struct.pack("<4sII", b"glTF", 2, 40) + struct.pack("<II", 2**32 - 1, 0x4E4F534A) + b"{}"),
    },
    ".gltf": {
        "link of data": text(json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "data:;base64," + "A" * 1000, "byteLength": 10**12}]})),
        "long address": text(json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": X, "byteLength": 36}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}], "bufferViews": [{"buffer": 0, "byteLength": 36}]})),
        "list": text("[]"),
        "deep": text('{"a":' * 100_000),
    },
    ".ply": {
        "count of 4e9": text("ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n"),
        "binary count of 4e9": text("ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
        "faces out of range": text("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99999\n"),
        "long property": text(f"ply\nformat ascii 1.0\nelement {X} 3\nproperty float {X}\nend_header\n"),
    },
    ".off": {
        "count of 4e9": text("OFF\n4000000000 4000000000 0\n0 0 0\n"),
        "faces out of range": text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9999\n"),
        "NaN": text("OFF\n3 1 0\nnan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    },
}  # fmt: skip
MESH_KINDS = ("fifo", "device", "folder", "empty", "290 MB", "junk", "truncated")
ASSET_JSON: dict[str, Change] = {
    "joint limits of infinity": in_json("joints", 0, "upper", value=float("inf")),
    "NaN mass": in_json("links", 0, "mass_kg", value=float("nan")),
    "list of links": in_json("links", value=[[]]),
    "text of joints": in_json("joints", value=X),
    "long name": in_json("name", value=X),
    "path as a name": in_json("joints", 0, "name", value="../../secret"),
    "control characters in a name": in_json("joints", 0, "name", value="a\n\x1b[31mb"),
    "long category": in_json("category", value=X),
    "unknown parent": in_json("joints", 0, "parent", value=X),
    "old schema": in_json("schema_version", value=0),
    "schema of a list": in_json("schema_version", value=[[1]]),
    "100,000 links": in_json("links", value=[{"name": "l"}] * 100_000),
}
ASSET_XML: dict[str, Change] = {
    "includes a file outside": _head('<include file="/etc/passwd"/>'),
    "texture outside": _head('<asset><texture name="a" type="2d" file="/etc/passwd"/></asset>'),
    "mesh upwards": _head('<asset><mesh name="a" file="../../secret"/></asset>'),
    "height field": _head('<asset><hfield name="a" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>'),
    "memory": _head('<size memory="1T"/>'),
    "user data": _head('<size nuserdata="2000000000"/>'),
    "numeric": _head('<custom><numeric name="n" size="900000000"/></custom>'),
    "NaN": _mjcf('damping="5.0"', 'damping="nan"'),
    "deep elements": text("<a>" * 100_000),
    "entities": text(ENTITIES + "<mujoco model='&e11;'/>"),
    "user of joints": _head('<size nuser_jnt="1000000000"/>'),
    "time step": _head('<option timestep="1e-300" iterations="2000000000"/>'),
    "other joints": _mjcf('name="drawer_0_slide"', f'name="{X}"'),
    "100,000 bodies": _body("<body/>" * 100_000),
    "attributes": edited(("<mujoco ", "<mujoco " + " ".join(f'a{k}="1"' for k in range(100_000)) + " ")),
    "10,000 geoms": _mjcf('<geom type="box"', '<geom size="0.01"/>' * 10_000 + '<geom type="box"'),
    "900 joints": _mjcf("<joint", '<body><joint type="slide"/><geom size="0.01" mass="1"/></body>' * 900 + "<joint"),
}  # fmt: skip
SCENE_JSON: dict[str, Change] = {
    "NaN": in_json("task", "span", value=float("nan")),
    "time of an episode": in_json("task", "episode_s", value=1e300),
    "list as a task": in_json("task", value=[]),
    "long joint": in_json("task", "joint", value=X),
    "far start of the arm": in_json("placement", "start_q", value=[1e300] * 7),
    "force limit of infinity": in_json("task", "limits", "force_n", value=float("inf")),
    "placement of lists": in_json("placement", "pos_w", value=[[[]]]),
    "far placement": in_json("placement", "pos_w", value=[1e300, 0, 0]),
    "old schema": in_json("schema_version", value=0),
}
CHECKPOINTS: dict[str, Change] = {
    "zip of a pickle": zip_of(archive__data__pkl=pickle.dumps({"a": 1}), archive__version=b"3\n"),
    "pickle that runs a command": data(b"cos\nsystem\n(S'touch OWNED'\ntR."),
    "zip bomb": zip_of(archive__data__pkl=bytes(3_000_000_000 // 10)),
}
MANIFESTS: dict[str, Change] = {
    "long file": in_json("files", value={X: "0" * 64}),
    "file outside": in_json("files", value={"../../secret": "0" * 64}),
    "files as a list": in_json("files", value=[]),
    "old schema": in_json("schema_version", value=0),
}
ZIPS: dict[str, Change] = {
    "zip bomb": zip_of(**{"manifest.json": bytes(3_000_000_000 // 10)}),
    "path upwards": zip_of(**{"../OWNED": b"x", "manifest.json": b"{}"}),
    "absolute path": zip_of(**{"/tmp/OWNED": b"x", "manifest.json": b"{}"}),
    "long member": zip_of(**{X: b"x"}),
    "5000 members": zip_of(**{f"m{k}": b"" for k in range(5000)}),
    "deep folders": zip_of(**{"d/" * 3000 + "x": b"", "manifest.json": b"{}"}),
    "empty zip": zip_of(),
    "zip of a zip": zip_of(**{"bundle.zip": JUNK}),
}
IMAGES: dict[str, Change] = {
    "PNG of 60,000 x 60,000": data(png_of(60_000, 60_000)),
    "PNG of 2e9 x 2e9": data(png_of(2**31 - 1, 2**31 - 1)),
    "PNG bomb": replaced(lambda path: path.write_bytes(png_of(20_000, 20_000, 2000))),
    "PNG of 99 million pixels": replaced(lambda path: path.write_bytes(png_of(9900, 9999, 9999))),
    "PNG of 1 x 1e8": data(png_of(1, 100_000_000)),
    "JPEG of 65,535 x 65,535": data(jpeg_of(65_535, 65_535)),
    "GIF of 65,535 x 65,535": data(gif_of(65_535, 65_535, 1)),
    "blank": data(png_of(64, 64, 64)),
    "BMP of 2e9": data(b"BM" + struct.pack("<IHHIIiiHHIIiiII", 100, 0, 0, 54, 40, 2**31 - 1, 2**31 - 1, 1, 24, 0, 0, 0, 0, 0, 0)),
    "TIFF of 2e9": data(b"II*\0" + struct.pack("<IH", 8, 2) + struct.pack("<HHII", 256, 4, 1, 2**31 - 1) + struct.pack("<HHII", 257, 4, 1, 2**31 - 1) + bytes(4)),
    "PPM of 1e9": data(b"P6\n100000 100000\n255\n" + bytes(100)),
}  # fmt: skip
VIDEOS: dict[str, Change] = {
    "GIF of 65,535 x 65,535": data(gif_of(65_535, 65_535, 3)),
    "GIF of 4000 x 4000 in 3000 frames": data(gif_of(4000, 4000, 3000)),
    "GIF of 30,000 frames": data(gif_of(64, 64, 30_000)),
    "playlist": text("#EXTM3U\n#EXTINF:4,\n../secret\n#EXT-X-ENDLIST\n"),
    "list of files": text("ffconcat version 1.0\nfile ../secret\n"),
    "MP4 without frames": data(struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0)),
    "MP4 box of 4 GB": data(struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0) + struct.pack(">I4s", 2**32 - 1, b"moov") + JUNK),
    "AVI of junk": data(b"RIFF\xff\xff\xff\xffAVI " + JUNK),
    "Matroska of junk": data(b"\x1aE\xdf\xa3" + JUNK),
}  # fmt: skip


def _mp4_size(width: int, height: int) -> Change:
    """Return a change of the size that the header of an MP4 announces."""

    def change(path: Path) -> None:
        content = bytearray(path.read_bytes())
        at = content.index(b"avc1")
        content[at + 28 : at + 32] = struct.pack(">HH", width, height)
        tkhd = content.index(b"tkhd")
        content[tkhd + 80 : tkhd + 88] = struct.pack(">II", width << 16, height << 16)
        path.write_bytes(content)

    return change


def _damaged(path: Path) -> None:
    """Overwrite a third of a video."""
    content = bytearray(path.read_bytes())
    third = len(content) // 3
    content[third : 2 * third] = zlib.compress(JUNK)[:third].ljust(third, b"\xff")
    path.write_bytes(content)


CAMERAS: dict[str, Change] = {
    "NaN": in_json("fx_px", value=float("nan")),
    "size of 1e9": in_json("width_px", value=10**9),
    "long text": in_json("T_oc", value=X),
    "deep lists": in_json("T_oc", value=[[[[[[1]]]]]]),
    "mirror image": in_json("T_oc", value=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]),
}  # fmt: skip
INDICES: dict[str, Change] = {
    "path outside": in_json("assets", 0, "path", value="../secret"),
    "path of a device": in_json("assets", 0, "path", value="/dev/zero"),
    "long path": in_json("assets", 0, "path", value=X),
    "long id": in_json("assets", 0, "id", value=X),
    "id of a path": in_json("assets", 0, "id", value="../../OWNED"),
    "text of joints": in_json("assets", 0, "truth_joints", value=X),
    "entries of lists": in_json("assets", value=[[]]),
}
PROGRAMS = {
    "endless loop": "while True:\n    pass\n",
    "nested loops": "for a in range(200):\n    for b in range(200):\n        for c in range(200):\n            x = 1\n",
    "many steps": "for a in range(2000):\n    for k in range(5):\n" + "        x = 1\n" * 200,
    "power": "x = 9 ** 9 ** 9\n",
    "long text": 'x = "a" * 1000000000\n',
    "list of 1e9": "x = list(range(1000000000))\n",
    "doubling list": "x = [1]\n" + "x = x + x\n" * 60,
    "doubling text": 'x = "ab"\n' + "x = x + x\n" * 60,
    "import": "import os\nos.system('touch OWNED')\n",
    "open": "open('../secret').read()\n",
    "attributes": "().__class__.__bases__[0].__subclasses__()\n",
    "brackets": "x = " + "(" * 5000 + ")" * 5000 + "\n",
    "long name": f"x = {X}\n",
    "unknown part with a long name": f'x = box("{X}")\n',
    "long program": "x = 1\n" * 100_000,
    "NUL": "x = 1\0\n",
    "division by zero": "x = 1 / 0\n",
    "NaN": 'move("door_2", (1e308 * 10, 0, 0))\n',
    "recursion": "def f(n):\n    return f(n + 1)\nf(0)\n",
    "no joints": "x = 1\n" * 10 + "y = unknown\n",
    "format": 'x = f"{1:>1000000000}"\n',
}


def _onnx(graph: str) -> Change:
    """Return a change that writes an ONNX policy whose sizes multiply."""

    def change(path: Path) -> None:
        from onnx import TensorProto, helper

        big = [100_000, 100_000]
        shape = helper.make_tensor("shape", TensorProto.INT64, [2], big)
        nodes = {
            "expand": [helper.make_node("Expand", ["one", "shape"], ["y"])],
            "constant of shape": [helper.make_node("ConstantOfShape", ["shape"], ["y"])],
            "concatenations": [
                helper.make_node("Concat", [f"c{k}"] * 8, [f"c{k + 1}"], axis=0) for k in range(14)
            ],
            "endless loop": [helper.make_node("Identity", ["one"], ["y"])] * 20_000,
        }[graph]
        if graph == "concatenations":
            nodes = [helper.make_node("Identity", ["one"], ["c0"]), *nodes]
        one = helper.make_tensor("one", TensorProto.FLOAT, [1], [1.0])
        inputs = [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", 4])]
        outputs = [helper.make_tensor_value_info("y", TensorProto.FLOAT, None)]
        model = helper.make_model(helper.make_graph(nodes, "g", inputs, outputs, [one, shape]))
        path.write_bytes(model.SerializeToString())
        _seal(path.parent)

    return change


def _seal(folder: Path) -> None:
    """Write the sums of the files as they are into the manifest of a bundle."""
    from articulate.task.manifest import decode_manifest, encode_manifest, with_files

    path = folder / "manifest.json"
    files = {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file() and p != path
    }
    path.write_text(encode_manifest(with_files(decode_manifest(path.read_text(), "m"), files)))


def _sealed(change: Change) -> Change:
    """Return the change with right sums in the manifest of the bundle."""

    def sealed(path: Path) -> None:
        change(path)
        _seal(next(folder for folder in path.parents if folder.name == "bundle"))

    return sealed


BUNDLE_FILES: dict[str, dict[str, Change]] = {
    "policy.onnx": {
        **{k: _onnx(k) for k in ("expand", "constant of shape", "concatenations", "endless loop")},
        **{k: _sealed(KINDS[k]) for k in ("empty", "junk", "pickle", "truncated", "gzip")},
        "brackets": _sealed(data(b"\x0a\xff\xff\xff\xff\x0f" + b"\x3a" * 100_000)),
    },
    "golden.npz": {
        "array of 1e12": _sealed(data(npz_of("(1000000, 1000000)"))),
        "bomb": _sealed(replaced(lambda path: path.write_bytes(npz_of("(40000000,)", bytes(320_000_000))))),
        "objects": _sealed(data(npz_of("(1,)", pickle.dumps([1]), "|O"))),
        "shape of a program": _sealed(data(npz_of("(__import__('os').system('touch OWNED'),)"))),
        "deep shape": _sealed(data(npz_of("(" * 5000))),
        **{k: _sealed(KINDS[k]) for k in ("empty", "junk")},
    },
    "episodes.npz": {
        "array of 1e12": _sealed(data(npz_of("(1000000, 1000000)"))),
        "bomb": _sealed(replaced(lambda path: path.write_bytes(npz_of("(40000000,)", bytes(320_000_000))))),
        "objects": _sealed(data(npz_of("(1,)", pickle.dumps([1]), "|O"))),
        "junk": _sealed(KINDS["junk"]),
    },
    "scene/scene.xml": {
        "includes a file outside": _sealed(_head('<include file="/etc/passwd"/>')),
        "height field": _sealed(_head('<asset><hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>')),
        "100,000 bodies": _sealed(_body("<body/>" * 100_000)),
        "user data": _sealed(_head('<size nuserdata="2000000000"/>')),
        "deep elements": _sealed(text("<a>" * 100_000)),
        "attributes": _sealed(edited(("<mujoco ", "<mujoco " + " ".join(f'a{k}="1"' for k in range(100_000)) + " "))),
        "entities": _sealed(text(ENTITIES + "<mujoco model='&e11;'/>")),
    },
    "object/object.urdf": {
        **{f"{k} in an origin": _sealed(edited(('<origin xyz="0.0 ', f'<origin xyz="{v} '))) for k, v in NUMBERS.items() if k != "1e308"},
        "100,000 links": _sealed(edited(("</robot>", '<link name="l"/>' * 100_000 + "</robot>"))),
        "attributes": _sealed(edited(("<robot ", "<robot " + " ".join(f'a{k}="1"' for k in range(100_000)) + " "))),
        "mesh outside": _sealed(edited(("</robot>", '<link name="l"><visual><geometry><mesh filename="/etc/passwd"/></geometry></visual></link></robot>'))),
        "entities": _sealed(text(ENTITIES + "<robot name='&e11;'/>")),
    },
}  # fmt: skip


def folder_of_pipes(path: Path) -> None:
    path.unlink()
    path.mkdir()
    for name in ("a.urdf", "b.xml", "asset.json", "c.sdf"):
        os.mkfifo(path / name)


VIDEO_EDITS: dict[str, Change] = {
    "MP4 of 65,535 x 65,535": _mp4_size(65_535, 65_535),
    "a third overwritten": _damaged,
}
