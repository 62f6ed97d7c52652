"""Export of a compiled model as ``scene.xml`` and ``meshes/``.

MuJoCo's writer keeps six digits of every number, too few for a simulated robot that must repeat
the training. This one writes the elements of scenes with all digits, and :func:`differences`
compares every array of the exported model.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial import cKDTree

from articulate.errors import AssetError
from articulate.files import write_text
from articulate.simulator import mujoco
from articulate.transforms import Array, quat_to_matrix

SCENE_FILE = "scene.xml"
TOLERANCE = 1e-7
"""Largest difference of a number between the model and its copy (relative above 1)."""

_GEOMS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")
_INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast")
_SOLVERS = ("PGS", "CG", "Newton")
_CONES = ("pyramidal", "elliptic")
_OPTIONS = (
    "timestep", "impratio", "tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance",
    "gravity", "wind", "magnetic", "density", "viscosity",
    "iterations", "ls_iterations", "noslip_iterations", "ccd_iterations",
)  # fmt: skip
_MESH_INERTIA = ("legacy", "convex", "shell")
"""Methods of the compiler for the frame of a mesh; some require that it has a volume."""
_FLAGS = (
    "constraint", "equality", "frictionloss", "limit", "contact", "spring", "damper", "gravity",
    "clampctrl", "warmstart", "filterparent", "actuation", "refsafe", "sensor", "midphase",
    "eulerdamp", "autoreset", "nativeccd", "island", "multiccd",
)  # fmt: skip
_FREE = (
    "mesh_", "bvh_", "oct_", "name", "paths", "text", "tex_", "mat_", "vis", "stat",
    "nbvh", "nmesh", "noct", "nnames", "npaths", "narena", "nbuffer", "ntree", "eq_objtype",
)  # fmt: skip
"""Prefixes of names that are not compared: texts, sizes of buffers, rendering."""
_MESH_FRAME = ("geom_aabb", "geom_pos", "geom_quat", "geom_rbound", "geom_size")
"""Arrays that depend on the frame that the compiler chooses for a mesh."""


def export_scene(model: mujoco.MjModel, folder: Path) -> Path:
    """Write ``model`` into ``folder`` and return the path of its ``scene.xml``.

    Raises:
        AssetError: The model has an element that is not supported.
    """
    path = folder / SCENE_FILE
    copy, reason = None, ""
    for inertia in _MESH_INERTIA:
        for name, text in scene_files(model, inertia).items():
            write_text(folder / name, text)
        try:
            copy = mujoco.MjModel.from_xml_path(str(path))
            break
        except ValueError as error:
            reason = " ".join(str(error).split())
    if copy is None:
        raise AssetError(f"{path}: MuJoCo does not read it back ({reason})")
    wrong = differences(model, copy)
    if wrong:
        raise AssetError(f"{path}: not the scene that was trained; it differs in {wrong[0]}")
    return path


def scene_files(model: mujoco.MjModel, inertia: str = "legacy") -> dict[str, str]:
    """Texts of ``scene.xml`` and of the meshes that it names, by their paths in the folder."""
    files = {f"meshes/{_mesh_file(model, i)}": _obj(model, i) for i in range(model.nmesh)}
    lines = [
        f"<mujoco model={quoteattr(_model_name(model))}>",
        '  <compiler angle="radian" autolimits="false" inertiafromgeom="false" meshdir="meshes"/>',
        *_option(model),
        *_assets(model, inertia),
        "  <worldbody>",
        *_body_content(model, 0, "    "),
        "  </worldbody>",
        *_contact(model),
        *_equality(model),
        *_actuators(model),
        *_sensors(model),
        "</mujoco>",
    ]
    return {SCENE_FILE: "\n".join(lines) + "\n", **files}


def differences(a: mujoco.MjModel, b: mujoco.MjModel, tolerance: float = TOLERANCE) -> list[str]:
    """Return the names of arrays and settings in which two models differ; empty if none do.

    The compiler chooses the frames of meshes, so geoms of meshes are compared by the positions of
    their points. Texts, paths and bounding volumes are not compared.
    """
    wrong = [f"option {n}" for n in _settings(a.opt) if not _same(a.opt, b.opt, n, tolerance)]
    for name in _settings(a):
        if name.startswith(_FREE) or name in {*_MESH_FRAME, "geom_sameframe", "eq_data"}:
            continue
        if not _same(a, b, name, tolerance):
            wrong.append(name)
    if wrong:
        return wrong
    if not _close(a.eq_data[:, :5], b.eq_data[:, :5], tolerance):
        wrong.append("eq_data")
    plain = np.asarray(a.geom_dataid) < 0
    for name in _MESH_FRAME:
        if not _close(getattr(a, name)[plain], getattr(b, name)[plain], tolerance):
            wrong.append(name)
    for i in np.flatnonzero(~plain):
        if not _same_points(_points(a, int(i)), _points(b, int(i)), tolerance):
            wrong.append(f"points of geom {a.geom(int(i)).name}")
    return wrong


def _settings(item: object) -> list[str]:
    kinds = (int, float, np.ndarray)
    names = [n for n in dir(item) if not n.startswith("_") and n not in {"names_map", "signature"}]
    return [n for n in names if isinstance(getattr(item, n), kinds)]


def _same(a: object, b: object, name: str, tolerance: float) -> bool:
    return _close(getattr(a, name), getattr(b, name), tolerance)


def _close(a: object, b: object, tolerance: float) -> bool:
    x, y = np.asarray(a), np.asarray(b)
    if x.shape != y.shape:
        return False
    if x.dtype.kind != "f":
        return bool(np.array_equal(x, y))
    return bool(np.allclose(x, y, rtol=tolerance, atol=tolerance))


def _points(model: mujoco.MjModel, geom: int) -> Array:
    """Return the points of a geom's mesh in the frame of its body (P, 3) [m]."""
    mesh = int(model.geom_dataid[geom])
    points = _vertices(model, mesh) @ quat_to_matrix(model.geom_quat[geom]).T
    return np.asarray(points + model.geom_pos[geom])


