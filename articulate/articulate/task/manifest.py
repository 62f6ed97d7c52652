"""Manifest of a policy bundle: all data that running the policy needs, decoded strictly.

A bundle is a folder or a zip file::

    manifest.json       the fields below, and the SHA-256 of every other file
    policy.onnx         from raw observations to clipped actions
    golden.npz          observations and their expected actions
    episodes.npz           sampled parameters of the episodes that compare robots
    scene/scene.xml     the nominal scene, with scene/meshes/
    object/object.urdf  the object, with object/meshes/

Every key must be present and no other. ``content_id`` is the SHA-256 of the rest of the manifest.
It detects damage; it does not authenticate the author.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from typing import Any, Literal

from articulate.assets.asset import Asset
from articulate.config import from_mapping, to_plain
from articulate.errors import BundleError, ConfigError
from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.task.layout import Layout
from articulate.task.object_placement import ObjectPlacement
from articulate.task.randomization import COLUMNS
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Task

SCHEMA = "articulate.policy-bundle"
SCHEMA_VERSION = 6
MANIFEST_FILE, POLICY_FILE = "manifest.json", "policy.onnx"
GOLDEN_FILE, SCENE_FILE = "golden.npz", "scene/scene.xml"
EPISODES_FILE, OBJECT_FILE = "episodes.npz", "object/object.urdf"
LIMIT_TABLES = ("q_min", "q_max", "dq_max", "ddq_max", "dddq_max", "tau_max", "dtau_max")
"""Fields of :class:`articulate.robot.arm.Arm` that the manufacturer of the arm sets."""


@dataclass(frozen=True, kw_only=True)
class PolicyEntry:
    """The network."""

    file: str = POLICY_FILE
    """File in the bundle."""
    opset: int
    """Version of ONNX's operators."""
    input: str = "observation"
    """Name of the input, float32 (batch, size of the observation)."""
    output: str = "action"
    """Name of the output, float32 (batch, size of the action)."""
    recurrent: bool = False
    """True if it keeps a state between control steps."""


@dataclass(frozen=True, kw_only=True)
class Golden:
    """Pairs of observations and actions from the export of the policy."""

    file: str = GOLDEN_FILE
    """File in the bundle, with the arrays ``observation`` and ``action``."""
    count: int = 64
    """Number of pairs."""
    atol: float = 1e-5
    """Largest difference of an action."""


@dataclass(frozen=True, kw_only=True)
class EpisodesEntry:
    """Sampled parameters of the episodes on which robots are compared, equal for all robots."""

    file: str = EPISODES_FILE
    """File in the bundle, with the array ``values``, one row for each episode."""
    columns: tuple[str, ...] = COLUMNS
    """Names of its columns."""
    count: int = 200
    """Number of episodes."""
    seed: int
    """Seed of the parameters and of the noise within an episode."""


@dataclass(frozen=True, kw_only=True)
class FingersEntry:
    """Drive and contact of the simulated fingers, equal for both."""

    stiffness_n_m: float
    """Gain of force = stiffness (set point - position) - damping speed, up to the limit [N/m]."""
    damping_n_s_m: float
    """Damping of that law [N s/m]."""
    force_n: float
    """Largest force of a finger [N]."""
    passive_damping_n_s_m: float
    """Damping of its slide [N s/m]."""
    friction_n: float
    """Dry friction of its slide [N]."""
    sliding_friction: float
    """Coefficient of friction of a contact with a finger."""
    spin_friction_m: float
    """Torsional friction about the contact's normal, relative to the normal force [m]."""


@dataclass(frozen=True, kw_only=True)
class ControllerEntry:
    """Control law between targets and torques; its gains are fields of the robot."""

    law: Literal["joint_impedance"] = "joint_impedance"
    """Torque = stiffness (set point - q) - damping dq + gravity."""
    gravity_compensation: bool = True
    """True if the controller compensates the arm's weight."""
    target_filter: Literal["triple_pole"] = "triple_pole"
    """Set-point filter between targets and set points; its bandwidth is ``control.omega_rad_s``."""
    trained_delay_steps: tuple[int, int]
    """Shortest and longest delay of actions in training [control steps]."""


@dataclass(frozen=True, kw_only=True)
class StartEntry:
    """Initial state of an episode."""

    q: tuple[float, ...]
    """Angles of the arm (7,) [rad]."""
    tolerance_rad: float
    """Largest offset of each joint in training [rad]."""
    gripper_width_m: float
    """Opening of the empty gripper [m]."""


@dataclass(frozen=True, kw_only=True)
class EstimatorEntry:
    """Required estimate of the object."""

    needs: tuple[str, ...]
    """Fields of :class:`articulate.task.observation.Estimate`."""
    rate_hz: float
    """Rate of the estimates [Hz]."""
    max_age_s: float
    """Largest age of a state in training [s]; its noise is part of ``randomization``."""


