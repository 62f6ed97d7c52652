import dataclasses
import re
import stat
import zipfile

import numpy as np
import pytest

from articulate.errors import BundleError
from articulate.task.manifest import decode_manifest, encode_manifest, with_files
from articulate.task.randomization import COLUMNS, at_size, sample_episode_params_each
from articulate_deploy import bundle_files
from articulate_deploy.bundle import load_bundle
from articulate_train.export import write_bundle


def files_of(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


def resealed(folder, **changes):
    """Write the manifest anew over the files as they are: what a careful forger would do."""
    path = folder / "manifest.json"
    manifest = decode_manifest(path.read_text(), "m")
    files = files_of(folder)
    del files["manifest.json"]
    manifest = dataclasses.replace(with_files(manifest, files), **changes)
    path.write_text(encode_manifest(manifest))


def test_a_folder_and_its_zip_are_the_same_bundle(exported, tmp_path):
    write_bundle(tmp_path / "b.zip", files_of(exported))
    a, b = load_bundle(exported), load_bundle(tmp_path / "b.zip")
    assert a.manifest == b.manifest
    assert a.files == b.files


def test_every_changed_byte_is_refused(folder):
    for path in [p for p in folder.rglob("*") if p.is_file()]:
        content = path.read_bytes()
        for at in (0, len(content) // 2, len(content) - 2):
            changed = bytearray(content)
            changed[at] ^= 0x01
            path.write_bytes(changed)
            with pytest.raises(BundleError):
                load_bundle(folder)
        path.write_bytes(content)
    load_bundle(folder)


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("changed policy", lambda f: (f / "policy.onnx").write_bytes(b"x")),
        ("extra file", lambda f: (f / "run.py").write_text("")),
        ("missing file", lambda f: (f / "golden.npz").unlink()),
        ("no manifest", lambda f: (f / "manifest.json").unlink()),
        ("link", lambda f: (f / "link").symlink_to("/etc/passwd")),
    ],
)
def test_a_folder_that_was_changed_is_refused_in_one_line(folder, what, change, error_line):
    change(folder)
    error_line(f"load_bundle: {what}", lambda: load_bundle(folder))


def test_a_bundle_that_is_not_there_is_refused(tmp_path, error_line):
    error_line("load_bundle: absent", lambda: load_bundle(tmp_path / "none.zip"))


def test_a_zip_whose_content_does_not_inflate_is_refused(tmp_path):
    """Every byte of the compressed content flipped; the directory stays whole."""
    path = tmp_path / "b.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("manifest.json", bytes(range(256)) * 40)
    content = bytearray(path.read_bytes())
    begin = 30 + len("manifest.json")
    for i in range(begin, begin + 40):
        content[i] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(BundleError, match="not a bundle"):
        load_bundle(path)


def test_a_file_that_is_no_zip_is_refused(tmp_path, error_line):
    (tmp_path / "b.zip").write_text("hello")
    error_line("load_bundle: no zip", lambda: load_bundle(tmp_path / "b.zip"))


@pytest.mark.parametrize(
    "name", ["../evil", "/etc/evil", "a/../../evil", "a//b", "./a", "C:\\evil", "a\\b", "a\x01"]
)
def test_members_that_lead_out_of_the_bundle_are_refused(exported, tmp_path, name):
    write_bundle(tmp_path / "b.zip", {**files_of(exported), name: b""})
    with pytest.raises(BundleError, match="not a valid file name"):
        load_bundle(tmp_path / "b.zip")


def test_a_member_that_is_a_link_is_refused(tmp_path):
    item = zipfile.ZipInfo("link")
    item.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr(item, "/etc/passwd")
    with pytest.raises(BundleError, match="regular file"):
        load_bundle(tmp_path / "b.zip")


def test_a_member_that_stands_twice_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("a", b"1")
        with pytest.warns(UserWarning, match="Duplicate"):
            archive.writestr("a", b"2")
    with pytest.raises(BundleError, match="duplicate member"):
        load_bundle(tmp_path / "b.zip")


def test_a_member_that_unpacks_to_much_more_is_refused(tmp_path):
    write_bundle(tmp_path / "b.zip", {"a": bytes(1 << 20)})
    with pytest.raises(BundleError, match="unpacks"):
        load_bundle(tmp_path / "b.zip")


def test_a_bundle_larger_than_allowed_is_refused(exported, monkeypatch):
    monkeypatch.setattr(bundle_files, "MAX_BYTES", 1000)
    with pytest.raises(BundleError, match="larger"):
        load_bundle(exported)


