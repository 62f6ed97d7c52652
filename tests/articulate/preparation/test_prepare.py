import dataclasses
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import pytest
import trimesh
from tests.articulate.checks.objects import Part, make_object
from tests.articulate.conversion.boxes import written
from tests.articulate.conversion.cabinets import write_cabinet

from articulate.assets.asset import load_asset
from articulate.assets.check_report import Check, CheckReport
from articulate.checks.descriptions import CHECKS
from articulate.checks.run_checks import run_checks
from articulate.conversion import ConvertConfig
from articulate.errors import UsageError
from articulate.geometry.time_budget import Budget
from articulate.preparation import prepare, refine_colliders
from articulate.preparation.check_report_file import load_check_report
from articulate.preparation.prepare import check_asset, links_to_refine
from articulate.preparation.refine_colliders import Refined
from articulate.preparation.repair import RepairResult

CONFIG = ConvertConfig(decompose=False, licence="MIT")


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """Folder, proof and cache of the little cabinet; not to be changed."""
    folder = tmp_path_factory.mktemp("check")
    source = write_cabinet(folder)
    config = dataclasses.replace(CONFIG, cache_dir=folder / "cache")
    return source, folder / "out", check_asset(source, folder / "out", config), config


@pytest.mark.render
def test_a_cabinet_is_proven_with_all_its_evidence(checked):
    _, out, check_report, _ = checked
    assert check_report.reasons == ()
    assert check_report.verdict == "repaired"  # two links without inertia
    assert {c.name for c in check_report.checks} <= set(CHECKS)
    assert {
        "forward_kinematics",
        "input_kinematics",
        "joint_limits",
        "inertia",
        "cavities",
        "collision_coverage",
        "joint_sweep",
        "opening",
    } <= {c.name for c in check_report.checks if c.outcome == "passed"}
    assert [(j.name, j.blocked, j.swept) for j in check_report.joints] == [
        ("drawer_joint", False, 1.0),
        ("door_joint", False, 1.0),
    ]
    assert check_report.counts is not None
    assert check_report.counts.links == (4, 3)
    assert check_report.licence == "MIT"
    assert check_report.colliders == sum(x.collisions for x in load_asset(out).links)
    assert load_check_report(out) == check_report
    assert (out / "check_report.html").stat().st_size > 10_000


@pytest.mark.render
def test_the_same_input_is_not_checked_twice(checked, tmp_path, monkeypatch):
    source, out, check_report, config = checked
    monkeypatch.setattr(prepare, "prepare_in_cache", None)
    assert check_asset(source, tmp_path / "again", config) == check_report
    assert (tmp_path / "again" / "object.xml").read_bytes() == (out / "object.xml").read_bytes()


@pytest.mark.render
def test_an_asset_folder_is_proven_as_it_is(checked, tmp_path):
    _, out, check_report, _ = checked
    again = check_asset(out, tmp_path / "again", CONFIG)
    assert again.verdict == check_report.verdict
    assert {c.name for c in check_report.checks} - {c.name for c in again.checks} == {
        "input_kinematics",
        "visual_fidelity",
    }


@pytest.mark.render
def test_a_damaged_asset_folder_is_judged_against_its_input(checked, tmp_path):
    source, out, _, _ = checked
    assert check_asset(out, tmp_path / "whole", CONFIG, against=source).verdict == "repaired"
    shutil.copytree(out, tmp_path / "damaged")
    path = tmp_path / "damaged" / "object.xml"
    text = path.read_text()
    assert 'axis="0 0 1"' in text
    path.write_text(text.replace('axis="0 0 1"', 'axis="0 0.0872 0.9962"'))
    check_report = check_asset(tmp_path / "damaged", tmp_path / "judged", CONFIG, against=source)
    assert check_report.verdict == "rejected"
    failed = {(c.name, c.subject) for c in check_report.checks if c.outcome == "failed"}
    assert {("forward_kinematics", "door"), ("input_kinematics", "door")} <= failed


