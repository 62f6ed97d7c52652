"""With the guard off, each layer holds what it is there for, and all together hold everything."""

import struct
import sys

import pytest
from tests.articulate.reconstruct.program.hostile import attacks
from tests.articulate.reconstruct.program.raw import ROOT, attacked

from articulate.reconstruct.program.process_limits import LAYERS, seccomp_filter
from articulate.reconstruct.program.sandbox import Sandbox, SandboxLimits

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the layers are Linux's")

ALL = attacks()
CONTROLS = [attack for attack in ALL if attack.control]
ONE_OF_EACH = list({attack.family: attack for attack in reversed(CONTROLS)}.values())
"""One attack of each family that does harm where nothing holds it."""
QUICK = {attack.name: attack for attack in ALL}
BY_NATURE = {"files-change_mode", "files-change_times", "network-unix_socket_connect"}
"""What Landlock does not know: rights and times of files, and sockets that are files."""


@pytest.fixture(scope="module")
def available(tmp_path_factory):
    """Layers that this kernel has."""
    folder = tmp_path_factory.mktemp("probe")
    return attacked(QUICK["name_dunder"], folder, LAYERS).layers


def need(available, *layers):
    lacking = set(layers) - set(available)
    if lacking:
        pytest.skip(f"this kernel or user has no {', '.join(sorted(lacking))}")


@pytest.mark.parametrize("attack", ONE_OF_EACH, ids=str)
def test_an_attack_of_each_family_does_no_harm_behind_all_layers(attack, tmp_path):
    outcome = attacked(attack, tmp_path, LAYERS)
    assert outcome.harm == ()


@pytest.mark.parametrize(
    "name", ["fork_bomb", "list_times", "ignore_terminate", "endless_output", "double_fork_daemon"]
)
def test_a_bomb_ends_and_leaves_nothing(name, tmp_path):
    outcome = attacked(QUICK[name], tmp_path, LAYERS)
    assert outcome.harm == ()
    assert outcome.end != "ran"


@pytest.mark.parametrize("name", ["open_write", "connect_tcp_by_socket", "change_mode"])
def test_the_same_attacks_do_harm_where_nothing_holds_them(name, tmp_path):
    """Else the tests beside this one would show nothing."""
    outcome = attacked(QUICK[name], tmp_path, ())
    assert outcome.layers == ()
    assert outcome.harm != ()


def test_a_process_that_a_child_leaves_behind_ends_with_it(tmp_path):
    """Even where no layer forbids it to make one."""
    outcome = attacked(QUICK["fork"], tmp_path, ())
    assert (outcome.end, outcome.harm) == ("ran", ())


@pytest.mark.parametrize("name", ["open_write", "connect_tcp_by_socket", "delete_in_folder"])
def test_landlock_alone_holds_files_and_tcp(name, tmp_path, available):
    need(available, "landlock")
    outcome = attacked(QUICK[name], tmp_path, ("landlock",))
    assert outcome.layers == ("landlock",)
    assert (outcome.harm, outcome.end) == ((), "PermissionError")


@pytest.mark.parametrize(
    "name", ["open_write", "connect_tcp_by_socket", "change_mode", "unix_socket_connect", "fork"]
)
def test_seccomp_alone_holds_every_door(name, tmp_path, available):
    need(available, "seccomp")
    outcome = attacked(QUICK[name], tmp_path, ("seccomp",))
    assert outcome.layers == ("seccomp",)
    assert (outcome.harm, outcome.end) == ((), "PermissionError")


def test_limits_alone_hold_new_files_and_processes(tmp_path, available):
    need(available, "limits", "user")
    for name in ("open_write", "fork"):
        folder = tmp_path / name
        folder.mkdir()
        outcome = attacked(QUICK[name], folder, ("limits", "user"))
        assert outcome.harm == ()
        assert outcome.end in {"OSError", "BlockingIOError"}


