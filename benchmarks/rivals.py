"""What other converters make of the same objects, judged by the same proof.

python benchmarks/rivals.py --checked /tmp/checked --data ../shared/data --tools /tmp/tools \
    --out /tmp/rivals --count 40 --json

``--tools`` holds an environment for each tool (``python3.11 -m venv /tmp/tools/simcheck`` and
``pip install`` in it: urdf2mjcf 0.2.39, urdf-to-mjcf 0.1.1, simcheck 0.2.0). Each tool gets a copy
of the object's folder. What it makes is scaled to metres, put where our asset stands and proven
with our asset's joints and handles, without comparing it with the input; free joints at the root
and floors are taken away, and neither what is seen nor limits and inertia in our own files count.
All but this is left as the tool wrote it. Each tool and object runs in a process of its own; its
row is noted in ``--out``, and a second run goes on from there.
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
PROOF_LIMIT_S = 600.0
"""Time for the tool and the proof of one object together [s]; what takes longer is not good."""
SEED = 1
"""Of the order in which objects are taken."""
NOT_COUNTED = frozenset({"joint_limits", "collision_coverage", "inertia"})
"""Clauses that compare with our own files or with what is seen do not count for anyone here."""
TOOL_FILES = "tool_files"
"""Folder of the meshes and textures of a tool, below the asset folder."""
BARE = "no collision shapes"
"""Stands for a part that nothing can touch: nothing would be in its way, and no hand could pull."""
FLAGS = (
    '<mujoco><compiler discardvisual="false" fusestatic="false" strippath="false" '
    'balanceinertia="true" boundmass="0.001" boundinertia="1e-6" inertiafromgeom="auto"/></mujoco>'
)
"""Compiler settings that help most URDFs into MuJoCo."""


@dataclass(frozen=True)
class ToolResult:
    """What a tool made of an object, as a file that MuJoCo reads, or why there is none."""

    path: Path | None
    reason: str = ""


Tool = Callable[[Path, Path], ToolResult]
"""From the URDF in a folder that may be written to, and the folder of environments."""


def unmodified(urdf: Path, _: Path) -> ToolResult:
    """MuJoCo's own reader."""
    return ToolResult(urdf)


def with_flags(urdf: Path, _: Path) -> ToolResult:
    """MuJoCo's own reader with compiler settings."""
    text = urdf.read_text(encoding="utf-8", errors="replace")
    at = text.find(">", text.find("<robot")) + 1
    out = urdf.with_name("with_flags.urdf")
    out.write_text(text[:at] + FLAGS + text[at:], encoding="utf-8")
    return ToolResult(out)


def urdf2mjcf(urdf: Path, tools: Path) -> ToolResult:
    """Run the converter of kscale."""
    out = urdf.with_name("urdf2mjcf.xml")
    return _run([tools / "urdf2mjcf/bin/urdf2mjcf", urdf, "--output", out], out)


def urdf_to_mjcf(urdf: Path, tools: Path) -> ToolResult:
    """Run the converter of discoverse with convex decomposition, in a separate folder."""
    out = urdf.parent / "urdf_to_mjcf" / "robot.xml"
    out.parent.mkdir(exist_ok=True)
    tool = tools / "urdf-to-mjcf/bin/urdf-to-mjcf"
    return _run([tool, "-ct", "decomposition", "-o", out, urdf], out)


def simcheck_fix(urdf: Path, tools: Path) -> ToolResult:
    """Run simcheck's repair of the URDF, then MuJoCo with compiler settings."""
    out = urdf.with_name("simcheck.urdf")
    done = _run([tools / "simcheck/bin/simcheck", "fix", "--no-verify", "-o", out, urdf], out)
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
    return ToolResult(
        None, f"exit {done.returncode}: {lines[-1] if lines else 'it said nothing'}"[:300]
    )


def adopted(path: Path, asset: Asset, frame: InputFrame, out: Path) -> Asset:
    """Write an asset folder around the model at ``path``, with the joints and handles of ``asset``.

    Args:
        path: MJCF or URDF in units of the input.
        asset: Our asset of the same object.
        frame: How units of the input become the frame of ``asset``.
        out: Folder to write.

    Raises:
        AssetError: MuJoCo refuses it.
    """
    try:
        saved = path.with_name(f"{path.stem}_saved.xml")
        mujoco.mj_saveLastXML(str(saved), mujoco.MjModel.from_xml_path(str(path)))
        spec = mujoco.MjSpec.from_file(str(saved))
        meshes = (path.parent / spec.meshdir).resolve()
        for geom in [g for g in spec.worldbody.geoms if g.type == mujoco.mjtGeom.mjGEOM_PLANE]:
            spec.delete(geom)  # a floor, which is no part of the object
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
    """Make every length ``s`` times as long; densities stay."""
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
    """Write ``text`` with everything in one body called ``root``; names of its bodies."""
    tree = etree.fromstring(text.encode())
    _cleared(tree)
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
    stand = etree.SubElement(top, "body", name=f"{root}__stand", pos=pos, quat=quat)
    for child in list(world):
        stand.append(child)
    world.append(top)
    path.write_bytes(etree.tostring(tree))
    return {str(b.get("name")) for b in tree.iter("body")}


