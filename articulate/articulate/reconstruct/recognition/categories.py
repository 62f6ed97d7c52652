"""Category of an object from ImageNet probabilities.

A category of PartNet-Mobility is the sum of the ImageNet classes (ILSVRC 2012) that show it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from articulate.reconstruct.recognition.classifier import classify
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
FLOOR = 1e-4
"""Least probability of a category before normalization."""
TEMPERATURE = 1.0
"""Exponent of the probabilities; smaller values make them less certain."""


def category_probabilities(crops: Sequence[Pixels]) -> dict[str, float]:
    """Return the probability of each category from crops (H, W, 3) of one object.

    Raises:
        UsageError: The package with the weights is not installed.
    """
    found, _ = classify(list(crops))
    return category_scores(found.mean(axis=0))


def category_scores(imagenet: Array) -> dict[str, float]:
    """Return normalized category scores from ImageNet probabilities (1000,)."""
    raw = {name: float(imagenet[list(ids)].sum()) + FLOOR for name, ids in CLASSES.items()}
    sharp = {name: value**TEMPERATURE for name, value in raw.items()}
    total = float(np.sum(list(sharp.values())))
    return {name: value / total for name, value in sharp.items()}


def multiply(*factors: Mapping[str, float]) -> dict[str, float]:
    """Multiply probabilities of categories and normalize; missing ones count as the least."""
    names = sorted(set().union(*factors))
    product = {
        name: float(np.prod([f.get(name, min(f.values())) for f in factors])) for name in names
    }
    total = sum(product.values())
    return {name: value / total for name, value in product.items()}
