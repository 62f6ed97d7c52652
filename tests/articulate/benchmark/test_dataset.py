from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from tests.articulate.benchmark.objects import write_index

from articulate.benchmark.dataset import (
    FolderDataset,
    IndexDataset,
    LibraryDataset,
    open_dataset,
)
from articulate.errors import AssetError, ConfigError
from articulate.formats.part_names import semantic_names


def test_an_index_offers_the_objects_whose_truth_holds(tmp_path):
    dataset = open_dataset(str(write_index(tmp_path, ("a", "b"))))
    assert isinstance(dataset, IndexDataset)
    assert dataset.ids() == ["a", "b"]
    assert dataset.category("a") == "StorageFurniture"
    assert [k.status for k in dataset.known("a")] == ["plain", "plain", "plain", "frozen"]


def test_compound_joints_are_known_as_such(tmp_path):
    path = write_index(tmp_path)
    path.write_text(path.read_text().replace('"frozen"', '"compound"'))
    known = IndexDataset(path, tmp_path).known("cupboard_77")
    assert [k.status for k in known].count("compound") == 1


def test_the_paths_of_an_index_may_start_elsewhere(tmp_path):
    path = write_index(tmp_path / "data")
    moved = path.rename(tmp_path / "assets.json")
    assert len(open_dataset(str(moved), tmp_path / "data").load("cupboard_77").parts) == 5
    with pytest.raises(AssetError):
        open_dataset(str(moved)).load("cupboard_77")


def test_meshes_that_were_scaled_without_their_joints_are_taken_in_the_size_of_the_truth(tmp_path):
    path = write_index(tmp_path)
    home = tmp_path / "objects" / "cupboard_77"
    trimesh.creation.box(extents=(1.0, 1.2, 1.0)).export(home / "body.obj")
    urdf = home / "mobility.urdf"
    box = '<box size="1.0 1.2 1.0"/>'
    assert box in urdf.read_text()
    scaled = urdf.read_text().replace(box, '<mesh filename="body.obj" scale="0.1 0.1 0.1"/>')
    urdf.write_text(scaled)
    body = IndexDataset(path, tmp_path).load("cupboard_77").part("link_0")
    assert np.ptp(body.bounds, axis=0) == pytest.approx([1.0, 1.2, 1.0])


def test_a_folder_offers_every_urdf_in_it(tmp_path):
    write_index(tmp_path, ("a", "b"))
    dataset = open_dataset(str(tmp_path))
    assert isinstance(dataset, FolderDataset)
    assert dataset.ids() == ["objects/a/mobility", "objects/b/mobility"]
    assert dataset.category("objects/a/mobility") == "unknown"
    assert len(dataset.load("objects/a/mobility").joints) == 3


def test_a_library_is_opened_by_name():
    dataset = open_dataset("procedural")
    assert isinstance(dataset, LibraryDataset)
    assert "laptop-0000" in dataset.ids()
    assert [k.kind for k in dataset.known("laptop-0000")] == ["revolute"]
    assert dataset.category("laptop-0000") == "Laptop"


def test_semantic_names_are_read_from_beside_the_urdf(tmp_path):
    write_index(tmp_path)
    names = semantic_names(tmp_path / "objects" / "cupboard_77")
    assert names["link_1"] == "translation_drawer"
    assert semantic_names(tmp_path) == {}


def test_a_data_set_that_is_nowhere_is_refused(error_line):
    error_line('open_dataset("procedurel")', lambda: open_dataset("procedurel"))


def test_a_file_that_is_no_index_is_refused(tmp_path, error_line):
    path = tmp_path / "list.json"
    path.write_text("[]")
    error_line('open_dataset("list.json")', lambda: open_dataset(str(path)))


def test_an_index_without_truth_is_refused(tmp_path, error_line):
    path = tmp_path / "empty.json"
    path.write_text('{"assets": []}')
    error_line('open_dataset("empty.json")', lambda: open_dataset(str(path)))


def test_a_folder_without_urdf_is_refused(tmp_path, error_line):
    (tmp_path / "bare").mkdir()
    error_line('open_dataset("bare")', lambda: open_dataset(str(tmp_path / "bare")))


@pytest.mark.parametrize("key", ["id", "path", "truth_joints"])
def test_an_entry_that_lacks_something_is_refused_when_the_index_is_read(tmp_path, key, error_line):
    path = write_index(tmp_path)
    content = json.loads(path.read_text())
    del content["assets"][0][key]
    path.write_text(json.dumps(content))
    error_line(f'open_dataset("assets.json"), {key} missing', lambda: open_dataset(str(path)))


@pytest.mark.parametrize(
    ("told", "meant"),
    [('"prismatic"', '"hinge"'), ('"upper": 0.5', '"upper": "far"'), ("[-1, 0, 0]", '["x", 0, 0]')],
)
def test_a_true_joint_that_is_none_costs_one_object(tmp_path, told, meant):
    path = write_index(tmp_path)
    path.write_text(path.read_text().replace(told, meant))
    with pytest.raises(AssetError, match="a true joint of the index"):
        IndexDataset(path, tmp_path).known("cupboard_77")


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
def test_an_index_with_a_number_that_is_not_finite_is_rejected(tmp_path, number):
    path = write_index(tmp_path)
    path.write_text(path.read_text().replace('"upper": 0.5', f'"upper": {number}'))
    with pytest.raises(ConfigError, match="not JSON"):
        IndexDataset(path, tmp_path)


def test_a_name_that_is_too_long_is_refused():
    with pytest.raises(ConfigError, match="too long"):
        open_dataset("x" * 300)


def test_a_true_joint_that_cannot_be_read_is_told(tmp_path, error_line):
    path = write_index(tmp_path)
    path.write_text(path.read_text().replace('"axis": [-1, 0, 0], ', ""))
    error_line(
        "IndexDataset(joint without axis).known()",
        lambda: IndexDataset(path, tmp_path).known("cupboard_77"),
    )


def test_an_id_that_stands_twice_in_an_index_is_refused(tmp_path, error_line):
    path = write_index(tmp_path)
    content = json.loads(path.read_text())
    content["assets"].append(content["assets"][0])
    path.write_text(json.dumps(content))
    error_line('open_dataset("assets.json"), an id twice', lambda: open_dataset(str(path)))


def test_an_index_that_is_nested_too_deeply_is_refused(tmp_path):
    path = tmp_path / "deep.json"
    path.write_text("[" * 100_000)
    with pytest.raises(ConfigError, match="nested deeper"):
        open_dataset(str(path))
