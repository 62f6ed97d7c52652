"""From a trained run to its report: evaluate every seed, film two episodes, write the files."""

from __future__ import annotations

import logging
import re
import shlex
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.config import to_yaml
from articulate.errors import MissingError
from articulate.task.task import Task, done_word
from articulate_envs.rewards import TERMS
from articulate_envs.scene import Scene
from articulate_envs.video import picture, write_film
from articulate_train.command_line import train_command
from articulate_train.evaluate import NOMINAL, Rollout, evaluate_seed, timelines
from articulate_train.policy import load_policy
from articulate_train.report import Curve, Report, RunInfo, Timeline, make_report
from articulate_train.report_html import write_report
from articulate_train.run import DONE, Run, done_steps, versions
from articulate_train.seed_runner import processors, read_progress
from articulate_train.statistics import percent
from articulate_train.training_time import trained_s

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Evaluated:
    """A report and where it lies."""

    report: Report
    json_path: Path
    html_path: Path

    def text(self) -> str:
        """A few lines for a terminal."""
        r = self.report
        episodes = sum(s.success.episodes for s in r.seeds)
        worst = percent(r.worst_seed_success_rate)
        lines = [
            f"success {percent(r.success_rate)}% (worst seed {worst}%), "
            f"{done_word(r.info.task)} {percent(r.opened_rate)}%, of {episodes} episodes"
        ]
        reasons = ", ".join(f"{k} {v}" for k, v in r.reasons.items() if k != "success")
        if reasons:
            lines.append(f"failures: {reasons}")
        return "\n".join([*lines, f"report: {self.html_path}"])


