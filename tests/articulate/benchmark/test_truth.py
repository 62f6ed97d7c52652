from __future__ import annotations

import numpy as np
import pytest
from tests.articulate.benchmark.objects import cupboard, write_index

from articulate.benchmark.dataset import FolderDataset, LibraryDataset
from articulate.benchmark.known_joint import KnownJoint
from articulate.benchmark.truth import joints_in_urdf, true_object
from articulate.errors import AssetError
from articulate.formats.read_urdf import read_urdf
from articulate.library import ProceduralLibrary
from articulate.reconstruct.link_meshes import link_poses
from articulate.render.parts import joint_bounds


def joint_of(subject, part):
    return next(j for j in subject.joints if j.joint.part == part)


def test_the_object_stands_on_the_ground_with_its_front_to_plus_x(tmp_path):
    subject = cupboard(tmp_path)
    assert joint_bounds(subject.parts)[0, 2] == pytest.approx(0.0)
    drawer = joint_of(subject, "link_1").joint
    assert drawer.axis_o == pytest.approx((1.0, 0.0, 0.0))
    assert (drawer.lower, drawer.upper) == (0.0, 0.5)
    # The lowest point is at 0.45 in the URDF, below the flap at 0.6.
    assert joint_of(subject, "link_2").joint.pivot_o == pytest.approx((0.55, -0.6, 0.8 - 0.5))


def test_what_hangs_on_a_part_moves_along_and_what_is_fixed_to_it_is_the_part(tmp_path):
    subject = cupboard(tmp_path)
    assert joint_of(subject, "link_2").moves == ("link_2", "link_3")
    assert joint_of(subject, "link_2").rigid == ("link_2",)
    assert joint_of(subject, "link_2").joint.parent == "link_0"


def test_joints_that_the_urdf_has_frozen_count(tmp_path):
    subject = cupboard(tmp_path)
    flap = joint_of(subject, "link_4")
    assert flap.status == "frozen"
    assert flap.joint.kind == "revolute"
    assert flap.rigid == ("link_4",)


def test_a_part_fixed_to_a_moving_one_belongs_to_it(tmp_path):
    path = write_index(tmp_path).parent / "objects" / "cupboard_77" / "mobility.urdf"
    text = path.read_text().replace('type="continuous"', 'type="fixed"')
    path.write_text(text)
    source = read_urdf(path)
    known = [k for k in joints_in_urdf(source) if k.link == "link_2"]
    subject = true_object(source, known, object_id="a", category="b", labels={}, in_metres=False)
    assert subject.joints[0].rigid == ("link_2", "link_3")


def test_objects_in_metres_are_scaled_to_the_size_of_the_data_set():
    dataset = LibraryDataset("procedural", ProceduralLibrary(1))
    subject = dataset.load("chest_of_drawers-0000")
    low, high = joint_bounds(subject.parts)
    assert np.linalg.norm(high - low) == pytest.approx(2.0)
    drawers = [j.joint for j in subject.joints if j.joint.kind == "prismatic"]
    assert len(drawers) >= 2
    for drawer in drawers:
        assert drawer.axis_o == pytest.approx((1.0, 0.0, 0.0))
        assert drawer.upper == pytest.approx(0.8, abs=0.4)


def test_the_joints_of_a_urdf_are_in_the_frame_of_its_root(tmp_path):
    write_index(tmp_path)
    dataset = FolderDataset(tmp_path)
    known = {k.link: k for k in dataset.known(dataset.ids()[0])}
    assert known["link_3"].kind == "continuous"
    assert known["link_3"].origin_s == pytest.approx((-0.55, 0.6, 0.8))
    assert set(known) == {"link_1", "link_2", "link_3"}


LINK = '<link name="{0}"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
JOINT = (
    '<joint name="to_{1}" type="{2}"><parent link="{0}"/><child link="{1}"/>'
    '<axis xyz="0 0 1"/>{3}</joint>'
)


