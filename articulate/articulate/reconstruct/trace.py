"""``trace.html``: how an object was made, stage by stage, in one page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from articulate.page import Page, Tile
from articulate.reconstruct.actors.protocol import ActorAttempt, PredictedJoint, Verdict
from articulate.reconstruct.images import frames_row, only, opening, view_of
from articulate.reconstruct.result import PROGRAM_FOLDER, MakeRecord, MakeResult
from articulate.render.image import as_png, png

MOST_JOINTS = 12
"""Joints that are drawn one by one."""
LEAD = {
    "passed": "The object is proven: the URDF beside this page moves as it says.",
    "doubtful": "The URDF beside this page is proven, but it may not be the object that was meant.",
    "unproven": "The object is not proven: there is no URDF to rely on.",
}


def write_trace(made: MakeResult, story: MakeRecord, path: Path) -> Path:
    """Write the page and return its path."""
    given = story.given
    page = Page(f"Making {given.name}", LEAD[made.verdict])
    page.tiles(
        Tile(
            value=made.verdict,
            label="verdict",
            tone="good" if made.verdict == "passed" else "bad",
        ),
        Tile(value=len(made.joints), label="joints that move"),
        Tile(value="none" if made.rating is None else made.rating, label="critic's rating, 0-10"),
        Tile(value=made.check_report.verdict, label="check-asset says"),
        Tile(value=round(made.seconds, 1), label="seconds"),
    )
    for reason in made.reasons:
        page.text(f"Because {reason}.")
    _asked(page, story)
    _said(page, story)
    _turns(page, story)
    _program(page, story)
    _proof(page, made, story)
    page.footer("articulate make", {})
    return page.save(path)


def _asked(page: Page, story: MakeRecord) -> None:
    question, given = story.question, story.given
    page.section("What was given", f"An object of {len(given.meshes)} parts, and {question.told}.")
    if question.video is not None:
        page.png(frames_row(question.video), f"The clip, {len(question.video)} frames of it read")
    if question.image is not None:
        page.png(png(question.image), "The picture")
    if question.text and question.modality != "text":
        page.text(f"Said beside it: {question.text}")
    rows = []
    for mesh in given.meshes:
        low, high = mesh.bounds
        size = " x ".join(f"{side:.3g}" for side in high - low)
        rows.append((mesh.name, given.labels.get(mesh.name, ""), size, len(mesh.faces)))
    page.table(["part", "what it is", "size [m]", "triangles"], rows, "The parts")
    origin = f"Source: {given.source}; category: {given.category}; licence: {given.licence}."
    page.text(origin)


def _said(page: Page, story: MakeRecord) -> None:
    actor = f"{story.actor}, {story.seconds['joints']:.1f} s, {story.prediction.calls} calls."
    page.section("What the actor says", f"By {actor}")
    rows = [_row(joint) for joint in story.moving]
    page.table(
        ["part", "against", "type", "axis", "through", "lower", "upper", "sure"],
        rows,
        "Joints; metres and radians, 0 is the pose in which the parts were given",
    )
    camera = view_of(story.given.meshes, story.held)
    order = "the parts in colours of their own; closed; half open; open"
    if len(story.moving) > 1:
        page.png(opening(story.given.meshes, story.held, camera), f"All joints: {order}")
    for joint in story.moving[:MOST_JOINTS]:
        alone = only(story.held, joint.part)
        caption = f"{joint.part} ({joint.kind}): {order}"
        page.png(opening(story.given.meshes, alone, camera), caption)
    for step in story.prediction.trace:
        if "\n" in step.text:
            page.text(f"{step.title}.").code(step.text)
        else:
            page.text(f"{step.title}. {step.text}")
        if step.figures:
            page.pairs(dict(step.figures))
        for title, picture in step.images.items():
            page.png(as_png(picture), title)


def _turns(page: Page, story: MakeRecord) -> None:
    attempts = story.prediction.attempts
    if not attempts:
        page.section("What the critic says", "No critic looked at it.")
        return
    page.section("Every turn", "The one that the critic rated best is kept, of equals the earlier.")
    rows = [
        (k + 1, _joints(attempt.joints), *_verdict(attempt.verdict), round(attempt.seconds, 1))
        for k, attempt in enumerate(attempts)
    ]
    page.table(["turn", "proposal", "verdict", "rating", "why", "seconds"], rows)
    _better(page, attempts)


def _better(page: Page, attempts: Sequence[ActorAttempt]) -> None:
    for k, attempt in enumerate(attempts):
        verdict = attempt.verdict
        if verdict is not None and verdict.figures:
            page.pairs(dict(verdict.figures), f"What was measured in turn {k + 1}")


def _verdict(verdict: Verdict | None) -> tuple[str, float | None, str]:
    if verdict is None:
        return "not judged", None, ""
    return verdict.failure.replace("_", " "), round(verdict.rating, 2), verdict.reason


def _program(page: Page, story: MakeRecord) -> None:
    layers = ", ".join(story.layers) or "none"
    page.section("The program", f"It ran in a sandbox; layers that were active: {layers}.")
    page.code(story.program)
    page.links({"program.py": f"{PROGRAM_FOLDER}/program.py"})


def _proof(page: Page, made: MakeResult, story: MakeRecord) -> None:
    check_report = made.check_report
    held = sum(check.outcome == "passed" for check in check_report.checks)
    tried = sum(check.outcome != "not_applicable" for check in check_report.checks)
    told = f"check-asset: {check_report.verdict}, {held} of {tried} measurements hold."
    page.section("The proof", told)
    for text in (*check_report.reasons, *check_report.repairs):
        page.text(text)
    rows = [(j.name, j.kind, j.span, j.swept, j.opened) for j in check_report.joints]
    if rows:
        header = ["joint", "type", "range [m or rad]", "free share", "opened by 30 N"]
        page.table(header, rows)
    page.links({"the whole proof": "check_report.html"})
    page.pairs(
        {f"{name} [s]": round(value, 2) for name, value in story.seconds.items()}, "Time by stage"
    )


def _joints(joints: Sequence[PredictedJoint]) -> str:
    moving = [j for j in joints if j.kind != "fixed"]
    return "; ".join(f"{j.part}: {j.kind}, axis {_three(j.axis_o)}" for j in moving)


def _row(joint: PredictedJoint) -> tuple[str | float | None, ...]:
    return (
        joint.part,
        joint.parent,
        joint.kind,
        _three(joint.axis_o),
        "" if joint.kind == "prismatic" else _three(joint.pivot_o),
        joint.lower,
        joint.upper,
        round(joint.confidence, 2),
    )


def _three(values: Sequence[float]) -> str:
    return ", ".join(f"{value + 0.0:.3f}" for value in values)
