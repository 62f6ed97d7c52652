r"""Compare this converter with other tools on the same objects, by the same checks.

python benchmarks/rivals.py --checked checked --data data --tools tools --out rivals \
    --count 30 --json

``--tools`` contains a virtual environment for each tool (``python3.11 -m venv tools/simcheck`` and
``pip install`` in it: urdf2mjcf 0.2.39, urdf-to-mjcf 0.1.1, simcheck 0.2.0). Each tool gets a copy
of the object's folder. Its output is scaled to metres, placed like our asset, and checked with the
joints and handles of our asset. Free joints at the root and floors are removed; the rest stays as
the tool wrote it. Checks that compare with the input or with our files do not count. Each tool and
object runs in a separate process, and its row is written to ``--out``; rows that exist are not
measured again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from articulate.assets.asset import Asset, load_asset, save_asset
from articulate.assets.check_report import CheckReport
from articulate.checks.forward_kinematics import InputFrame
from articulate.checks.run_checks import run_checks
from articulate.checks.source import origin_of_reading
from articulate.conversion.convert import read_input
from articulate.errors import AssetError
from articulate.files import write_json
from articulate.formats.config import ConvertConfig
from articulate.simulator import mujoco
from articulate.transforms import matrix_to_quat
from assets import items_of

LIMIT_S = 120.0
"""A tool that takes longer on one object is stopped [s]."""
TOTAL_LIMIT_S = 600.0
"""Time limit of the tool and the checks of one object together [s]; more is not good."""
SEED = 1
"""Seed of the order of the objects."""
NOT_COUNTED = frozenset({"joint_limits", "collision_coverage", "inertia"})
"""Checks that compare with our files or with visual meshes do not count for any tool."""
EXECUTABLES = {
    "urdf2mjcf": Path("urdf2mjcf/bin/urdf2mjcf"),
    "urdf-to-mjcf": Path("urdf-to-mjcf/bin/urdf-to-mjcf"),
    "simcheck fix": Path("simcheck/bin/simcheck"),
}
"""Programs of the tools, below the folder of virtual environments."""
TOOL_FILES = "tool_files"
"""Folder of the meshes and textures of a tool, below the asset folder."""
BARE = "no collision shapes"
"""Failure of a part without collision shapes: nothing blocks it, and no gripper could pull it."""
FLAGS = (
    '<mujoco><compiler discardvisual="false" fusestatic="false" strippath="false" '
    'balanceinertia="true" boundmass="0.001" boundinertia="1e-6" inertiafromgeom="auto"/></mujoco>'
)
"""Compiler settings that help most URDFs into MuJoCo."""


@dataclass(frozen=True)
class ToolResult:
    """File that a tool wrote and MuJoCo reads, or the reason why there is none."""

    path: Path | None
    reason: str = ""


Tool = Callable[[Path, Path], ToolResult]
"""Function of a URDF in a writable folder, and of the folder of virtual environments."""


def unmodified(urdf: Path, _: Path) -> ToolResult:
    """Read the URDF with MuJoCo."""
    return ToolResult(urdf)


def with_flags(urdf: Path, _: Path) -> ToolResult:
    """Read the URDF with MuJoCo and compiler settings."""
    text = urdf.read_text(encoding="utf-8", errors="replace")
    at = text.find(">", text.find("<robot")) + 1
    out = urdf.with_name("with_flags.urdf")
    out.write_text(text[:at] + FLAGS + text[at:], encoding="utf-8")
    return ToolResult(out)


def urdf2mjcf(urdf: Path, tools: Path) -> ToolResult:
    """Run the converter of kscale."""
    out = urdf.with_name("urdf2mjcf.xml")
    return _run([tools / EXECUTABLES["urdf2mjcf"], urdf, "--output", out], out)


def urdf_to_mjcf(urdf: Path, tools: Path) -> ToolResult:
    """Run the converter of discoverse with convex decomposition, in a separate folder."""
    out = urdf.parent / "urdf_to_mjcf" / "robot.xml"
    out.parent.mkdir(exist_ok=True)
    return _run([tools / EXECUTABLES["urdf-to-mjcf"], "-ct", "decomposition", "-o", out, urdf], out)


def simcheck_fix(urdf: Path, tools: Path) -> ToolResult:
    """Run simcheck's repair of the URDF, then MuJoCo with compiler settings."""
    out = urdf.with_name("simcheck.urdf")
    done = _run([tools / EXECUTABLES["simcheck fix"], "fix", "--no-verify", "-o", out, urdf], out)
    return with_flags(out, tools) if done.path else done


