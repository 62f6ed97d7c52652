"""Convert a URDF, SDF or MJCF to an asset folder, atomically."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from articulate.assets.asset import Asset, Joint, Link, load_asset, save_asset
from articulate.assets.check_report import Counts
from articulate.conversion.contact_exclusions import contact_excludes
from articulate.conversion.handles import handles_of
from articulate.conversion.joints import Travel, box_volume_of, travel_of
from articulate.conversion.metric_size import category_of, is_normalised, scale_of
from articulate.conversion.mimic import apply_mimics, resolve_mimics
from articulate.conversion.provenance import ORIGIN_FILES, origin_of
from articulate.conversion.up_axis import Z_FROM_Y_UP, parts_opening_upwards
from articulate.conversion.write_asset import Body, Mimic, mesh_files, mjcf, urdf, write_meshes
from articulate.errors import AssetError, UsageError
from articulate.files import is_asset, replace_directory, write_text
from articulate.formats.config import ConvertConfig
from articulate.formats.decompose_joints import decompose_joints
from articulate.formats.find_source import find_source
from articulate.formats.link_tree import Part, build_parts, poses_at
from articulate.formats.load_meshes import PartGeometry, bounds
from articulate.formats.orient_collada import load_parts
from articulate.formats.read_source import read_source
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceObject, free_name
from articulate.geometry.collision import collision_shapes
from articulate.geometry.inertia import inertial_of
from articulate.geometry.presets import joint_dynamics, joint_preset, weight
from articulate.geometry.rays import NOTHING
from articulate.geometry.shapes import Shape
from articulate.geometry.time_budget import UNLIMITED, Budget, OutOfTimeError
from articulate.transforms import Array, inverse, matrix_to_quat

MOST_NAMES = 6
"""At most this many links are named in one message."""
VERSION = "30"
"""Part of every cache key; change it with anything that changes the files written."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A source with its parts, geometry and joints, in its own units."""

    source: SourceObject
    parts: tuple[Part, ...]
    geometry: Mapping[str, PartGeometry]
    travels: Mapping[str, Travel]
    """By part."""
    files: Mapping[str, Path]
    """Mesh files in use, by reference."""


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Transform from units of the source to the object frame in metres."""

    scale: float
    rule: str
    T_os: Array
    """Pose of the URDF's root frame, already scaled, in the object frame (4, 4)."""


def convert(source: Path, out: Path, config: ConvertConfig | None = None) -> Asset:
    """Convert ``source`` to the asset folder ``out``.

    Args:
        source: URDF, SDF or MJCF file, or a folder with one.
        out: Folder to write; it may be absent, empty or an asset, which is replaced.
        config: Options.

    Raises:
        AssetError: The source cannot be read or made into an object.
        UsageError: ``out`` cannot be written.
    """
    config = config or ConvertConfig()
    _check_out(out)
    asset, bodies, mimics = build_asset(read_input(find_source(source), config), config)
    return write_asset(asset, bodies, mimics, out)


def read_input(path: Path, config: ConvertConfig) -> Reading:
    """Read the URDF, SDF or MJCF at ``path`` with its geometry and joints.

    Raises:
        AssetError: It cannot be read, or nothing in it has geometry.
    """
    source = read_source(path)
    parts = build_parts(decompose_joints(source))
    loader, geometry = load_parts(source, parts, config)
    parts = _without_empty(parts, geometry, source)
    if not any(geometry[part.name].visible for part in parts):
        raise AssetError(f"{path}: no link has geometry; nothing can be made of it")
    travels = _travels(parts, geometry, config, source.repairs)
    files = {**source.files, **loader.files}
    return Reading(source=source, parts=parts, geometry=geometry, travels=travels, files=files)


def _travels(
    parts: Sequence[Part],
    geometry: Mapping[str, PartGeometry],
    config: ConvertConfig,
    repairs: Repairs,
) -> dict[str, Travel]:
    """Return the travel of each part by its name."""
    moving = [(part, part.joint) for part in parts if part.joint is not None]
    own = {
        joint.name: travel_of(
            joint, geometry[part.name], config, repairs, box_volume_of(parts, geometry, part)
        )
        for part, joint in moving
    }
    leads, _ = resolve_mimics(joint for _, joint in moving)
    found = apply_mimics(own, leads, repairs)
    return {part.name: found[joint.name] for part, joint in moving}


