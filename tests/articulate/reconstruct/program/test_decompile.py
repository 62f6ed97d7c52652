"""Any URDF as a program, and back: the same links go the same ways."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.articulate.reconstruct.program import scenes

from articulate.errors import AssetError
from articulate.reconstruct.program.decompile import decompile
from articulate.reconstruct.program.program_parts import parts_of
from roundtrip import difference, read, round_trip

ROOT = Path(__file__).resolve().parents[4]
MESH = '<geometry><mesh filename="box.obj" scale="{}"/></geometry>'


def link(name, *visuals):
    body = "".join(
        f'<visual><origin xyz="{xyz}" rpy="{rpy}"/>{geometry}</visual>'
        for xyz, rpy, geometry in visuals
    )
    return f'<link name="{name}">{body}</link>'


def joint(name, kind, parent, child, inner="", xyz="0 0 0", rpy="0 0 0"):
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/>'
        f'<parent link="{parent}"/><child link="{child}"/>{inner}</joint>'
    )


CUBE = ("0 0 0", "0 0 0", '<geometry><box size="0.2 0.3 0.4"/></geometry>')
CASES = {
    "a chain of fixed joints": link("base") + link("a") + link("b", CUBE) + link("c", CUBE)
    + joint("f1", "fixed", "base", "a", xyz="1 2 3", rpy="0.3 -0.2 1.1")
    + joint("f2", "fixed", "a", "b", xyz="-1 0.5 0", rpy="1.5707963267948966 0 -1.5707963267948966")
    + joint("h", "revolute", "b", "c", '<axis xyz="0 1 0"/><limit lower="-1" upper="2"/>',
            xyz="0.1 0 0"),
    "a slide and a turn through a helper": link("base", CUBE) + link("helper") + link("cap", CUBE)
    + joint("s", "prismatic", "base", "helper", '<axis xyz="0 0 1"/><limit lower="0" upper="0.1"/>')
    + joint("t", "continuous", "helper", "cap", '<axis xyz="0 0 1"/>'),
    "oblique axes that are not of unit length": link("base", CUBE) + link("a", CUBE)
    + link("b", CUBE)
    + joint("h", "revolute", "base", "a", '<axis xyz="1 2 -3"/><limit lower="-1" upper="2"/>',
            xyz="0.1 0.2 0.3", rpy="0.4 0.5 0.6")
    + joint("s", "prismatic", "a", "b", '<axis xyz="0.1 0.1 0"/><limit lower="0" upper="1"/>',
            rpy="-1 2 3"),
    "a joint that follows another": link("base", CUBE) + link("a", CUBE) + link("b", CUBE)
    + joint("h", "revolute", "base", "a", '<axis xyz="0 0 1"/><limit lower="0" upper="1"/>')
    + joint("g", "revolute", "base", "b", '<axis xyz="0 0 1"/><limit lower="-1" upper="1"/>'
            '<mimic joint="h" multiplier="-0.5" offset="0.1"/>', xyz="1 0 0"),
    "several scaled visuals, turned": link(
        "base", CUBE, ("1 0 0", "0.1 0.2 0.3", MESH.format("2 1 0.5")),
        ("0 0 1", "0 0 3", MESH.format("-1 1 1"))) + link("a", CUBE)
    + joint("h", "continuous", "base", "a", '<axis xyz="1 0 0"/>'),
    "swapped limits": link("base", CUBE) + link("a", CUBE)
    + joint("h", "revolute", "base", "a", '<axis xyz="1 0 0"/><limit lower="1" upper="-1"/>'),
    "limits that say nothing": link("base", CUBE) + link("a", CUBE)
    + joint("h", "revolute", "base", "a", '<axis xyz="1 0 0"/><limit lower="-1e20" upper="1e20"/>'),
    "no limits": link("base", CUBE) + link("a", CUBE) + link("b", CUBE)
    + joint("h", "revolute", "base", "a", '<axis xyz="1 0 0"/>')
    + joint("s", "prismatic", "a", "b"),
    "pitch straight up": link("base", CUBE) + link("a", CUBE)
    + joint("h", "continuous", "base", "a", '<axis xyz="1 0 0"/>',
            rpy="0.3 1.5707963267948966 0.2"),
    "names with signs": link("a &quot;b&quot;", CUBE) + link("&lt;tür&gt; \\n", CUBE)
    + joint("it's", "continuous", "a &quot;b&quot;", "&lt;tür&gt; \\n", '<axis xyz="1 0 0"/>'),
    "a link called as a function": link("place", CUBE) + link("box", CUBE)
    + joint("root", "continuous", "place", "box", '<axis xyz="1 0 0"/>'),
}  # fmt: skip


def urdf(folder, body):
    path = folder / "object.urdf"
    path.write_text(f'<?xml version="1.0"?><robot name="r">{body}</robot>', encoding="utf-8")
    scenes.box((0.1, 0.2, 0.3)).export(folder / "box.obj")
    return path


@pytest.mark.parametrize("case", CASES)
def test_links_go_the_same_ways_after_a_round_trip(case, tmp_path):
    path = urdf(tmp_path, CASES[case])
    trip = round_trip(case, path, tmp_path / "out", np.random.default_rng(0))
    assert (trip.outcome, trip.message) == ("same", "")
    assert trip.error is not None
    assert trip.error < 1e-6


def test_a_difference_is_seen(tmp_path):
    """Else the other tests would show nothing."""
    path = urdf(tmp_path, CASES["a chain of fixed joints"])
    program = decompile(path)
    (tmp_path / "out").mkdir()
    changed = program.replace("revolute('c', 'b', (", "revolute('c', 'b', (0.001 + ", 1)
    assert changed != program
    found = scenes.compiled(changed, parts_of(path), tmp_path / "out")
    assert difference(read(path), read(found), np.random.default_rng(0)) > 1e-5


def test_geometry_lies_where_it_lay(tmp_path):
    path = urdf(tmp_path, CASES["several scaled visuals, turned"])
    found = scenes.compiled(decompile(path), parts_of(path), tmp_path / "out")
    before, after = parts_of(path), parts_of(found)
    assert list(before) == list(after)
    for name in before:
        np.testing.assert_allclose(
            np.sort(before[name].triangles.reshape(-1, 3), axis=0),
            np.sort(after[name].triangles.reshape(-1, 3), axis=0),
            atol=1e-8,
        )


def test_damping_and_friction_are_kept_where_the_file_says_them(tmp_path):
    dynamics = '<axis xyz="1 0 0"/><dynamics damping="0.7" friction="0.3"/>'
    path = urdf(
        tmp_path, link("a", CUBE) + link("b", CUBE) + joint("h", "continuous", "a", "b", dynamics)
    )
    built = scenes.built(decompile(path), parts_of(path))
    assert (built.joints[0].damping, built.joints[0].friction) == (0.7, 0.3)


def test_further_roots_are_fixed_to_the_first(tmp_path):
    body = link("a", CUBE) + link("b", CUBE) + link("c", CUBE) + joint("h", "fixed", "b", "c")
    path = urdf(tmp_path, body)
    built = scenes.built(decompile(path), parts_of(path))
    assert built.root == "b"
    assert {j.child: (j.kind, j.parent) for j in built.joints}["a"] == ("fixed", "b")


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (joint("h", "fixed", "a", "b") + joint("g", "fixed", "b", "a"), "cycle"),
        (joint("h", "continuous", "a", "b", '<axis xyz="0 0 0"/>'), "zero axis"),
        (joint("h", "fixed", "a", "x"), "does not exist"),
        (link("l" * 300) + joint("h", "fixed", "a", "l" * 300), "more than 200"),
    ],
)
def test_a_file_that_is_no_tree_is_refused(tmp_path, joints, words):
    with pytest.raises(AssetError, match=words):
        decompile(urdf(tmp_path, link("a") + link("b") + joints))


number = st.floats(-3, 3).map(lambda x: round(x, 4))
triple = st.tuples(number, number, number)


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["fixed", "revolute", "continuous", "prismatic"]),
            st.integers(0, 100), triple, triple,
            triple.filter(lambda v: np.linalg.norm(v) > 0.1),
        ),
        min_size=1, max_size=5,
    )
)  # fmt: skip
def test_random_trees_survive_the_round_trip(tmp_path, tree):
    body = link("l0", CUBE)
    for k, (kind, parent, xyz, rpy, axis) in enumerate(tree):
        row = [" ".join(map(repr, values)) for values in (xyz, rpy, axis)]
        inner = f'<axis xyz="{row[2]}"/><limit lower="-0.5" upper="0.7"/>'
        body += link(f"l{k + 1}")
        body += joint(f"j{k}", kind, f"l{parent % (k + 1)}", f"l{k + 1}", inner, row[0], row[1])
    path = urdf(tmp_path, body)
    trip = round_trip("random", path, tmp_path / "out", np.random.default_rng(0))
    assert (trip.outcome, trip.message) == ("same", "")


HANDFUL = ("partnet_6771", "partnet_45261", "unidoor_fridge_99614109960021")


@pytest.mark.dataset
@pytest.mark.parametrize("object_id", HANDFUL)
def test_objects_of_the_data_set_survive_the_round_trip(
    data_folder, data_index, object_id, tmp_path
):
    entry = next((e for e in data_index if e["id"] == object_id), None)
    if entry is None:
        pytest.skip(f"{object_id} is not in this data set")
    trip = round_trip(object_id, data_folder / entry["path"], tmp_path, np.random.default_rng(0))
    assert (trip.outcome, trip.message) == ("same", "")


@pytest.mark.dataset
@pytest.mark.slow
def test_one_in_sixty_objects_of_every_source_survives_the_round_trip(data_folder, tmp_path):
    command = [sys.executable, str(ROOT / "benchmarks" / "roundtrip.py"), str(data_folder)]
    done = subprocess.run([*command, "--every", "60", "--json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["outcomes"] == {"same": result["objects"]}
    assert result["worst_error"] < 1e-6


def test_a_program_of_a_urdf_is_no_longer_than_the_language_allows(tmp_path):
    names = [f"link_{k}" for k in range(300)]
    body = "".join(link(name) for name in names)
    for k, name in enumerate(names[1:]):
        inner = '<axis xyz="0.6 0.8 0"/><limit lower="-0.123456789" upper="1.23456789"/>'
        body += joint(f"joint_{k}", "revolute", names[0], name, inner, "0.1 0.2 0.3", "1 2 3")
    path = urdf(tmp_path, body)
    assert len(scenes.built(decompile(path), parts_of(path)).joints) == 299
