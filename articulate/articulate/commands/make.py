"""``articulate make``: from a clip, a picture or a sentence, and parts, to a proven URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from articulate.cache import cache_folder, cache_in_use
from articulate.commands import console
from articulate.commands.flags import parse
from articulate.commands.success import MISSED
from articulate.errors import ConfigError
from articulate.files import require_space

if TYPE_CHECKING:
    from articulate.reconstruct.part_set import PartSet
    from articulate.reconstruct.query import Query
    from articulate.reconstruct.result import MakeResult
    from articulate.render.camera import Camera

RESULT_BYTES = 20_000_000
"""About what a result takes."""
MOST_LIMIT_S = 1e6
"""Longest time that may be given [s]."""
FRONT_EYE = (3.0, 1.5, 2.0)
FRONT_TARGET = (0.0, 0.0, 0.8)
FRONT_FOVY = 35.0


@dataclass(frozen=True, kw_only=True)
class CameraFlags:
    """Where the camera of clip or picture stands, in the frame of the parts."""

    file: Path | None = None
    """JSON file with width_px, height_px, fx_px, fy_px, cx_px, cy_px and T_oc, as the benchmark
    exports it; the other camera flags are not heeded then."""
    eye: tuple[float, float, float] = FRONT_EYE
    """Position of the camera [m]; by default that of the benchmark."""
    target: tuple[float, float, float] = FRONT_TARGET
    """Point that is seen in the middle [m]."""
    fovy: float = FRONT_FOVY
    """Angle of view from top to bottom [deg]."""


@dataclass(frozen=True, kw_only=True)
class MakeFlags:
    """Find the joints of an object whose parts are known, and write a URDF that is proven.

    Example: articulate make --video clip.mp4 --parts parts/ --out asset/
    """

    video: Path | None = None
    """Clip in which a part moves."""
    image: Path | None = None
    """Picture of the object."""
    text: str | None = None
    """What the object is, e.g. "a cabinet with two drawers"; may stand beside a clip or picture."""
    parts: Path | None = None
    """Folder with one mesh for each part, a URDF (its joints are not heeded), or a GLB whose meshes
    are the parts."""
    library: str | None = None
    """Take the parts of a procedural category, e.g. cabinet:3, or of the folder of a
    PartNet-Mobility object."""
    out: Path | None = None
    """Folder that is made; by default made/<object>. An earlier result there is replaced."""
    joint: str = "auto"
    """auto: the joint that a clip shows, else all; all; or the part whose joint is meant."""
    actor: str = "auto"
    """Who finds the joints: vlm, hybrid, another name, or module:Class; by default a geometric one,
    which asks no model."""
    iterations: int | None = None
    """Most proposals that the critic is shown; by default the actor's own number."""
    dry_run: bool = False
    """Write what a model would be asked to the page <out>.prompts.html, and ask nobody."""
    camera: CameraFlags = field(default_factory=CameraFlags)
    up: Literal["auto", "z", "y"] = "auto"
    """Upward axis of the files of --parts; auto: y for a single GLB, else z."""
    front: Literal["x", "-x", "y", "-y"] = "x"
    """Where the front of the object of --parts is."""
    limit: float = 300.0
    """Time after which the proof is given up [s]."""
    seed: int = 0
    """Seed of all that is random."""
    json: bool = False
    """Print the result as JSON and nothing else on standard output."""

    def __post_init__(self) -> None:
        """Refuse what cannot be made."""
        if self.video is None and self.image is None and self.text is None:
            raise ConfigError("missing: --video, --image or --text; say how the object moves")
        if self.video is not None and self.image is not None:
            raise ConfigError("--video and --image are given; give one of them")
        if self.parts is None and self.library is None:
            raise ConfigError(
                "missing: --parts or --library; joints are found between parts that are known: "
                "give a folder with one mesh for each, a URDF or a GLB, or --library cabinet"
            )
        if self.parts is not None and self.library is not None:
            raise ConfigError("--parts and --library are given; give one of them")
        if self.iterations is not None and self.iterations < 1:
            raise ConfigError(f"--iterations is {self.iterations}; it must be 1 or more")
        if self.seed < 0:
            raise ConfigError(f"--seed is {self.seed}; it must be 0 or more")
        if not self.limit > 0.0:
            raise ConfigError(f"--limit is {self.limit:g} s; it must be above 0")
        if not self.limit <= MOST_LIMIT_S:
            raise ConfigError(
                f"--limit is {self.limit:g} s; it must be at most {MOST_LIMIT_S:.0f} s"
            )


