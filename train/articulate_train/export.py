"""Export a trained seed as a bundle for robots."""

from __future__ import annotations

import datetime
import io
import logging
import re
import shutil
import tempfile
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch

from articulate.errors import RunError, UsageError
from articulate.files import atomic_write, require_space, sha256
from articulate.robot.contact import FLOOR_SENSOR, GRIPPER_SENSOR, ROBOT_SENSOR
from articulate.task.manifest import (
    EPISODES_FILE,
    GOLDEN_FILE,
    MANIFEST_FILE,
    OBJECT_FILE,
    POLICY_FILE,
    SCENE_FILE,
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
    encode_manifest,
    limit_table_sha256,
    with_files,
)
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization import EpisodeParams, at_size, sample_episode_params_each
from articulate.task.randomization_config import RandomizationConfig
from articulate.transforms import Array
from articulate.untrusted import load_json_object
from articulate_envs.export_object import object_files
from articulate_envs.export_scene import export_scene
from articulate_envs.scene import PREFIX, Scene
from articulate_train.policy import (
    Policy,
    checkpoint_sha256,
    policy_file,
    policy_of,
    read_checkpoint,
    reject_other_versions,
    trained_steps,
)
from articulate_train.run import Run, open_run, versions
from articulate_train.seed_runner import last_progress

REPORT_BYTES = 100_000_000
"""Largest report of an evaluation that is read."""
OPSET = 18
"""Version of the ONNX operators."""
BUNDLE_BYTES = 40_000_000
"""Size of a large bundle with its unpacked files [bytes]."""
ARM_LICENCE = "Apache-2.0 (meshes of franka_description), MIT (model of robosuite)"
"""Licence of the arm in the exported scene."""
_NOT_FREE = re.compile(r"non[- ]?commercial|\bnc\b|research only|academic", re.IGNORECASE)
_UNKNOWN = re.compile(r"^\s*(unknown|none)?\s*$", re.IGNORECASE)


@dataclass(frozen=True)
class Exported:
    """Written bundle."""

    path: Path
    seed: int
    seed_rule: str
    files: int
    size_bytes: int
    warnings: tuple[str, ...]
    """Warnings about the licence of the bundle."""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return {
            "bundle": str(self.path),
            "seed": self.seed,
            "seed_rule": self.seed_rule,
            "files": self.files,
            "size_bytes": self.size_bytes,
            "warnings": list(self.warnings),
        }


def export_policy(folder: Path, out: Path | None = None, *, seed: int | None = None) -> Exported:
    """Write the bundle of one seed of the run in ``folder`` to ``out``, atomically.

    Args:
        folder: The run.
        out: A path ending in ``.zip``, or a folder that does not exist; by default
            ``bundles/<run>-seed_<seed>.zip``.
        seed: The seed; None takes the best.

    Raises:
        RunError: No such run or seed, or it has no checkpoint.
        UsageError: ``out`` exists or cannot be written.
    """
    run = open_run(folder)
    chosen, rule, success = select_seed(run, seed)
    out = out or Path("bundles") / f"{run.folder.resolve().name}-seed_{chosen}.zip"
    if out.exists():
        raise UsageError(f"{out}: exists; choose another --out")
    require_space(out, BUNDLE_BYTES, "a bundle")
    path = policy_file(run.seed_folder(chosen))
    checkpoint = read_checkpoint(path.parent, path.name)
    with reject_other_versions(path):
        policy, steps = policy_of(checkpoint), trained_steps(checkpoint)
    scene = run.scene((1.0,))
    files = bundle_files(scene, policy, sampled_episodes(run, scene))
    manifest = make_manifest(
        run,
        scene,
        opset=onnx_opset(files[POLICY_FILE]),
        training=Training(
            run=run.folder.resolve().name,
            seed=chosen,
            seed_rule=rule,
            steps=steps,
            config_sha256=sha256(run.folder / "config.yaml"),
            success=success,
        ),
    )
    text = encode_manifest(with_files(manifest, files))
    write_bundle(out, {MANIFEST_FILE: text.encode(), **files})
    return Exported(
        path=out,
        seed=chosen,
        seed_rule=rule,
        files=len(files) + 1,
        size_bytes=sum(len(content) for content in files.values()) + len(text),
        warnings=licence_warnings(run.asset.licence, run.asset.name),
    )


