"""Hostile files of all kinds, and honest inputs to put them into."""

from __future__ import annotations

import gzip
import io
import json
import os
import pickle  # noqa: TID251  # to make a hostile file
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from tests.assets import make_cabinet

SECRET = "root:x:0:0:SECRET-OF-THE-TEST"
"""Text of the file outside the input that no message may quote."""
LONG = 60_000
"""Length of long names and values."""
MESH_SUFFIXES = (".obj", ".stl", ".dae", ".glb", ".gltf", ".ply", ".off")

Change = Callable[[Path], object]
"""Replaces the honest file at a path."""


def sparse(path: Path, size: int, head: bytes = b"") -> None:
    """Write a file of ``size`` bytes that takes no room on the disk."""
    with path.open("wb") as stream:
        stream.write(head)
        stream.truncate(size)


def sparse_tail(path: Path, size: int) -> None:
    """Extend the honest file by zeros to ``size`` bytes."""
    with path.open("ab") as stream:
        stream.truncate(size)


def replaced(make: Change) -> Change:
    """Return a change that removes the honest file first."""

    def change(path: Path) -> None:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
        make(path)

    return change


def text(content: str, encoding: str = "utf-8") -> Change:
    """Return a change that writes a text."""
    return replaced(lambda path: path.write_text(content, encoding=encoding))


def data(content: bytes) -> Change:
    """Return a change that writes bytes."""
    return replaced(lambda path: path.write_bytes(content))


def edited(*pairs: tuple[str, str]) -> Change:
    """Return a change that replaces parts of the honest text, each found exactly as given."""

    def change(path: Path) -> None:
        content = path.read_text(encoding="utf-8")
        for old, new in pairs:
            assert old in content, old
            content = content.replace(old, new, 1)
        path.write_text(content, encoding="utf-8")

    return change


def in_json(*keys: str | int, value: object) -> Change:
    """Return a change of one value of the honest JSON; NaN and infinity as JavaScript writes them.

    The last key may be new.
    """

    def change(path: Path) -> None:
        content = json.loads(path.read_text(encoding="utf-8"))
        inside = content
        for key in keys[:-1]:
            inside = inside[key]
        inside[keys[-1]] = value
        path.write_text(json.dumps(content), encoding="utf-8")

    return change


def truncated(path: Path) -> None:
    """Keep the first 60 % of the honest file."""
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 6 // 10])


def utf16(path: Path) -> None:
    """Write the honest file in UTF-16, read as Latin-1 where it is no text."""
    path.write_bytes(path.read_bytes().decode("latin-1").encode("utf-16"))


def zeros_inside(path: Path) -> None:
    """Put NUL bytes into the middle of the honest file, over what is there."""
    content = path.read_bytes()
    middle = len(content) // 3
    path.write_bytes(content[:middle] + bytes(max(64, middle)) + content[middle:])


def outside(path: Path) -> None:
    """Replace the file by a link to one outside the folder of the input."""
    levels = len(path.relative_to(_root(path)).parts) - 1
    path.symlink_to("/".join([".."] * levels + ["secret"]))


def _root(path: Path) -> Path:
    """Return the folder of the case, which holds ``in``."""
    return next(folder.parent for folder in path.parents if folder.name == "in")


JUNK = bytes(range(256)) * 200
KINDS: dict[str, Change] = {
    "fifo": replaced(os.mkfifo),
    "device": replaced(lambda path: path.symlink_to("/dev/zero")),
    "link outside": replaced(outside),
    "folder": replaced(os.mkdir),
    "empty": data(b""),
    "290 MB": replaced(lambda path: sparse(path, 290_000_000)),
    "5 GB": replaced(lambda path: sparse(path, 5_000_000_000)),
    "290 MB with an honest head": lambda path: sparse_tail(path, 290_000_000),
    "junk": data(JUNK),
    "NUL bytes": zeros_inside,
    "UTF-16": utf16,
    "truncated": truncated,
    "page": text("<!DOCTYPE html><html><body>Not found</body></html>"),
    "pickle": data(pickle.dumps({"weights": [1.0] * 1000})),
    "gzip": data(gzip.compress(bytes(50_000_000))),
    "one long line": text("x" * 2_000_000),
    "brackets": text("[" * 100_000),
}
"""Changes that suit any file."""

