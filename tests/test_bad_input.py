"""Unusable input: one line, exit 2 and no files."""

import importlib.util
import shlex
import shutil

import pytest
from tests.assets import make_cabinet, make_cupboard
from tests.runs import make_run, write_checkpoint

from articulate.assets.asset import load_asset
from articulate.commands import main
from articulate.errors import UsageError
from articulate.preparation.prepare import load_checked_asset
from articulate_train import run as runs

BOX = '<box size="1 1 1"/>'
NO_MESH = """<robot name="chest"><link name="body"><visual><geometry>
<mesh filename="meshes/body.obj"/></geometry></visual></link></robot>"""


@pytest.fixture(scope="session")
def objects(tmp_path_factory):
    """A folder of objects, good and bad; not to be changed."""
    folder = tmp_path_factory.mktemp("objects")
    make_cabinet(folder / "cabinet")
    make_cabinet(folder / "far", travel_m=2.0)
    make_cupboard(folder / "cupboard")
    (folder / "letter.urdf").write_text("Dear Sir or Madam\n")
    (folder / "page.urdf").write_text("<html><body/></html>\n")
    (folder / "chest.urdf").write_text(NO_MESH)
    return folder


@pytest.fixture(scope="session")
def run_folder(objects, tmp_path_factory):
    """A run with a policy that learned nothing, and its bundle; not to be changed."""
    folder = tmp_path_factory.mktemp("made")
    asset = make_cabinet(folder / "cabinet")
    make_run(folder / "run", asset, episode_s=1.0)
    assert main(["export", str(folder / "run"), "--out", str(folder / "bundle")]) == 0
    return folder


def load_unchecked(source, cache, config):
    """Load asset folders of tests, which have no URDF to check, without a check."""
    if (source / "asset.json").is_file():
        return load_asset(source)
    return load_checked_asset(source, cache, config)