def select_seed(run: Run, seed: int | None) -> tuple[int, str, float | None]:
    """Return the seed, the rule of its selection, and its measured success if known.

    Raises:
        RunError: The run has no such seed, or none that was trained.
    """
    trained = [s for s in run.config.seeds if policy_file(run.seed_folder(s)).exists()]
    if not trained:
        raise RunError(f"{run.folder}: no seed has a checkpoint; train first")
    measured = _success_of_report(run)
    if seed is not None:
        if seed not in trained:
            known = ", ".join(map(str, trained))
            raise RunError(f"{run.folder}: seed {seed} has no checkpoint; there are: {known}")
        return seed, "given", measured.get(seed)
    if all(s in measured for s in trained):
        best = max(trained, key=lambda s: (measured[s], -s))
        return best, "highest success in the evaluation, ties to the lower seed", measured[best]
    seen = {s: float(last_progress(run, s).get("success", 0.0)) for s in trained}
    best = max(trained, key=lambda s: (seen[s], -s))
    return best, "highest success at the end of training (not evaluated)", None


def _success_of_report(run: Run) -> dict[int, float]:
    """Return the success rates of seeds whose checkpoint is the evaluated one."""
    try:
        report = load_json_object(run.folder / "report.json", limit_bytes=REPORT_BYTES)
        return {
            int(row["seed"]): float(row["success"]["value"])
            for row in report["seeds"]
            if row["checkpoint_sha256"] == checkpoint_sha256(run.seed_folder(int(row["seed"])))
        }
    except (UsageError, ValueError, KeyError, TypeError):
        return {}


def sampled_episodes(run: Run, scene: Scene) -> EpisodeParams:
    """Return the episode parameters on which robots are compared.

    They are sampled from the run's randomization with the seed of its evaluation, for the object at
    the size of the bundle's scene.
    """
    entry = randomization_entry(run)
    config = at_size(run.config.randomization, scene_scale(scene))
    return sample_episode_params_each(config, entry.seed, entry.count, begin=run.task.begin)


def randomization_entry(run: Run) -> EpisodesEntry:
    """Return the manifest's entry of :func:`sampled_episodes`."""
    return EpisodesEntry(seed=run.config.evaluation_seed)


def bundle_files(scene: Scene, policy: Policy, params: EpisodeParams) -> dict[str, bytes]:
    """Return the files of the bundle by path, without the manifest."""
    with tempfile.TemporaryDirectory(prefix="articulate-export-") as name:
        folder = Path(name)
        export_scene(scene.nominal, folder / Path(SCENE_FILE).parent)
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
    beside = Path(OBJECT_FILE).parent
    for name, content in object_files(scene.asset).items():
        files[(beside / name).as_posix()] = content
    pairs = golden_pairs(policy, np.random.default_rng(0), Golden().count)
    return {
        POLICY_FILE: to_onnx(policy),
        GOLDEN_FILE: _npz(observation=pairs[0], action=pairs[1]),
        EPISODES_FILE: _npz(values=params.values),
        **files,
    }


def _npz(**arrays: Array) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]  # names are ours
    return stream.getvalue()


def to_onnx(policy: Policy) -> bytes:
    """Return the policy as ONNX: float32 (batch, size) to (batch, 8), weights included."""
    entry = PolicyEntry(opset=OPSET)
    with _quiet_exporter():
        program = torch.onnx.export(
            policy,
            (torch.zeros(2, OBSERVATION.size),),
            input_names=[entry.input],
            output_names=[entry.output],
            opset_version=OPSET,
            dynamic_shapes=({0: torch.export.Dim("batch")},),
            external_data=False,
            verbose=False,
        )
    assert program is not None
    model = _without_traces(program.model_proto)
    return bytes(model.SerializeToString(deterministic=True))


def _without_traces(model: Any) -> Any:
    """Remove notes on the source code and the machine from the model."""
    graph = model.graph
    for item in (
        model,
        graph,
        *graph.node,
        *graph.input,
        *graph.output,
        *graph.value_info,
        *graph.initializer,
    ):
        del item.metadata_props[:]
        item.doc_string = ""
    onnx.checker.check_model(model)
    return model


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Suppress warnings of torch's exporter: deprecated calls, no torchvision."""
    log = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=FutureWarning)
            warnings.filterwarnings("ignore", category=DeprecationWarning)
            yield
    finally:
        log.setLevel(level)


def onnx_opset(model: bytes) -> int:
    """Return the version of the default operators of a model."""
    loaded = onnx.load_from_string(model)
    return int(next(item.version for item in loaded.opset_import if item.domain in ("", "ai.onnx")))