def test_limits_that_are_not_those_of_the_arm_are_refused(folder, bundle, error_line):
    robot = dataclasses.replace(bundle.manifest.robot, dq_max=(9.0,) * 7)
    resealed(folder, robot=robot)
    error_line("load_bundle: other limits", lambda: load_bundle(folder))


def test_an_unknown_arm_is_refused(folder, bundle, error_line):
    resealed(folder, robot=dataclasses.replace(bundle.manifest.robot, name="pandaa"))
    error_line("load_bundle: other arm", lambda: load_bundle(folder))


def test_a_layout_of_another_version_is_refused(folder, bundle, error_line):
    fields = bundle.manifest.observation.fields
    layout = dataclasses.replace(
        bundle.manifest.observation,
        fields=(*fields[:-1], dataclasses.replace(fields[-1], unit="s")),
    )
    resealed(folder, observation=layout)
    error_line("load_bundle: other layout", lambda: load_bundle(folder))


@pytest.mark.parametrize(
    "text",
    [
        '<include file="000_link0.obj"/>',
        '<!DOCTYPE mujoco [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<extension><plugin plugin="mujoco.pid"/></extension>',
        '<asset><mesh name="x" file="/etc/passwd"/></asset>',
        "<asset><mesh name='x' file='../x.obj'/></asset>",
        '<compiler meshdir="/"/>',
        '<asset><texture type="2d" file="000_link0.obj"/></asset>',
        """<asset><mesh name="x" file="000_link0.obj'/../../outside.obj"/></asset>""",
        """<compiler meshdir="meshes'/../.."/>""",
        """<compiler assetdir='meshes"/../..'/>""",
        '<asset><mesh name="x" fileup="/etc/passwd"/></asset>',
        '<asset><model name="x" file="000_link0.obj"/></asset>',
        '<worldbody><flexcomp name="x" file="/etc/passwd"/></worldbody>',
        '<asset><mesh name="x" file="a&#47;..&#47;b.obj"/></asset>',
    ],
)
def test_a_scene_that_refers_to_what_is_not_in_the_bundle_is_refused(folder, text):
    path = folder / "scene" / "scene.xml"
    path.write_text(path.read_text().replace("</mujoco>", f"{text}</mujoco>"))
    resealed(folder)
    with pytest.raises(BundleError):
        load_bundle(folder)


def test_loading_leaves_no_file_open_and_writes_none(exported, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bundle(tmp_path / "b.zip", files_of(exported))
    load_bundle(tmp_path / "b.zip")
    assert [p.name for p in tmp_path.iterdir()] == ["b.zip"]


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<link name="x"><collision><geometry><mesh filename="/etc/passwd"/></geometry></collision>'
        "</link>",
        "<link name='x'><visual/></link>",
        '<gazebo reference="x"/>',
        """<link name="x"><collision><geometry><mesh filename="meshes/c00_000.obj'/../../x"/>"""
        "</geometry></collision></link>",
        '<deformable name="x"><collision filename="/etc/passwd"/></deformable>',
    ],
)
def test_an_object_that_refers_to_what_is_not_in_the_bundle_is_refused(folder, text):
    path = folder / "object" / "object.urdf"
    path.write_text(path.read_text().replace("</robot>", f"{text}</robot>"))
    resealed(folder)
    with pytest.raises(BundleError, match=r"object\.urdf"):
        load_bundle(folder)


def test_a_mesh_of_the_object_that_names_another_file_is_refused(folder, error_line):
    (folder / "object" / "meshes").mkdir()
    (folder / "object" / "meshes" / "a.obj").write_text("v 0 0 0\nmtllib ../../secret\n")
    resealed(folder)
    error_line("load_bundle: mesh with a material", lambda: load_bundle(folder))


CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


@pytest.mark.parametrize(
    "text",
    [
        "",
        CORNERS,
        CORNERS + "f 1 2 5\n",
        CORNERS + "f 1 2 99999999\n",
        CORNERS + "f 1 2 -1\n",
        CORNERS + "f 0 1 2\n",
        CORNERS + "f 1\n",
        CORNERS + "f 1 2 3 4\n",
        CORNERS + "f 1/1 2/2 3/3\n",
        CORNERS + "v nan 0 0\nf 1 2 3\n",
        CORNERS + "v 1e999x 0 0\nf 1 2 3\n",
    ],
)
def test_a_mesh_whose_faces_are_none_of_its_corners_is_refused(folder, text):
    """Bullet reads the memory behind the corners then."""
    (folder / "object" / "meshes").mkdir(exist_ok=True)
    path = folder / "object" / "meshes" / "a.obj"
    path.write_text(text)
    resealed(folder)
    with pytest.raises(BundleError, match=r"a\.obj: not a mesh"):
        load_bundle(folder)
    path.write_text(CORNERS + "f 1 2 3\nf 1 4 2\n")
    resealed(folder)
    load_bundle(folder)


