"""Fit, calibrate and export the classifiers of `articulate.video.joint_classifier`.

The probability of the joint type is calibrated on predictions of cross-validation, in which no
category is in two folds. Needs scikit-learn.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from articulate.video.joint_classifier import LIMIT, USUAL

Floats = NDArray[np.float64]

PART_SHARE = 0.5
"""Share of a candidate's points on the moving part above which it is the part."""
FOLDS = 6
LEAST_WEIGHT, PART_WEIGHT = 0.05, 0.6
"""Least weight of a candidate and of the part when the type is learned; else its probability."""
PRECISION = 0.92
"""Precision, by cross-validation, of results that are not doubtful."""
POWERS = (0.5, 1.0, 2.0, 4.0)
TOLERANCE = 0.01
"""Log loss above the least one at which a smaller power is preferred."""


def train_classifiers(videos: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the content of ``joint_classifier.json``.

    Args:
        videos: One entry for each video: ``truth`` and ``rows``, the candidates with ``features``,
            ``opening`` and ``share``, the share of points on the moving part.
    """
    names = sorted(videos[0]["rows"][0]["features"])
    X = np.array([[r["features"][n] for n in names] for v in videos for r in v["rows"]])
    video = np.array([i for i, v in enumerate(videos) for _ in v["rows"]])
    part = np.array([r["share"] > PART_SHARE for v in videos for r in v["rows"]])
    turns = np.array([v["truth"]["kind"] == "revolute" for v in videos])
    category = np.array([v["truth"]["category"] for v in videos])
    role = _probability(_cross_validated(X, part, category[video]))
    weight = np.where(part, np.maximum(role, PART_WEIGHT), np.maximum(role, LEAST_WEIGHT))
    odds = _cross_validated(X, turns[video], category[video], weight)
    power, slope, offset = _calibrated(odds, role, video, turns)
    p = _probability(slope * _averaged(odds, role, video, power) + offset)
    below = _doubtful_below(p, turns)
    _report(p, turns, below)
    full_role, full_type = _fitted(X, part), _fitted(X, turns[video], weight)
    return {
        "note": "Learned from rendered videos of the procedural library (observe_training.py).",
        "features": names,
        "role": _exported(full_role),
        "rotates": _exported(full_type),
        "power": power,
        "slope": round(slope, 5),
        "offset": round(offset, 5),
        "doubtful_below": below,
        "opening": _opening(videos, video, role, turns),
    }


def _models() -> tuple[Any, Any]:
    from sklearn.ensemble import GradientBoostingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer, StandardScaler

    trees = GradientBoostingClassifier(
        n_estimators=int(os.environ.get("TREES", "160")),
        max_depth=2,
        learning_rate=0.06,
        subsample=0.5,
        max_features=0.3,
        min_samples_leaf=6,
        random_state=0,
    )
    clip = FunctionTransformer(_clipped)
    linear = LogisticRegression(C=0.03, max_iter=3000)
    return trees, make_pipeline(StandardScaler(), clip, linear)


def _clipped(X: Floats) -> Floats:
    return np.clip(X, -USUAL, USUAL)


def _fitted(X: Floats, y: NDArray[np.bool_], weight: Floats | None = None) -> tuple[Any, Any]:
    trees, linear = _models()
    trees.fit(X, y, sample_weight=weight)
    linear.fit(X, y, logisticregression__sample_weight=weight)
    return trees, linear


def _log_odds(models: tuple[Any, Any], X: Floats) -> Floats:
    both = [np.clip(m.decision_function(X), -LIMIT, LIMIT) for m in models]
    return np.asarray(0.5 * (both[0] + both[1]))


def _cross_validated(
    X: Floats, y: NDArray[np.bool_], group: NDArray[np.str_], weight: Floats | None = None
) -> Floats:
    from sklearn.model_selection import GroupKFold

    out = np.zeros(len(X))
    for train, test in GroupKFold(FOLDS).split(X, y, group):
        models = _fitted(X[train], y[train], None if weight is None else weight[train])
        out[test] = _log_odds(models, X[test])
    return out


def _probability(log_odds: Floats) -> Floats:
    return np.asarray(1.0 / (1.0 + np.exp(-log_odds)))


def _averaged(odds: Floats, role: Floats, video: NDArray[np.int64], power: float) -> Floats:
    w = role**power
    n = int(video.max()) + 1
    return np.asarray(np.bincount(video, w * odds, n) / np.bincount(video, w, n))


def _calibrated(
    odds: Floats, role: Floats, video: NDArray[np.int64], turns: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """Return power, slope and offset: the least power with about the least log loss."""
    from sklearn.linear_model import LogisticRegression

    found = []
    for power in POWERS:
        z = _averaged(odds, role, video, power)
        model = LogisticRegression(C=10.0).fit(z[:, None], turns)
        p = model.predict_proba(z[:, None])[:, 1]
        loss = -float(np.mean(np.log(np.where(turns, p, 1.0 - p))))
        print(f"power {power}: log loss {loss:.4f}, right {np.mean((p > 0.5) == turns):.3f}")
        found.append((loss, power, float(model.coef_[0, 0]), float(model.intercept_[0])))
    least = min(found)[0]
    return next(one for one in found if one[0] <= least + TOLERANCE)[1:]


def _doubtful_below(p: Floats, turns: NDArray[np.bool_]) -> float:
    """Return the least probability above which at least ``PRECISION`` are right."""
    confidence, ok = np.maximum(p, 1.0 - p), (p > 0.5) == turns
    for limit in np.arange(0.5, 0.96, 0.01):
        kept = confidence >= limit
        if kept.any() and ok[kept].mean() >= PRECISION:
            return round(float(limit), 3)
    return 0.95


def _report(p: Floats, turns: NDArray[np.bool_], below: float) -> None:
    confidence, ok = np.maximum(p, 1.0 - p), (p > 0.5) == turns
    for low in np.arange(0.5, 1.0, 0.1):
        now = (confidence >= low) & (confidence < low + 0.1 + 1e-9)
        right = ok[now].mean() if now.any() else float("nan")
        print(f"confidence {low:.1f} to {low + 0.1:.1f}: {now.sum()} videos, {right:.3f} right")
    kept = confidence >= below
    print(
        f"{len(ok)} videos: right {ok.mean():.3f}, slides {ok[~turns].mean():.3f}, hinges "
        f"{ok[turns].mean():.3f}; not doubtful from {below:.2f}: {kept.mean():.3f} of all, "
        f"{ok[kept].mean():.3f} right; wrong ones marked "
        f"{1.0 - (kept & ~ok).sum() / max((~ok).sum(), 1):.3f}"
    )


def _opening(
    videos: list[dict[str, Any]], video: NDArray[np.int64], role: Floats, turns: NDArray[np.bool_]
) -> dict[str, Any]:
    """Return logistic regressions of the sense of the motion, one for each joint type."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import cross_val_predict

    rows = [r for v in videos for r in v["rows"]]
    names = list(rows[0]["opening"])
    picks = [
        int(np.nonzero(video == i)[0][np.argmax(role[video == i])]) for i in range(len(videos))
    ]
    X = np.array([[rows[k]["opening"][n] for n in names] for k in picks])
    q = [np.asarray(v["truth"]["positions"]) for v in videos]
    opens = np.array([abs(p[np.argmax(np.abs(p - p[0]))]) > abs(p[0]) for p in q])
    out: dict[str, Any] = {"features": names}
    for kind, now in (("revolute", turns), ("prismatic", ~turns)):
        model = LogisticRegression(C=0.3, max_iter=2000)
        p = cross_val_predict(model, X[now], opens[now], cv=FOLDS, method="predict_proba")[:, 1]
        sure = np.maximum(p, 1 - p) >= 0.65
        print(
            f"opening, {kind}: {np.mean((p > 0.5) == opens[now]):.3f} right of all, "
            f"{np.mean(((p > 0.5) == opens[now])[sure]):.3f} of {sure.mean():.3f}"
        )
        model.fit(X[now], opens[now])
        out[kind] = {"weights": _rounded(model.coef_[0]), "bias": float(model.intercept_[0])}
    return out


def _exported(models: tuple[Any, Any]) -> dict[str, Any]:
    scaler = models[1].named_steps["standardscaler"]
    linear = models[1].named_steps["logisticregression"]
    return {
        "trees": _exported_trees(models[0]),
        "mean": _rounded(scaler.mean_),
        "scale": _rounded(scaler.scale_),
        "weights": _rounded(linear.coef_[0]),
        "bias": float(linear.intercept_[0]),
    }


def _rounded(values: Floats) -> list[float]:
    return [float(f"{x:.6g}") for x in values]


def _exported_trees(model: Any) -> dict[str, Any]:
    """Return all trees as one array of nodes; the left child is the next node."""
    roots: list[int] = []
    feature: list[int] = []
    threshold: list[float] = []
    right: list[int] = []

    def add(tree: Any, node: int) -> None:
        at = len(feature)
        leaf = tree.children_left[node] < 0
        feature.append(-1 if leaf else int(tree.feature[node]))
        value = tree.value[node, 0, 0] * model.learning_rate if leaf else tree.threshold[node]
        threshold.append(float(f"{value:.6g}"))
        right.append(-1)
        if not leaf:
            add(tree, tree.children_left[node])
            right[at] = len(feature)
            add(tree, tree.children_right[node])

    for one in model.estimators_[:, 0]:
        roots.append(len(feature))
        add(one.tree_, 0)
    prior = model.init_.class_prior_[1]
    return {
        "roots": roots,
        "feature": feature,
        "threshold": threshold,
        "right": right,
        "bias": float(np.log(prior / (1.0 - prior))),
    }