def golden_pairs(policy: Policy, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Observations (count, size) spread as those of training, in float32, and their actions."""
    first = policy.networks[0]
    mean, scale = (np.asarray(t, dtype=np.float64) for t in (first.mean, first.scale))
    seen = mean + rng.normal(size=(count, OBSERVATION.size)) / np.maximum(scale, 1e-3)
    seen = np.clip(seen, OBSERVATION.low, OBSERVATION.high).astype(np.float32)
    return seen, policy.act(seen).astype(np.float32)


def make_manifest(run: Run, scene: Scene, *, opset: int, training: Training) -> Manifest:
    """Return the manifest of a run's bundle, without the hashes of its files."""
    ranges, control, arm = run.config.randomization, scene.control, scene.arm
    return Manifest(
        name=f"{run.asset.name}-{run.task.name}",
        created_utc=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        producer={k: v for k, v in versions().items() if k != "system"},
        licences={"object": run.asset.licence, "arm": ARM_LICENCE},
        files={},
        policy=PolicyEntry(opset=opset),
        control=control,
        controller=ControllerEntry(trained_delay_steps=ranges.delay_steps),
        observation=OBSERVATION,
        action=ACTION,
        robot=arm,
        limit_table_sha256=limit_table_sha256(arm),
        start=StartEntry(
            q=run.placement.start_q,
            tolerance_rad=ranges.start_rad,
            gripper_width_m=arm.gripper.max_width_m,
        ),
        task=run.task,
        placement=run.placement,
        object=scene.asset,
        object_sha256=run.asset.content_id(),
        scene=scene_entry(scene),
        estimator=_estimator(ranges, control.rate_hz),
        randomization=ranges,
        episodes=randomization_entry(run),
        training=training,
        golden=Golden(),
    )


def scene_entry(scene: Scene) -> SceneEntry:
    """Return the names in the exported scene."""
    model, at = scene.nominal, scene.at
    first = scene.asset.links[0].name
    return SceneEntry(
        timestep_s=scene.physics.timestep_s,
        scale=scene_scale(scene),
        arm_joints=tuple(f"joint{i}" for i in range(1, 8)),
        finger_joints=("finger_joint1", "finger_joint2"),
        finger_geoms=tuple(str(model.geom(i).name) for i in at.finger_geoms),
        tool_site="tool",
        object_prefix=PREFIX,
        object_root=PREFIX + first,
        sensors=(GRIPPER_SENSOR, FLOOR_SENSOR, ROBOT_SENSOR),
        counterbalanced=tuple(
            model.body(i).name.removeprefix(PREFIX)
            for i in at.moving_bodies
            if model.body_gravcomp[i] > 0.0
        ),
        fingers=_fingers(scene),
    )


def scene_scale(scene: Scene) -> float:
    """Return the size factor of the object in the exported model."""
    return float(scene.scales[int(np.argmin(np.abs(np.asarray(scene.scales) - 1.0)))])


def _fingers(scene: Scene) -> FingersEntry:
    model, at = scene.nominal, scene.at
    slide = model.joint("finger_joint1")
    return FingersEntry(
        stiffness_n_m=float(model.actuator_gainprm[at.finger_ctrl, 0]),
        damping_n_s_m=float(-model.actuator_biasprm[at.finger_ctrl, 2]),
        force_n=float(model.actuator_forcerange[at.finger_ctrl, 1]),
        passive_damping_n_s_m=float(slide.damping[0]),
        friction_n=float(slide.frictionloss[0]),
        sliding_friction=float(model.geom_friction[at.finger_geoms[0], 0]),
        spin_friction_m=float(model.geom_friction[at.finger_geoms[0], 1]),
    )


def _estimator(ranges: RandomizationConfig, rate_hz: float) -> EstimatorEntry:
    return EstimatorEntry(
        needs=("T_wh", "opened", "speed"),
        rate_hz=rate_hz,
        max_age_s=ranges.estimate_delay_steps[1] / rate_hz,
    )


def licence_warnings(licence: str, name: str) -> tuple[str, ...]:
    """Return warnings about the licence of the object ``name`` in the bundle."""
    if _UNKNOWN.match(licence):
        return (f"the licence of {name} is unknown; the bundle holds its geometry",)
    if _NOT_FREE.search(licence):
        return (f"{name} is licensed {licence!r}; the bundle holds its geometry and inherits it",)
    return ()


def write_bundle(out: Path, files: dict[str, bytes]) -> None:
    """Write ``files`` to a zip file or a new folder, atomically."""
    if out.suffix == ".zip":
        with atomic_write(out) as temporary, zipfile.ZipFile(temporary, "w") as archive:
            for name, content in files.items():
                item = zipfile.ZipInfo(name)  # a fixed date: equal bundles are equal files
                item.compress_type = zipfile.ZIP_DEFLATED
                item.external_attr = 0o100644 << 16
                archive.writestr(item, content)
        return
    part = None
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        # A unique name: another bundle may be written beside this one at the same time.
        part = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
        part.chmod(0o755)
        for name, content in files.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            (part / name).write_bytes(content)
        part.replace(out)
    except OSError as error:
        raise UsageError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    finally:
        if part is not None:
            shutil.rmtree(part, ignore_errors=True)
