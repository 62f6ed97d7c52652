import errno
import importlib
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Literal

import pytest

from articulate import commands
from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse, summary_of
from articulate.errors import ConfigError, UsageError

HEAVY = {
    "mujoco",
    "torch",
    "scipy",
    "trimesh",
    "matplotlib",
    "gymnasium",
    "onnxruntime",
    "numpy",
    "tyro",
}


@dataclass(frozen=True, kw_only=True)
class Ppo:
    """Learning."""

    learning_rate: float = 1e-3
    """Step of the optimiser."""
    horizon: int = 100
    """Length of a rollout [steps]."""


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train a policy."""

    run: Annotated[Path, POSITIONAL]
    """Folder of the run."""
    asset: Path
    """The object."""
    task: Literal["open_drawer", "open_joint"] = "open_drawer"
    """Task."""
    ppo: Ppo = Ppo()
    seeds: tuple[int, ...] = (0,)
    """Seeds."""
    json: bool = False
    """Print JSON."""


def raising(error):
    def command(argv):
        raise error

    return command


def run_python(code, **env):
    """Output of ``code`` in a new interpreter."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=env or None, timeout=60
    )


def test_flags_override_defaults():
    flags = parse(
        Train, ["R", "--asset", "a.urdf", "--set", "ppo.horizon=7", "--seeds", "1", "2", "--json"]
    )
    assert flags == Train(
        run=Path("R"), asset=Path("a.urdf"), ppo=Ppo(horizon=7), seeds=(1, 2), json=True
    )


def test_flags_override_presets_and_later_presets_earlier_ones(tmp_path):
    low, high = tmp_path / "low.yaml", tmp_path / "high.yaml"
    low.write_text("asset: low.urdf\nppo: {horizon: 1, learning_rate: 1e-5}\n")
    high.write_text("ppo: {horizon: 2}\nseeds: [5]\n")
    argv = ["R", "--config", str(low), f"--config={high}", "--seeds", "6"]
    expected = Ppo(horizon=2, learning_rate=1e-5)
    assert parse(Train, argv) == Train(
        run=Path("R"), asset=Path("low.urdf"), ppo=expected, seeds=(6,)
    )


def test_presets_override_a_default(tmp_path):
    (tmp_path / "x.yaml").write_text("ppo: {horizon: 2}\n")
    default = Train(run=Path("D"), asset=Path("d.urdf"), ppo=Ppo(learning_rate=0.5), json=True)
    flags = parse(Train, ["R", "--config", str(tmp_path / "x.yaml")], default)
    assert flags.ppo.horizon == 2
    assert flags.asset == Path("d.urdf")
    assert flags.json


def test_keys_in_dashes_or_underscores_are_the_same():
    argv = ["R", "--asset", "a"]
    assert parse(Train, [*argv, "--set", "ppo.learning_rate=1"]) == parse(
        Train, [*argv, "--set=ppo.learning-rate=1"]
    )


@pytest.mark.parametrize(
    "argv",
    [
        "R --asset a --ppo.lerning-rate 3",
        "R --asset a --ppo.learning-rate 3",
        "R --asset a --set ppo.lerning_rate=3",
        "R --asset a --set horizon=3",
        "R --asset a --set xyz=3",
        "R --asset a --set ppo.horizon",
        "R --asset a --set",
        "R --aset a",
        "R --asset a --xyz",
        "R --asset a --nonsense",
        "R --asset a --set ppo.learning_rate=fast",
        "R --asset a --task open_door",
        "R --asset a --seeds 1 b",
        "R S --asset a",
        "R --asset",
        "R",
        "--asset a",
        "R --asset a --config",
        "R --asset a --json=yes",
        "R --asset a --task open_drawr",
        "R --asset a -j",
    ],
)
def test_wrong_flags_are_one_line(argv, error_line):
    error_line(f"parse(Train, {argv.split()})", lambda: parse(Train, argv.split(), prog="train"))