def test_a_folder_that_holds_a_whole_disk_is_not_walked_through(tmp_path, monkeypatch):
    monkeypatch.setattr(bundle_files, "MAX_FILES", 10)
    for name in ("manifest.json", *map(str, range(25))):
        (tmp_path / name).touch()
    with pytest.raises(BundleError, match="files"):
        load_bundle(tmp_path)


@pytest.mark.parametrize("shape", [(199, 30), (200, 29)])
def test_draws_of_another_size_are_refused(folder, shape, error_line):
    np.savez(folder / "episodes.npz", values=np.zeros(shape))
    resealed(folder)
    error_line("load_bundle: other draws", lambda: load_bundle(folder))


def test_a_line_that_ends_as_on_old_machines_hides_no_other_file(folder):
    (folder / "object" / "meshes").mkdir(exist_ok=True)
    (folder / "object" / "meshes" / "a.obj").write_bytes(b"v 0 0 0\rmtllib ../../secret\n")
    resealed(folder)
    with pytest.raises(BundleError, match="vertices and faces"):
        load_bundle(folder)


def test_a_mesh_of_the_scene_that_names_another_file_is_refused(folder):
    path = next((folder / "scene" / "meshes").glob("*.obj"))
    path.write_bytes(path.read_bytes() + b"mtllib ../../secret\n")
    resealed(folder)
    with pytest.raises(BundleError, match=rf"{path.name}: holds more"):
        load_bundle(folder)


@pytest.mark.parametrize("number", ["1e999", "-1e999", "1" * 400, "1" * 5000, "NaN"])
def test_a_number_that_is_not_finite_is_refused(folder, number):
    path = folder / "manifest.json"
    text = path.read_text()
    changed = re.sub(r'("max_age_s": )[\d.]+', rf"\g<1>{number}", text)
    assert changed != text
    path.write_text(changed)
    with pytest.raises(BundleError, match=r"manifest\.json: "):
        load_bundle(folder)


def test_a_member_packed_in_another_way_is_refused(tmp_path):
    """LZMA and bzip2 ask for memory as the file says."""
    with zipfile.ZipFile(tmp_path / "b.zip", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("manifest.json", "{}")
    with pytest.raises(BundleError, match="compression"):
        load_bundle(tmp_path / "b.zip")


def test_a_member_whose_name_is_not_text_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("é", "")
    content = (tmp_path / "b.zip").read_bytes()
    (tmp_path / "b.zip").write_bytes(content.replace("é".encode(), b"\xff\xfe"))
    with pytest.raises(BundleError, match="not a bundle"):
        load_bundle(tmp_path / "b.zip")


def test_a_folder_that_cannot_be_read_is_refused(folder, monkeypatch):
    def locked(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.scandir", locked)
    with pytest.raises(BundleError, match="Permission denied"):
        load_bundle(folder)


@pytest.mark.parametrize(("column", "value"), [("delay_steps", 1e9), ("mass", -1.0)])
def test_draws_that_no_range_allows_are_refused(folder, column, value):
    with np.load(folder / "episodes.npz", allow_pickle=False) as arrays:
        values = arrays["values"]
    values[3, COLUMNS.index(column)] = value
    np.savez(folder / "episodes.npz", values=values)
    resealed(folder)
    with pytest.raises(BundleError, match=f"a {column} is not"):
        load_bundle(folder)


def test_draws_are_those_of_the_evaluation_seed(bundle, run):
    entry = bundle.manifest.episodes
    config = at_size(run.config.randomization, 1.0)
    own = sample_episode_params_each(config, run.config.evaluation_seed, 3, begin=run.task.begin)
    assert entry.count == 200
    assert np.array_equal(bundle.episode_params.values[:3], own.values)


def test_a_manifest_larger_than_allowed_is_refused(folder):
    path = folder / "manifest.json"
    path.write_text(path.read_text() + " " * 1_000_001)
    with pytest.raises(BundleError, match=r"manifest\.json: larger than 1000 kB"):
        load_bundle(folder)
