"""What users are told when what they gave cannot be used: one line, exit 2, nothing left behind."""

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


def taken_as_proven(source, cache, config):
    """Asset folders made for tests have no URDF to prove them with."""
    if (source / "asset.json").is_file():
        return load_asset(source)
    return load_checked_asset(source, cache, config)


@pytest.fixture
def refused(error_line, tmp_path, monkeypatch, capsys):
    """``refused("VERB ...")``: the line it is refused with is kept, and nothing lies about."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / ".cache"))
    monkeypatch.setattr(runs, "proven_asset", taken_as_proven)
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
        "--asset cabinet --ppo.batch-size 500",
        "--asset cabinet --randomization.delay-steps 3 1",
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
def test_train_refuses(refused, flags):
    refused(f"train {flags}")


@pytest.mark.usefixtures("objects_here")
def test_train_refuses_an_unknown_key_and_names_the_nearest(refused, tmp_path):
    (tmp_path / "fast.yaml").write_text("ppo: {lerning_rate: 1}\n")
    refused("train --asset cabinet --config fast.yaml")
    (tmp_path / "slow.yaml").write_text("joint drawer\n")
    refused("train --asset cabinet --config slow.yaml")


@pytest.mark.usefixtures("objects_here")
def test_train_refuses_an_output_that_is_in_the_way(refused, tmp_path):
    (tmp_path / "file").write_text("mine")
    refused("train --asset cabinet --out file")
    refused("train --asset cabinet --out file/run")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "photo.jpg").touch()
    refused("train --asset cabinet --out old")


@pytest.mark.usefixtures("objects_here")
@pytest.mark.parametrize("flags", ["--ppo.gamma 0.9", "--seeds 0 1", "--joint drawer_0_slide"])
def test_train_refuses_to_go_on_with_something_else(refused, run_folder, tmp_path, flags):
    shutil.copytree(run_folder / "run", tmp_path / "run")
    refused(f"train --resume --out run {flags}")


@pytest.mark.usefixtures("objects_here")
def test_train_without_robosuite_says_how_to_get_it(refused, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "robosuite" else found(name)
    )
    refused("train --asset cabinet", "train --asset cabinet  # without robosuite")


@pytest.mark.usefixtures("objects_here")
@pytest.mark.parametrize(
    "flags",
    [
        "--asset cabinet --require-success 90",
        "--asset cabinet --require-success most",
        "--asset cabinet --dry-run --resume --out old",
        "--asset cabinet --size big",
        "--asset cabinet --randomization.mass 1",
        "--asset cabinet --randomization.mass 1.3 0.7",
        "--asset cabinet --ppo.net wide",
        "--asset cabinet --seeds",
        "--asset cabinet --episodes 0",
        "--asset cabinet --json=yes",
        "--asset cabinet --config",
        "--asset",
        "cabinet",
        "",
    ],
)
def test_train_refuses_flags(refused, run_folder, tmp_path, flags):
    shutil.copytree(run_folder / "run", tmp_path / "old")
    refused(f"train {flags}".strip())


@pytest.mark.usefixtures("objects_here")
def test_train_dry_run_refuses_to_overwrite_its_picture(refused, tmp_path):
    (tmp_path / "old.png").write_text("mine")
    refused("train --asset cabinet --dry-run --out old")


@pytest.mark.usefixtures("objects_here")
def test_the_cache_must_be_usable(refused, tmp_path, monkeypatch):
    monkeypatch.setenv("ARTICULATE_CACHE_GB", "much")
    refused("train --asset cabinet", "train --asset cabinet  # ARTICULATE_CACHE_GB=much")
    refused("cache", "cache  # ARTICULATE_CACHE_GB=much")
    monkeypatch.delenv("ARTICULATE_CACHE_GB")
    (tmp_path / "file").write_text("mine")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    for call in ("train --asset cabinet", "check chest.urdf"):
        refused(call, f"{call}  # XDG_CACHE_HOME is a file")


@pytest.mark.usefixtures("objects_here")
def test_a_full_disk_is_told_before_the_work(refused, monkeypatch, run_folder, tmp_path):
    free = shutil.disk_usage(tmp_path)._replace(free=1_000_000)
    monkeypatch.setattr("articulate.files.shutil.disk_usage", lambda _: free)
    for call in ("train --asset cabinet --out run", "check . --out checked"):
        refused(call, f"{call}  # 1 MB is free")
    shutil.copytree(run_folder / "run", tmp_path / "made")
    refused("export made --out b.zip", "export made --out b.zip  # 1 MB is free")


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
        "chest.urdf --against nowhere.urdf",
        "chest.urdf --config absent.yaml",
        "chest.urdf --size -1",
        "--explain opennes",
    ],
)
def test_check_refuses(refused, tmp_path, flags):
    (tmp_path / "empty").mkdir()
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "letter.txt").write_text("mine")
    (tmp_path / "mine").write_text("mine")
    refused(f"check {flags}".strip())


@pytest.mark.parametrize(
    "flags",
    ["lst", "list clean", "clean", "clean --keep-gb -1", "clean --keep-gb all", "clean --keep 1"],
)
def test_cache_refuses(refused, flags):
    refused(f"cache {flags}")


@pytest.mark.parametrize("line", ["trian", "--versio", "--completion", "--completion csh", "-x"])
def test_what_is_no_command_is_refused(refused, line):
    refused(line, f"articulate {line}")


def test_watch_refuses(refused, run_folder, tmp_path):
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
        refused(f"watch {flags}".strip())


def test_evaluate_and_export_refuse_what_is_no_run_or_is_untrained(refused, run_folder, tmp_path):
    for verb in ("evaluate nowhere", "export nowhere --out bundle.zip"):
        refused(verb)
    shutil.copytree(run_folder / "run", tmp_path / "run")
    shutil.rmtree(tmp_path / "run" / "seed_0")
    refused("evaluate run", "evaluate run  # untrained")
    refused("export run --out bundle.zip", "export run --out bundle.zip  # untrained")
    write_checkpoint(tmp_path / "run" / "seed_0", 0)
    refused("export run --out bundle.zip --seed 4")
    refused("evaluate run --episodes 0")
    refused("evaluate run --ranges 0")
    refused("evaluate run --asset nothing.urdf")
    refused("evaluate run --joint drawer_1")
    refused("evaluate run run --asset nothing.urdf")
    for flags in ("", "run --require-success 90", "run --episodes", "run --episode 5", "run old"):
        refused(f"evaluate {flags}".strip())
    for flags in ("", "run --seed first", "run --out run", "run --oot b.zip", "run --out empty/"):
        (tmp_path / "empty").mkdir(exist_ok=True)
        refused(f"export {flags}".strip())
    (tmp_path / "bundles").mkdir()
    (tmp_path / "bundles" / "run-seed_0.zip").write_text("mine")
    refused("export run", "export run  # its default --out exists")


def test_deploy_refuses_bundles_and_robots_it_cannot_use(refused, run_folder, tmp_path):
    refused("deploy nowhere")
    bundle = shutil.copytree(run_folder / "bundle", tmp_path / "bundle")
    for robot in ("panda", "fr3", "kuka"):
        refused(f"deploy bundle --robot {robot}")
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
        refused(f"deploy bundle {flags}")
    refused("deploy")
    (tmp_path / "letter.txt").write_text("Dear Sir or Madam")
    refused("deploy letter.txt")
    (tmp_path / "empty").mkdir()
    refused("deploy empty")
    policy = bundle / "policy.onnx"
    policy.write_bytes(policy.read_bytes()[:-1] + b"x")
    refused("deploy bundle", "deploy bundle  # its policy was changed")
    policy.unlink()
    refused("deploy bundle", "deploy bundle  # its policy is gone")