def _same_points(a: Array, b: Array, tolerance: float) -> bool:
    """Return whether two sets have the same number of points at the same positions.

    Points are not sorted for this: rounding may change their order.
    """
    near = tolerance * (1.0 + float(np.abs(a).max(initial=0.0)))
    distances = (cKDTree(a).query(b)[0], cKDTree(b).query(a)[0]) if len(a) == len(b) else ()
    return bool(distances) and all(bool((d <= near).all()) for d in distances)


def _vertices(model: mujoco.MjModel, mesh: int) -> Array:
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.asarray(model.mesh_vert[start : start + count], dtype=np.float64)


def _model_name(model: mujoco.MjModel) -> str:
    return bytes(model.names).split(b"\0", 1)[0].decode()


def _numbers(values: Iterable[float] | float) -> str:
    return " ".join(repr(float(v)) for v in np.atleast_1d(np.asarray(values)))


def _name(label: str, attribute: str = "name") -> str:
    return f" {attribute}={quoteattr(label)}" if label else ""


def _mesh_file(model: mujoco.MjModel, mesh: int) -> str:
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in model.mesh(mesh).name)
    return f"{mesh:03d}_{safe}.obj"


def _obj(model: mujoco.MjModel, mesh: int) -> str:
    """Return Wavefront text; nine digits preserve single-precision numbers."""
    start, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    faces = np.asarray(model.mesh_face[start : start + count]) + 1
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in _vertices(model, mesh)]
    lines += [f"f {a} {b} {c}" for a, b, c in faces]
    return "\n".join(lines) + "\n"


def _option(model: mujoco.MjModel) -> list[str]:
    opt = model.opt
    values = "".join(
        f' {n}="{getattr(opt, n) if "iterations" in n else _numbers(getattr(opt, n))}"'
        for n in _OPTIONS
    )
    flags = "".join(
        f' {name}="disable"'
        for name in _FLAGS
        if int(opt.disableflags) & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}"))
    )
    return [
        f'  <option integrator="{_INTEGRATORS[opt.integrator]}" solver="{_SOLVERS[opt.solver]}" '
        f'cone="{_CONES[opt.cone]}"{values}>',
        f"    <flag{flags}/>",
        "  </option>",
        f'  <size memory="{model.narena}"/>',
    ]


def _assets(model: mujoco.MjModel, inertia: str) -> list[str]:
    lines = [
        f"    <mesh{_name(model.mesh(i).name)}{_name(_mesh_file(model, i), 'file')} "
        f'inertia="{inertia}"/>'
        for i in range(model.nmesh)
    ]
    return ["  <asset>", *lines, "  </asset>"]