FLAGS = MakeFlags


def main(argv: Sequence[str]) -> int:
    """Make, write and print; 3 if it is doubtful or not proven."""
    flags = parse(MakeFlags, argv, prog="articulate make")
    # They read meshes and films, which --help does without.
    from articulate.reconstruct.make import dry_run, make
    from articulate.reconstruct.result import MakeRequest

    query, part_set = _question(flags), _given(flags)
    camera = _camera(flags, query)
    out = flags.out or Path("made") / part_set.name
    require_space(out, RESULT_BYTES, f"making {part_set.name}")
    cache = cache_folder()
    order = MakeRequest(
        out=out,
        cache=cache,
        actor=flags.actor,
        joint=flags.joint,
        iterations=flags.iterations,
        limit_s=flags.limit,
        seed=flags.seed,
    )
    console.show_progress(f"{part_set.name}: {len(part_set.meshes)} parts, {query.description}")
    if flags.dry_run:
        page = _prompts_page(out)
        asked = dry_run(query, part_set, camera, order, page)
        if flags.json:
            console.emit_json({"questions": asked, "page": str(page)})
        else:
            console.emit(f"{asked} questions, nothing sent: {page}")
        return 0
    with cache_in_use(cache):
        result = make(query, part_set, camera, order)
    if flags.json:
        console.emit_json(result.content())
    else:
        console.emit(_told(result))
    return 0 if result.verdict == "passed" else MISSED


def _prompts_page(out: Path) -> Path:
    """The page beside the folder ``out``, which may be ``.`` or ``..``."""
    folder = out if out.name not in {"", ".."} else out.resolve()
    return folder.parent / f"{folder.name}.prompts.html"


def _question(flags: MakeFlags) -> Query:
    from articulate.reconstruct.query import image_query, text_query, video_query

    said = "" if flags.text is None else text_query(flags.text).text
    if flags.video is not None:
        return video_query(flags.video, said)
    if flags.image is not None:
        return image_query(flags.image, said)
    return text_query(said)


def _given(flags: MakeFlags) -> PartSet:
    from articulate.reconstruct.part_set import library_part_set, read_part_set

    if flags.library is not None:
        return library_part_set(flags.library)
    assert flags.parts is not None
    return read_part_set(flags.parts, up=flags.up, front=flags.front)


def _camera(flags: MakeFlags, query: Query) -> Camera:
    from articulate.reconstruct.query import QueryCamera

    c = flags.camera
    view = QueryCamera(file=c.file, eye=c.eye, target=c.target, fovy=c.fovy)
    return view.camera(*query.size_px)


def _told(result: MakeResult) -> str:
    """What came of it, for a reader."""
    lines = [f"{result.out.name}: {result.verdict} ({result.seconds:.1f} s)"]
    lines += [f"  because  {reason}" for reason in result.reasons]
    for joint in result.joints:
        x, y, z = joint.axis_o
        way = "without end"
        if joint.lower is not None and joint.upper is not None:
            unit = "m" if joint.kind == "prismatic" else "rad"
            way = f"{joint.lower:.3g} to {joint.upper:.3g} {unit}"
        lines.append(
            f"  joint    {joint.part}: {joint.kind}, axis ({x:.2f}, {y:.2f}, {z:.2f}), {way}"
        )
    lines.append(f"  page     {result.out / 'trace.html'}")
    return "\n".join(lines)
