"""Plant defects in proven assets and see whether the proof finds and names them.

python benchmarks/defects.py --checked /tmp/checked --data ../shared/data --out /tmp/defects --json

Each defect changes ``object.xml`` or a mesh of a copy of the asset's folder, which is then
proven against the original input as ``check-asset DAMAGED --against INPUT`` does: no earlier
proof, hash or fresh conversion is looked at.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from lxml import etree

from articulate.asset import Asset, load_asset
from articulate.convert.config import ConvertConfig
from articulate.convert.convert import read_input
from articulate.proof import Proof
from articulate.prove.model import load_model
from articulate.prove.origin import Origin, origin_of_reading
from articulate.prove.prove import prove
from articulate.transforms import inverse
from assets import items_of

TURN_RAD = np.radians(5.0)
"""Least angle of a defect [rad]."""
SHARE = 0.02
"""Least length of a defect, as a share of the object's diagonal."""


@dataclass(frozen=True)
class Damaged:
    """A copy of an asset that is being damaged."""

    folder: Path
    asset: Asset
    tree: Any

    @property
    def diagonal(self) -> float:
        """Of the closed object [m]."""
        return float(np.linalg.norm(np.subtract(*self.asset.bounds_o)))

    def bodies(self) -> dict[str, Any]:
        """Body elements by name."""
        return {str(b.get("name")): b for b in self.tree.iter("body")}

    def joints(self, kind: str | None = None) -> Iterator[Any]:
        """Joint elements of bodies."""
        for body in self.tree.iter("body"):
            for joint in body.findall("joint"):
                if kind is None or joint.get("type") == kind:
                    yield joint

    def moving(self) -> Iterator[Any]:
        """Bodies that a joint moves and that can touch something."""
        for body in self.tree.iter("body"):
            if body.find("joint") is not None and list(colliders(body)):
                yield body

    def shown(self) -> Iterator[tuple[Any, Path]]:
        """Visual geoms and their mesh files."""
        for geom in self.tree.iter("geom"):
            if geom.get("class") == "visual":
                yield geom, self.folder / "meshes" / f"{geom.get('mesh')}.obj"


def colliders(body: Any) -> Iterator[Any]:
    """Collision geoms of a body."""
    return (g for g in body.findall("geom") if g.get("class") == "collision")


def numbers(element: Any, name: str, default: str) -> np.ndarray:
    """An attribute as numbers."""
    return np.array([float(v) for v in element.get(name, default).split()])


def write(element: Any, name: str, values: Any) -> None:
    """Numbers as an attribute."""
    element.set(name, " ".join(f"{v:.9g}" for v in np.atleast_1d(values)))


