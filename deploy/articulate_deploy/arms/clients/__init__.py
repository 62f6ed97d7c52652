"""Clients of controllers by name; each is imported in the child process that uses it."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from articulate.errors import ConfigError, MissingError, nearest
from articulate_deploy.arms.client import ArmClient, ClientSpec

CLIENTS = {
    "franka-rs": ("articulate_deploy.arms.clients.franka_rs:FrankaRsClient", "franka"),
    "panda-python": ("articulate_deploy.arms.clients.panda_python:PandaPythonClient", "panda_py"),
    "pylibfranka": ("articulate_deploy.arms.clients.pylibfranka:PylibfrankaClient", "pylibfranka"),
    "bridge": ("articulate_deploy.arms.clients.bridge:BridgeClient", "zmq"),
    "fake": ("articulate_deploy.arms.clients.fake:FakeClient", "numpy"),
}
"""Name to ``module:class`` and the module of the client's package."""
EXTRAS = {
    "franka-rs": "deploy-panda",
    "panda-python": "deploy-panda",
    "pylibfranka": "deploy-fr3",
    "bridge": "deploy-bridge",
}
"""Extra that installs a client."""


def check_installed(name: str) -> None:
    """Check that the client called ``name`` is known and installed; nothing is imported.

    Raises:
        ConfigError: The name is unknown.
        MissingError: Its package is not installed.
    """
    if name not in CLIENTS:
        raise ConfigError(f"--client {name}: unknown{nearest(name, EXTRAS)}")
    module = CLIENTS[name][1]
    if importlib.util.find_spec(module) is None:
        raise MissingError(
            f"--client {name} needs {module}, which is not installed; run: "
            f'pip install "articulate-robots[{EXTRAS[name]}]"'
        )


def make_client(spec: ClientSpec) -> ArmClient:
    """Return the client of ``spec``, not yet connected."""
    module, name = CLIENTS[spec.client][0].split(":")
    client: Any = getattr(importlib.import_module(module), name)
    made: ArmClient = client(spec.address, **spec.options)
    return made