@pytest.mark.parametrize(
    ("text", "reason"),
    [("", "no XML in it"), ("<robot name='a'><link name='b'/></robot>", "no link has geometry")],
)
def test_what_cannot_be_converted_is_refused_with_a_reason(tmp_path, text, reason):
    source = tmp_path / "bad.urdf"
    source.write_text(text)
    check_report = check_asset(source, tmp_path / "out", CONFIG)
    assert check_report.verdict == "rejected"
    assert reason in check_report.reasons[0]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "check_report.html",
        "check_report.json",
    ]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.urdf", "out"]


def test_a_source_that_does_not_exist_and_an_out_in_the_way_are_usage_errors(tmp_path):
    with pytest.raises(UsageError, match="does not exist"):
        check_asset(tmp_path / "none.urdf", tmp_path / "out", CONFIG)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter").write_text("")
    with pytest.raises(UsageError, match="is not an asset"):
        check_asset(tmp_path / "none.urdf", tmp_path / "full", CONFIG)


def test_a_failed_check_rejects_with_its_name_and_joint(tmp_path):
    box = ((0.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    wall = ((0.4, 0.0, 0.0), (0.05, 0.2, 0.2))
    part = Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0), boxes=(box,))
    asset = make_object(tmp_path / "object", part, body=(wall,))
    check_report = run_checks(asset)
    assert check_report.verdict == "rejected"
    assert any(
        reason.startswith("authored_overlap of drawer_joint: ") for reason in check_report.reasons
    )
    assert {c.name for c in check_report.checks} <= set(CHECKS)
    assert check_report.joints[0].blocked


def test_an_object_without_joints_is_proven_as_rigid_and_says_so(tmp_path):
    box = ((0.0, 0.0, 0.5), (0.1, 0.2, 0.5))
    asset = make_object(tmp_path / "stone", body=(box,))
    names = {c.name: c for c in run_checks(asset).checks}
    assert "rigid" in names["rigid"].message
    assert "joint_sweep" not in names
    assert "opening" not in names


def test_a_model_that_does_not_load_is_refused(tmp_path):
    asset = make_object(tmp_path / "object")
    asset.mjcf_path.write_text("<mujoco><nonsense/></mujoco>")
    check_report = run_checks(asset)
    assert check_report.verdict == "rejected"
    assert check_report.reasons[0].startswith("loads: ")


def test_a_check_that_cannot_be_measured_is_undecided_and_leaves_the_others(tmp_path, monkeypatch):
    def broken(model):
        raise RuntimeError("over\nthere")

    monkeypatch.setattr("articulate.checks.run_checks.check_inertia", broken)
    check_report = run_checks(make_object(tmp_path / "object"))
    assert [c.outcome for c in check_report.checks if c.name == "inertia"] == ["undecided"]
    assert any(
        "could not be measured (RuntimeError: over there)" in r for r in check_report.reasons
    )
    assert any(c.name == "collision_coverage" for c in check_report.checks)


def test_every_check_is_explained_in_three_parts():
    for check in CHECKS.values():
        assert all(len(text) > 30 for text in (check.means, check.matters, check.remedy))


LEAF = """<robot name="leaf"><link name="body">{box}<visual><geometry>
<mesh filename="package://far/leaf.obj"/></geometry></visual></link></robot>"""
BOX = '<visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual>'


