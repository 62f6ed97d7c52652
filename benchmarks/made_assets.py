"""Objects whose joints were all found: does ``check-asset`` prove what is made of them?

python benchmarks/made_assets.py runs/video --data data --out made --json

Takes the records of runs of ``articulate benchmark`` on ``assets.json``, or what is kept of them
(``joints_said.py``); of an object in several, the last. Where every joint of an object came out
right, its parts are joined by a program from the predicted joints, as ``articulate make`` does, and
the URDF is proven; so is the object's own. Only those count whose own is proven. With ``--own``,
the summary of ``assets.py``, its verdict on the object's own is taken, which saves half of the
time; where what was made is refused the own is proven here all the same. Files of the data set
freeze joints that it states: where what was made is refused and the own is not, it is also made of
all stated joints, and where that is refused, too, the object is told apart. A proof that lies below
``--out`` is not made again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from articulate.assets.check_report import CheckReport
from articulate.benchmark.dataset import open_dataset
from articulate.cache import cache_folder
from articulate.errors import UsageError
from articulate.library.partnet import URDF_NAME
from articulate.preparation.batch import Batch, Item
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.hinge_adjustment import Held, diagonal_of, relieved
from articulate.reconstruct.part_set import library_parts
from articulate.reconstruct.program.result import ProgramError
from articulate.reconstruct.program.run import compile_program
from articulate.reconstruct.program_writer import program_of, tree_of
from joints_said import SAID, records_of

LIMIT_S = 600.0
REFUSED = "refused"
PASSED = "not refused"
"""Verdict on an object that a summary of ``assets.py`` does not list among the refused."""


@dataclass(frozen=True)
class Pair:
    """One object, and what was made of it."""

    id: str
    own: str
    """Verdict on the object's own URDF."""
    made: str
    """Verdict on what was made."""
    reasons: tuple[str, ...]
    """Why what was made is refused."""
    stated: str = ""
    """Verdict on what is made of the joints as the data set states them; empty if not asked."""


def found_joints(record: Mapping[str, Any], protocol: str) -> list[PredictedJoint]:
    """Predicted joints of an object of which all are right under ``protocol``; else none.

    With them goes what was said to go along with a part that moves.
    """
    joints = [joint for case in record["cases"] for joint in case["joints"]]
    right = all(joint["failures"][protocol] == "success" for joint in joints)
    if record["error"] or not joints or not right or any(c["spurious"] for c in record["cases"]):
        return []
    told = [{name: joint["predicted"][name] for name in SAID} for joint in joints]
    moved = [
        PredictedJoint(**t | {"axis_o": tuple(t["axis_o"]), "pivot_o": tuple(t["pivot_o"])})
        for t in told
    ]
    fixed = [pair for case in record["cases"] for pair in case.get("fixed", ())]
    return moved + [PredictedJoint(part=a, parent=b, kind="fixed") for a, b in fixed]


def proof_of(urdf: Path, out: Path) -> CheckReport:
    """The proof of ``urdf``, in a process of its own."""
    batch = Batch(out=out, cache=cache_folder(), options={}, limit_s=LIMIT_S, single=True)
    return batch.one(Item(name=urdf.stem, file=urdf)).proof


@dataclass(frozen=True)
class ObjectPlacement:
    """Where an object lies, and where what is made of it."""

    id: str
    data: Path
    """Folder with ``assets.json``."""
    folder: Path
    """The object's own."""
    out: Path


def made_of(
    place: ObjectPlacement, joints: Sequence[PredictedJoint], name: str = "made"
) -> tuple[str, tuple[str, ...]]:
    """Make an object of the parts of one and of ``joints``: verdict and reasons."""
    given = library_parts(str(place.folder))
    root, held = tree_of(list(joints), given.meshes)

    def prove(others: Held, where: str) -> CheckReport:
        source = program_of(root, others, actor="the benchmark", question=place.id)
        with tempfile.TemporaryDirectory() as work:
            built = compile_program(source, given.parts, Path(work) / "program")
            if isinstance(built, ProgramError):
                raise UsageError(str(built))
            given.write_origin(Path(work) / "program")
            return proof_of(built, place.out / place.id / where)

    made = prove(held, name)
    if made.verdict == REFUSED:
        trial = partial(prove, where="trial")
        other = relieved(held, made, trial, diagonal_of(given.meshes))
        made = made if other is None else prove(other, f"{name}_eased")
    return made.verdict, tuple(made.reasons)


