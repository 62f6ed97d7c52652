"""The documents of the repository keep their promises."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ["articulate", "envs", "train", "deploy", "configs", "docs", "benchmarks"]
PAGES = sorted(
    [*ROOT.glob("*.md"), *(p for folder in FOLDERS for p in ROOT.glob(f"{folder}/*.md"))]
)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    links = re.findall(r"(?<!!)\[[^\]]*\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert missing == []


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