@pytest.fixture
def unmeasured(monkeypatch):
    """Objects are converted, and taken as proven."""
    monkeypatch.setattr(prepare, "write_page", lambda *_, **__: None)
    monkeypatch.setattr(
        prepare,
        "run_checks",
        lambda asset, *_: CheckReport(asset=asset.name, verdict="passed", repairs=asset.repairs),
    )


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("box", ["", BOX], ids=["rejected", "left out"])
@pytest.mark.parametrize("where", ["above", "named by the variable"])
def test_a_mesh_that_comes_to_another_folder_is_found_the_next_time(
    tmp_path, monkeypatch, box, where
):
    source = tmp_path / "in" / "obj" / "leaf.urdf"
    source.parent.mkdir(parents=True)
    source.write_text(LEAF.format(box=box))
    config = dataclasses.replace(CONFIG, cache_dir=tmp_path / "cache", allow_missing=True)
    if where != "above":
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    first = check_asset(source, tmp_path / "out", config)
    assert "not found" in " ".join((*first.reasons, *first.repairs))
    far = tmp_path / ("far" if where == "above" else "ros/far")
    far.mkdir(parents=True)
    trimesh.creation.box((0.3, 0.3, 0.3)).export(far / "leaf.obj")
    second = check_asset(source, tmp_path / "out", config)
    assert second.verdict == "passed"
    assert "not found" not in " ".join(second.repairs)


@pytest.mark.usefixtures("unmeasured")
def test_a_refusal_that_no_file_elsewhere_would_mend_is_kept(tmp_path, monkeypatch):
    source = tmp_path / "in" / "bad.urdf"
    source.parent.mkdir()
    source.write_text("")
    config = dataclasses.replace(CONFIG, cache_dir=tmp_path / "cache")
    first = check_asset(source, tmp_path / "out", config)
    monkeypatch.setattr(prepare, "prepare_in_cache", None)
    assert check_asset(source, tmp_path / "out", config) == first


@pytest.mark.usefixtures("unmeasured")
def test_a_damaged_mesh_that_is_mended_under_its_name_is_read_again(tmp_path):
    source = tmp_path / "in" / "leaf.urdf"
    source.parent.mkdir()
    source.write_text(LEAF.format(box=""))
    config = dataclasses.replace(CONFIG, cache_dir=tmp_path / "cache")
    mesh = source.parent / "far" / "leaf.obj"
    mesh.parent.mkdir()
    mesh.write_text("v 0 0\nf 1 2 3\n")
    assert check_asset(source, tmp_path / "out", config).verdict == "rejected"
    trimesh.creation.box((0.3, 0.3, 0.3)).export(mesh)
    assert check_asset(source, tmp_path / "out", config).verdict == "passed"


@pytest.mark.usefixtures("unmeasured")
def test_one_content_at_two_paths_is_written_by_one_call_at_a_time(tmp_path, monkeypatch):
    sources = [tmp_path / name / "obj" / "box.urdf" for name in ("one", "two")]
    for source in sources:
        source.parent.mkdir(parents=True)
        source.write_text(f'<robot name="box"><link name="body">{BOX}</link></robot>')
    config = dataclasses.replace(CONFIG, cache_dir=tmp_path / "cache")
    both, met = threading.Barrier(2), []

    def meet(asset, *_):
        try:
            both.wait(timeout=2.0)
            met.append(asset.folder)
        except threading.BrokenBarrierError:
            pass
        return CheckReport(asset=asset.name, verdict="passed")

    monkeypatch.setattr(prepare, "run_checks", meet)
    with ThreadPoolExecutor(2) as pool:
        outs = list(
            pool.map(lambda s: check_asset(s, s.parent.parent / "out", config).verdict, sources)
        )
    assert outs == ["passed", "passed"]
    assert len(list((tmp_path / "cache" / "assets").iterdir())) == 1
    assert met == []


def _mended(
    made: Refined, *, cut: tuple[str, ...] = (), stuck: tuple[str, ...] = ()
) -> RepairResult:
    return RepairResult(
        asset=made.asset,
        bodies=(),
        repairs=(),
        model=cast(Any, f"{made.model}, mended"),
        cut=frozenset(cut),
        stuck=frozenset(stuck),
    )


