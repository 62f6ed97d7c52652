"""Draw the diagrams of the documentation as SVG: ``python scripts/figures.py docs/images``."""

from __future__ import annotations

import sys
from html import escape
from pathlib import Path

Box = tuple[str, str]
"""Title and second line of a box."""

WIDTH, HEIGHT, GAP, MARGIN = 176, 58, 34, 16
"""Size of a box, distance between boxes and margin [px]."""

FIGURES: dict[str, list[list[Box]]] = {
    "architecture": [
        [
            ("Query", "video, image, text"),
            ("reconstruct", "actors, critics"),
            ("URDF", "or yours, MJCF, SDF"),
        ],
        [
            ("preparation", "convert, repair, check"),
            ("Asset", "MJCF and evidence"),
            ("Scene", "task, arm, physics"),
        ],
        [
            ("Engine", "randomized episodes"),
            ("Run", "imitation, PPO, seeds"),
            ("Report", "rates with intervals"),
        ],
        [
            ("Bundle", "ONNX and contract"),
            ("Robot", "simulated arm"),
            ("Recording", "one file per episode"),
        ],
    ],
    "concept_task": [
        [
            ("Start pose", "part closed"),
            ("Reach", "gripper only may touch"),
            ("Grasp", "fingers close"),
        ],
        [
            ("Open", "force, speed, torque limits"),
            ("Target", "0.8 of the range"),
            ("Rest 0.5 s", "then success"),
        ],
    ],
    "concept_control": [
        [
            ("Policy", "20 Hz, 8 actions"),
            ("Target", "damped least squares"),
            ("Force limiter", "15 N, 30 N"),
        ],
        [
            ("Safety filter", "clamps every target"),
            ("Set-point filter", "three equal poles"),
            ("Joint impedance", "torques"),
        ],
    ],
    "concept_observations": [
        [
            ("Arm", "joints, gripper, force"),
            ("Estimator", "handle pose, opening"),
            ("Control stack", "targets, pending actions"),
        ],
        [
            ("Observation", "72 numbers with units"),
            ("Policy", "normalizes inside"),
            ("Action", "8 numbers in [-1, 1]"),
        ],
    ],
    "concept_randomization": [
        [
            ("Object", "size, pose, mass, friction"),
            ("Arm", "start, gains, inertia"),
            ("Timing", "delays, latency"),
        ],
        [
            ("Estimation", "bias, noise, age"),
            ("Disturbance", "one push"),
            ("Episode parameters", "recorded with the outcome"),
        ],
    ],
    "concept_training": [
        [
            ("Imitation", "first 10 % of the steps"),
            ("PPO", "the other 90 %"),
            ("Ensemble of two", "half of the steps each"),
        ],
        [
            ("10 checkpoints", "of the second half"),
            ("Selection", "separate episodes"),
            ("Evaluation", "fresh episodes"),
        ],
    ],
    "concept_engines": [
        [
            ("Scene", "one MuJoCo model"),
            ("Engine", "single or batched"),
            ("Episodes", "observation, reward"),
        ],
        [("Gymnasium", "one or many"), ("robosuite", "ArticulatedObject"), ("train", "PPO")],
    ],
    "concept_checks": [
        [
            ("Source file", "URDF, MJCF, SDF"),
            ("Convert", "in a limited process"),
            ("Repair", "listed, measured"),
        ],
        [
            ("Checks", "read only"),
            ("Verdict", "passed, repaired, …"),
            ("Page", "3-D view, evidence"),
        ],
    ],
    "concept_reconstruction": [
        [
            ("Evidence", "video, parts, camera"),
            ("Actor", "proposes joints"),
            ("Critic", "compares the rendering"),
        ],
        [("Program", "sandboxed"), ("URDF", "compiled"), ("Checks", "as for any object")],
    ],
}
"""Rows of boxes; arrows go from left to right and from the end of a row to the next one."""
PARALLEL = {
    ("concept_observations", 0),
    ("concept_randomization", 0),
    ("concept_randomization", 1),
    ("concept_engines", 1),
}
"""Rows whose boxes have no order."""


def draw(name: str) -> str:
    """Return one diagram as SVG text."""
    rows = FIGURES[name]
    columns = max(map(len, rows))
    width = 2 * MARGIN + columns * WIDTH + (columns - 1) * GAP
    height = 2 * MARGIN + len(rows) * HEIGHT + (len(rows) - 1) * GAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" font-family="sans-serif" text-anchor="middle">',
        '<defs><marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z" fill="#456"/></marker></defs>',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
    ]
    for i, row in enumerate(rows):
        for j, (title, second) in enumerate(row):
            x, y = MARGIN + j * (WIDTH + GAP), MARGIN + i * (HEIGHT + GAP)
            middle = x + WIDTH / 2
            parts += [
                f'<rect x="{x}" y="{y}" width="{WIDTH}" height="{HEIGHT}" rx="6" '
                'fill="#eef3f8" stroke="#456"/>',
                f'<text x="{middle}" y="{y + 25}" font-size="15" font-weight="bold">'
                f"{escape(title)}</text>",
                f'<text x="{middle}" y="{y + 44}" font-size="12" fill="#345">'
                f"{escape(second)}</text>",
            ]
            if j + 1 < len(row) and (name, i) not in PARALLEL:
                parts.append(_arrow(f"M{x + WIDTH} {y + HEIGHT / 2}h{GAP - 2}"))
        if i + 1 < len(rows) and (name, i + 1) != ("concept_randomization", 1):
            end = MARGIN + (len(row) - 1) * (WIDTH + GAP) + WIDTH / 2
            y = MARGIN + i * (HEIGHT + GAP) + HEIGHT
            path = f"M{end} {y}v{GAP / 2}H{MARGIN + WIDTH / 2}v{GAP / 2 - 2}"
            parts.append(_arrow(path))
    return "\n".join([*parts, "</svg>", ""])


def _arrow(path: str) -> str:
    return f'<path d="{path}" fill="none" stroke="#456" marker-end="url(#a)"/>'


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name in FIGURES:
        (folder / f"{name}.svg").write_text(draw(name), encoding="utf-8")
