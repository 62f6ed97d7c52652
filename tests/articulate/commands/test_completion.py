import shutil
import subprocess

import pytest

from articulate.commands import main
from articulate.commands.completion import SHELLS


@pytest.fixture(scope="module")
def bash(tmp_path_factory):
    import contextlib
    import io

    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["--completion", "bash"]) == 0
    path = tmp_path_factory.mktemp("completion") / "articulate.bash"
    path.write_text(out.getvalue())
    return path


def completed(script, *words):
    """Return the completions of bash for the last of ``words``."""
    listed = " ".join(f"'{word}'" for word in words)
    code = (
        f"source {script}; COMP_WORDS=({listed}); COMP_CWORD={len(words) - 1}; "
        '_articulate; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "--norc", "-c", code], capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["articulate", "ev"], ["evaluate"]),
        (["articulate", "evaluate", "--epi"], ["--episodes"]),
        (["articulate", "train", "--set", "ppo.n_e"], ["ppo.n_envs=", "ppo.n_epochs="]),
        (["articulate", "train", "--help"], ["--help", "--help-all"]),
        (["train", "--closed", "l"], ["lower"]),
        (["check-asset", "--ou"], ["--out"]),
        (["deploy", "--no-r"], ["--no-randomise"]),
        (["articulate", "cache", ""], ["list", "clean"]),
    ],
)
def test_bash_completes_commands_flags_and_values(bash, words, offered):
    assert completed(bash, *words) == offered


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_has_a_script_with_every_command(shell, capsys, tmp_path):
    assert main([f"--completion={shell}"]) == 0
    text = capsys.readouterr().out
    for word in ["check", "train", "evaluate", "export", "deploy", "cache", "require-success"]:
        assert word in text
    program = shutil.which(shell)
    if program:
        (tmp_path / "script").write_text(text)
        subprocess.run([program, "-n", tmp_path / "script"], check=True)


def test_unknown_shells_name_the_nearest(capsys):
    assert main(["--completion", "bsh"]) == 2
    assert "did you mean bash?" in capsys.readouterr().err
    assert main(["--completion"]) == 2
    assert "needs the name of a shell: bash, zsh, fish" in capsys.readouterr().err
