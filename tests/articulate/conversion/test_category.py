"""Sources of the category of an object."""

import json

import pytest

from articulate.conversion.metric_size import category_of, is_normalised
from articulate.formats.config import ConvertConfig


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
def test_the_category_is_configured_or_beside_the_file(files, config, expected, tmp_path):
    for name, content in files.items():
        (tmp_path / name).write_text(json.dumps(content))
    assert category_of(tmp_path / "object.urdf", config or ConvertConfig()) == expected


@pytest.mark.parametrize(
    ("name", "beside", "expected"),
    [
        ("mobility.urdf", {}, True),
        ("cabinet.urdf", {"meta.json": '{"model_cat": "Box"}'}, True),
        ("cabinet.urdf", {}, False),
        ("cabinet.urdf", {"meta.json": '{"author": "me"}'}, False),
        ("cabinet.urdf", {"meta.json": '{"model_cat": null}'}, False),
        ("cabinet.urdf", {"meta.json": "[" * 100_000}, False),
        ("cabinet.urdf", {"semantics.txt": "a", "bounding_box.json": "{}"}, False),
    ],
)
def test_only_what_the_data_set_calls_its_own_is_of_no_size(name, beside, expected, tmp_path):
    for file, text in beside.items():
        (tmp_path / file).write_text(text)
    assert is_normalised(tmp_path / name) is expected
