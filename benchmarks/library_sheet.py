"""One picture of all procedural categories, each closed and open.

    python benchmarks/library_sheet.py --out docs/images/library.png

The pictures on the surfaces are drawn as the URDF names them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from articulate.library.procedural.categories import CATEGORIES, write_object
from articulate.library.procedural.truth import bounds
from articulate.library.procedural.urdf import Part
from articulate.render.canvas import Canvas
from articulate.render.view_camera import fitted_view
from articulate.simulator import mujoco

CELL = (164, 164)
"""Width and height of one picture [px]; each is drawn three times as large."""
FINE = 3
COLUMNS = 4
"""Objects in a row."""
LABEL = 20
"""Height of the line under a pair [px]."""
MOST_OPEN_RAD = 1.8
"""Hinges are opened so far at most: a bail that lies over looks like one that is closed."""
AZIMUTH_DEG, ELEVATION_DEG, FIELD_OF_VIEW_DEG = 32.0, -22.0, 30.0
PAPER = (244, 245, 246)


def spec_of(name: str, parts: list[Part], folder: Path) -> mujoco.MjSpec:
    """The object that was written into ``folder`` on a stage, with its pictures."""
    spec = mujoco.MjSpec()
    palette = CATEGORIES[name].palette
    bodies: dict[str, mujoco.MjsBody] = {}
    for key in {shape.material for part in parts for shape in part.shapes}:
        material = spec.add_material(name=key, rgba=palette[key].rgba)
        if palette[key].grain:
            file = str(folder / "meshes" / f"{key}.png")
            spec.add_texture(name=key, type=mujoco.mjtTexture.mjTEXTURE_2D, file=file)
            textures = [""] * mujoco.mjtTextureRole.mjNTEXROLE
            textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = key
            material.textures = textures
            material.rgba = [1.0, 1.0, 1.0, palette[key].rgba[3]]
    for part in parts:
        parent = spec.worldbody if part.motion is None else bodies[part.motion.parent]
        at = (0.0, 0.0, 0.0) if part.motion is None else part.motion.origin_p
        body = bodies[part.name] = parent.add_body(name=part.name, pos=at)
        if part.motion is not None:
            slides = part.motion.kind == "prismatic"
            kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=part.motion.name, type=kind, axis=part.motion.axis)
        for shape in part.shapes:
            file = str(folder / "meshes" / f"{shape.name}.obj")
            mesh = spec.add_mesh(name=shape.name, file=file)
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=shape.name,
                material=shape.material,
                contype=0,
                conaffinity=0,
            )
    return spec


def staged(spec: mujoco.MjSpec, box: NDArray[np.float64]) -> mujoco.MjModel:
    """The model with a floor and two lights."""
    low, high = box
    extent = float(np.linalg.norm(high - low))
    floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05])
    floor.pos = [0.0, 0.0, float(low[2]) - 0.001 * extent]
    floor.rgba = [0.90, 0.91, 0.92, 1.0]
    floor.contype = floor.conaffinity = 0
    for turn, down, strength, casts in ((-0.6, -1.3, 0.45, True), (0.9, -0.9, 0.16, False)):
        direction = np.array([np.cos(turn), np.sin(turn), down])
        light = spec.worldbody.add_light(dir=direction, castshadow=casts)
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        light.pos = (low + high) / 2.0 - 2.0 * extent * direction
        light.ambient, light.diffuse, light.specular = [0.0] * 3, [strength] * 3, [0.1] * 3
    spec.visual.headlight.ambient = [0.45] * 3
    spec.visual.headlight.diffuse = [0.25] * 3
    spec.visual.headlight.specular = [0.0] * 3
    spec.visual.rgba.haze = [c / 255.0 for c in PAPER] + [1.0]
    spec.visual.global_.offwidth, spec.visual.global_.offheight = FINE * CELL[0], FINE * CELL[1]
    spec.visual.global_.fovy = FIELD_OF_VIEW_DEG
    spec.visual.quality.shadowsize = 2048
    spec.visual.map.shadowclip = 2.0
    spec.visual.map.znear, spec.visual.map.zfar = 0.02, 60.0
    spec.stat.extent = extent
    spec.stat.center = (low + high) / 2.0
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=[c / 255.0 for c in PAPER],
        width=16,
        height=96,
    )
    return spec.compile()


def drawn(name: str, seed: int) -> list[Image.Image]:
    """The object closed and open, from the same place."""
    parts = CATEGORIES[name].parts(seed)
    with tempfile.TemporaryDirectory() as temporary:
        write_object(name, seed, Path(temporary))
        model = staged(spec_of(name, parts, Path(temporary)), bounds(parts))
    data = mujoco.MjData(model)
    poses, points = [np.zeros(model.nq), np.zeros(model.nq)], []
    for part in parts:
        if part.motion is not None and part.motion.kind != "continuous":
            address = model.joint(part.motion.name).qposadr[0]
            poses[1][address] = min(part.motion.upper, MOST_OPEN_RAD)
    for q in poses:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for geom in range(model.ngeom):
            mesh = int(model.geom_dataid[geom])
            if mesh >= 0:
                first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
                own = model.mesh_vert[first : first + count]
                points.append(own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    view = fitted_view(
        np.concatenate(points),
        azimuth_deg=AZIMUTH_DEG,
        elevation_deg=ELEVATION_DEG,
        fov_deg=FIELD_OF_VIEW_DEG,
        aspect=CELL[0] / CELL[1],
    )
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = view.lookat_w, view.distance_m
    camera.azimuth, camera.elevation = view.azimuth_deg, view.elevation_deg
    canvas = Canvas(model, (FINE * CELL[0], FINE * CELL[1]), shadows=True)
    out = []
    for q in poses:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        pixels = np.ascontiguousarray(canvas.draw(data, camera))
        out.append(Image.fromarray(pixels).resize(CELL, Image.Resampling.BOX))
    canvas.close()
    return out


def sheet(names: list[str], seed: int) -> Image.Image:
    """All of ``names``, a pair of pictures each."""
    rows = -(-len(names) // COLUMNS)
    wide, high = 2 * CELL[0] + 8, CELL[1] + LABEL
    page = Image.new("RGB", (COLUMNS * wide, rows * high), PAPER)
    pen = ImageDraw.Draw(page)
    for k, name in enumerate(names):
        x, y = (k % COLUMNS) * wide, (k // COLUMNS) * high
        for i, picture in enumerate(drawn(name, seed)):
            page.paste(picture, (x + i * CELL[0], y))
        pen.text((x + CELL[0], y + CELL[1] + 4), name, fill=(60, 60, 60), anchor="ma")
        sys.stderr.write(f"{name}\n")
    return page


def main() -> int:
    """Draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=list(CATEGORIES))
    args = parser.parse_args()
    page = sheet(args.only, args.seed).quantize(200, dither=Image.Dither.NONE)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    page.save(args.out, optimize=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
