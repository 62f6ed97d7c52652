"""``articulate benchmark``: score an actor on objects with known joints."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from articulate.benchmark.ablation_rows import Ablation
from articulate.benchmark.config import BenchmarkConfig, Condition, ImageState, Task
from articulate.benchmark.split import half
from articulate.commands import console, version
from articulate.commands.fields import ADVANCED, POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError, nearest
from articulate.files import write_json
from articulate.reconstruct.actors.modality import Modality
from articulate.untrusted import load_json_object

if TYPE_CHECKING:
    from articulate.reconstruct.actors.vlm.options import ModelOptions

LOST_EXIT = 3
MOST_LIMIT_S = 1e6
"""Largest time limit [s]."""
SCHEMA, SCHEMA_VERSION = "articulate.benchmark", 2
RESULTS_BYTES = 100_000_000
"""Largest results of another run that are read."""
PROMPTS_FOLDER = "prompts"
PROTOCOLS = ("paper", "released_code", "strict")
COMPARED = ("config", "protocols", "errors", "iterations", "cost")
MODEL_ACTORS = ("vlm", "hybrid")
SETTINGS = ("actor", "modality", "task", "condition")
"""Keys of other runs that the report reads, and those of their settings."""


@dataclass(frozen=True, kw_only=True)
class BenchmarkFlags:
    """Score an actor on objects with known joints.

    Example: articulate benchmark assets.json --modality video --actor prior --out runs/prior
    """

    dataset: Annotated[str, POSITIONAL]
    """An index such as assets.json, a folder of URDFs, or the library: procedural."""
    out: Path | None = None
    """Folder for results.json, report.html and one record for each object; by default
    runs/benchmark-<modality>-<actor>-<time>. A run that exists there is continued."""
    actor: str = "prior"
    """Name of the actor, or module:Class."""
    model: str = ""
    """Model of the actors vlm and hybrid: [gemini:|openai:|anthropic:]NAME[@URL]; by default that
    of ARTICULATE_MODEL."""
    budget: tuple[str, ...] = ()
    """Limits of the requests to the model: calls=N tokens=N usd=N; usd needs usd_in and usd_out,
    the costs of a million tokens."""
    examples: Annotated[int | None, ADVANCED] = None
    """Number of in-context examples of the actors vlm and hybrid, 0 to 20; by default 5."""
    record: Path | None = None
    """Folder that stores all answers of the model. With such a folder the run is repeated without
    key and network."""
    modality: Modality = "video"
    """Input of the actor."""
    predictions: str = ""
    """Score imported outputs instead of an actor: urdformer:FOLDER or real2code:FOLDER, with a file
    for each object that is named by its id."""
    task: Task = "joints"
    """Task; in placement the parts are displaced."""
    condition: Annotated[Condition, ADVANCED] = "plain"
    """Degradation of images and camera."""
    image_state: Annotated[ImageState, ADVANCED] = "open"
    """Joint state in images; in placement all joints are closed."""
    protocol: Literal["all", "paper", "released_code", "strict"] = "all"
    """Printed protocol; the files hold all."""
    data: Annotated[Path | None, ADVANCED] = None
    """Root of the paths in an index; by default the folder of the index."""
    jobs: int = 1
    """Number of objects in parallel; 0: one for each processor."""
    limit: float = 3600.0
    """Time after which an object is lost [s]."""
    query_limit: Annotated[float, ADVANCED] = 600.0
    """Processor time after which a query has no answer [s]."""
    only: tuple[str, ...] = ()
    """Ids or categories to run; all by default."""
    first: int | None = None
    """Run this number of objects at most, spread evenly over the data set."""
    split: Annotated[Literal["all", "development", "published"], ADVANCED] = "all"
    """Half of the objects, by the hash of their ids."""
    ablation: tuple[Ablation, ...] = ()
    """Run the rows of these ablations, each with its actor and modality, and print their tables."""
    width_px: Annotated[int, ADVANCED] = 640
    """Width of images [px]."""
    height_px: Annotated[int, ADVANCED] = 480
    """Height of images [px]."""
    n_frames: Annotated[int, ADVANCED] = 50
    """Number of frames of a video."""
    seed: int = 0
    """Random seed of order, names, noise and actor."""
    rerun: bool = False
    """Run completed objects again."""
    export: Annotated[bool, ADVANCED] = False
    """Write the queries as files to --out, without running the actor."""
    dry_run: Annotated[bool, ADVANCED] = False
    """Write the prompts for the first query of each object to --out; no requests are sent."""
    compare_with: tuple[Path, ...] = ()
    """Folders of other runs to compare with in the report."""
    json: bool = False
    """Print only the results, as JSON, on standard output."""

    def __post_init__(self) -> None:
        if self.jobs < 0:
            raise ConfigError(f"--jobs is {self.jobs}; it must be 0 or more")
        if not self.limit > 0.0:
            raise ConfigError(f"--limit is {self.limit:g} s; it must be above 0")
        if not self.limit <= MOST_LIMIT_S:
            raise ConfigError(
                f"--limit is {self.limit:g} s; it must be at most {MOST_LIMIT_S:.0f} s"
            )
        if not self.query_limit > 0.0:
            raise ConfigError(f"--query-limit is {self.query_limit:g} s; it must be above 0")
        if self.first is not None and self.first < 1:
            raise ConfigError(f"--first is {self.first}; it must be 1 or more")
        if self.seed < 0:
            raise ConfigError(f"--seed is {self.seed}; it must be 0 or more")
        if self.predictions and (self.ablation or self.actor != "prior" or self.task != "joints"):
            raise ConfigError("--predictions has no --actor, --task and --ablation; leave them out")
        if self.ablation and (self.actor, self.modality, self.task) != ("prior", "video", "joints"):
            raise ConfigError(
                "--ablation sets actor, modality and task of each row; leave out --actor, "
                "--modality and --task"
            )

    @property
    def folder(self) -> Path:
        """Folder of the results."""
        actor = (self.predictions or self.actor).replace(":", ".").replace("/", ".")
        words = self.ablation or (self.modality, actor)
        name = f"benchmark-{'-'.join(words)}-{time.strftime('%Y%m%d-%H%M%S')}"
        return self.out or Path("runs") / name

    def config(self) -> BenchmarkConfig:
        """Return the settings that determine the results."""
        return BenchmarkConfig(
            actor=self.predictions or self.actor,
            modality="image" if self.predictions else self.modality,
            task=self.task,
            condition=self.condition,
            image_state=self.image_state,
            width_px=self.width_px,
            height_px=self.height_px,
            n_frames=self.n_frames,
            query_limit_s=self.query_limit,
            seed=self.seed,
        )


FLAGS = BenchmarkFlags


def main(argv: Sequence[str]) -> int:
    """Run and print; 3 if objects were lost."""
    flags = parse(BenchmarkFlags, argv, prog="articulate benchmark")
    flags = dataclasses.replace(flags, out=flags.folder)
    if flags.export:
        exported = {"queries": _export(flags), "folder": str(flags.out)}
        _emit(flags, exported, "{queries} queries and their answers: {folder}")
        return 0
    if flags.dry_run:
        written = _dry_run(flags)
        _emit(
            flags,
            written,
            "{pages} pages; dry run, no requests sent: {folder}\n"
            "{cases} cases, {requests} to {requests_max} requests, about {tokens_in:,} to "
            "{tokens_in_max:,} input tokens and {tokens_out:,} to {tokens_out_max:,} output tokens",
        )
        return 0
    named = any(word.partition("=")[0] == "--out" for word in argv)
    again = argv if named else [*argv, "--out", flags.folder]
    command = console.command_line(["articulate", "benchmark", *again])
    console.hint_after_interrupt(f"continue with: {command}")
    if flags.ablation:
        results = _run_ablations(flags, command)
        console.emit_json(results) if flags.json else console.emit(_ablation_text(results, flags))
        rows = [row["results"] for table in results["ablations"] for row in table["rows"]]
        return LOST_EXIT if any(row["crashed"] for row in rows if row) else 0
    results = _run(flags, command)
    console.emit_json(results) if flags.json else console.emit(_text(results, flags))
    return LOST_EXIT if results["crashed"] else 0


def _emit(flags: BenchmarkFlags, content: dict[str, Any], text: str) -> None:
    """Print ``content`` as text or as JSON."""
    console.emit_json(content) if flags.json else console.emit(text.format(**content))


def _export(flags: BenchmarkFlags) -> int:
    """Write the queries and return their number."""
    from articulate.benchmark.dataset import open_dataset
    from articulate.benchmark.export import write_questions

    dataset = open_dataset(flags.dataset, flags.data)
    ids = _chosen(dataset.ids(), [dataset.category(i) for i in dataset.ids()], flags)
    return len(write_questions(map(dataset.load, ids), flags.config(), flags.folder))


def _dry_run(flags: BenchmarkFlags) -> dict[str, Any]:
    """Write a page of prompts for each object and return the number of requests and tokens.

    The first case of an object is written and counts for all its cases.
    """
    from articulate.benchmark.dataset import open_dataset
    from articulate.benchmark.evidence import cases_of
    from articulate.reconstruct.actors.registry import make_actor
    from articulate.reconstruct.actors.vlm.dry_run import DryRunSize, write_dry_run

    dataset = open_dataset(flags.dataset, flags.data)
    actor = _models(flags).apply(make_actor(flags.actor))
    ids = _chosen(dataset.ids(), [dataset.category(i) for i in dataset.ids()], flags)
    pages, cases, size = 0, 0, DryRunSize()
    for k, object_id in enumerate(ids):
        subject = dataset.load(object_id)
        case = next(iter(cases_of(subject, flags.config())), None)
        if case is None:  # an object without joints has no video
            continue
        page = flags.folder / PROMPTS_FOLDER / f"prompts_{k:04d}.html"
        text = f"{flags.modality}, {object_id}: {case.name}"
        n_cases = len(subject.joints) if flags.modality == "video" else 1
        size = size.plus(write_dry_run(actor, case.evidence, page, text).times(n_cases))
        pages, cases = pages + 1, cases + n_cases
    folder = str(flags.folder / PROMPTS_FOLDER)
    return {"pages": pages, "folder": folder, "cases": cases, **vars(size)}


def _models(flags: BenchmarkFlags) -> ModelOptions:
    """Return the settings of the actor's models; the use is counted over all processes."""
    from articulate.reconstruct.actors.vlm.options import LEDGER, ModelOptions

    models = ModelOptions(model=flags.model, budget=flags.budget, examples=flags.examples)
    if flags.record is not None:
        return models if flags.dry_run else models.recorded(flags.record)
    if models != ModelOptions() or flags.actor in MODEL_ACTORS:
        return dataclasses.replace(models, ledger=str(flags.folder / LEDGER))
    return models