BOX = '<geometry><box size="0.4 0.4 0.4"/></geometry>'
URDF = f"""<robot name="chest">
<link name="body"><visual>{BOX}</visual><collision>{BOX}</collision></link>
<link name="door"><visual>{BOX}</visual><collision>{BOX}</collision></link>
<joint name="slide" type="prismatic"><origin xyz="0.5 0 0" rpy="0 0 0"/><parent link="body"/>
<child link="door"/><axis xyz="1 0 0"/><limit lower="0" upper="0.3" effort="10" velocity="1"/>
</joint>
</robot>
"""
MJCF = """<mujoco model="chest"><compiler angle="radian"/>
<worldbody>
<body name="body"><geom type="box" size="0.2 0.2 0.2" mass="2"/>
<body name="door" pos="0.5 0 0"><joint name="slide" type="slide" axis="1 0 0" range="0 0.3"/>
<geom type="box" size="0.2 0.2 0.2" mass="1"/></body></body>
</worldbody>
</mujoco>
"""
SDF_BOX = "<geometry><box><size>0.4 0.4 0.4</size></box></geometry>"
SDF = f"""<sdf version="1.9"><model name="chest">
<link name="body"><visual name="v">{SDF_BOX}</visual>
<collision name="c">{SDF_BOX}</collision></link>
<link name="door"><pose>0.5 0 0 0 0 0</pose><visual name="v">{SDF_BOX}</visual></link>
<joint name="slide" type="prismatic"><parent>body</parent><child>door</child>
<axis><xyz>1 0 0</xyz><limit><lower>0</lower><upper>0.3</upper></limit></axis></joint>
</model></sdf>
"""
ENTITIES = (
    '<!DOCTYPE a [<!ENTITY e0 "ha">'
    + "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 12))
    + "]>"
)
"""Entities that expand to 10^11 words."""
EXTERNAL = '<!DOCTYPE a [<!ENTITY e SYSTEM "file:../secret">]>'
YAML_BOMB = "a0: &a0 [x, x]\n" + "".join(
    f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 40)
)


def with_mesh(name: str) -> str:
    """Return the URDF with a mesh for the door."""
    geometry = f'<geometry><mesh filename="{name}"/></geometry>'
    head, _, tail = URDF.rpartition(BOX)
    head, _, between = head.rpartition(BOX)
    return head + geometry + between + geometry + tail


