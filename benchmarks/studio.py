"""Measure the human time of corrections: a script operates the page in a headless Chromium.

Run as ``python -m benchmarks.studio --out FILE``. Twenty procedural objects (seeds >= 1000) get one
error of the kinds that a reconstruction makes. The script corrects each one with mouse and
buttons, as a person would who knows the object. Times per action: click 2 s, drag 4 s, decision
5 s; typing a number counts as a click. Waiting for checks is machine time, reported apart.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from tests.articulate.asset_page.browser import Browser

from articulate.benchmark.metrics import joint_errors, line_distance
from articulate.benchmark.protocols import strict_failure
from articulate.cache import cache_folder
from articulate.files import write_json
from articulate.library.procedural.categories import write_object
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.studio.candidates import candidates, front_direction, snap
from articulate.studio.checker import Checker
from articulate.studio.edits import MergeParts, SetJoint, SetSize, SplitPart, apply_edit
from articulate.studio.model import StudioModel, read_model
from articulate.studio.server import StudioServer
from articulate.studio.session import Session
from articulate.studio.source import read_studio_source
from articulate.studio.write import write_model

SECONDS = {"click": 2.0, "drag": 4.0, "decision": 5.0}
NEAR_M = 0.025
"""A candidate hinge this near to the true one is used; otherwise the edge is clicked [m]."""
NEAR_RAD = 0.05
LIMIT_SHARE = 0.03
"""Limits are corrected if they differ by more than this fraction of the range."""
CHECK_S = 400.0
GOOD = {"passed", "repaired"}
PRINTED = ("category", "seed", "error", "human_s", "check", "check_wall_s", "problems")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One object with one error."""

    category: str
    seed: int
    part: str
    error: str


CASES = tuple(
    Case(category=category, seed=seed, part=part, error=error)
    for category, seed, part, error in (
        ("cabinet", 1000, "door_0", "type"),
        ("fridge", 1000, "fridge_door", "type"),
        ("chest_of_drawers", 1000, "drawer_0", "type"),
        ("dishwasher", 1000, "door", "type"),
        ("cabinet", 1000, "door_0", "side"),
        ("fridge", 1001, "fridge_door", "side"),
        ("safe", 1000, "door", "side"),
        ("oven", 1000, "door", "side"),
        ("microwave", 1000, "door", "direction"),
        ("box_with_lid", 1000, "lid", "direction"),
        ("table_with_drawers", 1000, "drawer_0", "direction"),
        ("laptop", 1000, "lid", "direction"),
        ("washing_machine", 1000, "door", "limits"),
        ("suitcase", 1000, "front", "limits"),
        ("trash_can", 1000, "lid", "limits"),
        ("chest_of_drawers", 1001, "drawer_0", "scale"),
        ("microwave", 1001, "door", "scale"),
        ("dishwasher", 1001, "door", "merged"),
        ("box_with_lid", 1001, "lid", "merged"),
        ("fridge", 1002, "fridge_door", "split"),
    )
)


def perturb(model: StudioModel, case: Case) -> StudioModel:
    """Return the model with the error of the case."""
    joint = model.joint(case.part)
    front = front_direction(model)
    options = {c.label: c.edit for c in candidates(model, case.part)}
    if case.error == "type":
        wrong = "hinge left" if joint.kind == "prismatic" else "slide out"
        return apply_edit(model, options[wrong])
    if case.error == "side":
        axis, up = np.asarray(joint.axis_o), np.array([0.0, 0.0, 1.0])
        side = "hinge top" if abs(axis @ up) < 0.5 else "hinge right"
        if abs(axis @ up) >= 0.5 and axis @ up > 0.0:
            side = "hinge left"
        return apply_edit(model, options[side])
    if case.error == "direction":
        if joint.kind == "prismatic":
            return apply_edit(model, options["slide right"])
        x, y, z = joint.axis_o
        return apply_edit(model, SetJoint(part=case.part, axis_o=(-x, -y, -z)))
    if case.error == "limits":
        assert joint.upper is not None
        return apply_edit(model, SetJoint(part=case.part, upper=0.4 * joint.upper))
    if case.error == "scale":
        height = float(np.ptp(model.bounds_o, axis=0)[2])
        return apply_edit(model, SetSize(axis=2, size_m=1.4 * height))
    if case.error == "merged":
        return apply_edit(model, MergeParts(part=case.part, into=joint.parent))
    return _split_handle(model, case.part, front)