def _run(flags: BenchmarkFlags, command: str) -> dict[str, Any]:
    """Run the benchmark, write results and page, and return the results."""
    # These read meshes, which --help does without.
    from articulate.benchmark.batch import BenchmarkBatch
    from articulate.benchmark.dataset import open_dataset
    from articulate.benchmark.imported_predictions import validity
    from articulate.benchmark.report import write_report
    from articulate.benchmark.summary import summary
    from articulate.reconstruct.actors.registry import make_actor

    config, models = flags.config(), _models(flags)
    others = {str(folder): _results_in(folder) for folder in flags.compare_with}
    dataset = open_dataset(flags.dataset, flags.data)
    ids = _chosen(dataset.ids(), [dataset.category(i) for i in dataset.ids()], flags)
    if flags.predictions:
        imported = validity(flags.predictions, ids)
    else:
        models.apply(make_actor(config.actor))  # an unknown actor is an error before any work
    batch = BenchmarkBatch(
        dataset=dataset,
        source=flags.dataset,
        data=flags.data,
        config=config,
        out=flags.folder,
        limit_s=flags.limit,
        fresh=flags.rerun,
        models=models,
    )
    jobs = min(flags.jobs or os.cpu_count() or 1, len(ids))
    records = list(_with_progress(batch.run(ids, jobs), len(ids)))
    results = summary(records, config, dataset.name)
    if flags.predictions:
        results["predictions"] = imported
    if models.ledger:
        results["model"] = {"source": models.source, **vars(models.usage)}
    write_json(flags.folder / "results.json", results)
    page = flags.folder / "report.html"
    write_report(results, records, page, command, {"articulate": version()}, others)
    return results