TOOLS: dict[str, Tool] = {
    "mujoco": unmodified,
    "mujoco with flags": with_flags,
    "urdf2mjcf": urdf2mjcf,
    "urdf-to-mjcf": urdf_to_mjcf,
    "simcheck fix": simcheck_fix,
}


def _run(command: list[str | Path], out: Path) -> ToolResult:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return ToolResult(None, f"stopped after {LIMIT_S:g} s")
    if out.is_file():
        return ToolResult(out)
    lines = (done.stderr or done.stdout).strip().splitlines()
    return ToolResult(None, f"exit {done.returncode}: {lines[-1] if lines else 'no output'}"[:300])


def wrap_model(path: Path, asset: Asset, frame: InputFrame, out: Path) -> Asset:
    """Write an asset folder around the model at ``path``, with the joints and handles of ``asset``.

    Args:
        path: MJCF or URDF in units of the input.
        asset: Our asset of the same object.
        frame: Transform from the units of the input to the frame of ``asset``.
        out: Folder to write.

    Raises:
        AssetError: MuJoCo cannot read it.
    """
    try:
        saved = path.with_name(f"{path.stem}_saved.xml")
        mujoco.mj_saveLastXML(str(saved), mujoco.MjModel.from_xml_path(str(path)))
        spec = mujoco.MjSpec.from_file(str(saved))
        meshes = (path.parent / spec.meshdir).resolve()
        for geom in [g for g in spec.worldbody.geoms if g.type == mujoco.mjtGeom.mjGEOM_PLANE]:
            spec.delete(geom)  # a floor is not part of the object
        _scale(spec, frame.scale)
        shutil.copytree(asset.folder, out)
        folder = out.resolve() / TOOL_FILES
        folder.mkdir()
        for k, entry in enumerate([*spec.meshes, *spec.textures]):
            if entry.file:  # asset folders are self-contained
                name = f"{k}_{Path(entry.file).name}"
                shutil.copy(meshes / entry.file, folder / name)
                entry.file = name
        spec.meshdir, spec.texturedir = str(folder), str(folder)
        spec.compile()
        text = spec.to_xml().replace(str(folder), TOOL_FILES)
    except (ValueError, mujoco.FatalError, OSError) as error:
        raise AssetError(f"MuJoCo rejects it: {' '.join(str(error).split())[:300]}") from None
    names = _wrapped(text, asset.links[0].name, frame, out / "object.xml")
    links = tuple(link for link in asset.links if link.name in names)
    handles = tuple(h for h in asset.handles if h.link in names)
    save_asset(replace(asset, links=links, handles=handles, folder=out))
    return load_asset(out)


def _scale(spec: Any, s: float) -> None:
    """Scale every length by ``s`` at the same density."""
    for mesh in spec.meshes:
        mesh.scale = np.asarray(mesh.scale) * s
    for body in spec.bodies:
        body.pos, body.ipos = np.asarray(body.pos) * s, np.asarray(body.ipos) * s
        body.mass *= s**3
        body.inertia, body.fullinertia = (
            np.asarray(body.inertia) * s**5,
            np.asarray(body.fullinertia) * s**5,
        )
    for geom in spec.geoms:
        geom.pos = np.asarray(geom.pos) * s
        geom.size = np.asarray(geom.size) * s
    for site in spec.sites:
        site.pos = np.asarray(site.pos) * s
    for joint in spec.joints:
        joint.pos = np.asarray(joint.pos) * s
        if int(joint.type) == int(mujoco.mjtJoint.mjJNT_SLIDE):
            joint.range = np.asarray(joint.range) * s