def stated_of(place: ObjectPlacement) -> str:
    """Verdict on the object made of all joints that the data set states."""
    true = open_dataset(str(place.data / "assets.json"), place.data).load(place.id)
    return made_of(place, [joint.joint for joint in true.joints], "stated")[0]


def pair(place: ObjectPlacement, joints: Sequence[PredictedJoint], told: str = "") -> Pair:
    """Prove what is made of ``joints``, and the object's own where ``told`` does not settle it."""
    try:
        made, reasons = made_of(place, joints)
    except UsageError as error:
        made, reasons = REFUSED, (str(error),)
    settled = told == REFUSED or (told and made != REFUSED)
    own = (
        told
        if settled
        else proof_of(place.folder / URDF_NAME, place.out / place.id / "own").verdict
    )
    asked = made == REFUSED and own != REFUSED
    return Pair(place.id, own, made, reasons, stated_of(place) if asked else "")


def own_verdicts(file: Path | None, ids: Sequence[str]) -> dict[str, str]:
    """What a summary of ``assets.py`` says of the objects' own; empty without one."""
    if file is None:
        return {}
    summary = json.loads(file.read_text(encoding="utf-8"))
    if summary["objects"] != summary["asked"]:
        raise UsageError(f"{file}: not all objects that were asked for have a verdict")
    refused = {one["id"] for one in summary["refused"]}
    return {name: REFUSED if name in refused else PASSED for name in ids}


def summary(pairs: Sequence[Pair], protocol: str) -> dict[str, Any]:
    """Counts, and the objects that are not proven though their own are."""
    counted = [p for p in pairs if p.own != REFUSED]
    lost = [p for p in counted if p.made == REFUSED]
    return {
        "protocol": protocol,
        "objects_right": len(pairs),
        "own_proven": len(counted),
        "made_proven": len(counted) - len(lost),
        "share": (len(counted) - len(lost)) / len(counted) if counted else None,
        "refused_as_stated": sum(p.stated == REFUSED for p in lost),
        "not_proven": [asdict(p) for p in lost],
    }


def main() -> int:
    """Print what was made and proven."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "runs", type=Path, nargs="+", help="folders of articulate benchmark, or joints_said.py's"
    )
    parser.add_argument("--data", type=Path, required=True, help="folder with assets.json")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--protocol", default="paper", choices=("paper", "released_code", "strict"))
    parser.add_argument("--own", type=Path, help="summary of assets.py over all of the index")
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    index = json.loads((flags.data / "assets.json").read_text(encoding="utf-8"))["assets"]
    folders = {str(e["id"]): (flags.data / e["path"]).parent for e in index}
    own = own_verdicts(flags.own, list(folders))
    records = {name: one for run in flags.runs for name, one in records_of(run)}
    pairs = []
    for name, record in records.items():
        joints = found_joints(record, flags.protocol)
        if not joints:
            continue
        place = ObjectPlacement(name, flags.data, folders[name], flags.out)
        pairs.append(pair(place, joints, own.get(name, "")))
        if not flags.json:
            p = pairs[-1]
            print(f"{p.id}: its own {p.own}, made {p.made} {' '.join(p.reasons)}", flush=True)
    result = summary(pairs, flags.protocol)
    if flags.json:
        print(json.dumps(result, indent=1))
    else:
        print(f"{result['made_proven']} of {result['own_proven']} proven whose own is")
    return 0


if __name__ == "__main__":
    sys.exit(main())