def _body_content(model: mujoco.MjModel, body: int, pad: str) -> list[str]:
    lines: list[str] = []
    for kind, ids in (
        (_joint, np.flatnonzero(model.jnt_bodyid == body)),
        (_geom, np.flatnonzero(model.geom_bodyid == body)),
        (_site, np.flatnonzero(model.site_bodyid == body)),
    ):
        lines += [pad + kind(model, int(i)) for i in ids]
    for child in np.flatnonzero(model.body_parentid == body):
        if child != 0:
            lines += _body(model, int(child), pad)
    return lines


def _body(model: mujoco.MjModel, body: int, pad: str) -> list[str]:
    place = f'pos="{_numbers(model.body_pos[body])}" quat="{_numbers(model.body_quat[body])}"'
    lines = [
        f"{pad}<body{_name(model.body(body).name)} {place} "
        f'gravcomp="{_numbers(model.body_gravcomp[body])}">'
    ]
    if model.body_mass[body] > 0.0:
        lines.append(
            f'{pad}  <inertial pos="{_numbers(model.body_ipos[body])}" '
            f'quat="{_numbers(model.body_iquat[body])}" mass="{_numbers(model.body_mass[body])}" '
            f'diaginertia="{_numbers(model.body_inertia[body])}"/>'
        )
    return [*lines, *_body_content(model, body, pad + "  "), f"{pad}</body>"]


def _truth(value: object) -> str:
    return "true" if value else "false"


def _joint(model: mujoco.MjModel, i: int) -> str:
    kind = int(model.jnt_type[i])
    if kind not in {int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)}:
        raise AssetError(f"joint {model.joint(i).name}: only slides and hinges are written")
    dof = int(model.jnt_dofadr[i])
    word = "slide" if kind == int(mujoco.mjtJoint.mjJNT_SLIDE) else "hinge"
    return (
        f'<joint{_name(model.joint(i).name)} type="{word}" group="{model.jnt_group[i]}" '
        f'pos="{_numbers(model.jnt_pos[i])}" axis="{_numbers(model.jnt_axis[i])}" '
        f'limited="{_truth(model.jnt_limited[i])}" range="{_numbers(model.jnt_range[i])}" '
        f'margin="{_numbers(model.jnt_margin[i])}" stiffness="{_numbers(model.jnt_stiffness[i])}" '
        f'ref="{_numbers(model.qpos0[model.jnt_qposadr[i]])}" '
        f'springref="{_numbers(model.qpos_spring[model.jnt_qposadr[i]])}" '
        f'solreflimit="{_numbers(model.jnt_solref[i])}" '
        f'solimplimit="{_numbers(model.jnt_solimp[i])}" '
        f'armature="{_numbers(model.dof_armature[dof])}" '
        f'damping="{_numbers(model.dof_damping[dof])}" '
        f'frictionloss="{_numbers(model.dof_frictionloss[dof])}" '
        f'solreffriction="{_numbers(model.dof_solref[dof])}" '
        f'solimpfriction="{_numbers(model.dof_solimp[dof])}" '
        f'actuatorfrclimited="{_truth(model.jnt_actfrclimited[i])}" '
        f'actuatorfrcrange="{_numbers(model.jnt_actfrcrange[i])}" '
        f'actuatorgravcomp="{_truth(model.jnt_actgravcomp[i])}"/>'
    )


def _geom(model: mujoco.MjModel, i: int) -> str:
    kind, mesh = _GEOMS[int(model.geom_type[i])], int(model.geom_dataid[i])
    if kind == "mesh":
        shape = f"mesh={quoteattr(model.mesh(mesh).name)}"
    elif mesh < 0:
        shape = f'size="{_numbers(model.geom_size[i])}"'
    else:
        raise AssetError(f"geom {model.geom(i).name}: a {kind} of data is not written")
    return (
        f'<geom{_name(model.geom(i).name)} type="{kind}" {shape} '
        f'pos="{_numbers(model.geom_pos[i])}" quat="{_numbers(model.geom_quat[i])}" '
        f'contype="{model.geom_contype[i]}" conaffinity="{model.geom_conaffinity[i]}" '
        f'condim="{model.geom_condim[i]}" group="{model.geom_group[i]}" '
        f'priority="{model.geom_priority[i]}" friction="{_numbers(model.geom_friction[i])}" '
        f'solmix="{_numbers(model.geom_solmix[i])}" solref="{_numbers(model.geom_solref[i])}" '
        f'solimp="{_numbers(model.geom_solimp[i])}" margin="{_numbers(model.geom_margin[i])}" '
        f'gap="{_numbers(model.geom_gap[i])}" rgba="{_numbers(model.geom_rgba[i])}"/>'
    )


