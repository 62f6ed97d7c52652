from importlib.metadata import version

import pytest

from articulate.errors import UsageError
from articulate.preparation import store


@pytest.fixture
def kept(tmp_path):
    """A source with a mesh, and a result that was noted for it."""
    source, mesh = tmp_path / "in" / "a.urdf", tmp_path / "in" / "meshes" / "a.obj"
    mesh.parent.mkdir(parents=True)
    source.write_text("<robot/>")
    mesh.write_text("v 0 0 0")
    folder = tmp_path / "cache" / "assets" / "a"
    folder.mkdir(parents=True)
    (folder / "check_report.json").write_text('{"schema": "articulate.check_report"}')
    store.save(source, {}, tmp_path / "cache", [mesh], folder)
    return source, mesh, tmp_path / "cache", folder


def test_what_was_checked_is_found_again(kept):
    source, _, cache, folder = kept
    assert store.load(source, {}, cache) == folder


@pytest.mark.parametrize("change", ["source", "mesh", "options", "new file", "result", "record"])
def test_whatever_changes_it_is_checked_anew(kept, change):
    source, mesh, cache, folder = kept
    options = {}
    if change == "source":
        source.write_text("<robot />")
    elif change == "mesh":
        mesh.write_text("v 0 0 1")
    elif change == "options":
        options = {"size_m": 1.0}
    elif change == "new file":
        (mesh.parent / "b.obj").write_text("")
    elif change == "result":
        (folder / "check_report.json").unlink()
    else:
        next((cache / "checks").iterdir()).write_text("{")
    assert store.load(source, options, cache) is None


def test_the_code_that_proves_is_part_of_the_key(kept, monkeypatch):
    source, _, cache, _ = kept
    monkeypatch.setattr(store, "code_id", lambda: "another")
    assert store.load(source, {}, cache) is None


def test_how_the_path_is_written_does_not_matter(kept, monkeypatch, tmp_path):
    source, _, cache, folder = kept
    monkeypatch.chdir(tmp_path)
    assert store.load(source.relative_to(tmp_path), {}, cache) == folder
    (tmp_path / "link").symlink_to(source)
    assert store.load(tmp_path / "link", {}, cache) == folder


def test_package_folders_and_simulator_versions_are_part_of_the_key(kept, monkeypatch):
    source = kept[0]
    first = store.record_key(source, {})
    monkeypatch.setenv("ROS_PACKAGE_PATH", "/elsewhere")
    second = store.record_key(source, {})
    monkeypatch.setattr(store, "simulator_versions", lambda: ("mujoco 0.0.1", "pybullet absent"))
    assert len({first, second, store.record_key(source, {})}) == 3


def test_simulators_have_a_version_or_are_absent(monkeypatch):
    assert store.simulator_versions()[0] == f"mujoco {version('mujoco')}"
    monkeypatch.setattr(store, "SIMULATORS", ("no-such-simulator",))
    assert store.simulator_versions.__wrapped__() == ("no-such-simulator absent",)


def test_a_source_that_is_gone_is_not_found(kept):
    source, _, cache, _ = kept
    source.unlink()
    assert store.load(source, {}, cache) is None


def test_handing_over_replaces_an_earlier_result_and_nothing_else(kept, tmp_path):
    folder = kept[3]
    out = tmp_path / "out"
    store.export(folder, out)
    (out / "old").write_text("")
    store.export(folder, out)
    assert [p.name for p in out.iterdir()] == ["check_report.json"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cache", "in", "out"]
    with pytest.raises(UsageError, match="is not an asset"):
        store.export(folder, kept[0].parent)
    for name in ("asset.json", "check_report.json"):
        (kept[0].parent / name).write_text("{}")  # of another program
    with pytest.raises(UsageError, match="is not an asset"):
        store.export(folder, kept[0].parent)
    assert kept[0].is_file()


def test_a_very_large_source_is_not_read(tmp_path):
    path = tmp_path / "large.urdf"
    with path.open("wb") as stream:
        stream.truncate(store.MAX_BYTES + 1)
    first = store.record_key(path, {})
    with path.open("ab") as stream:
        stream.truncate(store.MAX_BYTES + 2)
    assert store.record_key(path, {}) != first


def test_an_out_with_too_long_a_name_is_refused_in_one_line(kept, tmp_path):
    with pytest.raises(UsageError, match="cannot be written"):
        store.export(kept[3], tmp_path / ("x" * 300))


def test_an_out_may_have_the_longest_name_that_the_disk_takes(kept, tmp_path):
    store.export(kept[3], tmp_path / ("x" * 255))
    assert (tmp_path / ("x" * 255) / "check_report.json").is_file()