def across(axis: np.ndarray) -> np.ndarray:
    """A unit vector at right angles to ``axis``."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    out = np.cross(axis, other)
    return np.asarray(out / np.linalg.norm(out))


def axis_tilted(d: Damaged) -> bool:
    joint = next(d.joints(), None)
    if joint is None:
        return False
    axis = numbers(joint, "axis", "0 0 1")
    write(joint, "axis", np.cos(TURN_RAD) * axis + np.sin(TURN_RAD) * across(axis))
    return True


def pivot_moved(d: Damaged) -> bool:
    joint = next(d.joints("hinge"), None)
    if joint is None:
        return False
    way = SHARE * d.diagonal * across(numbers(joint, "axis", "0 0 1"))
    write(joint, "pos", numbers(joint, "pos", "0 0 0") + way)
    return True


def limited(d: Damaged) -> Any | None:
    return next((j for j in d.joints() if j.get("range")), None)


def limits_swapped(d: Damaged) -> bool:
    joint = limited(d)
    if joint is None:
        return False
    low, high = numbers(joint, "range", "0 0")
    write(joint, "range", (high, low))
    joint.set("limited", "false")  # what MuJoCo makes of it in a URDF
    return True


def limits_absent(d: Damaged) -> bool:
    joint = limited(d)
    if joint is None:
        return False
    del joint.attrib["range"]
    return True


def range_wider(d: Damaged) -> bool:
    joint = limited(d)
    if joint is None:
        return False
    low, high = numbers(joint, "range", "0 0")
    write(joint, "range", (low, high + 0.1 * (high - low)))
    return True


def range_in_degrees(d: Damaged) -> bool:
    joint = next((j for j in d.joints("hinge") if j.get("range")), None)
    if joint is None:
        return False
    write(joint, "range", np.degrees(numbers(joint, "range", "0 0")))
    return True


def type_changed(d: Damaged) -> bool:
    joint = limited(d)
    if joint is None:
        return False
    joint.set("type", "hinge" if joint.get("type") == "slide" else "slide")
    return True


def axis_reversed(d: Damaged) -> bool:
    joint = next(d.joints(), None)
    if joint is None:
        return False
    write(joint, "axis", -numbers(joint, "axis", "0 0 1"))
    return True


def sealed(d: Damaged) -> bool:
    """The link with most shapes collides as one box round all that it shows."""
    body = max(d.tree.iter("body"), key=lambda b: len(list(colliders(b))))
    own = list(colliders(body))
    if len(own) < 4:
        return False
    link = d.asset.link(str(body.get("name")))
    low, high = np.array(link.bounds_l)
    for geom in own[1:]:
        body.remove(geom)
    own[0].attrib.pop("mesh", None)
    own[0].attrib.pop("quat", None)
    own[0].set("type", "box")
    write(own[0], "pos", (low + high) / 2.0)
    write(own[0], "size", np.maximum((high - low) / 2.0, 0.001))
    return True


def blocked(d: Damaged) -> bool:
    """A box of the fixed body stands where a part's largest shape is in the middle of its way."""
    joint = next((j for j in d.asset.joints if j.lower is not None), None)
    if joint is None:
        return False
    low, high = np.array(d.asset.link(joint.link).bounds_l)
    half = max(SHARE * d.diagonal, 0.25 * float((high - low).min()))
    model = load_model(d.asset)
    data = model.data()
    model.set_joints(data, {joint.name: joint.closed + 0.5 * joint.span})
    geoms = model.collision_geoms(joint.link)
    largest = geoms[np.argmax(model.model.geom_rbound[geoms])]
    T_ow = inverse(model.T_ol(data, d.asset.links[0].name))
    centre = T_ow[:3, :3] @ data.geom_xpos[largest] + T_ow[:3, 3]
    root = d.tree.getroot().find("worldbody/body")
    geom = etree.SubElement(root, "geom", {"class": "collision", "type": "box", "name": "plug"})
    write(geom, "pos", centre)
    write(geom, "size", np.full(3, half))
    return True


def stray_collider(d: Damaged) -> bool:
    """A shape stands where nothing is seen, as large as a quarter of its link."""
    body = max(d.tree.iter("body"), key=lambda b: len(list(colliders(b))))
    low, high = np.array(d.asset.link(str(body.get("name"))).bounds_l)
    geom = etree.SubElement(body, "geom", {"class": "collision", "type": "box", "name": "stray"})
    write(geom, "size", np.maximum((high - low) / 4.0, 0.01))
    write(geom, "pos", high + 0.5 * (high - low))
    return True


def colliders_lost(d: Damaged) -> bool:
    body = next(d.moving(), None)
    if body is None:
        return False
    for geom in list(colliders(body)):
        body.remove(geom)
    return True


def mass_doubled(d: Damaged) -> bool:
    inertial = next(d.tree.iter("inertial"))
    write(inertial, "mass", 2.0 * numbers(inertial, "mass", "1"))
    return True


def inertia_wrong(d: Damaged) -> bool:
    inertial = next(d.tree.iter("inertial"))
    write(inertial, "fullinertia", 2.0 * numbers(inertial, "fullinertia", "1 1 1 0 0 0"))
    return True


