"""Frames, links and joints of an SDF model and of the models in it.

Frame semantics: sdformat.org, "Pose frame semantics proposal" (1.7), and for older versions the
conversions that libsdformat applies to them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from articulate.errors import AssetError, quote
from articulate.formats.find_source import CONFIG, file_of_config, sdf_version
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import LARGEST
from articulate.formats.xml_input import Element, child_of, children_of, read_markup, tag_of
from articulate.transforms import Array, pose, quat_to_matrix, rpy_to_matrix

MAX_FILES = 64
"""Most files that one model includes."""
MAX_NESTED = 8
"""Deepest nesting of models."""
MAX_FRAMES = 5_000
"""Most named frames of a model."""
WORLD, MODEL = "world", "__model__"


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A named frame: a link, joint, frame or model."""

    relative_to: str
    T: Array
    """Pose in ``relative_to`` (4, 4)."""
    link: str
    """Link or frame that it is attached to; its own name for a link."""
    where: str


@dataclass(kw_only=True)
class Content:
    """Elements of a model and of the models in it, with full names."""

    frames: dict[str, Frame] = field(default_factory=dict)
    links: dict[str, tuple[Element, Path]] = field(default_factory=dict)
    joints: dict[str, tuple[Element, Path, str, int]] = field(default_factory=dict)
    """Element, file, scope and version by name."""