def _without_empty(
    parts: tuple[Part, ...], geometry: Mapping[str, PartGeometry], source: SourceObject
) -> tuple[Part, ...]:
    """Return the parts without moving leaves that have no geometry and lead no other part."""
    kept = list(parts)
    while True:
        parents = {part.parent for part in kept}
        leaders = {part.joint.mimic[0] for part in kept if part.joint and part.joint.mimic}
        leads = {part.name for part in kept if part.joint and part.joint.name in leaders}
        empty = [
            part
            for part in kept[1:]
            if not geometry[part.name].visible and part.name not in parents | leads
        ]
        if not empty:
            return tuple(kept)
        for part in empty:
            source.repairs.add(f"link {part.name} has no geometry: left out with its joint")
            kept.remove(part)


def input_key(reading: Reading, config: ConvertConfig) -> str:
    """Return the content hash of files, options and version of the converter.

    The names of the file and of its folder are part of it, because an asset names its source.
    """
    digest = hashlib.sha256(f"convert {VERSION}\0".encode())
    options = dataclasses.asdict(config)
    del options["cache_dir"], options["decompose_s"]
    digest.update(json.dumps(options, sort_keys=True, default=str).encode())
    path = reading.source.path
    digest.update(json.dumps([path.name, path.parent.resolve().name]).encode() + b"\0")
    extra = [path.parent / n for n in ("meta.json", "semantics.txt", *ORIGIN_FILES)]
    files = [("urdf", path), *sorted(reading.files.items())]
    files += [(p.name, p) for p in extra if p.is_file()]
    digest.update(str(is_normalised(path)).encode())
    for name, file in files:
        digest.update(name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    colours = [[p.rgba for p in g.visible] for g in reading.geometry.values()]  # of other files too
    digest.update(json.dumps(colours).encode())
    return digest.hexdigest()


def placement_of(reading: Reading, config: ConvertConfig) -> Placement:
    """Size and place of the object frame.

    Raises:
        AssetError: The object has no extent.
    """
    closed = {
        part.joint.name: reading.travels[part.name].closed
        for part in reading.parts
        if part.joint is not None
    }
    poses = poses_at(reading.parts, closed)
    T_up = Z_FROM_Y_UP if config.up == "y" else np.eye(4)
    boxes = [bounds(reading.geometry[p.name], T_up @ poses[p.name]) for p in reading.parts]
    found = [box for box in boxes if box is not None]
    low = np.min([box[0] for box in found], axis=0)
    high = np.max([box[1] for box in found], axis=0)
    longest = float((high - low).max())
    if longest <= 0.0:
        raise AssetError(f"{reading.source.path}: all geometry is in one point")
    scale, rule = scale_of(reading.source.path, config, longest)
    T_os = T_up.copy()
    T_os[:3, 3] = -scale * np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return Placement(scale=scale, rule=rule, T_os=T_os)


def _scaled_pose(T: Array, scale: float) -> Array:
    out = np.array(T)
    out[:3, 3] *= scale
    return out


class Shaped(dict[tuple[str, int], tuple[tuple[Shape, ...], tuple[str, ...]]]):
    """Collision shapes of links and the messages about them, by name and number of refinements."""

    def __init__(self) -> None:
        super().__init__()
        self.unfinished: set[str] = set()
        """Links of which a refinement took too long."""


def build_asset(
    reading: Reading,
    config: ConvertConfig,
    known: Shaped | None = None,
    hollow: Mapping[str, Array] | None = None,
    budget: Budget = UNLIMITED,
) -> tuple[Asset, list[Body], list[Mimic]]:
    """Build the asset with its bodies and mimics, without writing it.

    Args:
        reading: The source.
        config: Options.
        known: Shapes of an earlier call for the same reading; those of this call are added.
        hollow: Points (H, 3) in the cavities of links that no shape may fill [m], by link and
            in its frame.
        budget: Time for links that are refined since an earlier call; those that take longer
            keep their earlier shapes.
    """
    source = reading.source
    place = placement_of(reading, config)
    category = category_of(source.path, config)
    origin, licence = origin_of(source.path, config)
    known = Shaped() if known is None else known
    bodies, T_ob = _bodies(reading, place, category, config, known, hollow or {}, budget)
    if not any(body.shapes for body in bodies):
        raise AssetError(f"{source.path}: no link has geometry of any area; nothing can be made")
    joints = tuple(body.joint for body in bodies if body.joint is not None)
    links = tuple(_link(body, T_ob[body.name]) for body in bodies)
    mimics = _mimics(reading, place)
    if not joints:
        source.repairs.note("no joint moves: the object is rigid")
    asset = Asset(
        name=config.name or source.name,
        category=category,
        links=links,
        joints=joints,
        handles=(),
        bounds_o=((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        source=origin,
        licence=licence,
        size_rule=place.rule,
    )
    handles, closed_box = handles_of(asset, bodies, source.repairs)
    upwards = parts_opening_upwards(asset) if config.up == "z" else ()
    if upwards:
        source.repairs.note(
            f"the object may lie on its back: {', '.join(upwards[:3])} opens upwards; if y points "
            "up in the file, read it with --up y"
        )
    asset = replace(asset, handles=handles, bounds_o=closed_box, repairs=source.repairs.messages)
    return asset, bodies, mimics


def _bodies(
    reading: Reading,
    place: Placement,
    category: str,
    config: ConvertConfig,
    known: Shaped,
    hollow: Mapping[str, Array],
    budget: Budget,
) -> tuple[list[Body], dict[str, Array]]:
    """Return the bodies in metres and their poses (4, 4) in the object frame, joints at 0."""
    repairs = reading.source.repairs
    bodies: list[Body] = []
    T_ob: dict[str, Array] = {}
    names: dict[str, str] = {}
    rescaled = abs(place.scale - 1.0) > 1e-9
    if rescaled:
        repairs.add(f"scaled by {place.scale:.4g}: {place.rule}")
    for part in reading.parts:
        geometry = reading.geometry[part.name].scaled(place.scale)
        specks = len(reading.geometry[part.name].visuals) - len(geometry.visuals)
        if specks:
            repairs.add(f"part {part.name}: {specks} visual pieces of next to no area left out")
        T_op = place.T_os @ _scaled_pose(part.T_sp, place.scale)
        members = tuple((link, _scaled_pose(T, place.scale)) for link, T in part.members)
        if part.joint is None:  # the frame of the fixed body is the object frame
            geometry = geometry.moved(T_op)
            members = tuple((link, T_op @ T_pl) for link, T_pl in members)
            T_op = np.eye(4)
        name = part.name  # MuJoCo keeps the name "world" for itself
        if name == "world":
            name = free_name("world_link", reading.source.links)
        names[part.name] = name
        shapes, messages = _shapes_of(name, geometry, config, known, hollow, budget)
        for message in messages:
            repairs.add(message)
        inertial = inertial_of(
            members,
            shapes,
            weight(category),
            rescaled=rescaled,
            kind=reading.travels[part.name].kind if part.joint is not None else "fixed",
            repairs=repairs,
        )
        parent = None if part.parent is None else names[part.parent]
        T_pc = np.eye(4) if parent is None else inverse(T_ob[parent]) @ T_op
        T_ob[name] = T_op
        joint = None
        travel = reading.travels.get(part.name)
        armature = 0.0
        if travel is not None and parent is not None and part.joint is not None:
            preset = joint_preset(travel.kind, inertial.mass_kg)
            own = part.joint.armature
            armature = own if own and not rescaled else preset.armature
            joint = _joint(part.joint.name, name, parent, travel, place.scale, T_op)
            damping, friction = joint_dynamics(
                preset, part.joint.damping, part.joint.friction, rescaled=rescaled
            )
            joint = replace(joint, damping=damping, frictionloss=friction)
        bodies.append(
            Body(
                name=name,
                parent=parent,
                T_pc=T_pc,
                visuals=geometry.visible,
                shapes=shapes,
                inertial=inertial,
                joint=joint,
                axis_l=None if travel is None else travel.axis,
                armature=armature,
                frames=tuple(
                    (link.name, T) for link, T in members if link.name not in {part.name, "world"}
                ),
            )
        )
    _note_inertia(reading, bodies, category, rescaled=rescaled)
    return bodies, T_ob


def _shapes_of(
    name: str,
    geometry: PartGeometry,
    config: ConvertConfig,
    known: Shaped,
    hollow: Mapping[str, Array],
    budget: Budget,
) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Return the shapes of a body and messages about them, computed once for each refinement.

    Refinements that are not done within ``budget`` keep the earlier shapes.
    """
    key = (name, config.finer.count(name))
    if key not in known:
        before = known.get((name, key[1] - 1))
        own = Repairs()
        left = UNLIMITED if before is None else budget
        try:
            free = hollow.get(name, NOTHING)
            shapes = collision_shapes(geometry, name, config, own, free, left)
            known[key] = shapes, own.messages
        except OutOfTimeError:
            assert before is not None
            known[key] = before
            known.unfinished.add(name)
    return known[key]


def _note_inertia(
    reading: Reading, bodies: Sequence[Body], category: str, *, rescaled: bool
) -> None:
    """Name the links whose masses are computed, and why those of the file are not used."""
    repairs = reading.source.repairs
    in_file = any(link.inertial is not None for link in reading.source.links.values())
    if in_file and rescaled:
        repairs.add("masses, damping and friction of the file ignored, for it is not metric")
    computed = [body.name for body in bodies if not body.inertial.from_source]
    if computed:
        names = ", ".join(computed[:MOST_NAMES])
        more = len(computed) - MOST_NAMES
        if more > 0:
            names += f" and {more} more"
        links = f"links {names}" if len(computed) > 1 else f"link {names}"
        repairs.add(
            f"mass and inertia of {links} computed from their shapes at "
            f"{weight(category).density_kg_m3:g} kg/m3, at least "
            f"{weight(category).sheet_kg_m2:g} kg for each m2 of a panel"
        )


def _joint(name: str, link: str, parent: str, travel: Travel, scale: float, T_ol: Array) -> Joint:
    unit = scale if travel.kind == "slide" else 1.0
    axis = T_ol[:3, :3] @ travel.axis
    return Joint(
        name=name,
        kind=travel.kind,
        link=link,
        parent=parent,
        axis_o=(float(axis[0]), float(axis[1]), float(axis[2])),
        pivot_o=(float(T_ol[0, 3]), float(T_ol[1, 3]), float(T_ol[2, 3])),
        lower=None if travel.lower is None else travel.lower * unit,
        upper=None if travel.upper is None else travel.upper * unit,
        closed=travel.closed * unit,
        open=travel.open * unit,
        closed_rule=travel.closed_rule,
    )


def _link(body: Body, T_ol: Array) -> Link:
    points = [piece.mesh.bounds for piece in body.visuals]
    low = np.min([p[0] for p in points], axis=0) if points else np.zeros(3)
    high = np.max([p[1] for p in points], axis=0) if points else np.zeros(3)
    quat = matrix_to_quat(T_ol[:3, :3])
    return Link(
        name=body.name,
        parent=body.parent,
        pos_o=(float(T_ol[0, 3]), float(T_ol[1, 3]), float(T_ol[2, 3])),
        quat_o=(float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])),
        mass_kg=body.inertial.mass_kg,
        bounds_l=(
            (float(low[0]), float(low[1]), float(low[2])),
            (float(high[0]), float(high[1]), float(high[2])),
        ),
        visuals=len(body.visuals),
        collisions=len(body.shapes),
    )


def _mimics(reading: Reading, place: Placement) -> list[Mimic]:
    kinds = {p.joint.name: reading.travels[p.name].kind for p in reading.parts if p.joint}
    leads, dropped = resolve_mimics(part.joint for part in reading.parts if part.joint)
    for name, what in dropped.items():
        reading.source.repairs.add(f"joint {name} mimics {what}: made independent")
    units = {name: place.scale if kind == "slide" else 1.0 for name, kind in kinds.items()}
    return [
        Mimic(
            joint=name,
            leader=leader,
            multiplier=multiplier * units[name] / units[leader],
            offset=offset * units[name],
        )
        for name, (leader, multiplier, offset) in leads.items()
    ]


def _check_out(out: Path) -> None:
    try:
        free = not out.exists() or is_asset(out) or (out.is_dir() and not any(out.iterdir()))
    except OSError as error:  # a name too long, a folder that is closed
        raise UsageError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    if not free:
        raise UsageError(f"{out}: exists and is not an asset; choose another --out")


def write_asset(asset: Asset, bodies: Sequence[Body], mimics: Sequence[Mimic], out: Path) -> Asset:
    """Write all files beside ``out`` and move them there in one step.

    Raises:
        UsageError: ``out`` cannot be written, or holds something other than an asset.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    except OSError as error:
        raise UsageError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    folder = beside / "new"
    try:
        folder.mkdir()
        folder.chmod(0o755)
        write_meshes(folder / "meshes", mesh_files(bodies))
        write_text(folder / "object.urdf", urdf(asset.name, bodies, mimics))
        excludes = contact_excludes(asset, bodies, mimics, folder)
        text = mjcf(asset.name, bodies, asset.handles, excludes, mimics)
        write_text(folder / "object.xml", text)
        save_asset(replace(asset, folder=folder))
        written = load_asset(folder)  # another writer may replace it right after the move
        replace_directory(folder, out, beside)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({error.strerror})") from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return replace(written, folder=out)


def counts_of(source: SourceObject, asset: Asset) -> Counts:
    """Count links, moving joints and geometry of ``source`` and of its ``asset``.

    The numbers differ for reasons that ``asset.repairs`` names: links fixed together become one, a
    mesh of several materials becomes several visuals, collision geometry is computed.
    """
    links = source.links.values()
    return Counts(
        links=(len(links), len(asset.links)),
        joints=(sum(joint.kind != "fixed" for joint in source.joints), len(asset.joints)),
        visuals=(
            sum(len(link.visuals) for link in links),
            sum(link.visuals for link in asset.links),
        ),
        collisions=(
            sum(len(link.collisions) for link in links),
            sum(link.collisions for link in asset.links),
        ),
    )
