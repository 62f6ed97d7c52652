"""Category of an object from the probabilities and features of an ImageNet network.

A category of PartNet-Mobility is the sum of the ImageNet classes (ILSVRC 2012) that show it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.recognition.classifier import classify
from articulate.reconstruct.recognition.library_index import LibraryIndex
from articulate.reconstruct.recognition.mask import crop_on_white, crop_with_background
from articulate.render.raster import Pixels
from articulate.transforms import Array

CLASSES: Mapping[str, tuple[int, ...]] = {
    "Bottle": (440, 907, 898, 899, 737, 720, 631, 838, 653),
    "Box": (492, 478, 519, 709, 549),
    "Bucket": (463, 790),
    "Camera": (759, 732),
    "Cart": (791, 428),
    "Chair": (423, 765, 857),
    "Clock": (530, 892, 409, 826),
    "CoffeeMachine": (550,),
    "Dishwasher": (534,),
    "Dispenser": (804,),
    "Display": (664, 782, 851, 527, 598),
    "Door": (799,),
    "Eyeglasses": (836, 837),
    "Fan": (545,),
    "Faucet": (896,),
    "FoldingChair": (559,),
    "Kettle": (849, 505),
    "Keyboard": (508, 878),
    "KitchenPot": (544, 521, 469, 926, 909, 567),
    "Knife": (623, 499),
    "Lamp": (846, 619),
    "Laptop": (620, 681),
    "Lighter": (626,),
    "Microwave": (651,),
    "Mouse": (673,),
    "Oven": (827, 766),
    "Pen": (418, 563, 749),
    "Phone": (487, 528, 707),
    "Printer": (742, 713),
    "Refrigerator": (760,),
    "Remote": (761,),
    "Safe": (771,),
    "StorageFurniture": (894, 553, 648, 495, 453, 493, 548),
    "Suitcase": (636, 748, 414),
    "Switch": (844,),
    "Table": (526, 532, 736, 846),
    "Toaster": (859, 891),
    "Toilet": (861,),
    "TrashCan": (412,),
    "WashingMachine": (897,),
    "Window": (904, 905, 580),
}
"""ImageNet classes of each category."""
FREQUENCY: Mapping[str, float] = {
    "StorageFurniture": 3.0,
    "Refrigerator": 3.0,
    "Oven": 3.0,
    "Table": 2.0,
    "Microwave": 2.0,
    "Dishwasher": 2.0,
    "WashingMachine": 2.0,
    "Door": 1.5,
    "Chair": 0.6,
    "Window": 0.4,
    "Switch": 0.2,
}
"""Assumed relative frequency of categories among inputs; 1 for the others."""
FLOOR = 1e-4
"""Least probability of a category before normalization."""
WEIGHTS_FILE = Path(__file__).with_name("category_weights.npz")
"""Linear classifier of features, trained on renders of the procedural library by
``benchmarks/category_classifier.py``."""
RENDERED_SHARE = 0.45
"""Weight of the linear classifier; the rest is that of the ImageNet classes."""


def category_probabilities(
    image: Pixels, mask: NDArray[np.bool_], library: LibraryIndex | None = None
) -> dict[str, float]:
    """Return the probability of each category of one object.

    The probabilities of ImageNet classes are the mean of two crops: with the background and on
    white. The linear classifier and the library use the crop on white. The logarithms of the scores
    from ImageNet classes and of the linear classifier are averaged. With a library, the result is
    the mean of these probabilities and those of the library.

    Args:
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).
        library: Renders of objects of known categories.

    Raises:
        UsageError: The mask is empty, or the package with the weights is not installed.
    """
    found, features = classify([crop_on_white(image, mask), crop_with_background(image, mask)])
    named, rendered = category_scores(found.mean(axis=0)), rendered_scores(features[0])
    logs = {
        name: (1.0 - RENDERED_SHARE) * np.log(named.get(name, FLOOR))
        + RENDERED_SHARE * np.log(rendered.get(name, FLOOR) + FLOOR)
        for name in {*named, *rendered}
    }
    usual = _normalized(
        {name: FREQUENCY.get(name, 1.0) * float(np.exp(value)) for name, value in logs.items()}
    )
    if library is None:
        return usual
    others = library.category_probabilities(features[0])
    names = {*usual, *others}
    return _normalized({n: 0.5 * (usual.get(n, 0.0) + others.get(n, 0.0)) for n in names})


def category_scores(imagenet: Array) -> dict[str, float]:
    """Return normalized category scores from ImageNet probabilities (1000,)."""
    return _normalized({n: float(imagenet[list(ids)].sum()) + FLOOR for n, ids in CLASSES.items()})


def rendered_scores(features: Array) -> dict[str, float]:
    """Return the probabilities of the procedural categories from features (1280,)."""
    names, weight, bias = _weights()
    scores = weight @ (features / np.linalg.norm(features)) + bias
    values = np.exp(scores - scores.max())
    return dict(zip(names, map(float, values / values.sum()), strict=True))


@lru_cache(maxsize=1)
def _weights() -> tuple[tuple[str, ...], Array, Array]:
    with np.load(WEIGHTS_FILE, allow_pickle=False) as file:
        names = tuple(str(name) for name in file["names"])
        return names, file["weight"].astype(np.float64), file["bias"].astype(np.float64)


def _normalized(scores: Mapping[str, float]) -> dict[str, float]:
    total = sum(scores.values())
    return {name: scores[name] / total for name in sorted(scores)}


def multiply(*factors: Mapping[str, float]) -> dict[str, float]:
    """Multiply probabilities of categories and normalize; missing ones count as the least."""
    names = sorted(set().union(*factors))
    return _normalized(
        {name: float(np.prod([f.get(name, min(f.values())) for f in factors])) for name in names}
    )
