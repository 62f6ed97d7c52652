"""Documentation: links, commands, code blocks and generated pages are valid."""

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

import figures
import reference
from articulate.assets.asset import Asset, Handle, Joint, Link
from articulate.checks.descriptions import CHECKS
from articulate.commands.benchmark import BenchmarkFlags
from articulate.commands.cache import CacheFlags
from articulate.commands.calibrate import CalibrateFlags
from articulate.commands.check import CheckFlags
from articulate.commands.completion import SHELLS
from articulate.commands.flags import parse
from articulate.commands.help import help_text
from articulate.commands.locate import LocateFlags
from articulate.commands.make import MakeFlags
from articulate.commands.markers import MarkersFlags
from articulate.commands.observe import ObserveFlags
from articulate.commands.studio import StudioFlags
from articulate.commands.watch import WatchFlags
from articulate.task.manifest import Manifest
from articulate_deploy.commands.deploy import DeployFlags
from articulate_deploy.commands.inspect import InspectFlags, SignFlags, VerifyFlags
from articulate_deploy.commands.recordings import ConvertFlags, ReplayFlags, ReportFlags
from articulate_deploy.commands.sim_robot import SimRobotFlags
from articulate_train.commands.evaluate import EvaluateFlags
from articulate_train.commands.export import ExportFlags
from articulate_train.commands.train import TrainFlags
from articulate_train.report import Report

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ["articulate", "envs", "train", "deploy", "configs", "benchmarks"]
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(p for folder in FOLDERS for p in ROOT.glob(f"{folder}/*.md")),
    ]
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
    "articulate-sim-robot": SimRobotFlags,
    "benchmark": BenchmarkFlags,
    "make": MakeFlags,
    "observe": ObserveFlags,
    "watch": WatchFlags,
    "cache": CacheFlags,
    "calibrate": CalibrateFlags,
    "locate": LocateFlags,
    "markers": MarkersFlags,
    "studio": StudioFlags,
}
COMMON = {"--set", "--help-all", "--config", "--help", "--quiet", "--verbose"}
"""Flags of every command."""

OTHERS = {"coverage", "git", "pip", "source", "tensorboard"}
"""Commands in the documents that are not ours."""


def fences(page):
    """Language and text of each fenced block of ``page``."""
    parts = re.split(r"^```(.*)\n", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return list(zip(parts[1::4], parts[2::4], strict=True))


SLOW = {"docs/concepts/engines.md"}
"""Pages whose blocks take seconds: they check a cabinet."""


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


DEPLOY_FLAGS = {
    "inspect": InspectFlags,
    "sign": SignFlags,
    "verify": VerifyFlags,
    "report": ReportFlags,
    "replay": ReplayFlags,
    "convert": ConvertFlags,
}


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
        if command in {"--help", "--version"}:
            continue
        if command == "deploy" and rest[0] in DEPLOY_FLAGS:
            parse(DEPLOY_FLAGS[rest[0]], rest[1:], prog=f"deploy {rest[0]}")
        elif command in FLAGS:
            resumes = (
                TrainFlags(asset="kept") if {"--resume", "--list-joints"} & set(rest) else None
            )
            flags = parse(FLAGS[command], rest, default=resumes, prog=command)
            assert getattr(flags, "explain", None) in {None, *CHECKS}
        elif command.startswith("python"):
            source = (ROOT / rest[0]).read_text(encoding="utf-8")
            assert all(f'"{flag}"' in source for flag in rest if flag.startswith("--"))
        else:
            assert command in OTHERS or os.access(ROOT / command, os.X_OK), line


@pytest.mark.parametrize("text", blocks("python"))
def test_python_in_the_documents_runs(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(text, "document", "exec"), {"__name__": "document"})


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_block_names_its_language(page):
    assert {kind for kind, _ in fences(page)} <= {"bash", "python", "text", "yaml", "json"}


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
    told = [
        name
        for row in table("reference/formats.md", head)
        for name in re.findall(r"`(\w+)`", row[0])
    ]
    assert sorted(told) == sorted({f.name for f in dataclasses.fields(cls)} - without)


@pytest.mark.parametrize("name", list(reference.PAGES))
def test_generated_reference_pages_are_those_of_the_code(name):
    """Rewrite them with ``python scripts/reference.py docs/reference``."""
    page = ROOT / "docs" / "reference" / name
    assert page.read_text(encoding="utf-8") == reference.PAGES[name]()


def test_diagrams_are_those_of_the_script():
    for name in figures.FIGURES:
        assert (ROOT / "docs" / "images" / f"{name}.svg").read_text() == figures.draw(name)


def test_pages_written_by_people_are_short():
    generated = {ROOT / "docs" / "reference" / name for name in reference.PAGES}
    pages = set((ROOT / "docs").rglob("*.md")) - generated
    assert sum(len(page.read_text(encoding="utf-8").splitlines()) for page in pages) <= 2500


def test_readme_animation_is_small():
    assert (ROOT / "docs" / "images" / "open_drawer.webp").stat().st_size <= 1_000_000


@pytest.mark.parametrize("command", sorted(set(FLAGS) - {"check", "export"}))
def test_help_is_short(command):
    shown = help_text(FLAGS[command], command, "")
    assert len(re.findall(r"^  --\w", shown, re.MULTILINE)) <= 35


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
    assert 'src="images/open_drawer.webp"' in home
    for page in (ROOT / "docs").rglob("*.md"):
        made = tmp_path / page.relative_to(ROOT / "docs").with_suffix("")
        made = made.parent if made.name == "index" else made
        assert (made / "index.html").is_file(), page
