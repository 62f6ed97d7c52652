"""The wheel: what is in it, what it asks for, and that it works without the repository."""

import email
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from articulate.config import preset_names

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The wheel unpacked, as an installer would."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def metadata(site):
    (path,) = site.glob("*.dist-info/METADATA")
    return email.message_from_string(path.read_text(encoding="utf-8"))


def python(site, code, folder):
    """``code`` with the wheel and its dependencies, but nothing of the checkout."""
    # Without `site` no .pth file is heeded: those of an editable install lead into the checkout.
    others = [p for p in sys.path if p.endswith("site-packages")]
    return subprocess.run(
        [sys.executable, "-S", "-c", code],
        cwd=folder,
        env={"PYTHONPATH": ":".join([str(site), *others]), "HOME": str(folder)},
        capture_output=True,
        text=True,
    )


def brought_by(metadata, extra):
    """Names of what the extra ``extra`` installs, extras of our own followed."""
    own = metadata["Name"]
    names = set()
    for line in metadata.get_all("Requires-Dist"):
        requirement, _, marker = line.partition(";")
        of = re.search(r"extra == ['\"]([\w-]+)['\"]", marker)
        if of is not None and of[1] != extra:
            continue
        name = re.split(r"[^\w.-]", requirement.strip(), maxsplit=1)[0]
        if name == own:
            for more in requirement.partition("[")[2].partition("]")[0].split(","):
                names |= brought_by(metadata, more.strip())
        else:
            names.add(name.lower())
    return names


def test_it_holds_the_four_packages_and_all_that_is_no_code(site):
    tops = {p.name for p in site.iterdir() if p.suffix != ".dist-info"}
    assert tops == {"articulate", "articulate_envs", "articulate_train", "articulate_deploy"}
    for folder in ("articulate/articulate", "envs/articulate_envs", "train/articulate_train"):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and path.suffix not in {".pyc", ".nbi", ".nbc"}:
                name = Path(folder).name / path.relative_to(ROOT / folder)
                assert (site / name).is_file(), name


def test_its_name_is_not_that_of_a_stranger(metadata):
    assert metadata["Name"] == "articulate-robots"


def test_a_robot_needs_neither_torch_nor_a_simulator(metadata):
    names = brought_by(metadata, "deploy")
    assert "onnxruntime" in names
    assert not names & {"torch", "mujoco", "robosuite", "gymnasium", "stable-baselines3", "trimesh"}
    assert "mujoco" in brought_by(metadata, "deploy-sim")
    assert "torch" in brought_by(metadata, "train")


def test_a_robot_deploys_without_them(site, tmp_path):
    blocked = ["torch", "mujoco", "robosuite", "gymnasium", "scipy", "trimesh", "matplotlib"]
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({blocked!r}))\n"
        "from articulate.commands import main\n"
        "import articulate_deploy.deploy, articulate_deploy.safety\n"
        "sys.exit(main(['deploy', 'nowhere.zip']))"
    )
    done = python(site, code, tmp_path)
    assert done.stderr == "nowhere.zip: no such bundle; export-policy makes one from a run\n"
    assert done.returncode == 2


def test_every_entry_point_leads_to_a_function_in_it(site):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (path,) = site.glob("*.dist-info/entry_points.txt")
    told = dict(re.findall(r"^([\w-]+) = (\S+)$", path.read_text(), re.MULTILINE))
    groups = [project["scripts"], *project["entry-points"].values()]
    assert told == {name: target for group in groups for name, target in group.items()}
    for target in told.values():
        module, function = target.split(":")
        file = site / (module.replace(".", "/") + ".py")
        file = file if file.is_file() else file.with_suffix("") / "__init__.py"
        assert f"\ndef {function}(" in file.read_text(encoding="utf-8")


def test_its_commands_answer_without_the_repository(site, tmp_path):
    code = (
        "import sys\n"
        "from articulate import config\n"
        "from articulate.commands import main, version\n"
        "print(config.preset_folder(), *config.preset_names(), version())\n"
        "for verb in ['check', 'train', 'evaluate', 'export', 'deploy', 'watch', 'cache']:\n"
        "    try: main([verb, '--help'])\n"
        "    except SystemExit as stop: assert not stop.code\n"
        "sys.exit(main(['train', '--asset', 'nowhere.urdf', '--config', 'quickstart']))"
    )
    done = python(site, code, tmp_path)
    folder, *names = done.stdout.splitlines()[0].split()
    assert folder == str(site / "articulate" / "_configs")
    assert names[:-1] == preset_names()
    assert done.stdout.count("usage: ") == 7
    assert done.stderr.startswith("nowhere.urdf: does not exist")
    assert done.returncode == 2


def test_it_checks_an_object_without_the_repository(site, tmp_path):
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from articulate.commands import main\n"
        "from articulate.library.procedural.cabinet import embedded_cabinet\n"
        "made = embedded_cabinet(Path('cabinet'))\n"
        "sys.exit(main(['check', str(made), '--json']))"
    )
    done = python(site, code, tmp_path)
    assert done.returncode == 0, done.stderr
    assert '"verdict": "' in done.stdout
    assert (tmp_path / "checked").is_dir()