@pytest.mark.parametrize(
    ("cut", "stuck", "failed", "wrong"),
    [
        ((), (), {}, set()),
        ((), ("lid",), {"it, mended": ["box"]}, {"lid"}),
        (("lid",), (), {}, set()),
        (("lid",), (), {"it, mended": ["lid"]}, {"lid"}),
        (("lid",), (), {"it, mended": ["lid"], "it": ["lid"]}, set()),
        (("lid",), (), {"it, mended": ["box"]}, set()),
        (("lid", "box"), ("pot",), {"it, mended": ["lid", "box"], "it": ["box"]}, {"lid", "pot"}),
    ],
)
def test_wrong_after_repairs_is_what_is_stuck_and_what_cuts_have_spoiled(
    monkeypatch, cut, stuck, failed, wrong
):
    def failing(model):
        return [
            Check(name="collision_coverage", outcome="failed", subject=link, message="")
            for link in failed.get(model, ())
        ]

    monkeypatch.setattr(prepare, "failed_shapes", failing)
    made = Refined(
        asset=cast(Any, None), bodies=[], mimics=[], model=cast(Any, "it"), unfinished=frozenset()
    )
    assert links_to_refine(made, _mended(made, cut=cut, stuck=stuck)) == wrong


def test_a_link_without_time_for_finer_shapes_is_undecided_and_made_again(tmp_path, monkeypatch):
    def coverage(model):
        return (
            Check(name="collision_coverage", outcome="failed", subject="body", message="coarse"),
        )

    times = []

    def budget(limit_s):
        times.append(limit_s)
        return Budget(-1.0)

    monkeypatch.setattr("articulate.checks.run_checks.check_coverage", coverage)
    monkeypatch.setattr(refine_colliders, "check_coverage", coverage)
    monkeypatch.setattr(refine_colliders, "Budget", budget)
    config = dataclasses.replace(ConvertConfig(), cache_dir=tmp_path / "cache")
    source = written(tmp_path / "in")
    report = check_asset(source, tmp_path / "out", config)
    assert report.verdict == "undecided"
    assert "the processor time was too short for finer shapes" in report.reasons[0]
    count = len(times)
    check_asset(source, tmp_path / "again", config)
    assert len(times) == 2 * count > 0
    monkeypatch.setattr(refine_colliders, "Budget", Budget)
    assert check_asset(source, tmp_path / "slowly", config).verdict == "rejected"


@pytest.mark.dataset
@pytest.mark.slow
def test_a_lid_that_cuts_would_spoil_is_made_finer_first(data_folder, tmp_path):
    """Two shapes stand for it; cut back, they bare what is not seen, and finer ones do not."""
    config = dataclasses.replace(ConvertConfig(), cache_dir=tmp_path / "cache")
    check_report = check_asset(
        data_folder / "assets" / "partnet" / "8867" / "mobility.urdf", tmp_path / "out", config
    )
    assert check_report.verdict == "repaired"


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("asset.json", "[]", "a JSON object was expected"),
        ("asset.json", "[" * 100_000, "nested deeper"),
        ("asset.json", '{"schema": NaN}', "not a JSON number"),
        ("object.xml", '<mujoco><include file="/etc/passwd"/></mujoco>', "<include>"),
        ("object.xml", "link", "a link"),
    ],
)
def test_a_hostile_asset_folder_is_rejected_in_one_line(tmp_path, name, text, reason):
    folder = make_object(tmp_path / "object").folder
    path = folder / name
    if text == "link":
        path.unlink()
        path.symlink_to("/etc/passwd")
    else:
        path.write_text(text)
    check_report = check_asset(folder, tmp_path / "out", CONFIG)
    assert check_report.verdict == "rejected"
    (line,) = check_report.reasons
    assert reason in line
    assert line.startswith(f"{folder}/")
    assert len(line) < len(str(path)) + 250
    assert "root:" not in (tmp_path / "out" / "check_report.html").read_text()
    assert not (tmp_path / "out" / "object.xml").exists()
