"""Damaged and hostile bundles are rejected with one short line, before anything is simulated."""

import dataclasses
import json
import os
import pickle  # noqa: TID251  # to make a hostile file
import re
import zipfile

import pytest

from articulate.errors import BundleError
from articulate.task.manifest import decode_manifest, encode_manifest, with_files
from articulate_deploy.bundle import load_bundle


def files_of(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file() and p.name != "manifest.json"
    }


def seal(folder):
    """Write the sums of the files as they are into the manifest."""
    path = folder / "manifest.json"
    manifest = decode_manifest(path.read_text(), "m")
    path.write_text(encode_manifest(with_files(manifest, files_of(folder))))


def edit(name, pattern, text):
    """Return a change of a text file of a bundle that keeps its sums right."""

    def change(folder):
        path = folder / name
        before = path.read_text()
        after = re.sub(pattern, lambda _: text, before, count=1)
        assert after != before
        path.write_text(after)
        seal(folder)

    return change


def manifest_text(change):
    """Return a change of the text of the manifest."""

    def apply(folder):
        path = folder / "manifest.json"
        path.write_text(change(path.read_text()))

    return apply


def replace_by(name, make):
    """Return a change that puts something else in place of a file."""

    def change(folder):
        (folder / name).unlink()
        make(folder / name)

    return change


def long_name(folder):
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    content["files"] = {"x" * 60_000: "0" * 64}
    path.write_text(json.dumps(content))


def sealed_long_name(folder):
    path = folder / "manifest.json"
    manifest = decode_manifest(path.read_text(), "m")
    files = {**files_of(folder), "x" * 60_000: b""}
    path.write_text(encode_manifest(with_files(manifest, files)))


def pickled(folder):
    (folder / "policy.onnx").write_bytes(pickle.dumps({"weights": [1.0] * 100}))
    seal(folder)


SCENE, OBJECT = "scene/scene.xml", "object/object.urdf"
CHANGES = {
    "FIFO in place of the manifest": replace_by("manifest.json", os.mkfifo),
    "FIFO in place of the policy": replace_by("policy.onnx", os.mkfifo),
    "device in place of the policy": replace_by("policy.onnx", lambda p: p.symlink_to("/dev/zero")),
    "device in place of the manifest": replace_by(
        "manifest.json", lambda p: p.symlink_to("/dev/zero")
    ),
    "link of a folder": lambda folder: (folder / "more").symlink_to("/etc"),
    "deep folders": lambda folder: folder.joinpath(*["d"] * 300).mkdir(parents=True),
    "deep manifest": manifest_text(lambda _: '{"a":' * 100_000 + "1" + "}" * 100_000),
    "list as manifest": manifest_text(lambda _: "[]"),
    "deep list as manifest": manifest_text(lambda _: "[" * 100_000),
    "duplicate key": manifest_text(lambda text: '{"schema": 1,' + text.lstrip("{ \n")),
    "NaN": manifest_text(lambda text: re.sub(r'("atol": )[^,\n]+', r"\1NaN", text)),
    "infinity": manifest_text(lambda text: re.sub(r'("atol": )[^,\n]+', r"\1-1e999", text)),
    "long integer": manifest_text(
        lambda text: re.sub(r'("count": )\d+', r"\g<1>" + "9" * 4000, text)
    ),
    "long key": manifest_text(
        lambda text: text.replace('"schema":', f'"{"k" * 60_000}": 1, "schema":')
    ),
    "long text": manifest_text(lambda text: text.replace('"joint_impedance"', f'"{"k" * 60_000}"')),
    "long name": long_name,
    "sealed long name": sealed_long_name,
    "pickled policy": pickled,
    "memory of a scene": edit(SCENE, 'memory="[0-9]+"', 'memory="99999999999"'),
    "suffix of memory": edit(SCENE, 'memory="[0-9]+"', 'memory="900G"'),
    "user data": edit(SCENE, 'memory="', 'nuserdata="1000000000" memory="'),
    "solver iterations": edit(SCENE, ' iterations="[0-9]+"', ' iterations="1000000000"'),
    "contacts of a sensor": edit(SCENE, 'num="[0-9]+"', 'num="1000000000"'),
    "height field": edit(SCENE, "<asset>", '<asset><hfield name="h" nrow="100000" ncol="100000"/>'),
    "texture": edit(SCENE, "<asset>", '<asset><texture name="t" file="/etc/passwd"/>'),
    "include": edit(SCENE, "<asset>", '<asset><include file="/etc/passwd"/>'),
    "mass that is not a number": edit(SCENE, 'mass="[^"]+"', 'mass="nan"'),
    "infinite friction": edit(OBJECT, 'friction="[^"]+"', 'friction="-inf"'),
    "gravity of a black hole": edit(SCENE, 'gravity="[^"]+"', 'gravity="0 0 -1e30"'),
    "many bodies": edit(SCENE, "</worldbody>", "<body/>" * 1000 + "</worldbody>"),
    "many geoms": edit(SCENE, "</worldbody>", '<geom size="1"/>' * 10_000 + "</worldbody>"),
    "deep bodies": edit(SCENE, "</worldbody>", "<body>" * 300 + "</body>" * 300 + "</worldbody>"),
    "many links": edit(OBJECT, "</robot>", '<link name="x"/>' * 1000 + "</robot>"),
    "entities": edit(OBJECT, "<robot", '<!DOCTYPE r [<!ENTITY a "aa">]><robot'),
    "long attribute": edit(OBJECT, 'name="', f'name="{"x" * 60_000}'),
    "mesh far away": edit("scene/meshes/000_link0.obj", r"\Av [^ ]+", "v 1e30"),
    "mesh that is not a number": edit("scene/meshes/000_link0.obj", r"\Av [^ ]+", "v 1.e.e"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_it_is_rejected_in_one_short_line(folder, name):
    CHANGES[name](folder)
    with pytest.raises(BundleError) as caught:
        load_bundle(folder)
    line = str(caught.value).replace(str(folder), "bundle")
    assert line.isprintable()
    assert len(line) < 800


@pytest.mark.parametrize("kind", ["FIFO", "device", "large", "pickle", "many members", "folder"])
def test_other_files_are_no_bundles(tmp_path, kind):
    path = tmp_path / "bundle.zip"
    if kind == "FIFO":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "large":
        with path.open("wb") as stream:
            stream.truncate(10 << 30)
    elif kind == "pickle":
        path.write_bytes(pickle.dumps({"weights": [1.0] * 100}))
    elif kind == "many members":
        with zipfile.ZipFile(path, "w") as archive:
            for k in range(5000):
                archive.writestr(str(k), b"")
    else:
        path.mkdir()
        (path / "x").mkdir()
    with pytest.raises(BundleError) as caught:
        load_bundle(path)
    assert str(caught.value).isprintable()


def test_a_bundle_that_was_not_changed_is_accepted(folder):
    seal(folder)
    assert dataclasses.is_dataclass(load_bundle(folder))