def centre_moved(d: Damaged) -> bool:
    inertial = next(d.tree.iter("inertial"))
    moved = numbers(inertial, "pos", "0 0 0") + np.array([SHARE * d.diagonal, 0.0, 0.0])
    write(inertial, "pos", moved)
    return True


def _vertices(path: Path, change: Callable[[np.ndarray], np.ndarray], *, flip: bool) -> bool:
    lines = path.read_text().splitlines()
    at = [i for i, line in enumerate(lines) if line.startswith("v ")]
    points = np.array([[float(v) for v in lines[i].split()[1:4]] for i in at])
    changed = change(points)
    if float(np.abs(np.sort(changed, axis=0) - np.sort(points, axis=0)).max()) < 1e-3:
        return False  # it looks the same as before
    for i, point in zip(at, changed, strict=True):
        lines[i] = "v " + " ".join(f"{v:.9g}" for v in point)
    if flip:
        for i, line in enumerate(lines):
            if line.startswith("f "):
                lines[i] = "f " + " ".join(reversed(line.split()[1:]))
    path.write_text("\n".join(lines) + "\n")
    return True


def _largest(d: Damaged) -> Path | None:
    """The mesh file of largest area that is shown."""
    files = [path for _, path in d.shown() if path.is_file()]
    return max(files, key=lambda p: float(trimesh.load_mesh(p).area)) if files else None


def mesh_mirrored(d: Damaged) -> bool:
    path = _largest(d)
    return path is not None and any(
        _vertices(path, lambda p, k=k: p * (1.0 - 2.0 * np.eye(3)[k]), flip=True) for k in range(3)
    )


def mesh_scaled(d: Damaged) -> bool:
    path = _largest(d)
    return path is not None and _vertices(path, lambda p: 1.05 * p, flip=False)


def visual_lost(d: Damaged) -> bool:
    path = _largest(d)
    for body in d.tree.iter("body"):
        for geom in body.findall("geom"):
            if path is not None and geom.get("mesh") == path.stem:
                body.remove(geom)
                return True
    return False


def link_lost(d: Damaged) -> bool:
    for parent in d.tree.iter("body"):
        for body in parent.findall("body"):
            if not body.findall("body"):
                parent.remove(body)
                lost = str(body.get("name"))
                for group in d.tree.iter("contact"):
                    for pair in list(group):
                        if lost in (pair.get("body1"), pair.get("body2")):
                            group.remove(pair)
                names = {j.get("name") for j in body.findall("joint")}
                for group in d.tree.iter("equality"):
                    for pair in list(group):
                        if names & {pair.get("joint1"), pair.get("joint2")}:
                            group.remove(pair)
                return True
    return False


def link_moved(d: Damaged) -> bool:
    for parent in d.tree.iter("body"):
        for body in parent.findall("body"):
            way = np.array([SHARE * d.diagonal, 0.0, 0.0])
            write(body, "pos", numbers(body, "pos", "0 0 0") + way)
            return True
    return False


def stuck(d: Damaged) -> bool:
    joint = next(d.joints(), None)
    if joint is None:
        return False
    write(joint, "frictionloss", 200.0)
    return True


def sluggish(d: Damaged) -> bool:
    joint = next(d.joints(), None)
    if joint is None:
        return False
    write(joint, "damping", 1000.0)
    return True


def sprung(d: Damaged) -> bool:
    """A spring pulls the part open by itself."""
    joint = next((j for j in d.joints() if j.get("range")), None)
    if joint is None:
        return False
    known = d.asset.joint(str(joint.get("name")))
    write(joint, "springref", known.open)
    write(joint, "stiffness", 60.0 / max(abs(known.span), 1e-3))
    return True


