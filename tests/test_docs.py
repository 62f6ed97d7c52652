"""The documents of the repository keep their promises."""

import ast
import dataclasses
import importlib
import os
import re
import shlex
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config

from articulate.assets.asset import Asset, Handle, Joint, Link
from articulate.commands.benchmark import BenchmarkFlags
from articulate.commands.cache import CacheFlags
from articulate.commands.check import CheckFlags
from articulate.commands.completion import SHELLS
from articulate.commands.fields import flags_of
from articulate.commands.flags import parse
from articulate.commands.make import MakeFlags
from articulate.commands.observe import ObserveFlags
from articulate.commands.watch import WatchFlags
from articulate.robot.config import ControlConfig
from articulate.task.episode_monitor import REASONS
from articulate.task.manifest import Manifest
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Limits
from articulate_deploy.commands.deploy import DeployFlags
from articulate_envs.config import InitialStatesConfig, RewardConfig
from articulate_envs.interface import OPTIONS
from articulate_envs.make_scene import EnvConfig
from articulate_train.commands.evaluate import EvaluateFlags
from articulate_train.commands.export import ExportFlags
from articulate_train.commands.train import TrainFlags
from articulate_train.config import ActionScalingConfig, ImitationConfig
from articulate_train.report import Report

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = [
    "articulate",
    "envs",
    "train",
    "deploy",
    "configs",
    "benchmarks",
    "docs",
    "docs/commands",
    "docs/results",
]
PAGES = sorted(
    [*ROOT.glob("*.md"), *(p for folder in FOLDERS for p in ROOT.glob(f"{folder}/*.md"))]
)
OURS = "articulate|benchmarks|configs|deploy|docs|envs|scripts|tests|train"
FLAGS = {
    "check-asset": CheckFlags,
    "check": CheckFlags,
    "train": TrainFlags,
    "evaluate": EvaluateFlags,
    "export-policy": ExportFlags,
    "export": ExportFlags,
    "deploy": DeployFlags,
    "benchmark": BenchmarkFlags,
    "make": MakeFlags,
    "observe": ObserveFlags,
    "watch": WatchFlags,
    "cache": CacheFlags,
}
COMMON = {"--config", "--help", "--quiet", "--verbose"}
"""Flags of every command."""

OTHERS = {"coverage", "source", "tensorboard"}
"""Commands in the documents that are not ours."""