def _run_ablations(flags: BenchmarkFlags, command: str) -> dict[str, Any]:
    """Run the rows of the ablations, write results and page, and return the results."""
    from articulate.benchmark.ablation import SCHEMA, SCHEMA_VERSION, AblationRun
    from articulate.benchmark.ablation_report import write_ablation_report
    from articulate.benchmark.dataset import open_dataset

    dataset = open_dataset(flags.dataset, flags.data)
    ids = _chosen(dataset.ids(), [dataset.category(i) for i in dataset.ids()], flags)
    run = AblationRun(
        dataset=dataset,
        source=flags.dataset,
        data=flags.data,
        base=flags.config(),
        ids=ids,
        out=flags.folder,
        jobs=min(flags.jobs or os.cpu_count() or 1, len(ids)),
        limit_s=flags.limit,
        fresh=flags.rerun,
        recordings=flags.record,
    )
    results = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "dataset": dataset.name,
        "config": {"condition": flags.condition, "seed": flags.seed, "split": flags.split},
        "objects": len(ids),
        "ablations": [run.table(name, _with_progress) for name in dict.fromkeys(flags.ablation)],
    }
    write_json(flags.folder / "ablations.json", results)
    page = flags.folder / "report.html"
    write_ablation_report(results, page, command, {"articulate": version()})
    return results