def _split_handle(model: StudioModel, part: str, front: np.ndarray) -> StudioModel:
    """Return the model with the outermost piece of a part attached to the part's parent."""
    link = model.link(part)
    ahead = [float((p.mesh.bounds @ front).max()) for p in link.visible]
    outermost = int(np.argmax(ahead))
    faces = tuple(
        tuple(range(len(p.mesh.faces))) if k == outermost else ()
        for k, p in enumerate(link.visible)
    )
    split = apply_edit(model, SplitPart(part=part, name="piece", faces=faces))
    return apply_edit(split, SetJoint(part="piece", parent=model.joint(part).parent))


class HeldChecker(Checker):
    """Checks only the last revision, to save processor time."""

    _held: tuple[StudioModel, int] | None = None

    def start(self, model: StudioModel, revision: int) -> None:
        """Remember the revision."""
        self._held = (model, revision)

    def release(self) -> None:
        """Check the last revision."""
        assert self._held is not None
        super().start(*self._held)


@dataclass(kw_only=True)
class Person:
    """Operates the page and records the actions."""

    browser: Browser
    session: Session
    actions: list[tuple[str, str]] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Human time of the recorded actions [s]."""
        return sum(SECONDS[kind] for kind, _ in self.actions)

    def decide(self, text: str) -> None:
        """Record a decision."""
        self.actions.append(("decision", text))

    def press(self, selector: str) -> None:
        """Click an element of the page and wait for the server."""
        self.actions.append(("click", selector))
        before = len(self.session.edits)
        self.browser.run(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            "e.scrollIntoView({block: 'nearest'}); e.click(); })()"
        )
        self._settle(before)

    def type(self, selector: str, value: str) -> None:
        """Type into an input."""
        self.actions.append(("click", f"{selector} = {value}"))
        before = len(self.session.edits)
        self.browser.run(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            f"e.value = {json.dumps(value)}; e.dispatchEvent(new Event('change')); }})()"
        )
        self._settle(before)

    def click_at(self, at: list[float]) -> None:
        """Click a point of the window [px]."""
        self.actions.append(("click", f"{at[0]:.0f}, {at[1]:.0f}"))
        before = len(self.session.edits)
        self.browser.drag((at[0], at[1]), (at[0], at[1]), steps=1)
        self._settle(before)

    def drag(self, start: list[float], end: list[float]) -> None:
        """Drag between two points of the window [px]."""
        self.actions.append(("drag", f"{start[0]:.0f}, {start[1]:.0f}"))
        before = len(self.session.edits)
        self.browser.drag((start[0], start[1]), (end[0], end[1]), steps=16)
        self._settle(before)

    def _settle(self, before: int) -> None:
        """Wait until the page has the edits that the server has."""
        time.sleep(0.5)
        self.browser.wait(
            f"studio.state().history.length >= {max(before, len(self.session.edits))}", 60.0
        )

    def select(self, part: str) -> None:
        """Select a part by its card unless it is selected."""
        chosen = self.browser.run("document.querySelector('.card.chosen')?.dataset.part")
        if chosen != part:
            self.press(f'.card[data-part="{part}"] .head')

    def correct_joint(self, part: str, truth: PredictedJoint) -> None:
        """Correct type, axis and limits of a part."""
        self.select(part)
        now = predicted(self.session.model, part)
        if not same_axis(now, truth):
            self.decide("type and axis")
            reverse = same_axis(now, truth, signed=False)
            found = [
                c.label
                for c in candidates(self.session.model, part)
                if same_axis(_of(part, c.edit), truth)
            ]
            if reverse:
                self.press("#reverse")
            elif found:
                self.press(f'[data-candidate="{found[0]}"]')
            else:
                self.click_edge(part, truth)
        now = predicted(self.session.model, part)
        if truth.upper is None or now.upper is None:
            return
        if abs(now.upper - truth.upper) > LIMIT_SHARE * abs(truth.upper):
            self.decide("limit")
            handle = self.browser.run("studio.view.handle('upper')")
            target = self.browser.run(f"studio.view.handle('upper', {truth.upper})")
            self.drag(handle, target)

    def click_edge(self, part: str, truth: PredictedJoint) -> None:
        """Set the hinge by clicking geometry near the true axis; turn the view if needed."""
        self.press('[data-mode="edge"]')
        axis, pivot = np.asarray(truth.axis_o), np.asarray(truth.pivot_o)
        home = self.session.state()["azimuth_deg"]
        for azimuth, elevation in ((0, -22), (-64, -22), (0, -60), (0, 25), (150, -30), (210, -30)):
            self.browser.run(f"studio.view.setEye({home + azimuth}, {elevation})")
            if azimuth or elevation != -22:
                self.actions.append(("drag", "turn the view"))
            for point in near_axis(self.session.model, part, axis, pivot):
                if not self._is_hinge(part, point, truth):
                    continue
                at = self.browser.run(f"studio.view.screen({json.dumps(part)}, {point})")
                hit = self.browser.run(f"studio.view.pick({at[0]}, {at[1]})")
                near = hit and hit["part"] == part
                if near and self._is_hinge(part, hit["point"], truth):
                    self.click_at(at)
                    now = predicted(self.session.model, part)
                    if float(np.asarray(now.axis_o) @ axis) < 0.0:
                        self.press("#reverse")
                    return

    def _is_hinge(self, part: str, point: list[float], truth: PredictedJoint) -> bool:
        """Return whether a click at a point selects the true hinge line."""
        found = snap(self.session.model.link(part), (point[0], point[1], point[2]), "edge")
        edit = SetJoint(part=part, kind=truth.kind, axis_o=found.axis_o, pivot_o=found.pivot_o)
        return same_axis(_of(part, edit), truth, signed=False)

    def split(self, root: str, name: str, wanted: list[str]) -> None:
        """Split meshes of a merged part off by clicking them."""
        self.select(root)
        self.decide("the part is merged")
        self.press('[data-mode="paint"]')
        for key in wanted:
            at = self._visible_point(root, key)
            if at is not None:
                self.click_at(at)
        self.type("#split-name", name)
        self.press("#make-part")

    def _visible_point(self, part: str, key: str) -> list[float] | None:
        """Return a point of the window at which a mesh is visible [px]."""
        model = self.session.model
        pieces = {self.session._key(p): p for p in model.link(part).visible}
        mesh = pieces[key].mesh
        centres = np.asarray(mesh.triangles_center)
        for point in centres[:: max(1, len(centres) // 40)].tolist():
            at: list[float] = self.browser.run(f"studio.view.screen({json.dumps(part)}, {point})")
            hit = self.browser.run(f"studio.view.pick({at[0]}, {at[1]})")
            if hit and hit["key"] == key:
                return at
        return None


def _of(part: str, edit: SetJoint) -> PredictedJoint:
    assert edit.kind is not None
    assert edit.axis_o is not None
    return PredictedJoint(
        part=part,
        parent=None,
        kind=edit.kind,
        axis_o=edit.axis_o,
        pivot_o=edit.pivot_o or (0.0, 0.0, 0.0),
        lower=edit.lower,
        upper=edit.upper,
    )


def predicted(model: StudioModel, part: str) -> PredictedJoint:
    """Return the joint of a part."""
    joint = model.joint(part)
    return PredictedJoint(
        part=part,
        parent=joint.parent,
        kind=joint.kind,
        axis_o=joint.axis_o,
        pivot_o=joint.pivot_o,
        lower=joint.lower,
        upper=joint.upper,
    )


def same_axis(joint: PredictedJoint, truth: PredictedJoint, *, signed: bool = True) -> bool:
    """Return whether two joints have the same type and axis, and the same direction."""
    cosine = float(np.asarray(joint.axis_o) @ np.asarray(truth.axis_o))
    cosine = cosine if signed else abs(cosine)
    if joint.kind != truth.kind or cosine < np.cos(NEAR_RAD):
        return False
    return truth.kind == "prismatic" or line_distance(truth, joint) <= NEAR_M


def near_axis(
    model: StudioModel, part: str, axis: np.ndarray, pivot: np.ndarray
) -> list[list[float]]:
    """Return points on a part that are nearest to an axis, at most 60 [m]."""
    vertices = np.concatenate([p.mesh.triangles_center for p in model.link(part).visible])
    corners = np.concatenate([np.asarray(p.mesh.vertices) for p in model.link(part).visible])
    edges = 0.9 * corners + 0.1 * vertices.mean(axis=0)
    points = np.concatenate([vertices, edges])
    away = np.linalg.norm(np.cross(points - pivot, axis), axis=1)
    found: list[list[float]] = points[np.argsort(away, kind="stable")[:60]].tolist()
    return found


def is_true(model: StudioModel, truth: StudioModel) -> list[str]:
    """Return the differences of a corrected object from the true one; empty if it is true."""
    problems = []
    extent, true_extent = np.ptp(model.bounds_o, axis=0), np.ptp(truth.bounds_o, axis=0)
    if float(np.abs(extent / true_extent - 1.0).max()) > 0.01:
        problems.append("size")
    for link in truth.links:
        if link.joint is None or link.joint.kind == "fixed":
            continue
        if link.name not in {own.name for own in model.links}:
            problems.append(f"{link.name}: missing")
            continue
        true, now = predicted(truth, link.name), predicted(model, link.name)
        failure = strict_failure(joint_errors(true, now, link.bounds_o))
        cosine = float(np.asarray(true.axis_o) @ np.asarray(now.axis_o))
        if failure != "success" or (true.kind != "continuous" and cosine < 0.9):
            problems.append(f"{link.name}: {failure}")
        if float(np.abs(model.link(link.name).bounds_o - link.bounds_o).max()) > 0.01:
            problems.append(f"{link.name}: geometry")
    if {link.name for link in model.links} != {link.name for link in truth.links}:
        problems.append("parts")
    return problems


def correct(person: Person, case: Case, truth: StudioModel) -> None:
    """Correct the error of a case, and accept and export the object."""
    joint = predicted(truth, case.part)
    browser = person.browser
    start = f'[data-slider="{case.part}"]'
    if browser.run(f"!!document.querySelector({json.dumps(start)})"):
        person.actions.append(("drag", "move the part"))
        value = browser.run(f"Number(document.querySelector({json.dumps(start)}).max)")
        browser.run(f"studio.view.setPosition({json.dumps(case.part)}, {value})")
        browser.run(f"studio.view.setPosition({json.dumps(case.part)}, 0)")
    person.decide("is it right?")
    if case.error == "scale":
        height = 1000.0 * float(np.ptp(truth.bounds_o, axis=0)[2])
        person.decide("the real height")
        person.type("#size", f"{height:.1f}")
        person.press("#set-size")
    elif case.error == "merged":
        keys = {person.session._key(p): p for p in person.session.model.links[0].visible}
        own = [p.mesh.bounds for p in truth.link(case.part).visible]
        wanted = [
            k for k, p in keys.items() if any(np.abs(p.mesh.bounds - b).max() < 1e-4 for b in own)
        ]
        person.split(joint.parent or "", case.part, wanted)
        person.correct_joint(case.part, joint)
    elif case.error == "split":
        person.select("piece")
        person.decide("the piece belongs to the door")
        person.press('[data-mode="merge"]')
        centre = truth.link(case.part).bounds_o.mean(axis=0).tolist()
        at = browser.run(f"studio.view.screen({json.dumps(case.part)}, {centre})")
        person.click_at(at)
    else:
        person.correct_joint(case.part, joint)
    person.select(case.part)
    person.press("#accept")


def correct_case(case: Case, browser: Browser, folder: Path) -> Callable[[], dict[str, object]]:
    """Perturb and correct one object; return the function that checks it and gives its record."""
    truth = read_model(write_object(case.category, case.seed, folder / "true"))
    wrong = write_model(perturb(truth, case), folder / "wrong")
    source = read_studio_source(wrong)
    checker = HeldChecker(cache_folder(), 300.0, dict(source.licence))
    session = Session(source=source, out=folder / "out", checker=checker)
    person = Person(browser=browser, session=session)
    before = is_true(session.model, truth)
    with StudioServer(session) as server:
        server.start()
        browser.send("Page.navigate", url=server.url)
        browser.wait("!!window.studio && studio.view.triangles() > 0", 120.0)
        correct(person, case, truth)
        person.actions.append(("click", "#export"))
        server.shutdown()
    page_errors = list(browser.problems)

    def finish() -> dict[str, object]:
        start = time.monotonic()
        checker.release()
        check = checker.wait(session.state()["revision"], CHECK_S)
        if check is not None and check.folder is not None:
            session.export()
        problems = is_true(session.model, truth)
        session.close()
        return {
            "category": case.category,
            "seed": case.seed,
            "error": case.error,
            "was_wrong": bool(before),
            "human_s": person.seconds,
            "actions": [list(action) for action in person.actions],
            "check_wall_s": round(time.monotonic() - start, 1),
            "check_cpu_s": None if check is None else round(check.seconds, 1),
            "check": None if check is None else check.verdict,
            "reasons": [] if check is None else list(check.reasons),
            "problems": problems,
            "exported": (folder / "out" / "edits.json").is_file(),
            "page_errors": page_errors,
        }

    print(case.category, case.seed, case.error, f"{person.seconds:.0f} s",
          is_true(session.model, truth), flush=True)  # fmt: skip
    return finish


def main(argv: list[str] | None = None) -> None:
    """Correct all objects, check them, write the records, and print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="JSON file with the records")
    parser.add_argument("--first", type=int, default=0, help="index of the first case")
    parser.add_argument("--count", type=int, default=len(CASES), help="number of cases")
    parser.add_argument("--jobs", type=int, default=1, help="checks at the same time")
    flags = parser.parse_args(argv)
    records: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(flags.jobs) as pool:
        running = []
        with Browser(width=1280, height=800) as browser:
            for k, case in enumerate(CASES[flags.first : flags.first + flags.count]):
                try:
                    finish = correct_case(case, browser, Path(folder, str(k)))
                except AssertionError as error:  # the script could not go on: a failure
                    records.append({**asdict(case), "problems": [f"script: {error}"]})
                    print(case.category, case.error, error, flush=True)
                else:
                    running.append(pool.submit(finish))
                browser.problems.clear()
        for future in running:
            records.append(record := future.result())
            print(*(record[key] for key in PRINTED), flush=True)
            write_json(flags.out, records)
    times = [float(str(r["human_s"])) for r in records if "human_s" in r]
    right = sum(
        r.get("problems") == [] and r.get("check") in GOOD and bool(r.get("exported"))
        for r in records
    )
    if times:
        print(f"median {statistics.median(times):.0f} s, largest {max(times):.0f} s")
    print(f"{right} of {len(records)} end true and pass the checks")


if __name__ == "__main__":
    main()
