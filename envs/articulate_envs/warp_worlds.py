"""Environments of one scene as worlds of MuJoCo Warp, all on one device.

Worlds differ in the numbers that the randomization samples and in the size of the object. Warp has
such fields for each world, except for meshes: the model holds the meshes of all sizes, and
``geom_dataid`` names those of a world.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import mujoco_warp as mjw
import numpy as np
import warp as wp

from articulate.errors import EngineError, shorten
from articulate.simulator import mujoco
from articulate.transforms import Array
from articulate_envs.config import WarpConfig
from articulate_envs.native_mujoco import SAMPLED
from articulate_envs.scene import Scene

MESH_ADDRESSES = {
    "mesh_vertadr": "mesh_vert",
    "mesh_faceadr": "mesh_face",
    "mesh_normaladr": "mesh_normal",
    "mesh_graphadr": "mesh_graph",
    "mesh_polyadr": "mesh_polynormal",
    "mesh_polyvertadr": "mesh_polyvert",
    "mesh_polymapadr": "mesh_polymap",
}
"""Fields of addresses in meshes, with the array that each points into; -1 is no address."""
LEAST_CONTACTS = 128
"""Memory for contacts in a small batch, whose mean is not near that of many environments."""
STATE = ("qpos", "qvel", "qacc_warmstart")
"""Arrays of the state that a step continues from."""
POSES = ("geom_xpos", "geom_xmat")
"""Poses of geoms. Warp never calculates those of geoms that do not move, which are in another place
in each world."""


@wp.kernel  # type: ignore[untyped-decorator]  # Warp's
def _scatter(
    rows: wp.array[int], values: wp.array2d[float], first: int, target: wp.array2d[float]
) -> None:
    i, j = wp.tid()
    target[rows[i], j] = values[i, first + j]


@wp.kernel  # type: ignore[untyped-decorator]
def _scatter_ints(
    rows: wp.array[int], values: wp.array2d[float], first: int, target: wp.array2d[int]
) -> None:
    i, j = wp.tid()
    target[rows[i], j] = int(values[i, first + j])


@wp.kernel  # type: ignore[untyped-decorator]
def _push(forces: wp.array[wp.vec3], body: int, wrenches: wp.array2d[wp.spatial_vector]) -> None:
    i = wp.tid()
    wrenches[i, body] = wp.spatial_vector(forces[i], wp.vec3(0.0))


@wp.kernel  # type: ignore[untyped-decorator]
def _record(
    step: int,
    site: int,
    qvel: wp.array2d[float],
    torque: wp.array2d[float],
    sensors: wp.array2d[float],
    sites: wp.array2d[wp.vec3],
    nacon: wp.array[int],
    ncollision: wp.array[int],
    nefc: wp.array[int],
    samples: wp.array3d[float],
    used: wp.array[int],
) -> None:
    i = wp.tid()
    nv = qvel.shape[1]
    ns = sensors.shape[1]
    for k in range(nv):
        samples[step, i, k] = qvel[i, k]
        samples[step, i, nv + k] = torque[i, k]
    for k in range(ns):
        samples[step, i, 2 * nv + k] = sensors[i, k]
    for k in range(3):
        samples[step, i, 2 * nv + ns + k] = sites[i, site][k]
    if i == 0:
        wp.atomic_max(used, 0, wp.max(nacon[0], ncollision[0]))
    wp.atomic_max(used, 1, nefc[i])


class Field(NamedTuple):
    """Array on the device with one row per world, and its place in a row of :meth:`Worlds.load`."""

    name: str
    array: Any
    first: int
    size: int


class Worlds:
    """N worlds of one scene."""

    @staticmethod
    def device_name() -> str:
        """Return the name of Warp's device: the first GPU if there is one."""
        return str(wp.get_preferred_device().alias)

    def __init__(self, scene: Scene, n: int, config: WarpConfig) -> None:
        """Put the models of ``scene`` on the device.

        Args:
            scene: Scene, at all of its sizes.
            n: Number of worlds.
            config: Memory.

        Raises:
            EngineError: MuJoCo Warp does not support the model.
        """
        self.scene, self.n, self.device = scene, n, wp.get_preferred_device()
        self._contacts = max(n * config.contacts, LEAST_CONTACTS)
        self._constraints = config.constraints
        with wp.ScopedDevice(self.device):
            host = _with_flags_of_warp(scene.nominal)
            try:
                self.model = mjw.put_model(host)
                self.data = mjw.put_data(
                    host,
                    mujoco.MjData(host),
                    nworld=n,
                    naconmax=self._contacts,
                    njmax=self._constraints,
                )
            except (NotImplementedError, ValueError) as error:
                raise EngineError(
                    f"{scene.asset.name}: MuJoCo Warp does not support the scene "
                    f"({shorten(error)}); use --engine cpu"
                ) from None
            # More contacts than this have more constraint rows than there is memory for.
            self.model.opt.contact_sensor_maxmatch = max(self._constraints // 3, 1)
            self._first_mesh = self._put_meshes()
            self.fields = self._put_fields()
            self._allocate()
        self._graph: Any = None

    def _put_meshes(self) -> list[int]:
        """Put the meshes of all sizes on the device; return the first mesh of each size."""
        models = self.scene.models
        if len(models) == 1 or not models[0].nmesh:
            return [0] * len(models)
        for name, parts in _joined_meshes(models).items():
            dtype = getattr(self.model, name).dtype
            setattr(self.model, name, wp.array(parts, dtype=dtype))
        self.model.nmaxpolygon = max(int(m.mesh_polyvertnum.max(initial=0)) for m in models)
        self.model.nmaxmeshdeg = max(int(m.mesh_polymapnum.max(initial=0)) for m in models)
        return [k * models[0].nmesh for k in range(len(models))]

    def _put_fields(self) -> list[Field]:
        """Give each world its own row of all fields in which worlds differ."""
        out, first = [], 0
        nominal = self.scene.nominal
        for name in _own_fields(self.scene):
            shared = getattr(self.model, name)
            values = np.asarray(getattr(nominal, name))
            shape = (self.n, *shared.shape[1:])
            if values.size > np.prod(shape[1:]):  # vectors
                shape = (*shape, -1)
            rows = np.repeat(values[None], self.n, axis=0).reshape(shape)
            array = wp.array(rows, dtype=shared.dtype)
            setattr(self.model, name, array)
            out.append(_field(name, array, self.n, first))
            first += out[-1].size
        self.model.stat.meaninertia = wp.full(self.n, nominal.stat.meaninertia, dtype=float)
        for name, array in (
            ("meaninertia", self.model.stat.meaninertia),
            *((name, getattr(self.data, name)) for name in STATE + POSES),
        ):
            out.append(_field(name, array, self.n, first))
            first += out[-1].size
        return out

    def _allocate(self) -> None:
        """Allocate what is exchanged in a control step, on the device and beside it."""
        model, substeps = self.scene.nominal, self.scene.substeps
        width = 2 * model.nv + model.nsensordata + 3
        self._exchanged = {
            name: Exchanged(shape, dtype, pinned=self.device.is_cuda)
            for name, shape, dtype in (
                ("controls", (substeps, self.n, model.nu), wp.float32),
                ("forces", (self.n, 3), wp.float32),
                ("samples", (substeps, self.n, width), wp.float32),
                ("qpos", (self.n, model.nq), wp.float32),
                ("used", (2,), wp.int32),
            )
        }
        self._forces = wp.array(
            ptr=self._exchanged["forces"].device.ptr, dtype=wp.vec3, shape=(self.n,)
        )

    def pack(self, k: int, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the row of a world of size ``k`` with the numbers of ``model`` and ``data``.

        The poses of ``data`` are written.
        """
        mujoco.mj_kinematics(model, data)
        row: Any = np.empty(self.fields[-1].first + self.fields[-1].size, dtype=np.float32)
        for field in self.fields:
            values: Any
            if field.name == "meaninertia":
                values = model.stat.meaninertia
            elif field.name in STATE + POSES:
                values = np.ravel(getattr(data, field.name))
            else:
                values = np.ravel(getattr(model, field.name))
            if field.name == "geom_dataid":
                values = np.where(values >= 0, values + self._first_mesh[k], values)
            row[field.first : field.first + field.size] = values
        return np.asarray(row)

    def load(self, packed: Mapping[int, Array]) -> None:
        """Write rows of :meth:`pack`, by the index of their world."""
        with wp.ScopedDevice(self.device):
            rows = wp.array(np.array(list(packed), dtype=np.int32), dtype=int)
            values = wp.array(np.stack(list(packed.values())), dtype=float)
            for field in self.fields:
                kernel = _scatter_ints if field.array.dtype == wp.int32 else _scatter
                wp.launch(
                    kernel,
                    dim=(len(packed), field.size),
                    inputs=[rows, values, field.first],
                    outputs=[field.array],
                )

    @property
    def controls(self) -> Array:
        """Controls of the physics steps of the next control step (substeps, N, nu)."""
        return np.asarray(self._exchanged["controls"].host)

    @property
    def forces(self) -> Array:
        """Forces on the moving parts during the next control step (N, 3) [N]."""
        return np.asarray(self._exchanged["forces"].host)

    def step(self) -> tuple[Array, Array]:
        """Run the physics steps of a control step.

        Returns:
            Samples (substeps, N, 2 nv + nsensordata + 3): velocities, actuator forces, sensors and
            position of the tool; positions at the end (N, nq). The next step overwrites both.

        Raises:
            EngineError: There were more contacts or constraint rows than memory for them.
        """
        exchanged = self._exchanged
        with wp.ScopedDevice(self.device):
            exchanged["controls"].to_device()
            exchanged["forces"].to_device()
            if self._graph is not None:
                wp.capture_launch(self._graph)
            else:
                self._run()
                if self.device.is_cuda:  # the first run has compiled all kernels
                    self._graph = self._capture()
            for name in ("samples", "qpos", "used"):
                exchanged[name].to_host()
            wp.synchronize_device()
        self._check_memory(exchanged["used"].host)
        return exchanged["samples"].host, exchanged["qpos"].host

    def _run(self) -> None:
        """Queue all physics steps of a control step."""
        d, at, exchanged = self.data, self.scene.at, self._exchanged
        exchanged["used"].device.zero_()
        wp.launch(_push, dim=self.n, inputs=[self._forces, at.part_body], outputs=[d.xfrc_applied])
        for step in range(self.scene.substeps):
            wp.copy(d.ctrl, exchanged["controls"].device[step])
            mjw.step(self.model, d)
            wp.launch(
                _record,
                dim=self.n,
                inputs=[
                    step,
                    at.tool_site,
                    d.qvel,
                    d.qfrc_actuator,
                    d.sensordata,
                    d.site_xpos,
                    d.nacon,
                    d.ncollision,
                    d.nefc,
                ],
                outputs=[exchanged["samples"].device, exchanged["used"].device],
            )
        wp.copy(exchanged["qpos"].device, d.qpos)

    def _capture(self) -> Any:
        """Return a CUDA graph of a control step."""
        with wp.ScopedCapture() as capture:
            self._run()
        return capture.graph

    def _check_memory(self, used: Any) -> None:
        contacts, rows = (int(count) for count in used)
        if contacts > self._contacts:
            raise EngineError(
                f"{self.scene.asset.name}: {contacts} contacts of {self.n} environments, but "
                f"memory for {self._contacts}; increase warp.contacts to "
                f"{-(-5 * contacts // (4 * self.n))}"
            )
        if rows > self._constraints:
            raise EngineError(
                f"{self.scene.asset.name}: {rows} constraint rows of one environment, but memory "
                f"for {self._constraints}; increase warp.constraints to {-(-5 * rows // 4)}"
            )

    def state(self) -> dict[str, Array]:
        """Return the arrays :data:`STATE` of all worlds, (N, nq) or (N, nv)."""
        return {name: getattr(self.data, name).numpy() for name in STATE}


class Exchanged:
    """Array on the device and its copy beside it."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, *, pinned: bool) -> None:
        self.device = wp.zeros(shape, dtype=dtype)
        self._copy = wp.zeros(shape, dtype=dtype, device="cpu", pinned=pinned)
        self.host: Any = self._copy.numpy()

    def to_device(self) -> None:
        """Copy to the device."""
        wp.copy(self.device, self._copy)

    def to_host(self) -> None:
        """Copy from the device; read it after a synchronization."""
        wp.copy(self._copy, self.device)


def _with_flags_of_warp(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy with the flags that make Warp do what MuJoCo does with those of ``model``.

    Warp does not know the flag of automatic resets and never resets by itself. Without
    ``mjDSBL_NATIVECCD`` it collides two boxes by an algorithm for convex bodies; with it, by the
    one that MuJoCo uses for boxes in any case.
    """
    model = copy.copy(model)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    return model


def _own_fields(scene: Scene) -> list[str]:
    """Return the fields in which worlds differ: sampled, or dependent on the object's size.

    Raises:
        EngineError: A field that all worlds of Warp share depends on the object's size.
    """
    first, *others = scene.models
    out = []
    for field in fields(mjw.Model):
        name, value = field.name, getattr(first, field.name, None)
        if not isinstance(value, np.ndarray) or not value.size or name.startswith("mesh_"):
            continue
        differs = any(not np.array_equal(value, getattr(other, name)) for other in others)
        own = getattr(field.type, "shape", ("",))[0] == "*"
        if differs and not own:
            raise EngineError(
                f"{scene.asset.name}: its {name} changes with its size, but MuJoCo Warp has one "
                "for all sizes; set randomization.scale to one size, or use --engine cpu"
            )
        if own and (name in SAMPLED or differs or (name == "geom_dataid" and others)):
            out.append(name)
    return out


def _field(name: str, array: Any, n: int, first: int) -> Field:
    """Return ``array`` of N rows as numbers (N, size)."""
    dtype = wp.int32 if array.dtype == wp.int32 else wp.float32
    assert array.is_contiguous
    size = array.numpy().size // n
    view = wp.array(ptr=array.ptr, dtype=dtype, shape=(n, size))
    return Field(name, view, first, size)


def _joined_meshes(models: tuple[mujoco.MjModel, ...]) -> dict[str, Array]:
    """Return the mesh arrays of ``models`` one after another, with addresses that fit."""
    names = [f.name for f in fields(mjw.Model) if f.name.startswith("mesh_")]
    out = {}
    for name in names:
        parts, offset = [], 0
        for model in models:
            values = np.array(getattr(model, name))
            if name in MESH_ADDRESSES:
                values = np.where(values >= 0, values + offset, values)
                offset += len(getattr(model, MESH_ADDRESSES[name]))
            parts.append(values)
        out[name] = np.concatenate(parts)
    return out
