"""In-context examples from the procedural library, rendered on demand.

The objects have seeds that no benchmark uses (:data:`SEED` and above), and come from a library that
shares no object with PartNet-Mobility.
"""

from __future__ import annotations

import json
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from articulate.cache import cache_folder, touch
from articulate.files import write_json
from articulate.library.procedural.categories import category_named
from articulate.library.procedural.truth import bounds, origins
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Content
from articulate.reconstruct.link_meshes import HALF_TURN
from articulate.reconstruct.part_set import PartSet, library_part_set
from articulate.reconstruct.program_writer import program_of, tree_of
from articulate.render.camera import front_camera
from articulate.render.scene import PartScene
from articulate.transforms import pose

SEED = 90
"""Seed of the objects; benchmarks use 0 to 4."""
CATEGORIES = (
    "cabinet",
    "door",
    "office_chair",
    "trash_can",
    "faucet",
    "chest_of_drawers",
    "washing_machine",
    "laptop",
    "kettle",
    "sliding_window",
    "fridge",
    "box_with_lid",
    "bucket",
    "switch",
    "oven",
    "table_with_drawers",
    "bottle",
    "suitcase",
    "toilet",
    "safe",
)
"""Category of each example; neighbours have different kinds of joints."""
SIZE_PX = (360, 270)
KIND = "examples"
"""Folder of the cache."""
VERSION = 1
"""Version of the content of examples; others miss the cache."""


@dataclass(frozen=True, eq=False)
class ExampleObject:
    """An object whose joints are known."""

    part_set: PartSet
    joints: tuple[PredictedJoint, ...]
    """The joint of each part but the root, in the frame of the parts."""
    root: str

    @property
    def program(self) -> str:
        """Program that joins the parts."""
        joints = {joint.part: joint for joint in self.joints}
        text = program_of(self.root, joints, actor="example", query="example")
        return text.partition("\n")[2]  # without the comment

    @property
    def evidence(self) -> Evidence:
        """Parts, labels, and an image with all joints closed."""
        camera = front_camera(*SIZE_PX)
        low, high = bounds_of(self.part_set)
        size = float(np.linalg.norm(high - low))
        T = camera.T_wc.copy()
        T[:3, 3] = 0.5 * (low + high) - camera.T_wc[:3, 2] * 0.75 * size / np.sin(np.radians(17.5))
        camera = camera.at(T)
        return Evidence(
            modality="image",
            parts=self.part_set.meshes,
            labels=self.part_set.labels,
            image=PartScene(self.part_set.meshes).render_image(camera),
            camera=camera,
        )

    @property
    def separated(self) -> Evidence:
        """The same evidence with each part's box centred at the origin."""
        evidence = self.evidence
        parts = tuple(part.moved(pose(-part.centre)) for part in evidence.parts)
        return replace(evidence, parts=parts, placed=False)


def bounds_of(part_set: PartSet) -> Any:
    """Return the lowest and highest corner (2, 3) of all parts [m]."""
    boxes = np.stack([mesh.bounds for mesh in part_set.meshes])
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


@lru_cache(maxsize=len(CATEGORIES))
def example_object(k: int) -> ExampleObject:
    """Return the example ``k`` of :data:`CATEGORIES`."""
    name = CATEGORIES[k]
    part_set = library_part_set(f"{name}:{SEED + k // len(CATEGORIES)}")
    parts = category_named(name).parts(SEED)
    at, floor = origins(parts), float(bounds(parts)[0, 2])
    joints = []
    for part in parts:
        if part.motion is None:
            continue
        motion = part.motion
        x, y, z = HALF_TURN @ at[part.name] - np.array([0.0, 0.0, floor])
        ax, ay, az = HALF_TURN @ np.asarray(motion.axis)
        endless = motion.kind == "continuous"
        joints.append(
            PredictedJoint(
                part=part.name,
                parent=motion.parent,
                kind=motion.kind,
                axis_o=(float(ax), float(ay), float(az)),
                pivot_o=(float(x), float(y), float(z)),
                lower=None if endless else 0.0,
                upper=None if endless else motion.upper,
            )
        )
    root, tree = tree_of(joints, part_set.meshes)
    return ExampleObject(part_set=part_set, joints=tuple(tree.values()), root=root)


def example_content(
    agent: str, n: int, one: Callable[[int], tuple[Iterable[Content], Any]]
) -> tuple[Content, ...]:
    """Return ``n`` examples as content of a message, each with its answer.

    Args:
        agent: Name of the agent, for the cache.
        n: Number of examples.
        one: Function from the number of an example to its content and its answer, a dataclass.
    """
    content: list[Content] = []
    for k in range(n):
        content.append(f"Example {k + 1} of {n}:")
        content += _cached(agent, k, one)
    return (*content, "End of the examples. Now the object to work on:") if n else ()


def _cached(
    agent: str, k: int, one: Callable[[int], tuple[Iterable[Content], Any]]
) -> list[Content]:
    """Return an example from the cache, or make it."""
    path = cache_folder() / KIND / f"{agent}-{VERSION}-{CATEGORIES[k]}-{SEED}.json"
    content: list[Content] = []
    try:
        for entry in json.loads(path.read_text(encoding="utf-8"))["content"]:
            known = isinstance(entry, str)
            content.append(entry if known else CaptionedImage(entry[0], b64decode(entry[1])))
    except (OSError, ValueError, TypeError, KeyError, IndexError):
        pieces, answer = one(k)
        content = [*pieces, f"The correct answer:\n{json.dumps(asdict(answer))}"]
        entries = [
            [piece.caption, b64encode(piece.png).decode()]
            if isinstance(piece, CaptionedImage)
            else piece
            for piece in content
        ]
        write_json(path, {"content": entries})
    else:
        touch(path)
    return content