def test_help_is_printed_if_the_output_is_not_utf_8():
    result = subprocess.run(
        [sys.executable, "-m", "articulate", "train", "--help-all"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert result.returncode == 0
    assert b"randomization.position_m=" in result.stdout


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--set ppo.horizon=7", {"ppo": Ppo(horizon=7)}),
        ("--set=ppo.horizon=1e3", {"ppo": Ppo(horizon=1000)}),
        ("--set ppo.learning_rate=-1", {"ppo": Ppo(learning_rate=-1.0)}),
        ("--seeds", {}),
        ("--set seeds=1,2", {"seeds": (1, 2)}),
        ("--set json=true", {"json": True}),
        ("--seeds 1 2 --seeds 3", {"seeds": (3,)}),
        ("--json --no-json", {"json": False}),
        ("--task=open_joint", {"task": "open_joint"}),
    ],
)
def test_values_have_several_forms(words, expected):
    argv = ["R", "--asset", "a", *words.split()]
    if words == "--seeds":
        with pytest.raises(ConfigError, match="--seeds: a value is missing; give --seeds INT"):
            parse(Train, argv)
        return
    assert parse(Train, argv) == Train(run=Path("R"), asset=Path("a"), **expected)


@pytest.mark.parametrize(
    ("flag", "printed"), [("-q", ""), ("--quiet", ""), ("--json", "some "), ("-v", "some more ")]
)
def test_every_command_has_levels_of_verbosity(flag, printed, capsys):
    def verb(argv):
        parse(Train, argv)
        console.show_progress("some")
        console.detail("more")
        return 0

    assert commands.run_command(verb, ["R", "--asset", "a", flag]) == 0
    assert capsys.readouterr().err == printed.replace(" ", "\n")


def test_words_after_two_dashes_are_not_flags():
    assert parse(Train, ["--asset", "a", "--", "--run"]).run == Path("--run")


def test_values_of_two_presets_and_a_flag_meet_in_one_group(tmp_path):
    (tmp_path / "x.yaml").write_text("ppo: {horizon: 2}\n")
    default = Train(run=Path("D"), asset=Path("d"))
    argv = ["--config", str(tmp_path / "x.yaml"), "--set", "ppo.learning_rate=0.5"]
    assert parse(Train, argv, default).ppo == Ppo(horizon=2, learning_rate=0.5)


def test_flag_without_a_preset_stays_required(tmp_path):
    (tmp_path / "x.yaml").write_text("ppo: {horizon: 2}\n")
    with pytest.raises(ConfigError, match="missing: --asset PATH"):
        parse(Train, ["R", "--config", str(tmp_path / "x.yaml")])


def test_unknown_key_of_a_preset_names_the_file(tmp_path, error_line):
    path = tmp_path / "fast.yaml"
    path.write_text("ppo: {lerning_rate: 1}")
    argv = ["R", "--asset", "a", "--config", str(path)]
    error_line(
        "parse(Train, ['R', '--asset', 'a', '--config', 'fast.yaml'])", lambda: parse(Train, argv)
    )


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("A video, e.g. an .mp4, of a part. More.", "A video, e.g. an .mp4, of a part"),
        ("Folder of the run; of several, to compare them.", "Folder of the run"),
        ("Output folder.", "Output folder"),
        ("", ""),
    ],
)  # fmt: skip
def test_the_summary_of_does_not_end_in_an_abbreviation(text, first):
    assert summary_of(text) == first


def test_help_of_a_command_shows_flags_units_and_presets(capsys):
    with pytest.raises(SystemExit) as stop:
        parse(Train, ["--help"], prog="articulate train")
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for word in [
        "articulate train",
        "Train a policy",
        "Further settings of --help-all: ppo.",
        "ppo.learning_rate=0.001",
        "--config FILE|PRESET",
    ]:
        assert word in text
    assert "ppo.horizon" not in text


