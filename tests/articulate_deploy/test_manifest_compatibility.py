"""Values of a manifest that nothing else would stop, each in one line."""

import copy
import dataclasses
import hashlib
import json

import pytest

from articulate.errors import BundleError
from articulate_deploy.bundle import load_bundle
from articulate_deploy.manifest_compatibility import check_manifest


def forced(item, path, value):
    """A copy with one value changed, whatever its class accepts."""
    name, _, rest = path.partition(".")
    out = copy.copy(item)
    inner = forced(getattr(item, name), rest, value) if rest else value
    object.__setattr__(out, name, inner)
    return out


def test_what_was_exported_fits(bundle):
    check_manifest(bundle.manifest, "b")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("control.margin_rad", -3.0),
        ("control.margin_rad", 3.0),
        ("control.margin_rad", float("nan")),
        ("control.max_tracking_error_rad", 0.0),
        ("control.move_m", -0.008),
        ("control.rate_hz", 0.0),
        ("control.rate_hz", 1e9),
        ("scene.timestep_s", 0.0),
        ("scene.timestep_s", 0.007),
        ("scene.scale", 0.0),
        ("start.q", (0.0,) * 6),
        ("start.q", (9.0,) * 7),
        ("start.tolerance_rad", -0.1),
        ("start.gripper_width_m", 1.0),
        ("robot.stiffness", (-1.0,) * 7),
        ("task.name", "nonsense"),
        ("task.hold_s", -1.0),
        ("task.hold_s", 11.0),
        ("task.episode_s", float("inf")),
        ("task.limits.force_n", 0.0),
        ("task.limits.moment_nm", -1.0),
        ("task.limits.torque_share", 1.5),
        ("task.limits.torque_share", 0.0),
        ("task.limits.short_filter_s", 0.0),
        ("task.limits.force_n", 40.1),
        ("task.limits.force_n", 1e9),
        ("task.limits.moment_nm", 1e9),
        ("task.limits.speed_share", 0.71),
        ("task.limits.filter_s", 10.0),
        ("task.episode_s", 0.01),
        ("control.force_limit_n", 0.0),
        ("control.force_limit_n", 1e9),
        ("control.force_limit_holding_n", 40.1),
        ("robot.gripper.smoothing", -0.5),
        ("robot.gripper.smoothing", 1e308),
        ("randomization.push_n", (-1.7e308, 1.7e308)),
        ("episodes.seed", -1),
        ("randomization.scales", 10**9),
        ("golden.atol", float("inf")),
        ("golden.count", 10**9),
        ("scene.timestep_s", 1e-6),
    ],
)
def test_a_value_that_makes_no_sense_is_refused_by_its_name(bundle, path, value):
    with pytest.raises(BundleError, match=path) as caught:
        check_manifest(forced(bundle.manifest, path, value), "b")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("changes", [{"span": 0.0}, {"span": -0.3}, {"kind": "hinge"}])
def test_a_task_that_does_not_open_as_its_joint_does_is_refused(bundle, changes):
    ((name, value),) = changes.items()
    with pytest.raises(BundleError, match=r"task\.span"):
        check_manifest(forced(bundle.manifest, f"task.{name}", value), "b")


def test_a_task_for_a_joint_that_the_object_lacks_is_refused(bundle):
    with pytest.raises(BundleError, match="no joint 'drawer_9'"):
        check_manifest(forced(bundle.manifest, "task.joint", "drawer_9"), "b")


@pytest.mark.parametrize("name", ["j\n  success  200 of 200", "j\x1b[2J", "j\ud800"])
def test_a_joint_whose_name_would_write_lines_of_a_report_is_refused(bundle, name):
    manifest = bundle.manifest
    joints = tuple(dataclasses.replace(joint, name=name) for joint in manifest.object.joints)
    manifest = forced(manifest, "object.joints", joints)
    with pytest.raises(
        BundleError, match=r"task\.joint is '[ -~]+'; it must be printable"
    ) as caught:
        check_manifest(forced(manifest, "task.joint", name), "b")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("changes", "unit"),
    [
        ({"step_rad": 10.0}, "rad/s"),
        ({"omega_rad_s": 500.0}, "rad/s"),
        ({"step_rad": 2.0, "omega_rad_s": 0.5}, "rad/s"),
    ],
)
def test_a_follower_that_may_leave_the_arms_limits_is_refused(bundle, changes, unit):
    """The last one is so slow that its speed grows throughout the episode."""
    manifest = bundle.manifest
    manifest = forced(manifest, "task", dataclasses.replace(manifest.task, episode_s=10.0))
    for name, value in changes.items():
        manifest = forced(manifest, f"control.{name}", value)
    with pytest.raises(BundleError, match=f"control: targets could reach .* {unit}"):
        check_manifest(manifest, "b")


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("control", "margin_rad"), -3.0),
        (("task", "span"), 0.0),
        (("task", "limits", "force_n"), -1.0),
        (("robot", "gripper", "force_n"), 0.0),
        (("robot", "gripper", "stiffness_n_m"), 0.0),
        (("golden", "atol"), 1e9),
        (("task", "name"), "nonsense"),
    ],
)
def test_such_a_bundle_is_not_loaded(folder, keys, value):
    """Whoever refuses it first: its sums are right."""
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    inner = content
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    bare = {k: v for k, v in content.items() if k not in ("schema", "schema_version", "content_id")}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"))
    content["content_id"] = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps(content))
    with pytest.raises(BundleError, match=keys[-1] if keys[-1] != "name" else "nonsense") as caught:
        load_bundle(folder)
    assert "\n" not in str(caught.value)
