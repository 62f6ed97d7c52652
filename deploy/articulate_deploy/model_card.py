"""Description of a bundle for people: ``deploy inspect``, and its model card."""

from __future__ import annotations

from typing import Any

import numpy as np

from articulate.task.layout import Layout
from articulate_deploy.bundle import Bundle
from articulate_deploy.report import bundle_sha256


def describe(bundle: Bundle) -> dict[str, Any]:
    """Return the main facts of a bundle as a JSON object."""
    m = bundle.manifest
    control, robot, limits, task = m.control, m.robot, m.task.limits, m.task
    return {
        "name": m.name,
        "created_utc": m.created_utc,
        "sha256": bundle_sha256(m),
        "task": {
            "name": task.name, "joint": task.joint, "kind": task.kind, "target": task.target,
            "hold_s": task.hold_s, "episode_s": task.episode_s,
        },
        "object": {"name": m.object.name, "joints": [joint.name for joint in m.object.joints]},
        "robot": {
            "name": robot.name, "limit_table_sha256": m.limit_table_sha256,
            "stiffness_nm_rad": list(robot.stiffness), "damping_nms_rad": list(robot.damping),
            "gripper_force_n": robot.gripper.force_n,
        },
        "start": {"q_rad": list(m.start.q), "tolerance_rad": m.start.tolerance_rad},
        "control": {
            "rate_hz": control.rate_hz, "filter_rad_s": control.omega_rad_s,
            "step_rad": control.step_rad, "delay_steps": list(m.controller.trained_delay_steps),
            "force_limit_n": control.force_limit_n,
            "force_limit_holding_n": control.force_limit_holding_n,
        },
        "stops_and_thresholds": {
            "force_n": limits.force_n, "moment_nm": limits.moment_nm,
            "speed_share": limits.speed_share,
        },
        "estimator": {
            "needs": list(m.estimator.needs), "rate_hz": m.estimator.rate_hz,
            "max_age_s": m.estimator.max_age_s,
        },
        "observation": _layout(m.observation),
        "action": _layout(m.action),
        "training": vars(m.training),
        "producer": m.producer,
        "licences": m.licences,
        "files": len(m.files),
    }  # fmt: skip


def _layout(layout: Layout) -> list[dict[str, Any]]:
    return [
        {
            "name": f.name, "size": f.size, "unit": f.unit, "frame": f.frame, "source": f.source,
        }
        for f in layout.fields
    ]  # fmt: skip


def text(bundle: Bundle) -> str:
    """Return the description of a bundle as text."""
    d = describe(bundle)
    task, control, robot = d["task"], d["control"], d["robot"]
    stops, training = d["stops_and_thresholds"], d["training"]
    success = training["success"]
    lines = [
        f"{d['name']}, made {d['created_utc']}, SHA-256 {d['sha256'][:16]}",
        f"  task       {task['name']} ({task['joint']}, {task['kind']}) of {d['object']['name']} "
        f"to {task['target']:.0%} in {task['episode_s']:g} s",
        f"  robot      {robot['name']}, limit table {robot['limit_table_sha256'][:12]}",
        f"  start      {_numbers(d['start']['q_rad'])} rad, "
        f"within {d['start']['tolerance_rad']:g} rad",
        f"  stiffness  {_numbers(robot['stiffness_nm_rad'])} Nm/rad",
        f"  damping    {_numbers(robot['damping_nms_rad'])} Nm s/rad",
        f"  control    {control['rate_hz']:g} Hz, set-point filter {control['filter_rad_s']:g} "
        f"rad/s, delays of {control['delay_steps'][0]} to {control['delay_steps'][1]} steps",
        f"  forces     retract at {control['force_limit_n']:g} N, or "
        f"{control['force_limit_holding_n']:g} N holding; stop at {stops['force_n']:g} N and "
        f"{stops['moment_nm']:g} Nm, which are also the arm's collision thresholds",
        f"  estimator  {', '.join(d['estimator']['needs'])}, at most "
        f"{d['estimator']['max_age_s'] * 1e3:.0f} ms old",
        f"  policy     {sum(f['size'] for f in d['observation'])} inputs, "
        f"{sum(f['size'] for f in d['action'])} outputs",
        f"  training   run {training['run']}, seed {training['seed']}, {training['steps']:,} steps"
        + ("" if success is None else f", success {success:.1%} in simulation"),
        f"  licences   {', '.join(f'{k}: {v}' for k, v in d['licences'].items())}",
    ]
    return "\n".join(lines)


def _numbers(values: list[float]) -> str:
    return " ".join(f"{value:.3g}" for value in np.round(values, 9) + 0.0)


def model_card(bundle: Bundle) -> str:
    """Return a model card in Markdown: use, limits, training and evaluation of the policy."""
    d = describe(bundle)
    task, training = d["task"], d["training"]
    success = "not measured" if training["success"] is None else f"{training['success']:.1%}"
    inputs = "\n".join(
        f"| {f['name']} | {f['size']} | {f['unit']} | {f['frame']} | {f['source']} |"
        for f in d["observation"]
    )
    return f"""# {d["name"]}

Policy for {task["name"]} ({task["joint"]}) of the object "{d["object"]["name"]}" with the arm
{d["robot"]["name"]}.

## Use

Run it with `deploy`, which verifies it, limits its targets and stops the arm. It is valid for this
object, this task and this arm's limit table. It is not a safety function.

## Training

Run {training["run"]}, seed {training["seed"]} ({training["seed_rule"]}), {training["steps"]:,}
control steps in simulation. Success of that seed in simulation: {success}. No figure of this card
is from a real arm.

## Limits

It starts within {d["start"]["tolerance_rad"]:g} rad of its start pose. It stops at
{d["stops_and_thresholds"]["force_n"]:g} N. The estimate of the object may be
{d["estimator"]["max_age_s"] * 1e3:.0f} ms old.

## Inputs

| name | size | unit | frame | source |
|---|---|---|---|---|
{inputs}

## Origin

SHA-256 of the manifest: `{d["sha256"]}`. Licences:
{", ".join(f"{k}: {v}" for k, v in d["licences"].items())}.
"""
