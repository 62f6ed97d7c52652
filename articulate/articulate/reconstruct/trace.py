"""Trace page ``trace.html``: the stages of a reconstruction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from articulate.page import Page, Tile
from articulate.preparation.check_report_file import PAGE_FILE
from articulate.reconstruct.actors.protocol import ActorAttempt, PredictedJoint, TraceStep, Verdict
from articulate.reconstruct.images import frames_row, only_joint, opening_row, view_camera
from articulate.reconstruct.result import PROGRAM_FOLDER, MakeRecord, MakeResult
from articulate.render.image import as_png, png

MAX_JOINTS = 12
"""Most joints with an image each."""
SUMMARY = {
    "passed": "The object passed its checks: the URDF beside this page moves as described below.",
    "doubtful": "The object passed its checks, but it may not be the intended one.",
    "rejected": "The object failed its checks: there is no reliable URDF.",
    "undecided": "The checks did not finish: there is no reliable URDF.",
}


def write_trace(result: MakeResult, record: MakeRecord, path: Path) -> Path:
    """Write the page and return its path."""
    page = Page(f"Reconstruction of {record.part_set.name}", SUMMARY[result.verdict])
    page.tiles(
        Tile(
            value=result.verdict,
            label="verdict",
            tone="good" if result.verdict == "passed" else "bad",
        ),
        Tile(value=len(result.joints), label="moving joints"),
        Tile(
            value="none" if result.rating is None else result.rating, label="critic's rating, 0-10"
        ),
        Tile(value=result.check_report.verdict, label="verdict of check-asset"),
        Tile(value=round(result.seconds, 1), label="seconds"),
    )
    for reason in result.reasons:
        page.text(f"Reason: {reason}.")
    for text in result.assumptions:
        page.text(f"Assumed: {text}.")
    _add_input(page, record)
    _add_joints(page, record)
    _add_attempts(page, record)
    _add_program(page, record)
    add_checks(page, result, record.seconds)
    page.footer("articulate make", {})
    return page.save(path)


def _add_input(page: Page, record: MakeRecord) -> None:
    query, part_set = record.query, record.part_set
    page.section("Input", f"An object of {len(part_set.meshes)} parts, and {query.description}.")
    if query.video is not None:
        page.png(frames_row(query.video), f"The video, {len(query.video)} frames")
    if query.image is not None:
        page.png(png(query.image), "The image")
    if query.text and query.modality != "text":
        page.text(f"Text: {query.text}")
    rows = []
    for mesh in part_set.meshes:
        low, high = mesh.bounds
        size = " x ".join(f"{side:.3g}" for side in high - low)
        rows.append((mesh.name, part_set.labels.get(mesh.name, ""), size, len(mesh.faces)))
    page.table(["part", "label", "size [m]", "triangles"], rows, "The parts")
    page.text(
        f"Source: {part_set.source}; category: {part_set.category}; licence: {part_set.licence}."
    )


def _add_joints(page: Page, record: MakeRecord) -> None:
    actor = f"{record.actor}, {record.seconds['joints']:.1f} s, {record.prediction.calls} calls."
    page.section("Predicted joints", f"Actor: {actor}")
    page.table(
        ["part", "parent", "type", "axis", "pivot", "lower", "upper", "confidence"],
        [_row(joint) for joint in record.moving],
        "Joints in metres and radians; at 0 the parts are where they were given",
    )
    camera = view_camera(record.part_set.meshes, record.part_joints)
    order = "parts in distinct colours; closed; half open; open"
    if len(record.moving) > 1:
        image = opening_row(record.part_set.meshes, record.part_joints, camera)
        page.png(image, f"All joints: {order}")
    for joint in record.moving[:MAX_JOINTS]:
        single = only_joint(record.part_joints, joint.part)
        image = opening_row(record.part_set.meshes, single, camera)
        page.png(image, f"{joint.part} ({joint.kind}): {order}")
    add_steps(page, record.prediction.trace)


def add_steps(page: Page, steps: Sequence[TraceStep]) -> None:
    """Add the stages of an actor or of a reconstruction."""
    for step in steps:
        if "\n" in step.text:
            page.text(f"{step.title}.").code(step.text)
        else:
            page.text(f"{step.title}. {step.text}")
        if step.figures:
            page.pairs(dict(step.figures))
        for title, content in step.images.items():
            page.png(as_png(content), title)


def _add_attempts(page: Page, record: MakeRecord) -> None:
    attempts = record.prediction.attempts
    if not attempts:
        page.section("Critic", "No critic was used.")
        return
    page.section("Proposals", "The result is the first proposal with the highest rating.")
    rows = [
        (k + 1, _joints(attempt.joints), *_verdict(attempt.verdict), round(attempt.seconds, 1))
        for k, attempt in enumerate(attempts)
    ]
    page.table(["iteration", "proposal", "verdict", "rating", "reason", "seconds"], rows)
    _add_measurements(page, attempts)


def _add_measurements(page: Page, attempts: Sequence[ActorAttempt]) -> None:
    for k, attempt in enumerate(attempts):
        verdict = attempt.verdict
        if verdict is not None and verdict.figures:
            page.pairs(dict(verdict.figures), f"Measurements of iteration {k + 1}")


def _verdict(verdict: Verdict | None) -> tuple[str, float | None, str]:
    if verdict is None:
        return "none", None, ""
    return verdict.failure.replace("_", " "), round(verdict.rating, 2), verdict.reason


def _add_program(page: Page, record: MakeRecord) -> None:
    layers = ", ".join(record.layers) or "none"
    page.section("The program", f"It ran in a sandbox with these active layers: {layers}.")
    page.code(record.program)
    page.links({"program.py": f"{PROGRAM_FOLDER}/program.py"})


def add_checks(page: Page, result: MakeResult, seconds: Mapping[str, float]) -> None:
    """Add the check report and the time [s] of each stage."""
    report = result.check_report
    passed = sum(check.outcome == "passed" for check in report.checks)
    applied = sum(check.outcome != "not_applicable" for check in report.checks)
    summary = f"check-asset: {report.verdict}; {passed} of {applied} checks passed."
    page.section("Checks of the asset", summary)
    for text in (*report.reasons, *report.repairs):
        page.text(text)
    rows = [(j.name, j.kind, j.span, j.swept, j.opened) for j in report.joints]
    if rows:
        header = ["joint", "type", "range [m or rad]", "free share", "opened by 30 N"]
        page.table(header, rows)
    page.links({"full check report": PAGE_FILE})
    page.pairs({f"{name} [s]": round(value, 2) for name, value in seconds.items()}, "Time by stage")


def _joints(joints: Sequence[PredictedJoint]) -> str:
    moving = [j for j in joints if j.kind != "fixed"]
    return "; ".join(f"{j.part}: {j.kind}, axis {_vector(j.axis_o)}" for j in moving)


def _row(joint: PredictedJoint) -> tuple[str | float | None, ...]:
    return (
        joint.part,
        joint.parent,
        joint.kind,
        _vector(joint.axis_o),
        "" if joint.kind == "prismatic" else _vector(joint.pivot_o),
        joint.lower,
        joint.upper,
        round(joint.confidence, 2),
    )


def _vector(values: Sequence[float]) -> str:
    return ", ".join(f"{value + 0.0:.3f}" for value in values)
