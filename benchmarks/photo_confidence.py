"""Fit the confidence of photos to scored images.

    python benchmarks/photo_confidence.py SCORES.json ...

Scores are outputs of ``benchmarks/photos.py --json`` for the development half: all photos, 84
``procedural`` and 80 ``rendered``. Prints the constants
of ``articulate.reconstruct.fitting.confidence`` and the precision at several limits in cross
validation.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import cross_val_predict

from articulate.reconstruct.fitting.confidence import logit
from articulate.transforms import Array

FOLDS = 10


def fitted(scores: list[float], right: NDArray[np.bool_]) -> tuple[Array, tuple[float, float]]:
    """Return probabilities (N,) of right answers in cross validation, and bias and weight."""
    x = np.array([[logit(score)] for score in scores])
    model = LogisticRegression()
    found = cross_val_predict(model, x, right, cv=FOLDS, method="predict_proba")[:, 1]
    model.fit(x, right)
    return found, (round(float(model.intercept_[0]), 3), round(float(model.coef_[0, 0]), 3))


def main() -> None:
    """Fit and print the regressions."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("scores", type=Path, nargs="+")
    flags = parser.parse_args()
    rows = [row for path in flags.scores for row in json.loads(path.read_text())["rows"]]
    rows = [row for row in rows if "evidence" in row]
    named = np.array([row["top1"] for row in rows])
    kinds = np.array([row["kinds"] for row in rows])
    free = np.array([row["evidence"]["parts"] is not None for row in rows])
    p, category = fitted([row["evidence"]["category"] for row in rows], named)
    fronts = [row["evidence"]["parts"] for row in rows if row["evidence"]["parts"] is not None]
    known = named[free]
    p_parts, parts = fitted(
        [s for s, k in zip(fronts, known, strict=True) if k], kinds[free & named]
    )
    p[free & named] *= p_parts
    others = np.array([logit(s) for s, k in zip(fronts, known, strict=True) if not k])
    p[free & ~named] *= 1.0 / (1.0 + np.exp(-parts[0] - parts[1] * others))
    fixed = float(kinds[~free & named].mean())
    p[~free] *= fixed
    for limit in np.arange(0.5, 0.91, 0.05):
        kept = p >= limit
        share = float((named & kinds)[kept].mean()) if kept.any() else float("nan")
        print(f"limit {limit:.2f}: {kept.sum()} of {len(rows)} kept, {share:.3f} right")
    print(f"CATEGORY {category}\nPARTS {parts}\nFIXED_PARTS {fixed:.3f}")


if __name__ == "__main__":
    main()