def _ablation_text(results: dict[str, Any], flags: BenchmarkFlags) -> str:
    """Format the tables of ablations."""
    lines = [f"{results['objects']} objects of {results['dataset']}"]
    for table in results["ablations"]:
        lines.append(table["ablation"])
        for row in table["rows"]:
            text = row["status"]
            if row["results"]:
                found = row["results"]["protocols"]
                text = ", ".join(
                    f"{name} {found[name]['joint_success']:.1%}"
                    for name in ("paper", "strict")
                    if found[name]["joint_success"] is not None
                )
                text += f" of {found['paper']['n']} joints"
            lines.append(f"  {row['label']:<24} {text}")
    return "\n".join([*lines, f"page: {flags.folder / 'report.html'}"])


def _results_in(folder: Path) -> dict[str, Any]:
    path = folder / "results.json"
    try:
        content = load_json_object(path, limit_bytes=RESULTS_BYTES, error=ConfigError)
    except ConfigError as error:
        raise ConfigError(f"--compare-with {error}") from None
    if content.get("schema") != SCHEMA or content.get("schema_version") != SCHEMA_VERSION:
        raise ConfigError(
            f"--compare-with {folder}: {path.name} is not of {SCHEMA} {SCHEMA_VERSION}; "
            "run that benchmark again"
        )
    config = content.get("config")
    missing = [key for key in COMPARED if key not in content]
    missing += [key for key in SETTINGS if not isinstance(config, dict) or key not in config]
    if missing:
        raise ConfigError(
            f"--compare-with {folder}: {path.name} has no {missing[0]}; run that benchmark again"
        )
    return content


def _chosen(ids: Sequence[str], categories: Sequence[str], flags: BenchmarkFlags) -> list[str]:
    chosen = list(ids)
    if flags.only:
        known = {*ids, *categories}
        for word in flags.only:
            if word not in known:
                raise ConfigError(
                    f"--only {word}: no such object or category{nearest(word, known)}"
                )
        pairs = zip(ids, categories, strict=True)
        chosen = [i for i, category in pairs if i in flags.only or category in flags.only]
    if flags.split != "all":
        chosen = [i for i in chosen if half(i) == flags.split]
    if not chosen:
        raise ConfigError(f"--split {flags.split}: no object remains")
    if flags.first is not None and flags.first < len(chosen):
        step = len(chosen) / flags.first
        chosen = [chosen[int(k * step)] for k in range(flags.first)]
    return chosen


def _with_progress(
    records: Iterator[dict[str, Any]], total: int, label: str = ""
) -> Iterator[dict[str, Any]]:
    """Yield the records, with progress on stderr; ``label`` names the row of an ablation."""
    for done, record in enumerate(records, 1):
        joints = [joint for case in record["cases"] for joint in case["joints"]]
        right = sum(joint["failures"]["strict"] == "success" for joint in joints)
        text = record["error"] or f"{right} of {len(joints)} joints right in strict"
        run = f"{label}: " if label else ""
        console.show_progress(f"{run}{done}/{total} {record['object']}: {text}")
        yield record


def _text(results: dict[str, Any], flags: BenchmarkFlags) -> str:
    """Format the results."""
    wanted = PROTOCOLS if flags.protocol == "all" else (flags.protocol,)
    lines = [f"{results['objects']} objects, {results['joints']} joints"]
    for protocol in wanted:
        row = results["protocols"][protocol]
        if row["joint_success"] is None:
            lines.append(f"{protocol:<14} no joints")
            continue
        low, high = row["joint_success_interval"]
        lines.append(
            f"{protocol:<14} {row['joint_success']:6.1%} of {row['n']} "
            f"({low:.1%} to {high:.1%}); type, axis, origin {row['type_axis_origin']:.1%}"
        )
    if "model" in results:
        lines.append(
            "{source}: {calls} calls, {tokens_in:,} input and {tokens_out:,} output tokens".format(
                **results["model"]
            )
        )
    if "predictions" in results:
        found = results["predictions"]
        reasons = ", ".join(f"{name} {n}" for name, n in found["invalid"].items())
        lines.append(f"{found['valid']} of {found['files']} files valid; invalid: {reasons}")
    if results["placement"] is not None:
        objects = results["placement"]["objects"]
        summary = ", ".join(f"{p} {objects[p]['share']:.1%}" for p in wanted)
        lines.append(f"{'placement':<14} objects right: {summary}")
    if results["crashed"]:
        lines.append(f"crashed: {', '.join(row['object'] for row in results['crashed'][:8])}")
    return "\n".join([*lines, f"page: {flags.folder / 'report.html'}"])