KINDS: dict[str, Callable[[Damaged], bool]] = {
    "axis tilted by 5 degrees": axis_tilted,
    "axis reversed": axis_reversed,
    "pivot moved by 2 % of the diagonal": pivot_moved,
    "limits swapped, read as none": limits_swapped,
    "limits absent": limits_absent,
    "range 10 % wider": range_wider,
    "range in degrees": range_in_degrees,
    "slide for hinge or hinge for slide": type_changed,
    "sealed by a box": sealed,
    "way blocked by a box": blocked,
    "stray collision shape": stray_collider,
    "collision shapes of a part lost": colliders_lost,
    "mass doubled": mass_doubled,
    "inertia doubled": inertia_wrong,
    "centre of mass moved by 2 % of the diagonal": centre_moved,
    "mesh mirrored": mesh_mirrored,
    "mesh 5 % larger": mesh_scaled,
    "visual lost": visual_lost,
    "link lost": link_lost,
    "link moved by 2 % of the diagonal": link_moved,
    "dry friction of 200 N or Nm": stuck,
    "damping of 1000 N s/m or Nm s/rad": sluggish,
    "spring of 60 N or Nm that opens": sprung,
}
"""What is planted, with its size."""


def judged(folder: Path, kind: str | None, out: Path, origin: Origin) -> Proof | None:
    """The proof of a copy with one defect; None where the kind does not apply."""
    name = f"{folder.name}-{kind}".replace(" ", "_").replace("%", "pc")[:120]
    copy = out / name
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("proof.*"))
    asset = load_asset(copy)
    if kind is not None:
        tree = etree.parse(str(copy / "object.xml"), etree.XMLParser(resolve_entities=False))
        if not KINDS[kind](Damaged(copy, asset, tree)):
            shutil.rmtree(copy)
            return None
        tree.write(str(copy / "object.xml"))
    proof = prove(asset, origin)
    shutil.rmtree(copy)
    return proof


def of_one(job: tuple[str, str, str]) -> dict[str, Any]:
    """All kinds on one asset."""
    folder, source, out = (Path(p) for p in job)
    config = ConvertConfig()
    origin = origin_of_reading(read_input(source, config), config)
    row: dict[str, Any] = {"id": folder.name, "kinds": {}}
    clean = judged(folder, None, out, origin)
    row["false_alarm"] = list(clean.reasons) if clean else ["not proven"]
    for kind in KINDS:
        proof = judged(folder, kind, out, origin)
        if proof is not None:
            row["kinds"][kind] = [r.split(":")[0] for r in proof.reasons]
    print(f"{folder.name}: {row['false_alarm'] or 'clean'}", file=sys.stderr, flush=True)
    return row


def main() -> int:
    """Print how many of each kind were found, and by which clauses."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--checked", type=Path, required=True, help="folders of benchmarks/assets.py"
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    flags.out.mkdir(parents=True, exist_ok=True)
    good = []
    for item, _ in items_of(flags.data, ()):
        path = flags.checked / item.name / "proof.json"
        if path.is_file():
            proof = json.loads(path.read_text(encoding="utf-8"))
            if proof["verdict"] != "refused" and proof["joints"]:
                good.append(item)
    chosen = [
        good[i] for i in np.linspace(0, len(good) - 1, min(flags.count, len(good))).astype(int)
    ]
    work = [(str(flags.checked / i.name), str(i.file), str(flags.out)) for i in chosen]
    with ProcessPoolExecutor(flags.jobs) as pool:
        rows = list(pool.map(of_one, work))
    found = {
        kind: {
            "planted": sum(kind in r["kinds"] for r in rows),
            "found": sum(bool(r["kinds"].get(kind)) for r in rows),
            "missed": [r["id"] for r in rows if kind in r["kinds"] and not r["kinds"][kind]],
        }
        for kind in KINDS
    }
    planted = sum(f["planted"] for f in found.values())
    hits = sum(f["found"] for f in found.values())
    result = {
        "assets": [r["id"] for r in rows],
        "planted": planted,
        "found": hits,
        "share": round(hits / max(planted, 1), 4),
        "false_alarms": {r["id"]: r["false_alarm"] for r in rows if r["false_alarm"]},
        "kinds": found,
    }
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
