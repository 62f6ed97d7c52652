"""Checkpoints that are none of ours are one line."""

import pytest
import torch
from tests.runs import write_checkpoint

from articulate.errors import RunError
from articulate.task.observation import OBSERVATION
from articulate_train.policy import CHECKPOINT, load_policy, read_checkpoint, trained_steps

POINTER = """version https://git-lfs.github.com/spec/v1
oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393
size 1234567
"""


@pytest.fixture
def folder(tmp_path):
    write_checkpoint(tmp_path / "seed_0", 0)
    return tmp_path / "seed_0"


def rejected(folder, match, ending="; train again"):
    with pytest.raises(RunError, match=match) as caught:
        load_policy(folder)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{folder / CHECKPOINT}: ")
    assert line.endswith(ending)


@pytest.mark.parametrize("content", [b"", b"\x00" * 64, b"PK\x03\x04 cut"])
def test_what_is_no_checkpoint_is_an_error(folder, content):
    (folder / CHECKPOINT).write_bytes(content)
    rejected(folder, "cannot be read")


def test_a_git_lfs_pointer_names_the_command_that_fetches_the_file(folder):
    (folder / CHECKPOINT).write_text(POINTER)
    rejected(folder, "Git LFS pointer", "git lfs pull")


@pytest.mark.parametrize("key", ["policy", "net_arch", "action_scaling", "normalization"])
def test_a_checkpoint_that_lacks_something_is_of_another_version(folder, key):
    content = read_checkpoint(folder)
    del content[key]
    torch.save(content, folder / CHECKPOINT)
    rejected(folder, f"made by another version .*{key}")


@pytest.mark.parametrize("more", [-1, 1])
def test_a_policy_that_sees_something_else_is_of_another_version(folder, more):
    content = read_checkpoint(folder)
    size = OBSERVATION.size + more
    first = "mlp_extractor.policy_net.0.weight"
    content["policy"][first] = torch.zeros(32, size)
    for name in ("mean", "var"):
        content["normalization"][name] = torch.ones(size)
    torch.save(content, folder / CHECKPOINT)
    rejected(folder, "made by another version")


def test_a_file_of_something_else_is_of_another_version(folder):
    torch.save([1, 2], folder / CHECKPOINT)
    rejected(folder, "made by another version .*list")


def test_steps_are_those_that_the_checkpoint_reports_of(folder):
    assert trained_steps(read_checkpoint(folder)) == 0
    assert trained_steps({"metadata": '{"num_timesteps": 64}'}) == 64