def fences(page):
    """Language and text of each fenced block of ``page``."""
    parts = re.split(r"^```(.*)\n", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return list(zip(parts[1::4], parts[2::4], strict=True))


SLOW = {"docs/engines.md"}
"""Pages whose blocks take seconds: they prove a cabinet, or train on it."""


def blocks(language):
    """Fenced blocks of ``language`` in all pages, as parameters."""
    return [
        pytest.param(
            text,
            id=f"{page.relative_to(ROOT)}-{k}",
            marks=[pytest.mark.slow] if str(page.relative_to(ROOT)) in SLOW else [],
        )
        for page in PAGES
        for k, (kind, text) in enumerate(fences(page))
        if kind == language
    ]


def table(page, head):
    """Rows of the table in ``docs/<page>`` whose head begins with ``head``, as lists of cells."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    found = re.search(rf"^\| {re.escape(head)} \|.*\n\|[-|]+\n((?:\|.*\n?)+)", text, re.MULTILINE)
    assert found, f"no table {head!r} in {page}"
    rows = [row.strip("|").split(" | ") for row in found[1].splitlines()]
    return [[cell.strip(" ") for cell in row] for row in rows]


def words(line):
    """Words of a shell line in the documents, with assignments and redirections taken away."""
    found = shlex.split(line, comments=True)
    while found and re.fullmatch(r"[A-Z_]+=.*", found[0]):
        del found[0]
    return found[: found.index(">")] if ">" in found else found


def slug(heading):
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    links = re.findall(r"\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    missing = []
    for link in links:
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if "://" in link:
            continue
        if not target.exists():
            missing.append(link)
        elif anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            missing += [link] if anchor not in map(slug, headings) else []
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_files_of_the_repository_that_are_named_are_there(page):
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(rf"`((?:{OURS})/[\w./-]+\.\w+)`", text))
    named |= set(re.findall(r"`(scripts/\w+)[ `]", text))
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_modules_that_are_named_are_there(page):
    named = re.findall(r"`(articulate_\w+\.[\w.]+)`((?:, `\w+`)*)", page.read_text())
    missing = []
    for first, others in named:
        package = first.split(".", 1)[0]
        names = [first, *(f"{package}.{name}" for name in re.findall(r"\w+", others))]
        missing += [name for name in names if not there(name)]
    assert missing == []


def there(name):
    """Whether ``name`` is a module, or something that a module holds."""
    parent, last = name.rsplit(".", 1)
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # its parent is no package
        return hasattr(importlib.import_module(parent), last)


@pytest.mark.parametrize("text", blocks("bash"))
def test_shell_lines_name_what_is_there_and_flags_that_exist(text):
    for line in text.replace("\\\n", " ").splitlines():
        call = words(line)
        if not call:
            continue
        command, rest = call[0].removeprefix(".venv/bin/"), call[1:]
        if command == "articulate":
            command, rest = rest[0], rest[1:]
        if command == "--completion":
            assert rest[0] in SHELLS
            continue
        if command in FLAGS:
            resumes = TrainFlags(asset="kept") if "--resume" in rest else None
            parse(FLAGS[command], rest, default=resumes, prog=command)
        elif command.startswith("python"):
            source = (ROOT / rest[0]).read_text(encoding="utf-8")
            if "import policy_parser" in source:
                source += (ROOT / "benchmarks/policy_flags.py").read_text(encoding="utf-8")
            assert all(f'"{flag}"' in source for flag in rest if flag.startswith("--"))
        else:
            assert command in OTHERS or os.access(ROOT / command, os.X_OK), line


@pytest.mark.parametrize("text", blocks("python"))
def test_python_in_the_documents_runs(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(text, "document", "exec"), {"__name__": "document"})


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_block_names_its_language(page):
    assert {kind for kind, _ in fences(page)} <= {"bash", "python", "text"}


@pytest.mark.parametrize(
    ("head", "cls", "index"),
    [
        ("setting", ControlConfig, 0),
        ("setting", ActionScalingConfig, 1),
        ("setting", RandomizationConfig, 2),
        ("setting", InitialStatesConfig, 3),
        ("setting", ImitationConfig, 4),
        ("weight", RewardConfig, 0),
        ("limit", Limits, 0),
    ],
)
def test_tables_of_defaults_are_those_of_the_code(head, cls, index):
    text = (ROOT / "docs/concepts.md").read_text(encoding="utf-8")
    found = re.findall(rf"^\| {head} \| value \|.*\n\|[-|]+\n((?:\|.*\n?)+)", text, re.MULTILINE)
    rows = re.findall(r"^\| `(\w+)` \| `([^`]+)` \| .+ \|$", found[index], re.MULTILINE)
    told = {name: ast.literal_eval(value) for name, value in rows}
    assert told == {f.name: f.default for f in dataclasses.fields(cls)}


def test_reasons_and_layouts_are_those_of_the_code():
    assert [row[0].strip("`") for row in table("concepts.md", "reason")] == list(REASONS)
    for head, layout in (("observation", OBSERVATION), ("action", ACTION)):
        told = table("concepts.md", head)
        known = [[f"`{f.name}`", str(f.size), f.unit, f.source] for f in layout.fields]
        assert told == known


@pytest.mark.parametrize(
    ("head", "cls", "without"),
    [
        ("field of the asset", Asset, {"folder"}),
        ("field of a link", Link, set()),
        ("field of a joint", Joint, set()),
        ("field of a handle", Handle, set()),
        ("field of the report", Report, set()),
        ("field of the manifest", Manifest, set()),
    ],
)
def test_tables_of_fields_are_those_of_the_code(head, cls, without):
    told = [name for row in table("formats.md", head) for name in re.findall(r"`(\w+)`", row[0])]
    assert sorted(told) == sorted({f.name for f in dataclasses.fields(cls)} - without)


def test_arguments_and_options_of_environments_are_those_of_the_code():
    told = {row[0].strip("`"): row[1].strip("`") for row in table("engines.md", "argument")}
    assert list(told) == [f.name for f in dataclasses.fields(EnvConfig)]
    for field in dataclasses.fields(EnvConfig):
        if field.default is not dataclasses.MISSING and field.name != "task":
            assert ast.literal_eval(told[field.name]) == field.default
    assert [row[0].strip("`") for row in table("engines.md", "option")] == list(OPTIONS)


@pytest.mark.parametrize("command", [c for c in FLAGS if c not in {"check", "export"}])
def test_pages_of_commands_name_every_flag_and_no_other(command):
    """`--randomization.*` and the like stand for all flags of their group."""
    folder = "" if command in {"observe", "benchmark"} else "commands"
    page = (ROOT / "docs" / folder / f"{command}.md").read_text(encoding="utf-8")
    found = re.findall(r"(?<![\w-])--[a-z][a-z-]*", page)
    told = {flag.replace("--no-randomise", "--randomise") for flag in found}
    flags = [flag for flag in flags_of(FLAGS[command]) if not flag.positional]
    known = {f"--{flag.path[0].replace('_', '-')}" for flag in flags}
    assert told - COMMON <= known
    assert known <= told


@pytest.mark.parametrize("script", ["install", "test", "lint", "check", "quickstart"])
def test_scripts_can_be_run_and_are_valid(script):
    path = ROOT / "scripts" / script
    assert path.stat().st_mode & 0o111
    subprocess.run(["bash", "-n", path], check=True)


def test_quickstart_answers_unknown_arguments_in_one_line_before_it_installs_anything():
    result = subprocess.run(
        [ROOT / "scripts/quickstart", "--ot", "x"], capture_output=True, text=True
    )
    assert result.returncode == 2
    assert result.stderr == "scripts/quickstart: --ot: unknown argument; accepted: --out FOLDER\n"


def test_constraints_hold_names_and_versions_only():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", pin) for pin in pins)
    names = [re.sub(r"[-_.]+", "-", pin.split("==")[0]).lower() for pin in pins]
    assert names == sorted(set(names))


def test_the_documents_make_a_site_without_warnings(tmp_path):
    build(
        load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path))
    )  # strict: a warning ends it
    home = (tmp_path / "index.html").read_text()
    assert 'src="images/open_drawer.png"' in home
    for page in (ROOT / "docs").rglob("*.md"):
        made = tmp_path / page.relative_to(ROOT / "docs").with_suffix("")
        made = made.parent if made.name == "README" else made
        assert (made / "index.html").is_file(), page
