"""Table of hostile inputs: one row for each, of all readers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from tests.hostile.arm_cases import arm_rows
from tests.hostile.changes import (
    ASSET_JSON,
    ASSET_XML,
    BUNDLE_FILES,
    CAMERAS,
    CHECKPOINTS,
    IMAGES,
    INDICES,
    JSON_TEXTS,
    MANIFESTS,
    MESH_CHANGES,
    MESH_KINDS,
    MESH_NAMES,
    MJCF_CHANGES,
    PROGRAMS,
    SCENE_JSON,
    SDF_CHANGES,
    URDF_CHANGES,
    VIDEO_EDITS,
    VIDEOS,
    YAML_TEXTS,
    ZIPS,
    folder_of_pipes,
)
from tests.hostile.reader import Case, Reader, kinds, texts, xml
from tests.hostile.writers import KINDS, MESH_SUFFIXES, Change, text, with_mesh


def _check(file: str, inputs: str, *more: str) -> Reader:
    target = "in" if Path(file).parent == Path("in") and inputs == "meshes" else file
    return Reader(argv=("check", file, "--out", "out", *more), inputs={inputs: target}, file=file)


URDF_READER = _check("in/object.urdf", "urdf")
MJCF_READER = _check("in/object.xml", "mjcf")
SDF_READER = _check("in/object.sdf", "sdf")
MESH_READERS = {
    suffix: _check(f"in/{suffix[1:]}.urdf", "meshes").at(f"in/door{suffix}")
    for suffix in MESH_SUFFIXES
}
ASSET_READER = Reader(argv=("check", "in/asset", "--out", "out"), inputs={"asset": "in/asset"},
                      file="in/asset/asset.json")  # fmt: skip
TRAIN_READER = Reader(
    argv=("train", "--asset", "in/asset", "--out", "out", "--dry-run"),
    inputs={"asset": "in/asset"},
    file="in/asset/asset.json",
)
RUN = {"run": "in/run"}
EVALUATE = Reader(argv=("evaluate", "in/run", "--episodes", "1"), inputs=RUN, file="in/run/x")
EXPORT = Reader(argv=("export", "in/run", "--out", "out"), inputs=RUN, file="in/run/x")
WATCH = Reader(argv=("watch", "in/run", "--out", "out.mp4"), inputs=RUN, file="in/run/x")
DEPLOY = Reader(
    argv=("deploy", "in/bundle", "--out", "out", "--episodes", "1"),
    inputs={"bundle": "in/bundle"},
    file="in/bundle/manifest.json",
)
ZIP = Reader(argv=("deploy", "in/bundle.zip", "--out", "out"), inputs={}, file="in/bundle.zip")
OBSERVE = Reader(argv=("observe", "in/video.mp4"), inputs={"video": "in/video.mp4"},
                 file="in/video.mp4")  # fmt: skip


def _make(*argv: str, file: str, **inputs: str) -> Reader:
    return Reader(argv=("make", *argv, "--out", "out"), inputs=inputs, file=file)


PARTS = ("--parts", "in/parts")
MAKE_VIDEO = _make("--video", "in/video.mp4", *PARTS, file="in/video.mp4", video="in/video.mp4",
                   parts="in/parts")  # fmt: skip
MAKE_IMAGE = _make("--image", "in/image.png", *PARTS, file="in/image.png", image="in/image.png",
                   parts="in/parts")  # fmt: skip
MAKE_CAMERA = _make("--text", "a door", *PARTS, "--camera-file", "in/camera.json",
                    file="in/camera.json", camera="in/camera.json", parts="in/parts")  # fmt: skip
MAKE_PARTS = _make("--text", "a door", *PARTS, file="in/parts/door_2.obj", parts="in/parts")
MAKE_GLB = _make("--text", "a door", "--parts", "in/parts.glb", file="in/parts.glb",
                 glb="in/parts.glb")  # fmt: skip
MAKE_URDF = _make("--text", "a door", "--parts", "in/parts.urdf", file="in/parts.urdf",
                  urdf="in/parts.urdf")  # fmt: skip
SETTINGS = Reader(
    argv=("check", "in/object.urdf", "--out", "out", "--config", "in/settings.yaml"),
    inputs={"urdf": "in/object.urdf", "settings": "in/settings.yaml"},
    file="in/settings.yaml",
)
INDEX = Reader(
    argv=("benchmark", "in/index.json", "--out", "out"),
    inputs={"index": "in/index.json"},
    file="in/index.json",
)
RESULTS = Reader(
    argv=("benchmark", "in/index.json", "--out", "out", "--compare-with", "in/results"),
    inputs={"index": "in/index.json", "results": "in/results"},
    file="in/results/results.json",
)
PROGRAM = Reader(
    argv=("program", "in/program.py", "in/parts"),
    inputs={"program": "in/program.py", "parts": "in/parts"},
    file="in/program.py",
)


def _rows() -> Iterator[tuple[str, Reader, dict[str, Change]]]:
    """Yield groups of cases: a name, the reader, and the changes."""
    every = list(KINDS)
    # UTF-16 and NUL bytes in XML are repaired, with a note.
    left_out = {"290 MB with an honest head", "gzip", "brackets", "UTF-16", "NUL bytes"}
    names = [k for k in every if k not in left_out]
    yield "urdf", URDF_READER, kinds(*names) | xml("robot") | URDF_CHANGES
    yield "mjcf", MJCF_READER, kinds(*names) | xml("mujoco") | MJCF_CHANGES
    yield "sdf", SDF_READER, kinds("fifo", "junk", "truncated") | xml("sdf") | SDF_CHANGES
    meshes = {k: text(with_mesh(name)) for k, name in MESH_NAMES.items()}
    yield "mesh name", URDF_READER, meshes
    for suffix, reader in MESH_READERS.items():
        yield f"mesh{suffix}", reader, kinds(*MESH_KINDS) | MESH_CHANGES[suffix]
    few = ("fifo", "device", "link outside", "folder", "empty", "junk", "UTF-16", "truncated")
    yield "asset.json", ASSET_READER, kinds(*few, "290 MB") | texts(JSON_TEXTS) | ASSET_JSON
    yield "asset.json of train", TRAIN_READER, kinds("fifo", "junk") | ASSET_JSON
    model = ASSET_READER.at("in/asset/object.xml")
    yield "object.xml", model, kinds(*few, "290 MB") | ASSET_XML
    yield "object.urdf", model.at("in/asset/object.urdf"), kinds(*few) | xml("robot")
    yield "config.yaml", EVALUATE.at("in/run/config.yaml"), kinds(*few) | texts(YAML_TEXTS)
    yield (
        "scene.json",
        EVALUATE.at("in/run/scene.json"),
        (kinds(*few) | texts(JSON_TEXTS) | SCENE_JSON),
    )
    checkpoint = "in/run/seed_0/checkpoint.pt"
    some = kinds("fifo", "device", "link outside", "folder", "empty", "junk", "pickle", "5 GB")
    yield "checkpoint of evaluate", EVALUATE.at(checkpoint), some | CHECKPOINTS
    yield "checkpoint of export", EXPORT.at(checkpoint), some | CHECKPOINTS
    yield "checkpoint of watch", WATCH.at(checkpoint), kinds("fifo", "pickle")
    yield (
        "asset of a run",
        EVALUATE.at("in/run/asset/object.xml"),
        (
            kinds("fifo", "junk")
            | {k: ASSET_XML[k] for k in ("includes a file outside", "texture outside", "user data")}
        ),
    )
    # Exporting does not use the name of another joint.
    changes = {k: v for k, v in ASSET_JSON.items() if k != "path as a name"}
    yield "asset.json of a run", EXPORT.at("in/run/asset/asset.json"), kinds(*few) | changes
    yield "manifest", DEPLOY, kinds(*few, "290 MB") | texts(JSON_TEXTS) | MANIFESTS
    for file, changes in BUNDLE_FILES.items():
        some = kinds("fifo", "device", "folder", "290 MB")
        yield f"bundle {file}", DEPLOY.at(f"in/bundle/{file}"), some | changes
    yield "bundle.zip", ZIP, kinds(*(k for k in every if k not in _NEED_CONTENT)) | ZIPS
    yield "video", OBSERVE, kinds(*every) | VIDEOS | VIDEO_EDITS
    yield "video of make", MAKE_VIDEO, kinds("fifo", "device", "junk", "empty", "290 MB")
    yield "image", MAKE_IMAGE, kinds(*every) | IMAGES
    yield "camera", MAKE_CAMERA, kinds(*few, "290 MB") | texts(JSON_TEXTS) | CAMERAS
    yield "parts", MAKE_PARTS, kinds("empty", "junk", "290 MB") | MESH_CHANGES[".obj"]
    yield "parts.glb", MAKE_GLB, kinds(*few, "290 MB") | MESH_CHANGES[".glb"]
    yield (
        "parts.urdf",
        MAKE_URDF,
        kinds(*(k for k in few if k != "UTF-16"))
        | {k: URDF_CHANGES[k] for k in ("100,000 links", "long names", "cyclic joints")},
    )
    some = kinds("fifo", "device", "folder", "junk", "UTF-16", "290 MB", "one long line")
    yield "settings", SETTINGS, some | texts(YAML_TEXTS)
    yield "index", INDEX, kinds(*few, "290 MB") | texts(JSON_TEXTS) | INDICES
    yield "results", RESULTS, kinds(*few, "5 GB") | texts(JSON_TEXTS)
    some = kinds(*(k for k in few if k not in {"empty", "truncated"}), "290 MB")
    yield "program", PROGRAM, some | texts(PROGRAMS)
    yield (
        "named pipes as folders",
        _check("in/object.urdf", "urdf").at("in/object.urdf"),
        {"folder of pipes": folder_of_pipes},
    )


_NEED_CONTENT = frozenset({"NUL bytes", "UTF-16", "truncated", "290 MB with an honest head"})


DEFAULT = frozenset({
    "urdf: fifo", "urdf: entities", "urdf: cyclic joints", "urdf: long names", "mjcf: device",
    "mjcf: includes itself", "mjcf: nested replicate", "sdf: cyclic frames",
    "mesh name: path upwards", "mesh.glb: accessor of 1e9", "mesh.stl: count of 4e9",
    "asset.json: list", "asset.json: NaN mass", "object.xml: includes a file outside",
    "object.xml: user data", "bundle.zip: pickle", "bundle.zip: zip bomb", "video: playlist",
    "image: PNG of 60,000 x 60,000", "camera: NaN", "settings: aliases", "index: deep object",
    "results: fifo",
})  # fmt: skip
"""Cases of the default tests, each of some milliseconds."""
CASES = tuple(
    Case(name=f"{group}: {name}", reader=reader, change=change,
         is_default=f"{group}: {name}" in DEFAULT)
    for group, reader, changes in chain(_rows(), arm_rows())
    for name, change in changes.items()
)  # fmt: skip
