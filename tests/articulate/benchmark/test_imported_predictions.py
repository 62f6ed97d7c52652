from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.benchmark.objects import cupboard, write_index

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.imported_part import InvalidOutputError
from articulate.benchmark.imported_predictions import ImportedActor, box_overlap, validity
from articulate.benchmark.real2code import read_real2code, write_real2code
from articulate.benchmark.run import run_object
from articulate.benchmark.urdformer import read_urdformer
from articulate.commands.benchmark import main
from articulate.errors import UsageError

SMALL = BenchmarkConfig(actor="x", modality="image", width_px=64, height_px=48)
LINK = '<link name="{name}"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
JOINT = (
    '<joint name="{parent}_{child}" type="revolute">'
    '<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
    '<limit lower="0" upper="1"/></joint>'
)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    """The cupboard with its drawer and its door only, whose axes are those of their boxes."""
    full = cupboard(tmp_path_factory.mktemp("data"))
    names = ("link_0", "link_1", "link_2")
    return replace(
        full,
        parts=tuple(p for p in full.parts if p.name in names),
        joints=tuple(
            replace(j, rigid=tuple(r for r in j.rigid if r in names))
            for j in full.joints
            if j.joint.part in names
        ),
    )


def outcomes(subject, folder, form):
    source = f"{form}:{folder}"
    actor = ImportedActor(source, subject.object_id)
    record = run_object(subject, actor, replace(SMALL, actor=source))
    (case,) = record["cases"]
    found = {
        j["joint"]: None if j["errors"] is None else j["errors"]["origin_paper"]
        for j in case["joints"]
    }
    return {j["joint"]: j["failures"]["paper"] for j in case["joints"]}, found, case


def urdf(tmp_path, links, joints=()):
    body = "".join(LINK.format(name=name) for name in links)
    body += "".join(JOINT.format(parent=parent, child=child) for parent, child in joints)
    path = tmp_path / "a.urdf"
    path.write_text(f'<robot name="r">{body}</robot>')
    return path


def raw(parents=(0, 0)):
    """A drawer above a door whose hinge is at the right, as the network writes them."""
    n = len(parents)
    relations = np.zeros((n + 1, n + 1, 6))
    for child, parent in enumerate(parents):
        relations[child + 1, parent, 2] = 1.0
    return {
        "part_bases": [1],
        "part_meshes": [[1, 3]],
        "part_positions_start": [[[0, 8], [12, 0]]],
        "part_positions_end": [[[12, 12], [0, 8]]],
        "part_relations": [relations.tolist()],
    }


@pytest.mark.parametrize(
    ("links", "joints", "reason"),
    [
        (("a", "a"), (), "repeated_link"),
        (("a", "b"), (("a", "b"), ("b", "a")), "cycle"),
        (("a", "b", "c"), (("a", "c"), ("b", "c")), "cycle"),
        ((), (), "syntax"),
    ],
)
def test_a_urdf_without_a_tree_of_links_is_invalid(tmp_path, links, joints, reason):
    with pytest.raises(InvalidOutputError) as caught:
        read_urdformer(urdf(tmp_path, links, joints))
    assert caught.value.reason == reason


def test_a_raw_output_becomes_the_boxes_and_joints_of_the_released_code(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(raw()))
    body, drawer, door = read_urdformer(path)
    assert np.allclose(np.ptp(body.corners, axis=0), 1.0)
    assert (drawer.kind, drawer.lower, drawer.upper) == ("prismatic", 0.0, 0.4)
    assert np.allclose(drawer.corners.min(axis=0)[1:], [0.0, 8 / 12])
    assert (door.kind, door.lower, door.upper) == ("revolute", 0.0, 1.57)
    assert door.pivot is not None
    assert np.allclose(door.pivot, [0.0, 1.0, 0.0])


def test_a_part_that_is_its_own_ancestor_is_a_cycle(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(raw(parents=(2, 1))))
    with pytest.raises(InvalidOutputError) as caught:
        read_urdformer(path)
    assert caught.value.reason == "cycle"


@pytest.mark.parametrize(
    "change", [{"part_bases": []}, {"part_meshes": [[1, 12]]}, {"part_relations": [[]]}]
)
def test_a_raw_output_of_another_form_is_invalid(tmp_path, change):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(raw() | change))
    with pytest.raises(InvalidOutputError) as caught:
        read_urdformer(path)
    assert caught.value.reason == "syntax"


