"""Child process in which MuJoCo reads a reduced MJCF text: native code on untrusted input.

Run as a script, so that nothing of this package is imported::

    python -P read_mjcf_child.py JOB.json RESULT.json

The job holds ``text`` and, by file name in it, ``meshes``: the files on disk. The result holds
the bodies with their joints and geoms in MuJoCo's units (m, kg, rad, wxyz), or ``error``.
"""

from __future__ import annotations

import json
import math
import resource
import sys
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import UsageError
from articulate.jobs.process_identity import end_with_parent
from articulate.simulator import mujoco
from articulate.untrusted import read_bounded

MAX_MEMORY = 2_000_000_000
"""Largest address space [bytes]."""
MAX_CPU_S = 40
MAX_MESH_BYTES = 200_000_000
TINY = 1e-9
"""Mass [kg] and inertia [kg m2] given to bodies that have none, so that MuJoCo compiles them."""
WATER = 1000.0
"""MuJoCo's default density [kg/m3]: not set by the author."""
VISIBLE_GROUPS = 3
"""MuJoCo's viewer displays geoms of the groups 0, 1 and 2."""
PLAIN = (0.5, 0.5, 0.5, 1.0)
"""Colour of a geom by default."""
NO_FULL = [math.nan, 0.0, 0.0, 0.0, 0.0, 0.0]

# Elements of MjSpec, which have no type stubs.
Spec = Any


