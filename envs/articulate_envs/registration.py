"""Gymnasium ids of the tasks, such as ``Articulate/OpenDrawer-v0``.

Gymnasium loads no plug-ins, so the ids exist once ``articulate_envs`` is imported. Importing
Gymnasium takes 0.1 s, which every ``--help`` would pay; the ids are therefore registered when it
is imported, before or after ``articulate_envs``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

REGISTRY = "gymnasium.envs"
"""Module with the registry of Gymnasium."""


def gym_id(task: str) -> str:
    """Return the id of ``task``: ``open_drawer`` is ``Articulate/OpenDrawer-v0``."""
    return f"Articulate/{''.join(word.capitalize() for word in task.split('_'))}-v0"


def register_tasks() -> None:
    """Register an id for each known task."""
    from gymnasium.envs.registration import register  # late: see above

    from articulate.task.task import TASK_RULES

    for name in TASK_RULES:
        register(
            id=gym_id(name),
            entry_point="articulate_envs.gym_env:ArticulateEnv",
            vector_entry_point="articulate_envs.vector_env:ArticulateVectorEnv",
            kwargs={"task": name},
        )


def register_with_gymnasium() -> None:
    """Register the tasks now if Gymnasium is imported, otherwise as soon as it is."""
    if REGISTRY in sys.modules:
        register_tasks()
    else:
        sys.meta_path.insert(0, _DeferredFinder())


class _DeferredFinder(MetaPathFinder):
    """Import hook that registers the tasks after :data:`REGISTRY` is loaded, once."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != REGISTRY:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            spec.loader = _RegisteringLoader(spec.loader)
        return spec


class _RegisteringLoader(Loader):
    """Loader that delegates to the usual one and then registers the tasks."""

    def __init__(self, usual: Loader) -> None:
        self._usual = usual

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._usual.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        module.__loader__ = self._usual  # as without this hook
        if module.__spec__ is not None:
            module.__spec__.loader = self._usual
        self._usual.exec_module(module)
        register_tasks()
