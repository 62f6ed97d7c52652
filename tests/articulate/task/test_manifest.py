import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.assets import make_cabinet

from articulate.errors import BundleError
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.task.manifest import (
    ControllerEntry,
    EpisodesEntry,
    EstimatorEntry,
    FingersEntry,
    Golden,
    Manifest,
    PolicyEntry,
    SceneEntry,
    StartEntry,
    Training,
    decode_manifest,
    encode_manifest,
    limit_table_sha256,
    with_files,
)
from articulate.task.object_placement import ObjectPlacement
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import make_task

JOINT = "drawer_1_slide"


@pytest.fixture(scope="module")
def manifest(tmp_path_factory):
    asset = make_cabinet(tmp_path_factory.mktemp("cabinet"))
    place = ObjectPlacement(
        pos_w=(0.7, 0.0, 0.1),
        yaw_rad=0.25,
        flip=True,
        start_q=PANDA.home,
        joint_margin_rad=0.2,
        manipulability=0.1,
        reachable_share=1.0,
    )
    return Manifest(
        name="cabinet",
        created_utc="2026-01-01T00:00:00Z",
        producer={"mujoco": "3.9.0"},
        licences={"object": "MIT"},
        files={"policy.onnx": "00"},
        policy=PolicyEntry(opset=18),
        control=ControlConfig(),
        controller=ControllerEntry(trained_delay_steps=(0, 2)),
        observation=OBSERVATION,
        action=ACTION,
        robot=PANDA,
        limit_table_sha256=limit_table_sha256(PANDA),
        start=StartEntry(q=PANDA.home, tolerance_rad=0.1, gripper_width_m=0.08),
        task=make_task("open_drawer", asset, JOINT),
        placement=place,
        object=asset,
        object_sha256=asset.content_id(),
        scene=SceneEntry(
            timestep_s=0.005,
            scale=1.0,
            arm_joints=("joint1",),
            finger_joints=("a", "b"),
            finger_geoms=("pad",),
            tool_site="tool",
            object_prefix="object/",
            object_root="object/carcass",
            sensors=("x", "y", "z"),
            counterbalanced=(),
            fingers=FingersEntry(
                stiffness_n_m=2000.0,
                damping_n_s_m=40.0,
                force_n=40.0,
                passive_damping_n_s_m=20.0,
                friction_n=0.5,
                sliding_friction=1.0,
                spin_friction_m=0.02,
            ),
        ),
        estimator=EstimatorEntry(needs=("T_wh",), rate_hz=20.0, max_age_s=0.1),
        randomization=RandomizationConfig(),
        episodes=EpisodesEntry(seed=1),
        training=Training(
            run="r", seed=0, seed_rule="given", steps=1, config_sha256="", success=None
        ),
        golden=Golden(),
    )


def changed(manifest, edit):
    """The manifest's text after ``edit`` of its content, all else as it was."""
    content = json.loads(encode_manifest(manifest))
    edit(content)
    return json.dumps(content)


def put(key, value):
    def edit(content):
        *parents, last = key.split(".")
        for parent in parents:
            content = content[parent]
        content[last] = value

    return edit


def take(key):
    def edit(content):
        *parents, last = key.split(".")
        for parent in parents:
            content = content[int(parent) if parent.isdigit() else parent]
        del content[last]

    return edit


def test_a_manifest_reads_back_as_it_was_written(manifest):
    read = decode_manifest(encode_manifest(manifest), "manifest.json")
    bare = dataclasses.replace(manifest.object, folder=read.object.folder)
    assert read == dataclasses.replace(manifest, object=bare)


def test_what_is_read_gives_the_same_handle_as_the_asset(manifest):
    read = decode_manifest(encode_manifest(manifest), "manifest.json")
    q = np.linspace(0.0, 0.2, 3)
    assert_allclose(read.object.T_oh(JOINT, q), manifest.object.T_oh(JOINT, q), rtol=0, atol=0)


def test_a_manifest_names_no_folder_of_the_machine_it_was_made_on(manifest):
    assert str(manifest.object.folder) not in encode_manifest(manifest)


def test_it_is_read_back_whatever_its_order_of_keys(manifest):
    content = json.loads(encode_manifest(manifest))
    text = json.dumps(content, sort_keys=True)
    assert decode_manifest(text, "m") == decode_manifest(encode_manifest(manifest), "m")


@pytest.mark.parametrize(
    ("what", "edit"),
    [
        ("unknown key", put("roboot", 1)),
        ("unknown nested key", put("control.omega", 9.0)),
        ("missing nested key", take("robot.gripper.dwell_s")),
        ("missing key of a field", take("observation.0.low")),
        ("changed number", put("control.step_rad", 0.5)),
        ("number of another kind", put("task.target", "far")),
        ("folder of the object", put("object.folder", "/etc")),
        ("other version", put("schema_version", 99)),
        ("other schema", put("schema", "lerobot")),
        ("other law", put("controller.law", "torque")),
        ("slice that does not fit", lambda c: c["observation"][1].update(slice=[0, 7])),
        ("content id", put("content_id", "0" * 64)),
    ],
)
def test_what_is_not_as_exported_is_refused_in_one_line(manifest, what, edit, error_line):
    text = changed(manifest, edit)
    error_line(f"decode_manifest: {what}", lambda: decode_manifest(text, "manifest.json"))


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{", '{"schema": 1, "schema": 1}', '{"schema": NaN}', "[" * 100_000],
    ids=["empty", "list", "cut", "doubled", "nan", "deep"],
)
def test_what_is_no_manifest_is_refused(text):
    with pytest.raises(BundleError, match="manifest"):
        decode_manifest(text, "m")


def test_sums_are_taken_of_every_file(manifest):
    sums = with_files(manifest, {"b": b"", "a": b"x"}).files
    assert list(sums) == ["a", "b"]
    assert sums["b"] == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


def test_the_sum_of_limits_changes_with_every_limit_and_with_no_gain():
    own = limit_table_sha256(PANDA)
    gains = dataclasses.replace(PANDA, stiffness=PANDA.damping)
    assert limit_table_sha256(gains) == own
    faster = dataclasses.replace(PANDA, dq_max=(9.0, *PANDA.dq_max[1:]))
    assert limit_table_sha256(faster) != own