def _wrapped(text: str, root: str, frame: InputFrame, path: Path) -> set[str]:
    """Write ``text`` with everything in one body ``root``, and return the names of its bodies."""
    tree = etree.fromstring(text.encode())
    _remove_extras(tree)
    for body in list(tree.iter("body")):
        if body.get("name") == root:
            body.set("name", f"{root}__")
    for exclude in tree.iter("exclude"):
        for key in ("body1", "body2"):
            if exclude.get(key) == root:
                exclude.set(key, f"{root}__")
    world = tree.find("worldbody")
    quat = " ".join(f"{x:.12g}" for x in matrix_to_quat(frame.T_os[:3, :3]))
    pos = " ".join(f"{x:.12g}" for x in frame.T_os[:3, 3])
    top = etree.Element("body", name=root)
    base = etree.SubElement(top, "body", name=f"{root}__base", pos=pos, quat=quat)
    for child in list(world):
        base.append(child)
    world.append(top)
    path.write_bytes(etree.tostring(tree))
    return {str(b.get("name")) for b in tree.iter("body")}


def _remove_extras(tree: Any) -> None:
    """Remove elements that are not part of the object: free joints, actuators and sensors.

    The start pose of a free body does not belong to the object either: it is set to the origin.
    """
    extras = [
        *tree.iter("freejoint", "keyframe", "actuator", "sensor"),
        *(joint for joint in tree.iter("joint") if joint.get("type") == "free"),
    ]
    for element in extras:
        body = element.getparent()
        body.remove(element)
        if element.tag in ("freejoint", "joint"):
            for key in ("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"):
                body.attrib.pop(key, None)


def cavities_min(check_report: CheckReport) -> float | None:
    """Return the smallest free share of a cavity; None without cavities."""
    found = [
        c.measured for c in check_report.checks if c.name == "cavities" and c.measured is not None
    ]
    return round(min(found), 3) if found else None