def test_a_raw_output_is_matched_and_scored(tmp_path, subject):
    low, high = subject.box_of(p.name for p in subject.parts)
    boxes = {}
    for name in ("link_1", "link_2"):
        bounds = subject.part(name).bounds
        boxes[name] = 12.0 * (bounds - low) / (high - low)
    hinge = next(j for j in subject.joints if j.joint.part == "link_2").joint
    right = hinge.pivot_o[1] > subject.part("link_2").centre[1]
    (_, y0, z0), (_, y1, z1) = boxes["link_2"]
    start, end = ([y1, z0], [y0, z1]) if right else ([y0, z0], [y1, z1])
    content = raw()
    content["part_meshes"] = [[1, 3 if right else 2]]
    content["part_positions_start"] = [[boxes["link_1"][0, 1:].tolist(), start]]
    content["part_positions_end"] = [[boxes["link_1"][1, 1:].tolist(), end]]
    (tmp_path / f"{subject.object_id}.json").write_text(json.dumps(content))
    failures, _, case = outcomes(subject, tmp_path, "urdformer")
    assert set(failures.values()) <= {"success", "joint_limit", "joint_origin"}
    assert case["false_positives"] == 0


def test_true_joints_in_the_format_of_real2code_are_found_again(tmp_path, subject):
    joints = {j.joint.part: j.joint for j in subject.joints}
    text = write_real2code(
        [p.bounds for p in subject.parts], [joints.get(p.name) for p in subject.parts]
    )
    path = tmp_path / f"{subject.object_id}.txt"
    path.write_text(text)
    body, *others = read_real2code(path)
    assert body.kind == "fixed"
    assert [part.kind for part in others] == ["prismatic", "revolute"]
    failures, origins, case = outcomes(subject, tmp_path, "real2code")
    assert set(failures.values()) <= {"success", "joint_limit"}
    assert origins["link_2"] < 0.05
    assert case["false_positives"] == 0


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("child_joints", "children", "syntax"),
        ("box=2", "box=1", "repeated_link"),
        ("box=2", "box=0", "cycle"),
        ("box=2", "box=9", "syntax"),
        ("'hinge'", "'ball'", "syntax"),
        ("dict(box=2", "__import__('os')(box=2", "syntax"),
        ("2:{", "1:{", "repeated_link"),
    ],
)
def test_damaged_outputs_of_real2code_are_invalid(tmp_path, subject, old, new, reason):
    joints = {j.joint.part: j.joint for j in subject.joints}
    text = write_real2code(
        [p.bounds for p in subject.parts], [joints.get(p.name) for p in subject.parts]
    )
    assert old in text
    path = tmp_path / "a.txt"
    path.write_text(text.replace(old, new))
    with pytest.raises(InvalidOutputError) as caught:
        read_real2code(path)
    assert caught.value.reason == reason


def test_boxes_in_the_image_are_matched_with_the_masks_of_links(tmp_path, subject):
    content = raw() | {"part_normalized_bbox": [[0.0, 0.0, 0.01, 0.01], [0.0, 0.0, 1.0, 1.0]]}
    (tmp_path / f"{subject.object_id}.json").write_text(json.dumps(content))
    _, _, case = outcomes(subject, tmp_path, "urdformer")
    assert case["false_positives"] >= 1  # the drawer's box contains no link


def test_overlap_of_boxes():
    one = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    two = np.array([[5.0, 0.5, 0.0], [6.0, 1.5, 1.0]])
    assert box_overlap(one, two, front=True) == pytest.approx(1 / 3)
    assert box_overlap(one, two, front=False) == 0.0


def test_outputs_are_counted_and_scored_in_one_command(tmp_path, capsys):
    index = write_index(tmp_path, ("a",))
    folder = tmp_path / "outputs"
    folder.mkdir()
    (folder / "a.json").write_text(json.dumps(raw()))
    (folder / "other.json").write_text("{")
    out = tmp_path / "out"
    argv = [str(index), "--predictions", f"urdformer:{folder}", "--out", str(out), "--json"]
    assert main([*argv, "--width-px", "64", "--height-px", "48"]) == 0
    found = json.loads(capsys.readouterr().out)["predictions"]
    assert (found["files"], found["valid"], found["without_object"]) == (2, 1, 1)
    assert found["invalid"] == {"syntax": 1, "repeated_link": 0, "cycle": 0}
    assert "Imported outputs" in (out / "report.html").read_text()


def test_a_folder_without_outputs_is_an_error(tmp_path):
    with pytest.raises(UsageError, match="holds no file"):
        validity(f"real2code:{tmp_path}", ())


@pytest.mark.parametrize("source", ["urdformer:nowhere", "urdforme:x", "real2code"])
def test_predictions_that_do_not_exist_are_rejected(tmp_path, source, error_line):
    index = write_index(tmp_path, ("a",))
    error_line(
        f"articulate benchmark assets.json --predictions {source}",
        lambda: main([str(index), "--out", str(tmp_path / "out"), "--predictions", source]),
    )