class SdfModel:
    """The model of an SDF file, its frames collected and resolved.

    Args:
        path: The file.
        repairs: Receives messages about what is changed or left out.
    """

    def __init__(self, path: Path, repairs: Repairs) -> None:
        self.path = path
        self.repairs = repairs
        self.files: dict[str, Path] = {}
        self.content = Content()
        self.includes = 0
        self._poses: dict[str, Array] = {WORLD: np.eye(4)}

    def top_model(self) -> tuple[Element, int]:
        """Return the one model of the file and its minor version of SDF."""
        root = read_markup(self.path, self.repairs)
        if tag_of(root) != "sdf":
            raise AssetError(
                f"{self.path}: not SDF: its root element is <{tag_of(root)[:60]}>, <sdf> was "
                "expected"
            )
        models = children_of(root, "model")
        for world in children_of(root, "world"):
            included = children_of(world, "include")
            if included:
                raise AssetError(
                    f"{self.at(included[0], self.path)}: the world includes models; give the file "
                    "of one model"
                )
            models += children_of(world, "model")
        grounds = [model for model in models if _is_ground(model)]
        if grounds and len(grounds) < len(models):
            names = ", ".join((model.get("name") or "?") for model in grounds[:3])
            self.repairs.note(f"model {names}, the ground, left out")
            models = [model for model in models if model not in grounds]
        if len(models) != 1:
            names = ", ".join((model.get("name") or "?") for model in models[:4])
            count = f"{len(models)} models ({names})" if models else "no model"
            raise AssetError(f"{self.path}: holds {count}; give a file of one model")
        if text_of(models[0], "static") in {"1", "true"}:
            self.repairs.note("the model is static in Gazebo: its joints are read all the same")
        return models[0], sdf_version(root)

    def at(self, element: Element, path: Path) -> str:
        """Return file and line of an element."""
        return f"{path}:{element.sourceline}"

    def add(self, name: str, frame: Frame) -> None:
        """Add a frame under its full name.

        Raises:
            AssetError: The name is used, or there are too many frames.
        """
        if name in self.content.frames or name == WORLD:
            raise AssetError(
                f"{frame.where}: a second link, joint or frame is called {quote(name)}"
            )
        if len(self.content.frames) >= MAX_FRAMES:
            raise AssetError(f"{frame.where}: more than {MAX_FRAMES} links, joints and frames")
        self.content.frames[name] = frame

    def collect(
        self, model: Element, path: Path, version: int, *, scope: str, parent: str, depth: int
    ) -> None:
        """Collect the frames, links and joints of a model and of the models in it.

        Args:
            model: The ``<model>``.
            path: File that it is in.
            version: Minor version of SDF in this file.
            scope: Prefix of its names, empty or ending in ``::``.
            parent: Scope of the model that contains it.
            depth: How many models contain it.
        """
        if depth > MAX_NESTED:
            raise AssetError(f"{self.at(model, path)}: models nested deeper than {MAX_NESTED}")
        if scope and model.get("placement_frame"):
            raise AssetError(
                f"{self.at(model, path)}: placement_frame of a nested model is not read; give its "
                "pose by the model frame"
            )
        links = children_of(model, "link")
        first = name_of(links[0], path) if links else ""
        canonical = model.get("canonical_link") or first
        relative_to, T = self.pose_in(model, path, parent)
        if scope == "":
            relative_to = WORLD
        here = f"{scope}{MODEL}"
        where = self.at(model, path)
        self.add(here, Frame(relative_to=relative_to, T=T, link=scope + canonical, where=where))
        for element in links:
            name = scope + name_of(element, path)
            relative_to, T = self.pose_in(element, path, scope)
            at = self.at(element, path)
            self.add(name, Frame(relative_to=relative_to or here, T=T, link=name, where=at))
            self.content.links[name] = (element, path)
        for element in children_of(model, "joint"):
            name = scope + name_of(element, path)
            relative_to, T = self.pose_in(element, path, scope)
            child = scope + text_of(element, "child")
            at = self.at(element, path)
            self.add(name, Frame(relative_to=relative_to or child, T=T, link=child, where=at))
            self.content.joints[name] = (element, path, scope, version)
        for element in children_of(model, "frame"):
            name = scope + name_of(element, path)
            attached = scope + (element.get("attached_to") or MODEL)
            relative_to, T = self.pose_in(element, path, scope)
            at = self.at(element, path)
            self.add(name, Frame(relative_to=relative_to or attached, T=T, link=attached, where=at))
        for element in children_of(model, "model"):
            self.collect(
                element,
                path,
                version,
                scope=f"{scope}{name_of(element, path)}::",
                parent=scope,
                depth=depth + 1,
            )
        for element in children_of(model, "include"):
            self.include(element, path, scope, depth)

    def include(self, element: Element, path: Path, scope: str, depth: int) -> None:
        """Collect the model of another file as a model inside this one."""
        uri, at = text_of(element, "uri"), self.at(element, path)
        self.includes += 1
        if self.includes > MAX_FILES:
            raise AssetError(f"{at}: more than {MAX_FILES} files are included")
        file = _included_file(uri, path)
        inside = list(self.path.resolve().parents)[:2][-1]
        if file is None or not file.resolve().is_relative_to(inside):
            raise AssetError(
                f"{at}: included model {quote(uri)} not found beside this model; put its folder "
                "there, or write one file with: gz sdf -p"
            )
        if element.get("merge") in {"1", "true"}:
            raise AssetError(f"{at}: merge of an included model is not read; write one file")
        self.files[uri] = file
        model, version = SdfModel(file, self.repairs).top_model()
        for key in ("pose", "name"):
            new = child_of(element, key)
            if new is not None:
                for old in children_of(model, key):
                    model.remove(old)
                model.insert(0, new)
        if element.get("placement_frame") or child_of(element, "placement_frame") is not None:
            model.set("placement_frame", "?")
        name = text_of(model, "name") or name_of(model, file)
        self.collect(model, file, version, scope=f"{scope}{name}::", parent=scope, depth=depth + 1)

    def pose_in(self, element: Element, path: Path, scope: str) -> tuple[str, Array]:
        """Return the frame that a ``<pose>`` is relative to, empty by default, and the pose."""
        found = child_of(element, "pose")
        if found is None:
            return (scope + MODEL if tag_of(element) == "model" else ""), np.eye(4)
        relative_to = found.get("relative_to") or found.get("frame") or ""
        if tag_of(element) == "model" and not relative_to:
            relative_to = MODEL
        numbers = self.numbers(found, path)
        if found.get("rotation_format") == "quat_xyzw":
            if len(numbers) != 7 or not any(numbers[3:]):
                raise AssetError(f"{self.at(found, path)}: <pose> needs 7 numbers, xyz and xyzw")
            x, y, z, w = numbers[3:]
            T = pose(np.array(numbers[:3]), quat_to_matrix(np.array([w, x, y, z])))
        elif not numbers:
            T = np.eye(4)
        elif len(numbers) != 6:
            raise AssetError(f"{self.at(found, path)}: <pose> has {len(numbers)} numbers, not 6")
        else:
            unit = math.pi / 180.0 if found.get("degrees") in {"1", "true"} else 1.0
            T = pose(np.array(numbers[:3]), rpy_to_matrix(unit * np.array(numbers[3:])))
        return (scope + relative_to if relative_to and relative_to != WORLD else relative_to), T

    def frame(self, name: str, where: str) -> Frame:
        """Return a frame by its full name; that of a model by the name of the model."""
        frames = self.content.frames
        found = frames.get(name) or frames.get(f"{name}::{MODEL}")
        if found is None:
            raise AssetError(f"{where}: names {quote(name)}, which does not exist")
        return found

    def pose_of(self, name: str, where: str = "") -> Array:
        """Return the pose of a frame in the world (4, 4)."""
        chain: list[tuple[str, Frame]] = []
        while name not in self._poses:
            frame = self.frame(name, where or str(self.path))
            if len(chain) > MAX_FRAMES:
                raise AssetError(f"{frame.where}: poses are relative to each other in a cycle")
            chain.append((name, frame))
            name, where = frame.relative_to, frame.where
        T = self._poses[name]
        for name, frame in reversed(chain):
            T = frame.T if np.array_equal(T, np.eye(4)) else T @ frame.T
            self._poses[name] = T
        return T

    def link_of(self, name: str, where: str) -> str:
        """Return the link that a frame is attached to."""
        for _ in range(MAX_FRAMES):
            if name in self.content.links or name == WORLD:
                return name
            name = self.frame(name, where).link
        raise AssetError(f"{where}: frames are attached to each other in a cycle")

    def sizes(self, shape: Element, path: Path, key: str, count: int) -> tuple[float, ...]:
        """Return the ``count`` positive numbers of a shape's child ``key`` [m]."""
        found = child_of(shape, key)
        values = () if found is None else self.numbers(found, path)
        if len(values) != count or min(values, default=0.0) <= 0.0:
            raise AssetError(
                f"{self.at(shape, path)}: <{tag_of(shape)}> needs <{key}> of {count} positive "
                f"number{'s' if count > 1 else ''}"
            )
        return values

    def number(self, element: Element | None, key: str, path: Path) -> float | None:
        """Return a number, or None where it is absent, not finite or as large as no limit."""
        found = None if element is None else child_of(element, key)
        if found is None:
            return None
        value = float_of(found.text or "")
        if value is None:
            raise AssetError(
                f"{self.at(found, path)}: <{key}> is {quote((found.text or '').strip())}, not a "
                "number"
            )
        return value if abs(value) < LARGEST else None

    def numbers(self, element: Element, path: Path) -> tuple[float, ...]:
        """Return the numbers of an element, all finite and within the size of an object."""
        values = [float_of(word) for word in (element.text or "").split()]
        if any(value is None or not abs(value) < 1e6 for value in values):
            raise AssetError(
                f"{self.at(element, path)}: <{tag_of(element)}> is "
                f"{quote((element.text or '').strip())}, not made of finite numbers"
            )
        return tuple(value for value in values if value is not None)