@dataclass(frozen=True, kw_only=True)
class SceneEntry:
    """Names in the exported scene."""

    file: str = SCENE_FILE
    """MJCF file in the bundle."""
    timestep_s: float
    """Physics step [s]."""
    scale: float
    """Size of the object in it."""
    arm_joints: tuple[str, ...]
    """Joints, and actuators of the same names, in order."""
    finger_joints: tuple[str, str]
    """The same for the fingers; the second moves in the opposite direction."""
    finger_geoms: tuple[str, ...]
    """Geoms whose friction determines contacts of the fingers."""
    tool_site: str
    """Site of the tool frame."""
    object_prefix: str
    """Prefix of every name of the object."""
    object_root: str
    """Its root body."""
    sensors: tuple[str, str, str]
    """Contact sensors: object on gripper, floor on gripper, robot on object."""
    object_file: str = OBJECT_FILE
    """URDF of the object at the scene's size, its root frame the object's, without visuals."""
    counterbalanced: tuple[str, ...]
    """Links of the object whose weight is compensated, as the springs of lids do."""
    fingers: FingersEntry
    """Fingers of the gripper."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """Origin of the policy."""

    run: str
    """Name of the run's folder."""
    seed: int
    """Seed of the policy."""
    seed_rule: str
    """Rule by which the seed was selected."""
    steps: int
    """Control steps of experience."""
    config_sha256: str
    """SHA-256 of the run's ``config.yaml``."""
    success: float | None
    """Success rate of that seed, if it was measured."""


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """All data that running a policy needs."""

    name: str
    """Short name of the bundle."""
    created_utc: str
    """Time of export."""
    producer: dict[str, str]
    """Versions of the packages at export."""
    licences: dict[str, str]
    """Licences of the contents, by part."""
    files: dict[str, str]
    """SHA-256 of every other file of the bundle, by its path."""
    policy: PolicyEntry
    control: ControlConfig
    controller: ControllerEntry
    observation: Layout
    action: Layout
    robot: Arm
    limit_table_sha256: str
    """:func:`limit_table_sha256` of the robot."""
    start: StartEntry
    task: Task
    placement: ObjectPlacement
    object: Asset
    object_sha256: str
    """Content id of the asset's folder."""
    scene: SceneEntry
    estimator: EstimatorEntry
    randomization: RandomizationConfig
    """Randomization in training."""
    episodes: EpisodesEntry
    training: Training
    golden: Golden


def limit_table_sha256(arm: Arm) -> str:
    """Return the SHA-256 of the arm's limit tables."""
    return _digest({name: to_plain(getattr(arm, name)) for name in LIMIT_TABLES})


def encode_manifest(manifest: Manifest) -> str:
    """Return the text of ``manifest.json``."""
    content = _plain(manifest)
    head = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, "content_id": _digest(content)}
    return json.dumps(head | content, indent=1, allow_nan=False) + "\n"


def decode_manifest(text: str, where: str) -> Manifest:
    """Return the manifest that :func:`encode_manifest` wrote.

    Args:
        text: Content of ``manifest.json``.
        where: Name of the file, for messages.

    Raises:
        BundleError: The schema differs, a key is missing or unknown, a value is not accepted, or
            the file was changed.
    """
    content = _parse(text, where)
    schema, version = content.pop("schema", None), content.pop("schema_version", None)
    if schema != SCHEMA or version != SCHEMA_VERSION:
        found = "no schema" if schema is None else f"schema {str(schema)[:40]} {str(version)[:10]}"
        raise BundleError(
            f"{where}: {found}; this version reads {SCHEMA} {SCHEMA_VERSION}: export it again "
            "with articulate export"
        )
    content_id = content.pop("content_id", None)
    try:
        place = f"{where} (schema {version})"
        manifest = from_mapping(Manifest, _layouts_checked(content, place), place)
    except ConfigError as error:
        raise BundleError(str(error)) from None
    missing = _missing(_plain(manifest), content)
    if missing:
        raise BundleError(f"{where} (schema {version}): key {missing} is missing")
    if content_id != _digest(content):
        raise BundleError(f"{where}: the manifest was changed after export; export it again")
    return manifest


def _plain(manifest: Manifest) -> dict[str, Any]:
    content: dict[str, Any] = to_plain(manifest)
    content["observation"] = manifest.observation.as_list()
    content["action"] = manifest.action.as_list()
    del content["object"]["folder"]
    return content


def _parse(text: str, where: str) -> dict[str, Any]:
    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        if len({key for key, _ in items}) != len(items):
            raise ValueError("duplicate key")
        return dict(items)

    def constant(word: str) -> float:
        raise ValueError(f"{word} is not a number in JSON")

    try:
        content = json.loads(text, object_pairs_hook=pairs, parse_constant=constant)
    except (ValueError, RecursionError) as error:
        raise BundleError(f"{where}: not a manifest ({error})") from None
    if not isinstance(content, dict):
        raise BundleError(f"{where}: not a manifest; it must be a JSON object")
    return content


def _layouts_checked(content: dict[str, Any], where: str) -> dict[str, Any]:
    """Return the content with its two layouts as :class:`Layout` expects them, slices checked."""
    out = dict(content)
    for key in ("observation", "action"):
        items = content.get(key)
        if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
            raise ConfigError(f"{where}: {key} must be a list of fields")
        bare = [{k: v for k, v in item.items() if k != "slice"} for item in items]
        layout = from_mapping(Layout, {"fields": bare}, f"{where}: {key}")
        if layout.as_list() != items:
            raise ConfigError(
                f"{where}: {key}: a field lacks a key, or its slice does not fit its size"
            )
        out[key] = {"fields": bare}
    if isinstance(out.get("object"), dict) and "folder" in out["object"]:
        raise ConfigError(f"{where}: unknown key object.folder")
    return out


def _missing(complete: Any, present: Any, prefix: str = "") -> str:
    """Return the dotted name of the first key of ``complete`` that ``present`` lacks, or ``""``."""
    if isinstance(complete, dict):
        for key, value in complete.items():
            name = f"{prefix}.{key}" if prefix else key
            if key not in present:
                return name
            missing = _missing(value, present[key], name)
            if missing:
                return missing
    if isinstance(complete, list):
        for i, (a, b) in enumerate(zip(complete, present, strict=True)):
            missing = _missing(a, b, f"{prefix}[{i}]")
            if missing:
                return missing
    return ""


def _digest(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def with_files(manifest: Manifest, files: dict[str, bytes]) -> Manifest:
    """Return the manifest with the SHA-256 of ``files`` (by path, without the manifest)."""
    sums = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}
    return replace(manifest, files=sums)
