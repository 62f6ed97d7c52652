"""The gymnasium ids of our tasks: ``Articulate/OpenDrawer-v0`` and its like.

gymnasium loads no plug-ins: its ids exist once ``articulate_envs`` was imported. It takes a tenth
of a second to import, which every ``--help`` would pay; so they are registered when a user imports
gymnasium, before or after ``articulate_envs``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

REGISTRY = "gymnasium.envs"
"""The module that holds gymnasium's ids."""


def gym_id(task: str) -> str:
    """The id of ``task``: ``open_drawer`` is ``Articulate/OpenDrawer-v0``."""
    return f"Articulate/{''.join(word.capitalize() for word in task.split('_'))}-v0"


def register_tasks() -> None:
    """Register an id for each known task."""
    from gymnasium.envs.registration import register  # a user imported it, or asks for it now

    from articulate.task.task import TASK_RULES  # numpy, which gymnasium brings in any case

    for name in TASK_RULES:
        register(
            id=gym_id(name),
            entry_point="articulate_envs.gym_env:ArticulateEnv",
            vector_entry_point="articulate_envs.vector_env:ArticulateVectorEnv",
            kwargs={"task": name},
        )


def register_with_gymnasium() -> None:
    """Register now if gymnasium was imported, else when it is."""
    if REGISTRY in sys.modules:
        register_tasks()
    else:
        sys.meta_path.insert(0, _Waiting())


class _Waiting(MetaPathFinder):
    """Finds :data:`REGISTRY` as others do, once, and registers when it was loaded."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != REGISTRY:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            spec.loader = _Registering(spec.loader)
        return spec


class _Registering(Loader):
    """Loads as another does, then registers."""

    def __init__(self, usual: Loader) -> None:
        self._usual = usual

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._usual.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        module.__loader__ = self._usual  # what it says of itself is what it would say without us
        if module.__spec__ is not None:
            module.__spec__.loader = self._usual
        self._usual.exec_module(module)
        register_tasks()
