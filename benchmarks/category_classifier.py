"""Train the linear category classifier on renders of the procedural library.

    python benchmarks/category_classifier.py --seeds 40 --views 2 --out FILE.npz

The features are those of the ImageNet network, of crops around objects under unknown cameras.
Seeds below 1000 are used; figures come from other objects (benchmarks/photos.py).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from sklearn.linear_model import LogisticRegression

from articulate.library.procedural.categories import CATEGORIES
from articulate.reconstruct.images import only_joint, poses_at
from articulate.reconstruct.make_object import part_meshes, predicted_joints
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.recognition.classifier import classify
from articulate.reconstruct.recognition.mask import crop_on_white
from articulate.render.raster import Pixels
from articulate.render.rendered_photo import render_photo
from articulate.transforms import Array

OPEN_SHARE = 0.3
"""Share of the images with one part open."""
LAPTOP_OPEN_SHARE = 0.9
"""The same for laptops, which are rarely pictured closed."""


def sample_image(name: str, seed: int, view: int) -> Pixels:
    """Return the crop of one rendered object (H, W, 3)."""
    rng = np.random.default_rng([seed, view, *name.encode()])
    category = CATEGORIES[name]
    parts = tuple(category.parts(seed))
    meshes = list(part_meshes(parts, category.palette))
    proposal = ObjectProposal(
        name=name, category=category.partnet, parts=parts, confidence=1.0, evidence={}
    )
    joints = {joint.part: joint for joint in predicted_joints(proposal)}
    share = LAPTOP_OPEN_SHARE if name == "laptop" else OPEN_SHARE
    if joints and rng.uniform() < share:
        moved = list(joints)[int(rng.integers(len(joints)))]
        poses = poses_at(meshes, only_joint(joints, moved), float(rng.uniform(0.2, 1.0)))
        meshes = [mesh.moved(T) for mesh, T in zip(meshes, poses, strict=True)]
    turned = [mesh.with_vertices(mesh.vertices * [-1.0, -1.0, 1.0]) for mesh in meshes]
    photo = render_photo(turned, int(rng.integers(2**31)), occluded=rng.uniform() < 0.2)
    return crop_on_white(photo.image, photo.mask)


def main() -> None:
    """Render, train and write the weights."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seeds", type=int, default=40, help="number of seeds of the procedural library"
    )
    parser.add_argument("--views", type=int, default=2, help="images of each object")
    parser.add_argument("--out", type=Path, required=True, help="file of the weights (.npz)")
    parser.add_argument("--features", type=Path, help="file for the features, to train again")
    flags = parser.parse_args()
    rows: list[Array] = []
    labels: list[str] = []
    for seed in range(1, flags.seeds + 1):
        for name in CATEGORIES:
            crops = [sample_image(name, seed, view) for view in range(flags.views)]
            rows += list(classify(crops)[1])
            labels += [CATEGORIES[name].partnet] * len(crops)
        sys.stderr.write(f"seed {seed}: {len(rows)} images\n")
        if flags.features:
            np.savez_compressed(flags.features, x=np.array(rows), y=np.array(labels))
    x = np.array(rows)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    model = LogisticRegression(C=20.0, max_iter=2000, class_weight="balanced").fit(x, labels)
    np.savez_compressed(
        flags.out,
        names=np.array(model.classes_, dtype=str),
        weight=model.coef_.astype(np.float16),
        bias=model.intercept_.astype(np.float32),
    )


if __name__ == "__main__":
    main()
