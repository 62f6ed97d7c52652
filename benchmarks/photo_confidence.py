"""Fit the confidence of photos to scored images.

    python benchmarks/photo_confidence.py SCORES.json ...

Scores are outputs of ``benchmarks/photos.py --json`` for the development half. Prints the constants
of ``articulate.reconstruct.fitting.confidence`` and the precision at several limits in cross
validation.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import cross_val_predict

from articulate.reconstruct.fitting.confidence import Evidence

FOLDS = 10
STRENGTH = 1.0
"""Inverse strength of the regularization."""


def main() -> None:
    """Fit and print the regression."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("scores", type=Path, nargs="+")
    flags = parser.parse_args()
    rows = [row for path in flags.scores for row in json.loads(path.read_text())["rows"]]
    rows = [row for row in rows if "evidence" in row]
    x = np.array([Evidence(**row["evidence"]).features() for row in rows])
    right = np.array([row["top1"] and row["kinds"] for row in rows])
    model = LogisticRegression(C=STRENGTH)
    found = cross_val_predict(model, x, right, cv=FOLDS, method="predict_proba")[:, 1]
    for limit in np.arange(0.5, 0.96, 0.05):
        kept = found >= limit
        share = float(right[kept].mean()) if kept.any() else float("nan")
        print(f"limit {limit:.2f}: {kept.sum()} of {len(rows)} kept, {share:.3f} right")
    model.fit(x, right)
    print("BIAS", round(float(model.intercept_[0]), 3))
    print("WEIGHTS", tuple(round(float(w), 3) for w in model.coef_[0]))


if __name__ == "__main__":
    main()