def judge_run(
    run: Run,
    *,
    episodes: int,
    ranges: float = 1.0,
    on: Run | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Evaluated:
    """Evaluate the policies of all seeds and write ``report.json`` and ``report.html``.

    Args:
        run: What is evaluated.
        episodes: Drawn episodes for each seed.
        ranges: So many times as wide is every range of the randomisation.
        on: The same run on another object, of :func:`articulate_train.run.on_object`; by default
            its own.
        say: Told what is done next.

    Where ranges or object are others than those of training, the report lies in a folder of its own
    in the run, which :func:`report_folder` names.

    Raises:
        RunError: A seed has no checkpoint.
        ConfigError: ``ranges`` is not above 0, or a range would hold what cannot be.
    """
    trained, folder = run, report_folder(run, ranges, on)
    run = (on or run).widened(ranges)
    results, rollouts = [], []
    for seed in run.config.seeds:
        load_policy(run.seed_folder(seed))  # what is missing is told before the work
    lacking = _unfinished(trained)
    if lacking:
        say(f"training is not over ({lacking}); train --resume --out {run.folder} goes on")
    for seed in run.config.seeds:
        say(
            f"evaluating seed {seed}: {episodes} drawn episodes, "
            f"{min(episodes, NOMINAL)} without randomisation"
        )
        result, rollout = evaluate_seed(run, seed, episodes=episodes, threads=processors())
        results.append(result)
        rollouts.append(rollout)
    say("filming an episode of each kind, and writing the report")
    lines, videos, poster = _pictures(run, rollouts, folder)
    also = _also(trained, episodes, ranges, on)
    report = make_report(
        _info(trained, run, f"\nevaluate {run.folder.name} {also}" if also else ""),
        results,
        [_curve(run, s) for s in run.config.seeds],
        lines,
        videos,
        np.random.default_rng(run.config.evaluation_seed),
    )
    json_path, html_path = write_report(report, folder, poster=poster)
    return Evaluated(report, json_path, html_path)


def report_folder(run: Run, ranges: float = 1.0, on: Run | None = None) -> Path:
    """Where the report of a run lies that is judged with wider ranges, or on another object.

    Objects of the same name, and joints of one object, have folders of their own.
    """
    parts = []
    if on is not None:
        joint = re.sub(r"\W+", "_", on.task.joint)
        parts.append(f"on_{on.asset.name}_{joint}_{on.asset.content_id()[:6]}")
    parts += [f"ranges_{ranges:g}"] if ranges != 1.0 else []
    return run.folder / "_".join(parts) if parts else run.folder


def _also(run: Run, episodes: int, ranges: float, on: Run | None) -> str:
    """Flags of the ``evaluate`` that repeats a report which ``train`` does not make; else empty."""
    flags: list[object] = []
    if on is not None:
        flags += ["--asset", on.config.asset, "--joint", on.task.joint]
    if ranges != 1.0:
        flags += ["--ranges", f"{ranges:g}"]
    usual = not flags and episodes == run.config.episodes
    return "" if usual else shlex.join(map(str, ["--episodes", episodes, *flags]))


def target_text(task: Task) -> str:
    """What counts as done, in words."""
    unit = "m" if task.kind == "slide" else "rad"
    way = abs(task.span) * task.target
    slow = f"slower than {task.slow} {unit}/s"
    most = "at most " if task.closes else ""
    return f"{most}{way:.3f} {unit} from closed for the last {task.hold_s} s, {slow}"


def _info(run: Run, judged: Run, also: str = "") -> RunInfo:
    """What is told of ``run``, whose policies are judged on the object and draws of ``judged``."""
    rows = [read_progress(run.seed_folder(s)) for s in run.config.seeds]
    seconds = trained_s(run.folder, [r[-1]["seconds"] for r in rows if r])
    steps = sum(r[-1]["steps"] for r in rows if r)
    config = run.config
    return RunInfo(
        name=run.folder.name,
        asset=judged.asset.name,
        task=judged.task.name,
        joint=judged.task.joint,
        target_text=target_text(judged.task),
        target=judged.task.target,
        steps=config.steps,
        seconds=seconds,
        steps_per_s=steps / max(seconds, 1e-9),
        command=train_command(config, run.task.joint) + also,
        config=to_yaml(judged.config),
        versions=versions(),
        licence=judged.asset.licence,
        source=judged.asset.source,
        commit=commit(),
        limits=judged.task.limits,
        unfinished=_unfinished(run),
    )


def _unfinished(run: Run) -> str:
    """How far seeds are whose training is not over; empty if there are none."""
    told = []
    for seed in run.config.seeds:
        folder, asked = run.seed_folder(seed), run.config.steps
        if done_steps(folder / DONE) < asked:
            rows = read_progress(folder)
            now = rows[-1]["steps"] if rows else 0
            told.append(f"seed {seed} has {now / 1e6:.3g} of {asked / 1e6:.3g}M ticks")
    return ", ".join(told)


def commit() -> str:
    """Commit of the code where it is a checkout, else ``"unknown"``."""
    try:
        _git("ls-files", "--error-unmatch", Path(__file__).name)  # not the checkout of another
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


def _pictures(
    run: Run, rollouts: list[Rollout], folder: Path
) -> tuple[list[Timeline], list[str], bytes | None]:
    """Timelines and clips of the first success and failure over all seeds, and a picture."""
    lines: dict[str, tuple[Timeline, int, Rollout]] = {}
    for rollout in rollouts:
        for line, k in timelines(rollout, run.config.follow.tick_s):
            lines.setdefault(line.name, (line, k, rollout))
    videos: list[str] = []
    poster: bytes | None = None
    scene = run.scene((1.0,))
    try:
        for name, (_, k, rollout) in lines.items():
            videos.append(_film(folder, scene, rollout, k, name))
        for earlier in (folder / "videos").glob("*.mp4"):
            if earlier.stem not in lines:
                earlier.unlink()  # of an evaluation that had such an episode, as this has not
        if lines:
            _, k, rollout = next(iter(lines.values()))
            poster = picture(
                scene,
                rollout.traces.qpos[-1, k],
                scale=float(rollout.draws["scale"][k]),
                T_wo=rollout.poses[k],
            )
    except MissingError as error:
        log.warning("no videos: %s", error)
    return [line for line, _, _ in lines.values()], videos, poster


def _film(folder: Path, scene: Scene, rollout: Rollout, k: int, name: str) -> str:
    path = Path("videos") / f"{name}.mp4"
    write_film(
        folder / path,
        scene,
        rollout.traces.qpos[:, k],
        scale=float(rollout.draws["scale"][k]),
        T_wo=rollout.poses[k],
        tick_s=scene.follow.tick_s,
    )
    return path.as_posix()