def triangle_gltf(folder: Path, name: str, **changes: object) -> None:
    """Write a triangle as glTF with its buffer inside, ``changes`` made in its header."""
    corners = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    header: dict[str, object] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(corners)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(corners)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    } | changes
    content = json.dumps(header).encode()
    content += b" " * (-len(content) % 4)
    chunks = struct.pack("<II", len(content), 0x4E4F534A) + content
    chunks += struct.pack("<II", len(corners), 0x004E4942) + corners
    (folder / name).write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def png_of(width: int, height: int, rows: int = 0) -> bytes:
    """Return a PNG whose header announces a size, with ``rows`` rows of black pixels."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)

    packer = zlib.compressobj()
    packed = b"".join(packer.compress(bytes(1 + 3 * width)) for _ in range(rows)) + packer.flush()
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def jpeg_of(width: int, height: int) -> bytes:
    """Return a small JPEG whose header announces another size."""
    stream = io.BytesIO()
    Image.new("RGB", (64, 64), (200, 30, 30)).save(stream, "JPEG")
    content = bytearray(stream.getvalue())
    at = content.index(b"\xff\xc0")
    content[at + 5 : at + 9] = struct.pack(">HH", height, width)
    return bytes(content)


def gif_of(width: int, height: int, frames: int) -> bytes:
    """Return a GIF of tiny frames on a canvas of any size."""
    frame = b"\x21\xf9\x04\x00\x05\x00\x00\x00" + b"\x2c" + struct.pack("<HHHHB", 0, 0, 1, 1, 0)
    frame += b"\x02\x02\x44\x01\x00"
    head = b"GIF89a" + struct.pack("<HHBBB", width, height, 0x80, 0, 0) + b"\0\0\0\xff\xff\xff"
    return head + frame * frames + b"\x3b"


def npz_of(shape: str, packed: bytes = b"", dtype: str = "<f8") -> bytes:
    """Return an .npz whose only array announces a shape, a Python literal."""
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}"
    header += " " * (-(len(header) + 11) % 64) + "\n"
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + packed
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("observation.npy", array)
    return stream.getvalue()


def zip_of(**members: bytes) -> Change:
    """Return a change that writes a compressed zip; ``__`` in a name is a slash."""

    def change(path: Path) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in members.items():
                archive.writestr(name.replace("__", "/"), content)

    return replaced(change)


class HonestInputs:
    """Honest inputs of all readers, each made once and copied into the folder of a case."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def copy(self, name: str, target: Path) -> None:
        """Copy the input ``name`` to ``target``, a file or a folder."""
        source: Path = getattr(self, name)
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)

    @cached_property
    def urdf(self) -> Path:
        return self._text("urdf", "object.urdf", URDF)

    @cached_property
    def mjcf(self) -> Path:
        return self._text("mjcf", "object.xml", MJCF)

    @cached_property
    def sdf(self) -> Path:
        return self._text("sdf", "object.sdf", SDF)

    @cached_property
    def meshes(self) -> Path:
        """A folder with a box as a mesh of every format, and a URDF for each."""
        folder = self.folder / "meshes"
        folder.mkdir()
        box = trimesh.creation.box((0.4, 0.4, 0.4))
        for suffix in MESH_SUFFIXES:
            name = f"door{suffix}"
            if suffix == ".gltf":
                for file, content in trimesh.exchange.gltf.export_gltf(box.scene()).items():
                    (folder / (name if file.endswith(".gltf") else file)).write_bytes(content)
            else:
                box.export(folder / name)
            (folder / f"{suffix[1:]}.urdf").write_text(with_mesh(name))
        material = "newmtl m\nKd 1 1 1\nmap_Kd door.png\n"
        (folder / "door.mtl").write_text(material)
        Image.new("RGB", (8, 8), (200, 30, 30)).save(folder / "door.png")
        return folder

    @cached_property
    def asset(self) -> Path:
        return make_cabinet(self.folder / "asset").folder

    @cached_property
    def run(self) -> Path:
        from tests.runs import make_run  # torch, which most cases do without

        from articulate.assets.asset import load_asset

        return make_run(self.folder / "run", load_asset(self.asset), episode_s=1.0)

    @cached_property
    def bundle(self) -> Path:
        from articulate_train.export import export_policy  # torch

        return export_policy(self.run, self.folder / "bundle").path

    @cached_property
    def parts(self) -> Path:
        folder = self.folder / "parts"
        folder.mkdir()
        for k, name in enumerate(("body", "door_2")):
            box = trimesh.creation.box((1.0, 0.1 + k, 1.0))
            box.apply_translation((k, 0.0, 0.5))
            box.export(folder / f"{name}.obj")
        return folder

    @cached_property
    def glb(self) -> Path:
        path = self.folder / "parts.glb"
        trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
        return path

    @cached_property
    def image(self) -> Path:
        path = self.folder / "image.png"
        pixels = np.full((96, 128, 3), 255, np.uint8)
        pixels[20:70, 30:90] = (120, 60, 20)
        Image.fromarray(pixels).save(path)
        return path

    @cached_property
    def video(self) -> Path:
        from articulate.render.joint_video import Video

        frames = np.full((12, 96, 128, 3), 200, np.uint8)
        for t in range(12):
            frames[t, 20:60, 10 + 5 * t : 40 + 5 * t] = (20, 60, 120)
        video = Video(frames=frames, times_s=np.arange(12) / 20.0)
        return video.write(self.folder / "video.mp4")

    @cached_property
    def camera(self) -> Path:
        content = {
            "width_px": 640, "height_px": 480, "fx_px": 500, "fy_px": 500, "cx_px": 320,
            "cy_px": 240, "T_oc": np.eye(4).tolist(),
        }  # fmt: skip
        return self._text("camera", "camera.json", json.dumps(content))

    @cached_property
    def settings(self) -> Path:
        return self._text("settings", "settings.yaml", "limit: 100\n")

    @cached_property
    def index(self) -> Path:
        entry = {"id": "a", "path": "a.urdf", "category": "Box", "truth": "mobility_v2"}
        content = {"assets": [{**entry, "truth_joints": []}]}
        return self._text("index", "index.json", json.dumps(content))

    @cached_property
    def results(self) -> Path:
        """A folder of a benchmark, with results of another schema."""
        return self._text("results", "results.json", "{}").parent

    @cached_property
    def program(self) -> Path:
        return self._text("program", "program.py", "x = 1\n")

    @cached_property
    def recording(self) -> Path:
        """A folder of ``deploy --out`` with one episode."""
        folder = self.folder / "recording"
        from articulate.commands import main

        code = main(
            ["deploy", str(self.bundle), "--episodes", "1", "--out", str(folder), "--quiet"]
        )
        assert code == 0
        return folder

    @cached_property
    def key(self) -> Path:
        return self._text("key", "author.key", "11" * 32 + "\n")

    @cached_property
    def sensors(self) -> Path:
        """Files of an estimator, of a placement and of a calibration."""
        folder = self.folder / "sensors"
        folder.mkdir()
        eye = [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
        named: dict[str, tuple[str, dict[str, Any]]] = {
            "calibration.json": ("articulate.camera-calibration",
                {"camera": "webcam", "width_px": 640, "height_px": 480, "matrix": eye}),
            "pose.json": ("articulate.camera-pose",
                {"camera": "webcam", "pos_w": [0.2, 0.6, 0.7], "quat_w": [1.0, 0.0, 0.0, 0.0]}),
            "placement.json": ("articulate.object-location",
                {"object": "chest", "pose": {"x_m": 0.7, "y_m": 0, "yaw_deg": 180, "z_m": 0}}),
        }  # fmt: skip
        for name, (schema, content) in named.items():
            complete = {"schema": schema, "schema_version": 1, **content}
            (folder / name).write_text(json.dumps(complete))
        marker = "{id: %d, link: %s, size_m: 0.04, center_m: [0.2, 0.1, 0.3], normal: [1, 0, 0]}"
        rows = "".join(f"  - {marker % row}\n" for row in ((0, "body"), (1, "door")))
        (folder / "layout.yaml").write_text(f"markers:\n{rows}")
        (folder / "estimator.yaml").write_text(
            "kind: markers\ndevice: rendered\nlayout: layout.yaml\n"
            "calibration: calibration.json\ncamera_pose: pose.json\nplacement: placement.json\n"
        )
        Image.new("L", (640, 480), 200).save(folder / "view.png")
        rows_of_poses = [{"image": "view.png", "q": [0.0] * 7}]
        (folder / "poses.json").write_text(json.dumps({"poses": rows_of_poses}))
        return folder

    @cached_property
    def scan(self) -> Path:
        """A closed shell with its masks."""
        folder = self.folder / "scan"
        folder.mkdir()
        trimesh.creation.box((1.0, 1.0, 1.0)).export(folder / "scan.glb")
        np.savez(folder / "masks.npz", labels=np.array([0] * 10 + [1, 1]))
        return folder

    def _text(self, folder: str, name: str, content: str) -> Path:
        path = self.folder / folder / name
        path.parent.mkdir(parents=True)
        path.write_text(content, encoding="utf-8")
        return path
