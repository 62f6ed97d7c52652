from __future__ import annotations

import numpy as np
import pytest
from tests.articulate.benchmark.objects import cupboard, write_index

from articulate.benchmark.dataset import FolderDataset, LibraryDataset
from articulate.benchmark.truth import joints_in_urdf, link_poses, true_object
from articulate.convert.read import read_urdf
from articulate.errors import AssetError
from articulate.library import ProceduralLibrary
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


def test_a_cycle_of_joints_is_refused(tmp_path):
    path = tmp_path / "cycle.urdf"
    path.write_text(
        '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>'
    )
    with pytest.raises(AssetError, match="cycle"):
        link_poses(read_urdf(path))