@pytest.fixture
def rejected(error_line, tmp_path, monkeypatch, capsys):
    """``rejected("VERB ...")``: the line of the rejection is recorded, and no file changes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / ".cache"))
    monkeypatch.setattr(runs, "load_checked_asset", load_unchecked)
    capsys.readouterr()

    def files():
        found = (p for p in tmp_path.rglob("*") if ".cache" not in p.parts)
        return {p: p.read_bytes() if p.is_file() else None for p in found}

    def check(command, call=""):
        def provoke():
            before = files()
            code = main(shlex.split(command))
            out, err = capsys.readouterr()
            assert code == 2, err
            assert out == ""
            assert err.count("\n") == 1
            assert files() == before
            raise UsageError(err.strip())

        return error_line(call or command, provoke)

    return check


@pytest.fixture
def objects_here(objects, tmp_path):
    shutil.copytree(objects, tmp_path, dirs_exist_ok=True)


@pytest.mark.usefixtures("objects_here")
@pytest.mark.parametrize(
    "flags",
    [
        "--asset nowhere.urdf",
        "--asset letter.urdf",
        "--asset page.urdf",
        "--asset chest.urdf",
        "--asset cupboard",
        "--asset cabinet --joint drawer_7",
        "--asset cupboard --joint door_hinge",
        "--asset far",
        "--asset far --joint drawer_1_slide",
        "--asset cabinet --task open_drawr",
        "--asset cabinet --aset cabinet",
        "cabinet.urdf",
        "--asset cabinet --steps many",
        "--asset cabinet --steps 100",
        "--asset cabinet --seeds 1 1",
        "--asset cabinet --set ppo.batch_size=500",
        "--asset cabinet --set randomization.delay_steps=3,1",
        "--asset cabinet --closed middle",
        "--asset cabinet --size -1",
        "--task open_drawer",
        "--asset cabinet --config slow",
        "--resume",
        "--resume --out",
        "--resume --out nowhere",
        "--resume --out cabinet",
    ],
)
def test_train_rejects(rejected, flags, request):
    if flags.startswith("--asset far"):
        request.getfixturevalue("short_search")
    rejected(f"train {flags}")


@pytest.mark.usefixtures("objects_here")
def test_train_rejects_an_unknown_key_and_names_the_nearest(rejected, tmp_path):
    (tmp_path / "fast.yaml").write_text("ppo: {lerning_rate: 1}\n")
    rejected("train --asset cabinet --config fast.yaml")
    doubling = "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12))
    (tmp_path / "bomb.yaml").write_text(f"a0: &a0 [1]\n{doubling}")
    rejected("train --asset cabinet --config bomb.yaml", "train  # YAML anchors that double")
    (tmp_path / "slow.yaml").write_text("joint drawer\n")
    rejected("train --asset cabinet --config slow.yaml")


@pytest.mark.usefixtures("objects_here")
def test_train_rejects_an_output_that_is_in_the_place(rejected, tmp_path):
    (tmp_path / "file").write_text("mine")
    rejected("train --asset cabinet --out file")
    rejected("train --asset cabinet --out file/run")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "photo.jpg").touch()
    rejected("train --asset cabinet --out old")


@pytest.mark.usefixtures("objects_here")
@pytest.mark.parametrize("flags", ["--set ppo.gamma=0.9", "--seeds 0 1", "--joint drawer_0_slide"])
def test_train_rejects_to_resume_with_other_settings(rejected, run_folder, tmp_path, flags):
    shutil.copytree(run_folder / "run", tmp_path / "run")
    rejected(f"train --resume --out run {flags}")


@pytest.mark.usefixtures("objects_here")
def test_train_without_robosuite_names_the_extra(rejected, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "robosuite" else found(name)
    )
    rejected("train --asset cabinet", "train --asset cabinet  # without robosuite")


@pytest.mark.usefixtures("objects_here")
@pytest.mark.parametrize(
    "flags",
    [
        "--asset cabinet --require-success 90",
        "--asset cabinet --require-success most",
        "--asset cabinet --dry-run --resume --out old",
        "--asset cabinet --size big",
        "--asset cabinet --set randomization.mass=1",
        "--asset cabinet --set randomization.mass=1.3,0.7",
        "--asset cabinet --set ppo.net_arch=wide",
        "--asset cabinet --seeds",
        "--asset cabinet --set ppo.batch_sise=64",
        "--asset cabinet --set batch_size=64",
        "--asset cabinet --set ppo.gamma",
        "--asset cabinet --set",
        "--asset cabinet --ppo.gamma 0.9",
        "--asset cabinet --ppo.gama 0.9",
        "--asset cabinet --episodes 0",
        "--asset cabinet --json=yes",
        "--asset cabinet --config",
        "--asset",
        "cabinet",
        "",
    ],
)
def test_train_rejects_flags(rejected, run_folder, tmp_path, flags):
    shutil.copytree(run_folder / "run", tmp_path / "old")
    rejected(f"train {flags}".strip())


@pytest.mark.usefixtures("objects_here")
def test_train_dry_run_rejects_to_overwrite_its_image(rejected, tmp_path):
    (tmp_path / "old.png").write_text("mine")
    rejected("train --asset cabinet --dry-run --out old")


@pytest.mark.usefixtures("objects_here")
def test_the_cache_must_be_usable(rejected, tmp_path, monkeypatch):
    monkeypatch.setenv("ARTICULATE_CACHE_GB", "much")
    rejected("train --asset cabinet", "train --asset cabinet  # ARTICULATE_CACHE_GB=much")
    rejected("cache", "cache  # ARTICULATE_CACHE_GB=much")
    monkeypatch.delenv("ARTICULATE_CACHE_GB")
    (tmp_path / "file").write_text("mine")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    for call in ("train --asset cabinet", "check chest.urdf"):
        rejected(call, f"{call}  # XDG_CACHE_HOME is a file")


@pytest.mark.usefixtures("objects_here")
def test_a_full_disk_is_reported_before_the_work(rejected, monkeypatch, run_folder, tmp_path):
    free = shutil.disk_usage(tmp_path)._replace(free=1_000_000)
    monkeypatch.setattr("articulate.files.shutil.disk_usage", lambda _: free)
    for call in ("train --asset cabinet --out run", "check . --out checked"):
        rejected(call, f"{call}  # 1 MB is free")
    shutil.copytree(run_folder / "run", tmp_path / "made")
    rejected("export made --out b.zip", "export made --out b.zip  # 1 MB is free")


@pytest.mark.usefixtures("objects_here")
@pytest.mark.parametrize(
    "flags",
    [
        "",
        "nowhere.urdf",
        "empty",
        "/dev/null",
        "chest.urdf --out old",
        "chest.urdf --out mine",
        "chest.urdf --ot checked",
        "chest.urdf letter.urdf",
        "chest.urdf --jobs -1",
        "chest.urdf --jobs two",
        "chest.urdf --limit 0",
        "chest.urdf --max-geoms 0",
        "chest.urdf --closed uper",
        "chest.urdf --compare-with nowhere.urdf",
        "chest.urdf --config absent.yaml",
        "chest.urdf --size -1",
        "--explain opennes",
    ],
)
def test_check_rejects(rejected, tmp_path, flags):
    (tmp_path / "empty").mkdir()
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "letter.txt").write_text("mine")
    (tmp_path / "mine").write_text("mine")
    rejected(f"check {flags}".strip())


@pytest.mark.parametrize(
    "flags",
    ["lst", "list clean", "clean", "clean --keep-gb -1", "clean --keep-gb all", "clean --keep 1"],
)
def test_cache_rejects(rejected, flags):
    rejected(f"cache {flags}")


@pytest.mark.parametrize("line", ["trian", "--versio", "--completion", "--completion csh", "-x"])
def test_unknown_commands_are_rejected(rejected, line):
    rejected(line, f"articulate {line}")


def test_watch_rejects(rejected, run_folder, tmp_path):
    shutil.copytree(run_folder / "run", tmp_path / "run")
    shutil.copytree(run_folder / "bundle", tmp_path / "bundle")
    (tmp_path / "empty").mkdir()
    (tmp_path / "old.mp4").write_text("mine")
    (tmp_path / "letter.txt").write_text("Dear Sir or Madam")
    for flags in (
        "",
        "nowhere",
        "empty",
        "letter.txt",
        "run --seed 7",
        "run --episode -1",
        "run --out old.mp4",
        "run --out clip.avi",
        "run --out clip.mp4 --viewer",
        "run bundle",
        "bundle --seed 1",
        "bundle --sed 1",
    ):
        rejected(f"watch {flags}".strip())


def test_evaluate_and_export_reject_other_folders_and_untrained_runs(
    rejected, run_folder, tmp_path
):
    for verb in ("evaluate nowhere", "export nowhere --out bundle.zip"):
        rejected(verb)
    shutil.copytree(run_folder / "run", tmp_path / "run")
    shutil.rmtree(tmp_path / "run" / "seed_0")
    rejected("evaluate run", "evaluate run  # untrained")
    rejected("export run --out bundle.zip", "export run --out bundle.zip  # untrained")
    write_checkpoint(tmp_path / "run" / "seed_0", 0)
    rejected("export run --out bundle.zip --seed 4")
    rejected("evaluate run --episodes 0")
    rejected("evaluate run --ranges 0")
    rejected("evaluate run --asset nothing.urdf")
    rejected("evaluate run --joint drawer_1")
    rejected("evaluate run run --asset nothing.urdf")
    for flags in ("", "run --require-success 90", "run --episodes", "run --episode 5", "run old"):
        rejected(f"evaluate {flags}".strip())
    for flags in ("", "run --seed first", "run --out run", "run --oot b.zip", "run --out empty/"):
        (tmp_path / "empty").mkdir(exist_ok=True)
        rejected(f"export {flags}".strip())
    (tmp_path / "bundles").mkdir()
    (tmp_path / "bundles" / "run-seed_0.zip").write_text("mine")
    rejected("export run", "export run  # its default --out exists")


def test_deploy_rejects_bundles_and_unknown_robots(rejected, run_folder, tmp_path):
    rejected("deploy nowhere")
    bundle = shutil.copytree(run_folder / "bundle", tmp_path / "bundle")
    for robot in ("panda", "fr3", "kuka"):
        rejected(f"deploy bundle --robot {robot}")
    for flags in (
        "--episodes 0",
        "--episodes few",
        "--robt mujoco",
        "--robot mujco",
        "--robot pybullt",
        "--seed -1",
        "--require-success 2",
        "--out full",
        "--out full/letter.txt",
        "bundle",
    ):
        (tmp_path / "full").mkdir(exist_ok=True)
        (tmp_path / "full" / "letter.txt").write_text("mine")
        rejected(f"deploy bundle {flags}")
    rejected("deploy")
    (tmp_path / "letter.txt").write_text("Dear Sir or Madam")
    rejected("deploy letter.txt")
    (tmp_path / "empty").mkdir()
    rejected("deploy empty")
    policy = bundle / "policy.onnx"
    policy.write_bytes(policy.read_bytes()[:-1] + b"x")
    rejected("deploy bundle", "deploy bundle  # its policy was changed")
    policy.unlink()
    rejected("deploy bundle", "deploy bundle  # its policy is missing")
