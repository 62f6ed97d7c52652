"""Categories from renders of a user's library: regression, cache, command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from articulate.commands.make import MakeFlags
from articulate.errors import UsageError
from articulate.library.partnet import URDF_NAME
from articulate.library.procedural.library import ProceduralLibrary
from articulate.reconstruct.recognition import library_index
from articulate.reconstruct.recognition.categories import category_probabilities
from articulate.reconstruct.recognition.classifier import FEATURES
from articulate.reconstruct.recognition.library_index import (
    RIDGE,
    TEMPERATURE,
    VIEWS,
    LibraryIndex,
    open_index,
)
from articulate.transforms import Array

NAMES = {"1": "Box", "2": "Bucket", "3": "Box", "4": "Oven"}


def clusters(spread: float = 0.3) -> LibraryIndex:
    """Return objects whose views lie around one direction for each category."""
    rng = np.random.default_rng(0)
    axes = {name: np.eye(FEATURES)[k] for k, name in enumerate(sorted(set(NAMES.values())))}
    noise = spread / np.sqrt(FEATURES) * rng.normal(size=(len(NAMES), VIEWS, FEATURES))
    features = np.stack([np.tile(axes[name], (VIEWS, 1)) for name in NAMES.values()]) + noise
    features /= np.linalg.norm(features, axis=2, keepdims=True)
    return LibraryIndex(ids=tuple(NAMES), categories=tuple(NAMES.values()), features=features)


def test_the_regression_is_the_solution_of_the_augmented_least_squares() -> None:
    index = clusters()
    x = index.features.reshape(-1, FEATURES)
    kinds = sorted(set(NAMES.values()))
    y = np.eye(3)[np.repeat([kinds.index(name) for name in NAMES.values()], VIEWS)]
    rows = np.vstack([x - x.mean(axis=0), np.sqrt(RIDGE) * np.eye(FEATURES)])
    weight = np.linalg.lstsq(rows, np.vstack([y - y.mean(axis=0), np.zeros((FEATURES, 3))]))[0]
    query = np.random.default_rng(1).random(FEATURES)
    scores = y.mean(axis=0) + (query / np.linalg.norm(query) - x.mean(axis=0)) @ weight
    expected = np.exp(scores / TEMPERATURE) / np.exp(scores / TEMPERATURE).sum()
    found = index.category_probabilities(query)
    np.testing.assert_allclose([found[name] for name in kinds], expected, rtol=1e-6)


def test_a_similar_object_gives_its_category_unless_it_is_excluded() -> None:
    index = clusters()
    for k, name in enumerate(sorted(set(NAMES.values()))):
        found = index.category_probabilities(np.eye(FEATURES)[k])
        assert max(found, key=lambda key: found[key]) == name
        assert sum(found.values()) == pytest.approx(1.0)
    assert "Oven" not in index.without({"4"}).category_probabilities(np.eye(FEATURES)[2])
    with pytest.raises(UsageError, match="exclude fewer"):
        index.without(set(NAMES))


def test_the_library_changes_the_category(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.zeros((8, 8, 3), dtype=np.uint8)
    mask = np.ones((8, 8), dtype=np.bool_)
    imagenet, features = np.full((2, 1000), 1e-3), np.eye(FEATURES)[:2]
    monkeypatch.setattr(
        "articulate.reconstruct.recognition.categories.classify", lambda _: (imagenet, features)
    )
    usual = category_probabilities(image, mask)
    found = category_probabilities(image, mask, clusters())
    assert found["Box"] > usual["Box"]
    assert max(found, key=lambda key: found[key]) == "Box"
    assert sum(found.values()) == pytest.approx(1.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of objects in the format of PartNet-Mobility; two cannot be used."""
    library = ProceduralLibrary(1)
    for number, name in {"7": "bucket", "9": "box_with_lid", "11": "bottle"}.items():
        at = tmp_path / "objects" / number
        library.write(f"{name}-0000", at).rename(at / URDF_NAME)
        meta = {"model_cat": library.category(f"{name}-0000")}
        (at / "meta.json").write_text(json.dumps(meta if number != "11" else {}))
    broken = tmp_path / "objects" / "13"
    broken.mkdir()
    (broken / URDF_NAME).write_text("<robot/>")
    (broken / "meta.json").write_text('{"model_cat": "Oven"}')
    return tmp_path / "objects"


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Replace the network by the mean colour; the list holds the number of crops of each call."""
    calls: list[int] = []

    def classify(crops: list[Array]) -> tuple[Array, Array]:
        calls.append(len(crops))
        colours = np.array([crop.mean(axis=(0, 1)) for crop in crops])
        return np.zeros((len(crops), 1000)), np.pad(colours, ((0, 0), (0, FEATURES - 3)))

    monkeypatch.setattr(library_index, "classify", classify)
    return calls


def test_objects_are_rendered_once(folder: Path, tmp_path: Path, rendered: list[int]) -> None:
    lines: list[str] = []
    first = open_index(folder, tmp_path / "cache", lines.append)
    assert first.ids == ("7", "9")
    assert first.categories == ("Bucket", "Box")
    assert first.features.shape == (2, VIEWS, FEATURES)
    assert rendered == [VIEWS, VIEWS]
    assert len(lines) == 1
    second = open_index(folder, tmp_path / "cache")
    assert rendered == [VIEWS, VIEWS]
    np.testing.assert_allclose(second.features, first.features, atol=1e-3)


def test_changed_objects_and_damaged_entries_are_rendered_again(
    folder: Path, tmp_path: Path, rendered: list[int]
) -> None:
    open_index(folder, tmp_path / "cache")
    with (folder / "7" / URDF_NAME).open("a") as stream:
        stream.write("\n")
    open_index(folder, tmp_path / "cache")
    assert len(rendered) == 3
    for path in (tmp_path / "cache" / "renders").iterdir():
        path.write_bytes(b"damaged")
    open_index(folder, tmp_path / "cache")
    assert len(rendered) == 5


def test_a_folder_without_usable_objects_is_rejected(
    folder: Path, tmp_path: Path, rendered: list[int]
) -> None:
    for path in folder.glob("*/meta.json"):
        path.unlink()
    with pytest.raises(UsageError, match="no object with a category"):
        open_index(folder, tmp_path / "cache")
    assert not rendered


def test_a_folder_of_many_recognizes_an_image_and_gives_parts_otherwise(folder: Path) -> None:
    image = Path("photo.jpg")
    assert MakeFlags(image=image, library=str(folder)).generates
    assert MakeFlags(video=image, library=str(folder)).generates
    assert not MakeFlags(text="a box", library=str(folder)).generates
    assert not MakeFlags(image=image, library=str(folder), actor="vlm").generates
    assert not MakeFlags(image=image, library=str(folder / "7")).generates
    assert not MakeFlags(image=image, library="cabinet:3").generates
    assert not MakeFlags(image=image, library="procedural").generates
