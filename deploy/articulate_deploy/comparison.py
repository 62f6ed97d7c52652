"""Report on a recording: success, tracking, timing, force and estimates, beside a simulation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate.errors import ConfigError
from articulate.transforms import Array
from articulate_deploy.recorded_episodes import RecordedDeployment, RecordedEpisode

Z_95 = 1.959963984540054
"""Quantile of the normal distribution of a 95 % interval."""


@dataclass(frozen=True)
class Measure:
    """Distribution of one quantity over the episodes."""

    name: str
    unit: str
    median: float
    p95: float


def share_interval(successes: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a proportion: Wilson's score interval."""
    if n == 0:
        return 0.0, 1.0
    p, z2 = successes / n, Z_95**2
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = Z_95 / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def measures(deployment: RecordedDeployment) -> tuple[Measure, ...]:
    """Return the distributions of a recording."""
    found = []
    for name, unit, values in (
        ("tracking error", "rad", _tracking),
        ("peak force", "N", _force),
        ("time of the policy", "ms", _policy),
        ("estimator error", "% open", _estimate),
        ("largest joint speed", "rad/s", _speed),
    ):
        numbers = [values(episode) for episode in deployment.episodes]
        joined = np.concatenate([n for n in numbers if n is not None] or [np.zeros(0)])
        joined = joined[np.isfinite(joined)]
        if len(joined):
            found.append(
                Measure(name, unit, float(np.median(joined)), float(np.percentile(joined, 95)))
            )
    return tuple(found)


def _tracking(episode: RecordedEpisode) -> Array | None:
    error = episode.arrays["target"] - episode.arrays["joint_pos"]
    return np.asarray(np.abs(error).max(axis=1))


def _force(episode: RecordedEpisode) -> Array | None:
    force = episode.arrays.get("measured_force_n")
    return None if force is None else np.array([np.linalg.norm(force, axis=1).max(initial=0.0)])


def _policy(episode: RecordedEpisode) -> Array | None:
    seconds = episode.arrays.get("policy_s")
    return None if seconds is None else seconds * 1e3


def _estimate(episode: RecordedEpisode) -> Array | None:
    arrays = episode.arrays
    if not {"estimate_open", "part_open"} <= arrays.keys():
        return None
    return np.asarray(100.0 * np.abs(arrays["estimate_open"] - arrays["part_open"]))


def _speed(episode: RecordedEpisode) -> Array | None:
    return np.array([np.abs(episode.arrays["joint_vel"]).max(initial=0.0)])


@dataclass(frozen=True)
class DeploymentComparison:
    """A recording, beside one of the same bundle in simulation."""

    deployment: RecordedDeployment
    simulation: RecordedDeployment | None = None

    def __post_init__(self) -> None:
        if self.simulation is None:
            return
        ours, theirs = (
            d.report.get("bundle_sha256", "") for d in (self.deployment, self.simulation)
        )
        if ours and theirs and ours != theirs:
            raise ConfigError(
                f"--against {self.simulation.folder}: a recording of another bundle; use the same"
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a JSON object."""
        both = {"deployment": self.deployment, "simulation": self.simulation}
        return {name: _content(d) for name, d in both.items() if d is not None}

    def text(self) -> str:
        """Return the report as text."""
        ours = _content(self.deployment)
        theirs = None if self.simulation is None else _content(self.simulation)
        lines = [f"{ours['robot']}, {ours['episodes']} episodes of {ours['bundle']}"]
        lines.append(_success_line(ours, "success"))
        if theirs is not None:
            lines.append(_success_line(theirs, f"in simulation ({theirs['robot']})"))
        if ours["incomplete"]:
            lines.append(f"  {ours['incomplete']} episodes did not end: the process was stopped")
        head = f"  {'':<28}{'median':>10}{'95 %':>10}"
        lines.append(head + ("" if theirs is None else f"{'sim median':>13}{'sim 95 %':>10}"))
        others = {} if theirs is None else {m["name"]: m for m in theirs["measures"]}
        for m in ours["measures"]:
            line = (
                f"  {m['name'] + ' [' + m['unit'] + ']':<28}{m['median']:>10.3g}{m['p95']:>10.3g}"
            )
            other = others.get(m["name"])
            lines.append(line + (
                "" if other is None else f"{other['median']:>13.3g}{other['p95']:>10.3g}"
            ))  # fmt: skip
        for name, value in ours["sender"].items():
            printed = value if isinstance(value, str) else f"{value:.4g}"
            lines.append(f"  sender {name:<21}{printed:>10}")
        return "\n".join(lines)


def _success_line(content: dict[str, Any], title: str) -> str:
    n, done = content["ended"], content["successes"]
    low, high = content["success_95"]
    return f"  {title}: {done} of {n}, 95 % interval {low:.1%} to {high:.1%}"


def _content(deployment: RecordedDeployment) -> dict[str, Any]:
    ended = [episode for episode in deployment.episodes if episode.result]
    successes = sum(episode.result.get("reason") == "success" for episode in ended)
    report = deployment.report
    return {
        "robot": report.get("robot", "robot unknown"),
        "bundle": report.get("bundle", "an unknown bundle"),
        "episodes": len(deployment.episodes),
        "ended": len(ended),
        "incomplete": len(deployment.episodes) - len(ended),
        "successes": successes,
        "success_95": list(share_interval(successes, len(ended))),
        "measures": [vars(m) for m in measures(deployment)],
        "sender": report.get("sender", {}),
    }