def _cleared(tree: Any) -> None:
    """Take away what is no part of the object: free joints, and what drives or measures.

    Where a body that was free begins says nothing of the object: it is put back to the origin.
    """
    away = [
        *tree.iter("freejoint", "keyframe", "actuator", "sensor"),
        *(joint for joint in tree.iter("joint") if joint.get("type") == "free"),
    ]
    for element in away:
        body = element.getparent()
        body.remove(element)
        if element.tag in ("freejoint", "joint"):
            for key in ("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"):
                body.attrib.pop(key, None)


def cavities_min(check_report: CheckReport) -> float | None:
    """Least share of a cavity that is open, over the links that have one."""
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
    """Return the record of one object and tool."""
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
    """Links that move and have nothing that collides, with all that is fixed to them."""
    model = mujoco.MjModel.from_xml_path(str(asset.folder / "object.xml"))
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    solid = {int(model.body_weldid[body]) for body in model.geom_bodyid[touches]}
    links = [joint.link for joint in asset.joints]
    return tuple(n for n in links if int(model.body_weldid[model.body(n).id]) not in solid)


def judged(
    tool: str, name: str, source: Path, ours: Path, tools: Path, wrote: Path
) -> dict[str, Any]:
    """Run one tool on one object and prove what it made; ``wrote`` is there once it made a file."""
    with tempfile.TemporaryDirectory(prefix="rivals-") as temporary:
        copy = Path(temporary) / "input" / source.parent.name
        shutil.copytree(source.parent, copy)
        start = time.perf_counter()
        made = TOOLS[tool](copy / source.name, tools)
        took = time.perf_counter() - start
        if made.path is None:
            return row_of(name, made, None, made.reason, took)
        wrote.touch()
        config = ConvertConfig()
        frame = origin_of_reading(read_input(source, config), config).frame
        try:
            asset = adopted(made.path, load_asset(ours), frame, Path(temporary) / "asset")
        except AssetError as error:
            return row_of(name, made, None, str(error), took)
        check_report = run_checks(asset)
        loads = all(c.name != "loads" or c.outcome != "failed" for c in check_report.checks)
        return row_of(name, made, check_report, "", took, bare_parts(asset) if loads else ())


def ours(name: str, folder: Path) -> dict[str, Any]:
    """Return the record of this project's conversion, checked again without its input."""
    start = time.perf_counter()
    check_report = run_checks(load_asset(folder))
    return row_of(name, ToolResult(folder), check_report, "", time.perf_counter() - start)


def summed(rows: list[dict[str, Any]], joints: int) -> dict[str, Any]:
    """Sum the counts over the objects of one tool."""
    opennesses = sorted(r["cavities_min"] for r in rows if r["cavities_min"] is not None)
    return {
        "objects": len(rows),
        "made": sum(r["made"] for r in rows),
        "loads": sum(r["loads"] for r in rows),
        "good": sum(r["good"] for r in rows),
        "joints": joints,
        "joints_opened": sum(r["opened"] for r in rows),
        "cavities_min_median": opennesses[len(opennesses) // 2] if opennesses else None,
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
    note: Path
    """Where its row goes."""

    def run(self) -> None:
        """Make, prove and note the row; in a process of its own."""
        folder = self.checked / self.name
        if self.tool == "ours":
            row = ours(self.name, folder)
        else:
            row = judged(self.tool, self.name, self.source, folder, self.tools, self.wrote)
        write_json(self.note, row)

    @property
    def wrote(self) -> Path:
        """Stands beside the row as soon as the tool has made a file, proven or not."""
        return self.note.with_suffix(".wrote")

    def row(self) -> dict[str, Any]:
        """Return the earlier run's row, or make it; crashes and exceeded limits are rows too."""
        if not self.note.is_file():
            process = multiprocessing.get_context("forkserver").Process(target=self.run)
            start = time.perf_counter()
            process.start()
            process.join(PROOF_LIMIT_S)
            if process.is_alive():
                process.kill()
                process.join()
            if not self.note.is_file():
                took = time.perf_counter() - start
                reason = f"exit {process.exitcode} after {took:.0f} s, no proof"
                made = ToolResult(self.wrote if self.wrote.is_file() else None)
                write_json(self.note, row_of(self.name, made, None, reason, took))
        row: dict[str, Any] = json.loads(self.note.read_text(encoding="utf-8"))
        return row


def main() -> int:
    """Run the tools on a sample of the objects and print the sums."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--checked", type=Path, required=True, help="folder of benchmarks/assets.py"
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--tools", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True, help="folder of the rows")
    parser.add_argument("--only", nargs="*", default=tuple(TOOLS), choices=tuple(TOOLS))
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
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

    def one(job: Job) -> None:
        row = job.row()
        rows[job.tool].append(row)
        text = f"{job.tool:18s} {job.name} {row['good']} {row['reason'][:140]}"
        print(text, file=sys.stderr, flush=True)

    todo = [
        Job(tool, n, sources[n], flags.checked, flags.tools, flags.out / tool / f"{n}.json")
        for n in names
        for tool in ("ours", *flags.only)
    ]
    for job in todo:
        job.note.parent.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(flags.jobs) as pool:
        list(pool.map(one, todo))
    result = {
        "ids": names,
        "tools": {tool: summed(found, joints) for tool, found in rows.items()},
        "rows": {tool: sorted(found, key=lambda r: str(r["id"])) for tool, found in rows.items()},
    }
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