def row_of(
    name: str,
    made: ToolResult,
    check_report: CheckReport | None,
    reason: str,
    took_s: float,
    bare: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return the row of one object and tool."""
    checks = [c for c in check_report.checks if c.outcome == "failed"] if check_report else []
    checks = [c for c in checks if c.name not in NOT_COUNTED]
    failed = sorted({c.name for c in checks} | ({BARE} if bare else set()))
    if checks and not reason:
        reason = f"{checks[0].name}: {checks[0].message}"[:200]
    if bare and not reason:
        reason = f"{', '.join(bare)}: {BARE}"[:200]
    return {
        "id": name,
        "made": made.path is not None,
        "loads": check_report is not None and "loads" not in failed,
        "good": check_report is not None and not failed,
        "failed": failed,
        "reason": reason,
        "opened": sum((j.opened or 0.0) >= 0.9 for j in check_report.joints) if check_report else 0,
        "cavities_min": cavities_min(check_report) if check_report else None,
        "seconds": round(took_s, 2),
    }


def bare_parts(asset: Asset) -> tuple[str, ...]:
    """Return the moving links that have no collision shape, fixed parts included."""
    model = mujoco.MjModel.from_xml_path(str(asset.folder / "object.xml"))
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    solid = {int(model.body_weldid[body]) for body in model.geom_bodyid[touches]}
    links = [joint.link for joint in asset.joints]
    return tuple(n for n in links if int(model.body_weldid[model.body(n).id]) not in solid)


def check_tool(
    tool: str, name: str, source: Path, ours: Path, tools: Path, written: Path
) -> dict[str, Any]:
    """Run one tool on one object and check its output.

    The file ``written`` is created as soon as the tool has written a model.
    """
    with tempfile.TemporaryDirectory(prefix="rivals-") as temporary:
        copy = Path(temporary) / "input" / source.parent.name
        shutil.copytree(source.parent, copy)
        start = time.perf_counter()
        made = TOOLS[tool](copy / source.name, tools)
        took = time.perf_counter() - start
        if made.path is None:
            return row_of(name, made, None, made.reason, took)
        written.touch()
        config = ConvertConfig()
        frame = origin_of_reading(read_input(source, config), config).frame
        try:
            asset = wrap_model(made.path, load_asset(ours), frame, Path(temporary) / "asset")
        except AssetError as error:
            return row_of(name, made, None, str(error), took)
        check_report = run_checks(asset)
        loads = all(c.name != "loads" or c.outcome != "failed" for c in check_report.checks)
        return row_of(name, made, check_report, "", took, bare_parts(asset) if loads else ())


def ours(name: str, folder: Path) -> dict[str, Any]:
    """Return the row of this project's conversion, checked again without its input."""
    start = time.perf_counter()
    check_report = run_checks(load_asset(folder))
    return row_of(name, ToolResult(folder), check_report, "", time.perf_counter() - start)


def summarize(rows: list[dict[str, Any]], joints: int) -> dict[str, Any]:
    """Sum the counts over the objects of one tool."""
    shares = sorted(r["cavities_min"] for r in rows if r["cavities_min"] is not None)
    return {
        "objects": len(rows),
        "made": sum(r["made"] for r in rows),
        "loads": sum(r["loads"] for r in rows),
        "good": sum(r["good"] for r in rows),
        "joints": joints,
        "joints_opened": sum(r["opened"] for r in rows),
        "cavities_min_median": shares[len(shares) // 2] if shares else None,
        "failed_by": dict(Counter(c for r in rows for c in r["failed"]).most_common()),
        "seconds_median": sorted(r["seconds"] for r in rows)[len(rows) // 2] if rows else None,
    }


@dataclass(frozen=True)
class Job:
    """One tool on one object."""

    tool: str
    name: str
    source: Path
    checked: Path
    tools: Path
    row_path: Path
    """File of the row."""

    def run(self) -> None:
        """Measure and write the row, in the current process."""
        folder = self.checked / self.name
        if self.tool == "ours":
            row = ours(self.name, folder)
        else:
            row = check_tool(self.tool, self.name, self.source, folder, self.tools, self.written)
        write_json(self.row_path, row)

    @property
    def written(self) -> Path:
        """Path of the file that exists as soon as the tool has written a model."""
        return self.row_path.with_suffix(".written")

    def row(self) -> dict[str, Any]:
        """Return the row, measured in a separate process unless it exists.

        Crashes and exceeded limits are rows too.
        """
        if not self.row_path.is_file():
            process = multiprocessing.get_context("forkserver").Process(target=self.run)
            start = time.perf_counter()
            process.start()
            process.join(TOTAL_LIMIT_S)
            if process.is_alive():
                process.kill()
                process.join()
            if not self.row_path.is_file():
                took = time.perf_counter() - start
                reason = f"exit {process.exitcode} after {took:.0f} s, not checked"
                made = ToolResult(self.written if self.written.is_file() else None)
                write_json(self.row_path, row_of(self.name, made, None, reason, took))
        row: dict[str, Any] = json.loads(self.row_path.read_text(encoding="utf-8"))
        return row


def main() -> int:
    """Run the tools on a sample of the objects and print the sums."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--checked", type=Path, required=True, help="output folder of benchmarks/assets.py"
    )
    parser.add_argument("--data", type=Path, required=True, help="folder that contains assets.json")
    parser.add_argument("--tools", type=Path, required=True, help="folder of virtual environments")
    parser.add_argument("--out", type=Path, required=True, help="folder of the rows")
    parser.add_argument(
        "--only", nargs="*", default=tuple(TOOLS), choices=tuple(TOOLS), help="other tools"
    )
    parser.add_argument("--count", type=int, default=40, help="number of objects")
    parser.add_argument("--jobs", type=int, default=2, help="objects at the same time")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    flags = parser.parse_args()
    programs = [flags.tools / EXECUTABLES[tool] for tool in flags.only if tool in EXECUTABLES]
    for program in programs:
        if not program.is_file():
            parser.error(f"{program}: does not exist; install the tool there, or omit it in --only")
    sources = {
        item.name: item.file
        for item, entry in items_of(flags.data, ())
        if entry["format"] == "urdf" and (flags.checked / item.name / "asset.json").is_file()
    }
    names = sorted(sources)
    random.Random(SEED).shuffle(names)
    names = names[: flags.count]
    joints = sum(len(load_asset(flags.checked / n).joints) for n in names)
    rows: dict[str, list[dict[str, Any]]] = defaultdict(list)

    def measure(job: Job) -> None:
        row = job.row()
        rows[job.tool].append(row)
        text = f"{job.tool:18s} {job.name} {row['good']} {row['reason'][:140]}"
        print(text, file=sys.stderr, flush=True)

    jobs = [
        Job(tool, n, sources[n], flags.checked, flags.tools, flags.out / tool / f"{n}.json")
        for n in names
        for tool in ("ours", *flags.only)
    ]
    for job in jobs:
        job.row_path.parent.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(flags.jobs) as pool:
        list(pool.map(measure, jobs))
    result = {
        "ids": names,
        "tools": {tool: summarize(found, joints) for tool, found in rows.items()},
        "rows": {tool: sorted(found, key=lambda r: str(r["id"])) for tool, found in rows.items()},
    }
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