def test_help_all_lists_every_setting_with_its_unit(capsys):
    with pytest.raises(SystemExit):
        parse(Train, ["--help-all"], prog="train")
    text = capsys.readouterr().out
    assert "ppo.horizon=INT" in text
    assert "[steps]" in text


@pytest.mark.parametrize("verb", sorted(metadata.entry_points(group=commands.GROUP).names))
def test_help_of_a_command_is_short(verb, capsys):
    with pytest.raises(SystemExit):
        commands._command(verb)(["--help"])
    flags = re.findall(r"(?m)^  (--?\w[\w-]*)", capsys.readouterr().out)
    assert 5 < len(flags) <= 35


def test_bad_input_is_one_line_and_exit_2(capsys):
    assert commands.run_command(raising(ConfigError("no\n  such thing")), []) == 2
    assert capsys.readouterr().err == "no such thing\n"


def test_interrupt_is_exit_130(capsys):
    assert commands.run_command(raising(KeyboardInterrupt()), []) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_interrupt_while_a_module_is_imported_that_swallows_it_is_exit_130(
    tmp_path, capsys, monkeypatch
):
    """As trimesh does with optional imports."""
    swallow = "import os, signal\ntry:\n    os.kill(os.getpid(), signal.SIGINT)\n    x = 1\n"
    swallow += "except BaseException:\n    x = 2\n"
    (tmp_path / "swallowing.py").write_text(swallow)
    monkeypatch.syspath_prepend(tmp_path)
    values = []

    def command(argv):
        values.append(importlib.import_module("swallowing").x)
        time.sleep(30.0)
        return 0

    assert commands.run_command(command, []) == 130
    assert values == [1]
    assert capsys.readouterr().err.endswith("interrupted\n")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_full_disk_is_one_line_and_exit_2(capsys):
    error = OSError(errno.ENOSPC, "No space left on device", "runs/x")
    assert commands.run_command(raising(error), []) == 2
    assert "no space left on the disk for runs/x" in capsys.readouterr().err


def test_bug_is_exit_1_and_names_the_file_of_its_trace(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert commands.run_command(raising(RuntimeError("boom\nboom")), []) == 1
    line = capsys.readouterr().err
    assert line.startswith("RuntimeError: boom boom; trace in ")
    trace = Path(line.split("trace in ")[1].strip())
    assert trace.parent == tmp_path
    assert "raise error" in trace.read_text()


def test_a_bug_after_a_word_that_is_not_utf_8_leaves_its_trace_too(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("sys.argv", ["articulate", "clip \udcff.mp4"])
    assert commands.run_command(raising(RuntimeError("boom")), []) == 1
    trace = Path(capsys.readouterr().err.split("trace in ")[1].strip())
    assert "clip \\udcff.mp4" in trace.read_text()


def test_exit_code_of_a_command_is_passed_on():
    assert commands.run_command(len, ["a", "b", "c"]) == 3


def test_unknown_command_names_the_nearest(capsys):
    assert commands.main(["trian"]) == 2
    assert capsys.readouterr().err == "trian: no such command; did you mean train?\n"


def test_help_lists_the_commands_and_version_is_printed(capsys):
    assert commands.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(verb in text for verb in ["train", "evaluate", "export", "deploy"])
    assert commands.main(["--version"]) == 0
    assert capsys.readouterr().out == f"articulate {commands.version()}\n"


def test_no_verb_at_all_shows_the_help_and_is_exit_2(capsys):
    assert commands.main([]) == 2
    assert "usage: articulate COMMAND" in capsys.readouterr().out


def test_short_names_call_their_verb(monkeypatch):
    seen: list[list[str]] = []
    monkeypatch.setattr(commands, "main", seen.append)
    monkeypatch.setattr(sys, "argv", ["name", "--flag"])
    for short in ["train", "evaluate", "export_policy", "deploy"]:
        getattr(commands, short)()
    assert [argv[0] for argv in seen] == ["train", "evaluate", "export", "deploy"]
    assert all(argv[1:] == ["--flag"] for argv in seen)


@pytest.fixture
def plug_in(tmp_path):
    """A folder with a distribution whose verb ``shine`` needs a module that is not there."""
    info = tmp_path / "shiny-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: shiny\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[articulate.commands]\nshine = shiny:main\n")
    (tmp_path / "shiny.py").write_text("import module_that_is_not_there\n")
    return tmp_path


def test_broken_plug_in_is_listed_and_does_not_break_help(plug_in):
    code = "import sys; from articulate.commands import main; sys.exit(main(['--help']))"
    result = run_python(code, PYTHONPATH=str(plug_in))
    assert result.returncode == 0
    assert "shine" in result.stdout


def test_broken_plug_in_fails_in_one_line_when_called(plug_in):
    code = "import sys; from articulate.commands import main; sys.exit(main(['shine']))"
    result = run_python(code, PYTHONPATH=str(plug_in))
    assert result.returncode == 2
    assert result.stderr.startswith("shine: shiny:main needs the module module_that_is_not_there")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "code", ["import articulate", "from articulate.commands import main; main(['--help'])"]
)
def test_import_and_help_touch_no_heavy_module(code):
    result = run_python(f"{code}; import sys; print(*sys.modules, file=sys.stderr)")
    assert result.returncode == 0
    assert not HEAVY & set(result.stderr.split())