@pytest.mark.slow
@pytest.mark.parametrize("attack", ALL, ids=str)
def test_no_attack_does_harm_behind_all_layers(attack, tmp_path):
    outcome = attacked(attack, tmp_path, LAYERS)
    assert outcome.harm == ()


@pytest.mark.slow
@pytest.mark.parametrize("attack", CONTROLS, ids=str)
def test_each_control_does_harm_where_nothing_holds_it(attack, tmp_path):
    assert attacked(attack, tmp_path, ()).harm != ()


@pytest.mark.slow
@pytest.mark.parametrize("layer", ["landlock", "seccomp"])
@pytest.mark.parametrize("attack", CONTROLS, ids=str)
def test_either_layer_of_the_kernel_holds_the_controls(attack, layer, tmp_path, available):
    need(available, layer)
    harm = attacked(attack, tmp_path, (layer,)).harm
    assert bool(harm) == (layer == "landlock" and str(attack) in BY_NATURE)


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_jumps_of_the_filter_stay_within_it(machine):
    words = [struct.unpack("HBBI", word) for word in seccomp_filter(machine)]
    for at, (code, then, otherwise, _) in enumerate(words):
        if code & 0x07 == 0x05:
            assert at + 1 + max(then, otherwise) < len(words)
    assert words[-1][0] == 0x06


def verdict(machine, number, arguments=(0, 0, 0, 0), audit=None):
    """What the filter answers, run word by word."""
    words = [struct.unpack("HBBI", word) for word in seccomp_filter(machine)]
    arch = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}[machine] if audit is None else audit
    data = struct.pack("IIQ6Q", number, arch, 0, *arguments, *(0,) * (6 - len(arguments)))
    at = loaded = 0
    while True:
        code, then, otherwise, value = words[at]
        at += 1
        if code == 0x20:
            loaded = struct.unpack_from("I", data, value)[0]
        elif code == 0x06:
            return {0x7FFF0000: "allow", 0x00050001: "refuse", 0x80000000: "kill"}[value]
        else:
            true = {0x15: loaded == value, 0x35: loaded >= value, 0x45: bool(loaded & value)}[code]
            at += then if true else otherwise


def test_the_filter_lets_through_its_two_pipes_and_memory_alone():
    assert verdict("x86_64", 0, (0,)) == "allow"
    assert verdict("x86_64", 0, (3,)) == "refuse"
    assert verdict("x86_64", 0, (1 << 32,)) == "refuse"
    assert verdict("x86_64", 1, (1,)) == "allow"
    assert verdict("x86_64", 1, (2,)) == "refuse"
    assert verdict("x86_64", 9, (0, 4096, 3)) == "allow"
    assert verdict("x86_64", 9, (0, 4096, 7)) == "refuse"
    assert verdict("x86_64", 10, (0, 4096, 4)) == "refuse"
    assert verdict("x86_64", 231) == "allow"


def test_the_filter_refuses_every_other_call_and_kills_foreign_tables():
    allowed = {n for n in range(600) if verdict("x86_64", n, (0,)) == "allow"}
    assert allowed == {0, 9, 10, 11, 12, 13, 14, 15, 24, 25, 28, 60, 96, 131, 202, 228, 231}
    assert verdict("x86_64", 0x40000000) == "kill"
    assert verdict("x86_64", 0, audit=0x40000003) == "kill"


def test_a_child_has_no_environment_and_no_third_stream(tmp_path):
    script = tmp_path / "look.py"
    script.write_text(
        "import json, os\n"
        "fds = [k for k in range(3, 64) if os.path.exists(f'/proc/self/fd/{k}')]\n"
        "names = sorted(os.environ)\n"
        "print(json.dumps({'names': names, 'fds': fds, 'cwd': os.getcwd()}), flush=True)\n"
    )
    with (ROOT / "articulate" / "errors.py").open() as _, Sandbox(script, SandboxLimits()) as child:
        found = child.receive()
    assert set(found["names"]) <= {"LC_CTYPE"}  # Python sets it itself
    assert (found["fds"], found["cwd"]) == ([], "/")
