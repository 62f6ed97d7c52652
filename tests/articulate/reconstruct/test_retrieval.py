from __future__ import annotations

import numpy as np
import pytest
import trimesh

from articulate.errors import UsageError
from articulate.reconstruct import retrieval
from articulate.reconstruct.retrieval import read_index, render_views, write_entry
from articulate.render.parts import plain_part

SIZES = {"tall": (0.4, 0.4, 2.0), "wide": (0.5, 2.0, 0.4), "cube": (1.0, 1.0, 1.0)}


def block(name, scale=1.0):
    mesh = trimesh.creation.box(scale * np.array(SIZES[name]))
    return [plain_part(name, np.asarray(mesh.vertices), np.asarray(mesh.faces))]


@pytest.fixture(autouse=True)
def plain_features(monkeypatch):
    """Features from the size of a crop instead of a network, whose package may be absent."""

    def classify(crops):
        sizes = np.array([crop.shape[:2] for crop in crops], dtype=np.float64)
        return np.zeros((len(crops), 1000)), np.pad(sizes, ((0, 0), (0, 1278)))

    monkeypatch.setattr(retrieval, "classify", classify)


@pytest.fixture(scope="module")
def entries(tmp_path_factory):
    return {name: tmp_path_factory.mktemp("index") / f"{name}.npz" for name in SIZES}


@pytest.fixture
def index(entries):
    for name, path in entries.items():
        if not path.is_file():
            write_entry(path, block(name))
    return read_index(entries)


@pytest.mark.parametrize("name", SIZES)
def test_the_object_of_the_image_is_the_first_unless_it_is_excluded(index, name):
    images, masks = render_views(block(name, scale=3.0))
    ranked = index.rank(images[3], masks[3])
    assert ranked[0].object_id == name
    assert ranked[0].score >= ranked[1].score >= ranked[2].score
    others = index.rank(images[3], masks[3], exclude=[name])
    assert {c.object_id for c in others} == {*SIZES} - {name}


def test_an_empty_mask_and_an_empty_index_are_rejected(index):
    images, masks = render_views(block("cube"))
    with pytest.raises(UsageError, match="no object is in the image"):
        index.rank(images[0], np.zeros_like(masks[0]))
    with pytest.raises(UsageError, match="exclude fewer"):
        index.rank(images[0], masks[0], exclude=[*SIZES])
    with pytest.raises(UsageError, match="holds no object"):
        read_index({})


def test_a_file_that_is_no_entry_is_rejected(tmp_path):
    path = tmp_path / "a.npz"
    path.write_bytes(b"no entry")
    with pytest.raises(UsageError, match="no entry of an index"):
        read_index({"a": path})
