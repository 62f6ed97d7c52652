"""Evaluate a run: all seeds, videos of two episodes, and the report files."""

from __future__ import annotations

import logging
import re
import shlex
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.config import to_yaml
from articulate.errors import MissingError
from articulate.files import read_json_object, write_bytes
from articulate.statistics import percent
from articulate.task.task import Task, done_word
from articulate_envs.rewards import TERMS
from articulate_envs.scene import Scene
from articulate_envs.video import render_png, write_episode_video
from articulate_train.command_line import train_command
from articulate_train.evaluate import MAX_NOMINAL, Rollout, evaluate_seed, timelines
from articulate_train.policy import load_policy
from articulate_train.report import Curve, Report, RunInfo, Timeline, make_report
from articulate_train.report_html import write_report
from articulate_train.run import DONE, Run, is_seed_done, versions
from articulate_train.seed_runner import processors, read_progress
from articulate_train.target_evaluation import reached_target
from articulate_train.training_time import training_s

log = logging.getLogger(__name__)
INTERVAL_S = 10.0
"""Time between progress lines of an evaluation [s]."""


@dataclass(frozen=True)
class Evaluated:
    """Report and its files."""

    report: Report
    json_path: Path
    html_path: Path

    def text(self) -> str:
        """Return a summary for the terminal."""
        r = self.report
        episodes = sum(s.success.n for s in r.seeds)
        worst = percent(r.worst_seed_success_rate)
        lines = [
            f"success {percent(r.success_rate)}% (worst seed {worst}%), "
            f"{done_word(r.info.task)} {percent(r.opened_rate)}%, of {episodes} episodes"
        ]
        reasons = ", ".join(f"{k} {v}" for k, v in r.reasons.items() if k != "success")
        if reasons:
            lines.append(f"failures: {reasons}")
        return "\n".join([*lines, f"report: {self.html_path}"])


def evaluate_run_folder(
    run: Run,
    *,
    episodes: int,
    ranges: float = 1.0,
    on: Run | None = None,
    show_progress: Callable[[str], None] = lambda _: None,
) -> Evaluated:
    """Evaluate the policies of all seeds and write ``report.json`` and ``report.html``.

    With other ranges or another object than in training, the report is written to a subfolder of
    the run: :func:`report_folder`.

    Args:
        run: The run.
        episodes: Randomized episodes for each seed.
        ranges: Factor on all ranges of the randomization.
        on: The run on another object, of :func:`articulate_train.run.with_object`.
        show_progress: Called with one line before each stage and during long ones.

    Raises:
        RunError: A seed has no checkpoint.
        ConfigError: ``ranges`` is not above 0, or a range would hold invalid values.
    """
    trained, folder = run, report_folder(run, ranges, on)
    run = (on or run).widened(ranges)
    results, rollouts = [], []
    for seed in run.config.seeds:
        load_policy(run.seed_folder(seed))  # report a missing checkpoint before the work
    unfinished = _unfinished(trained)
    if unfinished:
        show_progress(
            f"training incomplete ({unfinished}); continue with train --resume --out {run.folder}"
        )
    for seed in run.config.seeds:
        show_progress(
            f"evaluating seed {seed}: {episodes} randomized episodes, "
            f"{min(episodes, MAX_NOMINAL)} without randomization"
        )
        result, rollout = evaluate_seed(
            run,
            seed,
            episodes=episodes,
            threads=processors(),
            on_progress=_at_intervals(show_progress, f"seed {seed}"),
        )
        results.append(result)
        rollouts.append(rollout)
    show_progress("rendering videos and writing the report")
    lines, videos, poster = _videos(run, rollouts, folder)
    flags = _evaluate_flags(trained, episodes, ranges, on)
    report = make_report(
        _info(trained, run, flags),
        results,
        [_curve(run, s) for s in run.config.seeds],
        lines,
        videos,
        np.random.default_rng(run.config.evaluation_seed),
    )
    json_path, html_path = write_report(report, folder, poster=poster)
    return Evaluated(report, json_path, html_path)


def _at_intervals(show_progress: Callable[[str], None], name: str) -> Callable[[float], None]:
    """Return a callback that shows the completed fraction every :data:`INTERVAL_S`."""
    last_s = time.monotonic()

    def on_progress(fraction: float) -> None:
        nonlocal last_s
        if time.monotonic() - last_s >= INTERVAL_S:
            last_s = time.monotonic()
            show_progress(f"{name}: {fraction:.0%} of the randomized episodes are evaluated")

    return on_progress


def report_folder(run: Run, ranges: float = 1.0, on: Run | None = None) -> Path:
    """Return the folder of the report for the given ranges and object.

    Objects of the same name, and joints of one object, have separate folders.
    """
    parts = []
    if on is not None:
        joint = re.sub(r"\W+", "_", on.task.joint)
        parts.append(f"on_{on.asset.name}_{joint}_{on.asset.content_id()[:6]}")
    parts += [f"ranges_{ranges:g}"] if ranges != 1.0 else []
    return run.folder / "_".join(parts) if parts else run.folder


def _evaluate_flags(run: Run, episodes: int, ranges: float, on: Run | None) -> str:
    """Return the flags of ``evaluate`` that repeat the report; empty if ``train`` writes it."""
    flags: list[object] = []
    if on is not None:
        flags += ["--asset", on.config.asset, "--joint", on.task.joint]
    if ranges != 1.0:
        flags += ["--ranges", f"{ranges:g}"]
    usual = not flags and episodes == run.config.episodes
    return "" if usual else shlex.join(map(str, ["--episodes", episodes, *flags]))