def _included_file(uri: str, path: Path) -> Path | None:
    """Return the SDF file of an included model, which is beside the folder of the model."""
    text = uri.strip().removeprefix("file://")
    name = text.removeprefix("model://").strip("/")
    bases = [path.parent, path.parent.parent]
    for base in bases if name and ".." not in Path(name).parts and "\0" not in name else []:
        folder = base / name
        if folder.is_file():
            return folder
        if (folder / CONFIG).is_file():
            return file_of_config(folder / CONFIG)
        if (folder / "model.sdf").is_file():
            return folder / "model.sdf"
    return None


def _is_ground(model: Element) -> bool:
    """Return whether all geometry of a model is planes."""
    found = [e for e in model.iter() if tag_of(e) == "geometry"]
    return bool(found) and all(child_of(e, "plane") is not None for e in found)


def name_of(element: Element, path: Path) -> str:
    """Return the name of an element.

    Raises:
        AssetError: It has none, or one that SDF reserves.
    """
    name = (element.get("name") or "").strip()
    if not name:
        raise AssetError(f"{path}:{element.sourceline}: <{tag_of(element)}> without a name")
    if name == WORLD or name.startswith("__"):
        raise AssetError(f"{path}:{element.sourceline}: the name {quote(name)} is reserved")
    return name


def text_of(element: Element, key: str) -> str:
    """Return the text of the first child called ``key``, empty without one."""
    found = child_of(element, key)
    return "" if found is None else (found.text or "").strip()


def float_of(word: str) -> float | None:
    """Return a number, or None where ``word`` is none."""
    try:
        return float(word.replace("_", "?"))
    except ValueError:
        return None