def write_urdf(folder, links, joints):
    """A URDF of cubes; joints are (parent, child, type, what else stands in them)."""
    path = folder / "cubes.urdf"
    body = [*(LINK.format(name) for name in links), *(JOINT.format(*joint) for joint in joints)]
    path.write_text(f'<robot name="r">{"".join(body)}</robot>')
    return path


def test_swapped_limits_are_put_in_order(tmp_path):
    swapped = '<limit lower="1.5" upper="0"/>'
    write_urdf(tmp_path, "ab", [("a", "b", "revolute", swapped)])
    joint = FolderDataset(tmp_path).load("cubes").joints[0].joint
    assert (joint.lower, joint.upper) == (0.0, 1.5)


def test_what_moves_by_a_joint_that_is_not_scored_is_neither_fixed_nor_part_of_another(tmp_path):
    limit = '<limit lower="0" upper="1"/>'
    joints = [
        ("a", "b", "revolute", limit),
        ("a", "c", "revolute", f'{limit}<mimic joint="to_b"/>'),
        ("c", "d", "fixed", ""),
        ("b", "e", "planar", ""),
        ("b", "f", "fixed", ""),
    ]
    write_urdf(tmp_path, "abcdef", joints)
    subject = FolderDataset(tmp_path).load("cubes")
    (joint,) = subject.joints
    assert subject.carried == {"c", "d", "e"}
    assert set(joint.rigid) == {"b", "f"}
    assert set(joint.moves) == {"b", "e", "f"}


def test_a_moving_stand_in_for_a_frozen_joint_belongs_to_its_part(tmp_path):
    joints = [("a", "b", "fixed", ""), ("b", "knob", "continuous", "")]
    source = read_urdf(write_urdf(tmp_path, ("a", "b", "knob"), joints))
    frozen = KnownJoint(
        link="b", kind="continuous", axis_s=(0, 0, 1), origin_s=(0, 0, 0), lower=None, upper=None
    )
    subject = true_object(source, [frozen], object_id="", category="", labels={}, in_metres=False)
    assert subject.joints[0].rigid == ("b", "knob")


def test_a_joint_that_moves_what_is_not_declared_is_refused(tmp_path, error_line):
    write_urdf(tmp_path, "a", [("a", "ghost", "continuous", "")])
    dataset = FolderDataset(tmp_path)
    error_line("FolderDataset(joint of an undeclared link).known()", lambda: dataset.known("cubes"))


def test_a_moving_link_without_geometry_is_refused(tmp_path, error_line):
    path = write_index(tmp_path).parent / "objects" / "cupboard_77" / "mobility.urdf"
    text = path.read_text()
    start = text.index('<link name="link_4">')
    end = text.index("</link>", start)
    path.write_text(text[:start] + '<link name="link_4">' + text[end:])
    source = read_urdf(path)
    flap = next(k for k in joints_in_urdf(source) if k.link == "link_1")
    bare = type(flap)(**{**flap.__dict__, "link": "link_4"})
    error_line(
        "true_object(URDF whose moving link_4 shows nothing)",
        lambda: true_object(
            source, [bare], object_id="a", category="b", labels={}, in_metres=False
        ),
    )


def test_a_slide_and_a_turn_in_a_row_are_compound_and_both_move_the_visible_part(tmp_path):
    joints = [("a", "helper", "prismatic", '<limit lower="0" upper="1"/>')]
    joints += [("helper", "cap", "continuous", "")]
    path = write_urdf(tmp_path, ("a", "helper", "cap"), joints)
    text = path.read_text()
    start = text.index('<link name="helper">')
    end = text.index("</link>", start)
    path.write_text(text[:start] + '<link name="helper">' + text[end:])
    slide, turn = FolderDataset(tmp_path).load("cubes").joints
    assert (slide.joint.kind, turn.joint.kind) == ("prismatic", "continuous")
    assert slide.rigid == turn.rigid == ("cap",)
    assert slide.status == turn.status == "compound"


def test_a_cycle_of_joints_is_refused(tmp_path):
    path = tmp_path / "cycle.urdf"
    path.write_text(
        '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>'
    )
    with pytest.raises(AssetError, match="cycle"):
        link_poses(read_urdf(path))