VERBS = sorted(metadata.entry_points(group=commands.GROUP).names)


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb_has_an_example_and_touches_no_heavy_module(verb):
    result = run_python(
        f"import sys; sys.argv = ['articulate', '{verb}', '--help']\n"
        "from articulate.commands import main\n"
        "try: main()\n"
        "finally: print(*sys.modules, file=sys.stderr)"
    )
    assert result.returncode == 0
    assert "\nExample: " in result.stdout
    assert result.stdout.count("-h, --help") == 1
    assert not HEAVY - {"numpy"} & set(result.stderr.split())
    if verb != "train":  # its defaults are classes that compute
        assert "numpy" not in result.stderr.split()


def test_python_m_articulate_is_the_command():
    result = subprocess.run(
        [sys.executable, "-m", "articulate", "--version"], capture_output=True, text=True
    )
    assert result.stdout == f"articulate {commands.version()}\n"


def test_reader_that_closes_the_pipe_is_no_bug():
    code = (
        "from articulate.commands import console, run_command; "
        "run_command(lambda _: console.emit('x' * 10**7), [])"
    )
    shell = f'{sys.executable} -c "{code}" | head -c 5'
    result = subprocess.run(["bash", "-c", shell], capture_output=True, text=True)
    assert result.stdout == "xxxxx"
    assert result.stderr == ""


@pytest.mark.parametrize(
    ("words", "redirect", "code", "line"),
    [
        ("--version", ">&- 2>&- <&-", 0, ""),
        ("--version", "2>/dev/full", 0, ""),
        ("--version", ">/dev/full", 2, "the standard output cannot be written"),
        ("trian", ">&- 2>/dev/full", 2, ""),
        ("trian", ">&-", 2, "trian: no such command"),
    ],
)
def test_closed_and_full_streams_give_one_line_at_most(words, redirect, code, line):
    shell = f"{sys.executable} -m articulate {words} {redirect}"
    result = subprocess.run(["bash", "-c", shell], capture_output=True, text=True)
    assert result.returncode == code
    assert result.stderr.startswith(line)
    assert len(result.stderr.splitlines()) == bool(line)


def test_usage_error_raised_by_a_verb_reaches_the_user_through_main(capsys, monkeypatch):
    monkeypatch.setattr(commands, "_command", lambda name: raising(UsageError(f"{name}: rejected")))
    assert commands.main(["train"]) == 2
    assert capsys.readouterr().err == "train: rejected\n"
