"""Every kind of defect is planted, names the parts it affects, and is counted by its result."""

import json
import shutil

import pytest
import trimesh
from lxml import etree
from tests.articulate.conversion.cabinets import write_cabinet

import defects
import planted
from articulate.assets.asset import load_asset
from articulate.assets.check_report import Check, CheckReport
from articulate.checks.descriptions import CHECKS
from articulate.checks.source import origin_of_reading
from articulate.conversion import ConvertConfig, convert
from articulate.conversion.convert import read_input

CONFIG = ConvertConfig(decompose=False, size_m=0.4)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return write_cabinet(tmp_path_factory.mktemp("source"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, source):
    return convert(source, tmp_path_factory.mktemp("made") / "cabinet", CONFIG).folder


def damage(folder, copy, kind):
    """Return the names that a defect affects, and whether object.xml or a mesh changed."""
    shutil.copytree(folder, copy)
    tree = etree.parse(str(copy / "object.xml"))
    names = planted.KINDS[kind].apply(planted.Damaged(copy, load_asset(copy), tree))
    tree.write(str(copy / "object.xml"))
    meshes = any(
        path.read_bytes() != (folder / "meshes" / path.name).read_bytes()
        for path in (copy / "meshes").iterdir()
    )
    before = etree.tostring(etree.parse(str(folder / "object.xml")), method="c14n")
    return names, meshes or etree.tostring(tree, method="c14n") != before


def test_every_kind_damages_a_cabinet_and_returns_the_affected_names(folder, tmp_path):
    asset = load_asset(folder)
    known = {x.name for x in asset.links} | {x.name for x in asset.joints}
    for k, kind in enumerate(planted.KINDS):
        names, differs = damage(folder, tmp_path / str(k), kind)
        assert (kind, bool(names), differs) == (kind, True, True)
        assert set(names) <= known


def test_a_kind_that_does_not_apply_changes_nothing(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    tree = etree.parse(str(copy / "object.xml"))
    for body in list(tree.iterfind(".//body/body")):
        body.getparent().remove(body)
    before = etree.tostring(tree)
    d = planted.Damaged(copy, load_asset(copy), tree)
    for kind in ("axis reversed", "limits absent", "link lost", "spring of 60 N or Nm that opens"):
        assert planted.KINDS[kind].apply(d) == ()
    assert etree.tostring(tree) == before


def test_checks_that_name_a_kind_exist():
    assert {c for kind in planted.KINDS.values() for c in kind.named_by} <= set(CHECKS)


def test_a_lost_link_is_rejected_and_named(folder, source, tmp_path):
    origin = origin_of_reading(read_input(source, CONFIG), CONFIG)
    names, check_report = defects.check_copy(folder, "link lost", tmp_path, origin)
    row = defects.row_of("link lost", names, check_report, 1.0)
    assert (row["planted"], row["found"], row["named"]) == (True, True, True)
    assert row["checks"] == ["loads"]
    assert list(tmp_path.iterdir()) == []


def failed(name, subject):
    check = Check(name=name, outcome="failed", subject=subject, message="why")
    return CheckReport(asset="a", verdict="rejected", reasons=("why",), checks=(check,))


@pytest.mark.parametrize(
    ("check", "subject", "named"),
    [
        ("joint_limits", "door_1", True),
        ("joint_limits", "door_11", False),  # another joint
        ("opening", "door_1", False),  # another check
    ],
)
def test_a_defect_is_named_by_its_check_and_its_joint(check, subject, named):
    row = defects.row_of("limits absent", ("door_1", "door"), failed(check, subject), 1.0)
    assert (row["found"], row["named"]) == (True, named)


def test_sums_separate_missed_unnamed_and_false_alarms():
    def row(kind, checks, *, named=False):
        return {
            "kind": kind,
            "planted": True,
            "found": bool(checks),
            "named": named,
            "checks": checks,
            "reasons": checks,
            "seconds": 2.0,
        }

    rows = {
        "a": [
            row("untouched", []),
            row("axis reversed", ["forward_kinematics"], named=True),
            row("mesh mirrored", ["visual_fidelity"], named=True),
            {**row("pivot moved by 2 % of the diagonal", []), "planted": False},
        ],
        "b": [
            row("untouched", ["opening"]),
            row("axis reversed", []),
            row("link lost", ["forward_kinematics"]),
        ],
    }
    result = defects.summarize(rows)
    assert (result["planted"], result["found"], result["named"]) == (4, 3, 2)
    assert result["false_alarms"] == {"b": ["opening"]}
    assert result["kinds"]["axis reversed"]["missed"] == ["b"]
    assert result["kinds"]["link lost"]["not_named"] == ["b"]
    assert result["kinds"]["mesh mirrored"]["by_input_only"] == 1
    assert result["kinds"]["axis reversed"]["by_input_only"] == 0
    assert (result["assets"], result["complete"]) == (2, 0)


def test_results_are_continued_after_a_kill(folder, source, tmp_path, monkeypatch):
    monkeypatch.setattr(defects, "KINDS", {"link lost": planted.KINDS["link lost"]})
    path = defects.results_of(tmp_path, folder.name)
    first = {"kind": "untouched", "planted": True, "found": False}
    path.write_text(json.dumps(first) + '\n{"kind": "link l')
    defects.run_asset((str(folder), str(source), str(tmp_path), 0.0))  # no time is left
    assert defects.read_results(path) == [first]
    defects.run_asset((str(folder), str(source), str(tmp_path), float("inf")))
    assert [row["kind"] for row in defects.read_results(path)] == ["untouched", "link lost"]
    assert defects.read_results(path)[1]["found"]


def test_the_largest_mesh_that_no_other_mesh_hides_is_damaged(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    tree = etree.parse(str(copy / "object.xml"))
    d = planted.Damaged(copy, load_asset(copy), tree)
    found = d.largest()
    assert found
    first = found[0]
    first.addnext(etree.fromstring(etree.tostring(first)))  # the same mesh once more hides both
    found = d.largest()
    assert found
    second = found[0]
    assert first.get("mesh") != second.get("mesh")
    assert first.getparent().get("name") == "body"
    assert second.getparent().get("name") in {"drawer", "door"}


def test_a_mirror_image_that_looks_the_same_is_no_defect(tmp_path):
    path = tmp_path / "pot.obj"
    pot = trimesh.creation.cylinder(radius=0.2, height=0.1, sections=500)
    pot.apply_translation((0.0, 0.0, 0.05))
    pot.export(path)
    before = path.read_bytes()
    assert not planted._vertices(path, lambda p: p * [-1.0, 1.0, 1.0], flip=True)
    assert path.read_bytes() == before
    assert planted._vertices(path, lambda p: p * [1.0, 1.0, -1.0], flip=True)
    mirrored = trimesh.load_mesh(path)
    assert mirrored.bounds[0, 2] == pytest.approx(-0.1)
    assert mirrored.volume == pytest.approx(pot.volume)
