import subprocess
import sys

import gymnasium
import pytest

import articulate_envs  # noqa: F401  it makes the ids known
from articulate.task.task import TASK_RULES
from articulate_envs.registration import gym_id

HEAVY = "numpy mujoco numba gymnasium torch robosuite"


def python(code):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_every_task_has_an_id():
    assert gym_id("open_drawer") == "Articulate/OpenDrawer-v0"
    for name in TASK_RULES:
        assert gymnasium.spec(gym_id(name)).kwargs == {"task": name}


def test_importing_the_package_imports_nothing_heavy():
    code = f"import sys, articulate_envs; print([m for m in {HEAVY.split()} if m in sys.modules])"
    assert python(code) == "[]"


@pytest.mark.parametrize(
    "order",
    [
        "import gymnasium, articulate_envs",
        "import articulate_envs, gymnasium",
        "import articulate_envs, gymnasium.spaces",
        "import gymnasium.wrappers as w; import articulate_envs, gymnasium",
    ],
)
def test_ids_exist_whichever_package_is_imported_first(order):
    code = f"{order}; print(gymnasium.spec('Articulate/OpenDrawer-v0').entry_point)"
    assert python(code) == "articulate_envs.gym_env:ArticulateEnv"


def test_gymnasium_is_what_it_would_be_without_us():
    code = (
        "import sys; before = list(sys.meta_path); import articulate_envs, gymnasium; "
        "import gymnasium.envs as e; print(sys.meta_path == before, "
        "type(e.__loader__).__name__, e.__spec__.loader is e.__loader__)"
    )
    assert python(code) == "True SourceFileLoader True"
