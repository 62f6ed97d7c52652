"""Where the category of an object stands."""

import json

import pytest

from articulate.convert.config import ConvertConfig
from articulate.convert.size import category_of


@pytest.mark.parametrize(
    ("files", "config", "expected"),
    [
        ({}, ConvertConfig(), "unknown"),
        ({"source.json": {"category": "Box"}}, ConvertConfig(), "Box"),
        ({"meta.json": {"model_cat": "Door"}}, ConvertConfig(), "Door"),
        ({"meta.json": {"model_cat": "Door"}, "source.json": {"category": "Box"}}, None, "Door"),
        ({"source.json": {"category": 3}}, ConvertConfig(), "unknown"),
        ({"source.json": {"category": "Box"}}, ConvertConfig(category="Safe"), "Safe"),
    ],
)
def test_the_category_is_asked_for_or_stands_beside_the_file(files, config, expected, tmp_path):
    for name, content in files.items():
        (tmp_path / name).write_text(json.dumps(content))
    assert category_of(tmp_path / "object.urdf", config or ConvertConfig()) == expected