def describe_target(task: Task) -> str:
    """Describe the goal of ``task`` in one phrase."""
    unit = "m" if task.kind == "slide" else "rad"
    travel = abs(task.span) * task.target
    slow = f"slower than {task.slow} {unit}/s"
    most = "at most " if task.closes else ""
    return f"{most}{travel:.3f} {unit} from closed for the last {task.hold_s} s, {slow}"


def _command(run: Run, flags: str) -> str:
    """Return the command that makes ``run``, and that of an evaluation with ``flags`` if any."""
    config, joint, name = run.config, run.task.joint, shlex.quote(run.folder.name)
    command = train_command(config, joint)
    if _generalist_steps(run):
        words = ["--asset", config.asset, "--task", config.task, "--joint", joint]
        command = shlex.join(["evaluate", "--policy", "generalist", *words])
    return f"{command} --out {name}\nevaluate {name} {flags}" if flags else command


def _generalist_steps(run: Run) -> int:
    """Return the control steps of the generalist policy if it is that of ``run``, else 0."""
    done = read_json_object(run.seed_folder(run.config.seeds[0]) / DONE)
    return int(done["control_steps"]) if done.get("policy") == "generalist" else 0


def _info(run: Run, evaluated: Run, flags: str = "") -> RunInfo:
    """Describe ``run``, evaluated with ``flags`` on the object and ranges of ``evaluated``."""
    rows = [read_progress(run.seed_folder(s)) for s in run.config.seeds]
    seconds = training_s(run.folder, [r[-1]["seconds"] for r in rows if r])
    steps = sum(r[-1]["steps"] for r in rows if r)
    config = run.config
    return RunInfo(
        name=run.folder.name,
        asset=evaluated.asset.name,
        task=evaluated.task.name,
        joint=evaluated.task.joint,
        target_text=describe_target(evaluated.task),
        target=evaluated.task.target,
        steps=_generalist_steps(run) or config.steps,
        seconds=seconds,
        steps_per_s=steps / max(seconds, 1e-9),
        command=_command(run, flags),
        config=to_yaml(evaluated.config),
        versions=versions(),
        licence=evaluated.asset.licence,
        source=evaluated.asset.source,
        commit=commit(),
        limits=evaluated.task.limits,
        unfinished=_unfinished(run),
        early_stopping=_early_stopping(run),
    )


def _unfinished(run: Run) -> str:
    """Describe the progress of seeds with incomplete training; empty if there are none."""
    rows_text = []
    for seed in run.config.seeds:
        folder, total = run.seed_folder(seed), run.config.steps
        if not is_seed_done(run.config, folder):
            rows = read_progress(folder)
            now = rows[-1]["steps"] if rows else 0
            rows_text.append(f"seed {seed} has {now / 1e6:.3g} of {total / 1e6:.3g}M control steps")
    return ", ".join(rows_text)


def _early_stopping(run: Run) -> str:
    """Describe the seeds whose training ended at the target success; empty if there are none."""
    found = {seed: reached_target(run.seed_folder(seed) / DONE) for seed in run.config.seeds}
    return ", ".join(f"seed {k}: {one.text()}" for k, one in found.items() if one is not None)


def commit() -> str:
    """Return the commit of the code if it is a checkout, else ``"unknown"``."""
    try:
        _git(
            "ls-files", "--error-unmatch", Path(__file__).name
        )  # not the checkout of another project
        return _git("rev-parse", "--short", "HEAD")
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", *words],  # noqa: S607
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=True,
        timeout=10,
    )
    return done.stdout.strip()


def _curve(run: Run, seed: int) -> Curve:
    rows = read_progress(run.seed_folder(seed))

    def column(name: str) -> Any:
        return np.array([row[name] for row in rows], dtype=np.float64)

    terms = [[row["terms"].get(term, 0.0) for term in TERMS] for row in rows]
    return Curve(
        seed=seed,
        steps=column("steps"),
        success=column("success"),
        opened=column("opened"),
        reward_terms=np.array(terms, dtype=np.float64).reshape(len(rows), len(TERMS)),
    )


def _videos(
    run: Run, rollouts: list[Rollout], folder: Path
) -> tuple[list[Timeline], list[str], bytes | None]:
    """Return timelines, videos and an image of the first success and failure of all seeds."""
    lines: dict[str, tuple[Timeline, int, Rollout]] = {}
    for rollout in rollouts:
        for line, k in timelines(rollout, run.config.control.step_s):
            lines.setdefault(line.name, (line, k, rollout))
    videos: list[str] = []
    poster: bytes | None = None
    scene = run.scene((1.0,))
    try:
        for name, (_, k, rollout) in lines.items():
            videos.append(_write_video(folder, scene, rollout, k, name))
        for earlier in (folder / "videos").glob("*.mp4"):
            if earlier.stem not in lines:
                earlier.unlink()  # of an earlier evaluation
        if lines:
            _, k, rollout = next(iter(lines.values()))
            poster = render_png(
                scene,
                rollout.traces.qpos[-1, k],
                scale=float(rollout.params["scale"][k]),
                T_wo=rollout.poses[k],
            )
    except MissingError as error:
        log.warning("no videos: %s", error)
    return [line for line, _, _ in lines.values()], videos, poster


def _write_video(folder: Path, scene: Scene, rollout: Rollout, k: int, name: str) -> str:
    path = Path("videos") / f"{name}.mp4"
    # Rendered outside the run, so that a killed process leaves no incomplete video in it.
    with tempfile.TemporaryDirectory(prefix="articulate-video-") as outside:
        made = write_episode_video(
            Path(outside) / path.name,
            scene,
            rollout.traces.qpos[:, k],
            scale=float(rollout.params["scale"][k]),
            T_wo=rollout.poses[k],
            step_s=scene.control.step_s,
        )
        write_bytes(folder / path, made.read_bytes())
    return path.as_posix()