def limit() -> None:
    """Bound memory, time and files of this process."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def describe_model(text: str, meshes: dict[str, str]) -> dict[str, Any]:
    """Return the bodies, meshes, materials and couplings of the text, poses resolved."""
    spec = mujoco.MjSpec.from_string(text)
    out: dict[str, Any] = {
        "masses": {},
        "meshes": {m.name: mesh(m) for m in spec.meshes},
        "materials": {m.name: floats(m.rgba) for m in spec.materials},
        "joint_equalities": [
            {"joint": e.name1, "leader": e.name2, "poly": floats(e.data)[:5]}
            for e in spec.equalities
            if int(e.type) == int(mujoco.mjtEq.mjEQ_JOINT) and e.active
        ],
        "ties": [
            {"name": e.name, "bodies": [e.name1, e.name2 or "world"], "active": bool(e.active)}
            for e in spec.equalities
            if int(e.type) in {int(mujoco.mjtEq.mjEQ_WELD), int(mujoco.mjtEq.mjEQ_CONNECT)}
        ],
        "rules": {
            "total": float(spec.compiler.settotalmass),
            "mass": float(spec.compiler.boundmass),
            "inertia": float(spec.compiler.boundinertia),
        },
    }
    bodies = {b.name: body(b) for b in spec.bodies}
    opacity = {m.name: float(m.rgba[3]) for m in spec.materials}
    geoms, joints = [geom(g, opacity) for g in spec.geoms], [joint(j, spec) for j in spec.joints]
    owners = [g.parent.name for g in spec.geoms], [j.parent.name for j in spec.joints]
    model = frames(spec)
    for index, (found, owner) in enumerate(zip(geoms, owners[0], strict=True)):
        address = model.geom(f"g{index}").id
        found["pos"], found["quat"] = (
            floats(model.geom_pos[address]),
            floats(model.geom_quat[address]),
        )
        if found["size"] is not None:
            found["size"] = floats(model.geom_size[address])
        bodies[owner]["geoms"].append(found)
    for index, (found, owner) in enumerate(zip(joints, owners[1], strict=True)):
        address = model.joint(f"j{index}").id
        found["pos"], found["axis"] = (
            floats(model.jnt_pos[address]),
            floats(model.jnt_axis[address]),
        )
        found["ref"] = float(model.qpos0[model.jnt_qposadr[address]])
        bodies[owner]["joints"].append(found)
    for name, found in bodies.items():
        address = model.body(name).id
        found["pos"], found["quat"] = (
            floats(model.body_pos[address]),
            floats(model.body_quat[address]),
        )
        found["parent"] = model.body(int(model.body_parentid[address])).name
    out["bodies"] = [bodies[model.body(i).name] for i in range(model.nbody)]
    masses(text, meshes, bodies, out)
    return out


def floats(values: Any) -> list[float]:
    """Return an array as a flat list."""
    return [float(v) for v in np.ravel(values)]


def number(value: Any) -> float:
    """Return the first of one or several numbers; later versions of MuJoCo have polynomials."""
    return float(np.ravel(value)[0])


def mesh(m: Spec) -> dict[str, Any]:
    """Return the scale and frame of a mesh, and its corners where they are in the text."""
    return {
        "scale": floats(m.scale),
        "refpos": floats(m.refpos),
        "refquat": floats(m.refquat),
        "vertices": None if m.file else floats(m.uservert),
        "faces": None if m.file else [int(i) for i in m.userface],
    }


def body(b: Spec) -> dict[str, Any]:
    """Return the name of a body and its ``<inertial>`` as written."""
    inertial = None
    if b.explicitinertial:
        full = floats(b.fullinertia)
        if math.isnan(full[0]):
            a, c, d = floats(b.inertia)
            full = [a, c, d, 0.0, 0.0, 0.0]
        quat = orientation(b)
        inertial = {"mass": float(b.mass), "pos": floats(b.ipos), "quat": quat, "full": full}
    return {
        "name": b.name,
        "mocap": bool(b.mocap),
        "inertial": inertial,
        "geoms": [],
        "joints": [],
    }


def orientation(b: Spec) -> list[float]:
    """Return the quaternion (4,) wxyz of the inertial frame, from any attribute."""
    if int(b.ialt.type) == int(mujoco.mjtOrientation.mjORIENTATION_QUAT):
        return floats(b.iquat)
    compiler = b.compiler
    return floats(
        mujoco.MjSpec.resolve_orientation(
            degree=bool(compiler.degree), sequence=compiler.eulerseq, orientation=b.ialt
        )
    )


def geom(g: Spec, opacity: dict[str, float]) -> dict[str, Any]:
    """Return one geom; meshes by name, in the frame of their file."""
    kinds = mujoco.mjtGeom
    named = {
        int(kinds.mjGEOM_PLANE): "plane",
        int(kinds.mjGEOM_HFIELD): "hfield",
        int(kinds.mjGEOM_SPHERE): "sphere",
        int(kinds.mjGEOM_CAPSULE): "capsule",
        int(kinds.mjGEOM_ELLIPSOID): "ellipsoid",
        int(kinds.mjGEOM_CYLINDER): "cylinder",
        int(kinds.mjGEOM_BOX): "box",
    }
    kind = "mesh" if g.meshname else named.get(int(g.type), "mesh")
    mass = float(g.mass)
    collides = bool(g.contype or g.conaffinity)
    weighed = not math.isnan(mass) or float(g.density) != WATER
    plain = g.material in opacity and np.allclose(g.rgba, PLAIN)
    alpha = opacity[g.material] if plain else float(g.rgba[3])
    hidden = int(g.group) >= VISIBLE_GROUPS or alpha <= 0.0
    return {
        "name": g.name,
        "index": int(g.name[1:].split("#")[0]),
        "kind": kind,
        "mesh": g.meshname,
        "size": None if kind in {"mesh", "hfield", "plane"} else [],
        "material": g.material,
        "rgba": floats(g.rgba),
        "group": int(g.group),
        "collides": collides,
        "massless": mass == 0.0 or float(g.density) == 0.0,
        "weighed": weighed,
        "unused": hidden and not collides and not weighed,
    }


def joint(j: Spec, spec: Spec) -> dict[str, Any]:
    """Return one joint, with angles in radians."""
    kinds = mujoco.mjtJoint
    kind = {
        int(kinds.mjJNT_FREE): "free",
        int(kinds.mjJNT_BALL): "ball",
        int(kinds.mjJNT_SLIDE): "slide",
        int(kinds.mjJNT_HINGE): "hinge",
    }[int(j.type)]
    unit = math.pi / 180.0 if spec.compiler.degree and kind == "hinge" else 1.0
    return {
        "name": j.name,
        "kind": kind,
        "range": [unit * v for v in floats(j.range)],
        "limited": int(j.limited),
        "damping": number(j.damping),
        "friction": number(j.frictionloss),
        "armature": number(j.armature),
        "stiffness": number(j.stiffness),
    }


def frames(spec: Spec) -> mujoco.MjModel:
    """Compile with all poses resolved; meshes are replaced by spheres, masses are dummies."""
    quiet(spec)
    for index, g in enumerate(spec.geoms):
        g.name, g.material = f"g{index}", ""
        g.mass, g.density = math.nan, WATER
        if g.meshname or int(g.type) in {
            int(mujoco.mjtGeom.mjGEOM_MESH),
            int(mujoco.mjtGeom.mjGEOM_SDF),
            int(mujoco.mjtGeom.mjGEOM_HFIELD),
            int(mujoco.mjtGeom.mjGEOM_PLANE),
        }:
            g.type, g.meshname, g.hfieldname = mujoco.mjtGeom.mjGEOM_SPHERE, "", ""
            g.size, g.fromto = [0.01, 0.0, 0.0], [math.nan] * 6
    for b in spec.bodies:
        b.explicitinertial = False
        b.mass, b.inertia, b.fullinertia = 1.0, [1.0, 1.0, 1.0], NO_FULL
    for index, j in enumerate(spec.joints):
        j.name = f"j{index}"
    for m in list(spec.meshes):
        spec.delete(m)
    return spec.compile()


def quiet(spec: Spec) -> None:
    """Switch off all that changes the tree or stops the compiler."""
    spec.compiler.boundmass = spec.compiler.boundinertia = TINY
    spec.compiler.settotalmass = -1.0
    spec.compiler.balanceinertia = spec.compiler.fusestatic = spec.compiler.discardvisual = False
    spec.compiler.alignfree = False
    for j in spec.joints:
        j.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        j.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    for e in list(spec.equalities):
        spec.delete(e)


def masses(
    text: str, meshes: dict[str, str], bodies: dict[str, dict[str, Any]], out: dict[str, Any]
) -> None:
    """Compute mass and inertia of the bodies whose author set masses or densities of geoms."""
    spec = mujoco.MjSpec.from_string(text)
    wanted = weighed(spec, bodies)
    if not wanted:
        return
    used = set()
    shared = float(spec.compiler.settotalmass) > 0.0
    quiet(spec)
    unused = {g["name"] for b in bodies.values() for g in b["geoms"] if g["unused"] and not shared}
    for g in list(spec.geoms):
        massless = float(g.mass) == 0.0 or float(g.density) == 0.0
        if g.parent.name not in wanted or massless or g.name in unused:
            spec.delete(g)
        else:
            g.contype = g.conaffinity = 0
            used.add(g.meshname)
    for b in spec.bodies:
        b.explicitinertial = b.name not in wanted
        b.mass, b.inertia, b.fullinertia = 1.0, [1.0, 1.0, 1.0], NO_FULL
    try:
        for m in list(spec.meshes):
            if m.name not in used:
                spec.delete(m)
            elif m.file:
                spec.assets[m.file] = read_bounded(Path(meshes[m.file]), MAX_MESH_BYTES)
        model = spec.compile()
    except (ValueError, KeyError, UsageError) as error:
        out["masses_error"] = " ".join(str(error).split())
        return
    for name in wanted:
        address = model.body(name).id
        bodies[name]["inertial"] = {
            "mass": float(model.body_mass[address]),
            "pos": floats(model.body_ipos[address]),
            "quat": floats(model.body_iquat[address]),
            "full": [*floats(model.body_inertia[address]), 0.0, 0.0, 0.0],
        }


def weighed(spec: Spec, bodies: dict[str, dict[str, Any]]) -> set[str]:
    """Return the bodies whose inertia follows from geoms that all set a mass or density.

    Geoms that are left out and set no mass have no vote. Where the file sets the total mass, all
    geoms share it.
    """
    rules = mujoco.mjtInertiaFromGeom
    rule = int(spec.compiler.inertiafromgeom)
    low, high = (int(v) for v in spec.compiler.inertiagrouprange)
    shared = float(spec.compiler.settotalmass) > 0.0
    found = set()
    for name, body_ in bodies.items():
        if rule == int(rules.mjINERTIAFROMGEOM_TRUE):
            body_["inertial"] = None
        if body_["inertial"] is not None or rule == int(rules.mjINERTIAFROMGEOM_FALSE):
            continue
        heavy = [
            g
            for g in body_["geoms"]
            if low <= g["group"] <= high and not g["massless"] and (shared or not g["unused"])
        ]
        if heavy and (shared or all(g["weighed"] for g in heavy)):
            found.add(name)
    return found


def answer(text: str, meshes: dict[str, str]) -> dict[str, Any]:
    """Return the description of the text, or why MuJoCo does not accept it."""
    try:
        return describe_model(text, meshes)
    except (ValueError, KeyError, mujoco.FatalError, MemoryError) as error:
        return {"error": " ".join(str(error).split()) or type(error).__name__}


def main(job_path: Path, result_path: Path) -> None:
    """Read the job, write the result."""
    end_with_parent()
    limit()
    job = json.loads(job_path.read_text(encoding="utf-8"))
    result = answer(job["text"], job["meshes"])
    result_path.write_text(json.dumps(result), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