def _site(model: mujoco.MjModel, i: int) -> str:
    return (
        f'<site{_name(model.site(i).name)} type="{_GEOMS[int(model.site_type[i])]}" '
        f'group="{model.site_group[i]}" pos="{_numbers(model.site_pos[i])}" '
        f'quat="{_numbers(model.site_quat[i])}" size="{_numbers(model.site_size[i])}" '
        f'rgba="{_numbers(model.site_rgba[i])}"/>'
    )


def _contact(model: mujoco.MjModel) -> list[str]:
    pairs = [(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature]
    lines = [
        f"    <exclude{_name(model.body(a).name, 'body1')}{_name(model.body(b).name, 'body2')}/>"
        for a, b in pairs
    ]
    return ["  <contact>", *lines, "  </contact>"]


def _equality(model: mujoco.MjModel) -> list[str]:
    lines = []
    for i in range(model.neq):
        if int(model.eq_type[i]) != int(mujoco.mjtEq.mjEQ_JOINT):
            raise AssetError(f"equality {model.equality(i).name}: only those of joints are written")
        second = int(model.eq_obj2id[i])
        other = _name(model.joint(second).name, "joint2") if second >= 0 else ""
        lines.append(
            f"    <joint{_name(model.equality(i).name)}"
            f"{_name(model.joint(int(model.eq_obj1id[i])).name, 'joint1')}{other} "
            f'polycoef="{_numbers(model.eq_data[i, :5])}" active="{_truth(model.eq_active0[i])}" '
            f'solref="{_numbers(model.eq_solref[i])}" solimp="{_numbers(model.eq_solimp[i])}"/>'
        )
    return ["  <equality>", *lines, "  </equality>"]


def _actuators(model: mujoco.MjModel) -> list[str]:
    lines = []
    for i in range(model.nu):
        if int(model.actuator_trntype[i]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            raise AssetError(f"actuator {model.actuator(i).name}: only those of joints are written")
        joint = model.joint(int(model.actuator_trnid[i, 0])).name
        lines.append(
            f"    <general{_name(model.actuator(i).name)}{_name(joint, 'joint')} "
            f'group="{model.actuator_group[i]}" gear="{_numbers(model.actuator_gear[i])}" '
            f'ctrllimited="{_truth(model.actuator_ctrllimited[i])}" '
            f'ctrlrange="{_numbers(model.actuator_ctrlrange[i])}" '
            f'forcelimited="{_truth(model.actuator_forcelimited[i])}" '
            f'forcerange="{_numbers(model.actuator_forcerange[i])}" '
            f'dyntype="none" gaintype="fixed" biastype="affine" '
            f'gainprm="{_numbers(model.actuator_gainprm[i])}" '
            f'biasprm="{_numbers(model.actuator_biasprm[i])}"/>'
        )
    return ["  <actuator>", *lines, "  </actuator>"]


def _sensors(model: mujoco.MjModel) -> list[str]:
    """Return the contact sensors that :func:`articulate_envs.scene.scene_spec` adds."""
    words = ("found", "force", "torque", "dist", "pos", "normal", "tangent")
    reduce = ("none", "mindist", "maxforce", "netforce")
    kinds = {int(mujoco.mjtObj.mjOBJ_BODY): "body", int(mujoco.mjtObj.mjOBJ_XBODY): "subtree"}
    lines = []
    for i in range(model.nsensor):
        if int(model.sensor_type[i]) != int(mujoco.mjtSensor.mjSENS_CONTACT):
            raise AssetError(f"sensor {model.sensor(i).name}: only contact sensors are written")
        bits, how, count = (int(v) for v in model.sensor_intprm[i, :3])
        data = " ".join(w for k, w in enumerate(words) if bits >> k & 1)
        ends = "".join(
            _name(model.body(int(ids[i])).name, f"{kinds[int(types[i])]}{k}")
            for k, types, ids in (
                (1, model.sensor_objtype, model.sensor_objid),
                (2, model.sensor_reftype, model.sensor_refid),
            )
        )
        lines.append(
            f'    <contact{_name(model.sensor(i).name)}{ends} num="{count}" data="{data}" '
            f'reduce="{reduce[how]}"/>'
        )
    return ["  <sensor>", *lines, "  </sensor>"]
