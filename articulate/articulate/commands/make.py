"""``articulate make``: an object from a video, image, text or mesh, with or without its parts."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from articulate.cache import cache_folder, cache_in_use
from articulate.commands import console
from articulate.commands.flags import parse
from articulate.commands.success import MISSED
from articulate.errors import ConfigError
from articulate.files import require_space

if TYPE_CHECKING:
    from articulate.reconstruct.actors.vlm.options import ModelOptions
    from articulate.reconstruct.part_set import PartSet
    from articulate.reconstruct.query import Query
    from articulate.reconstruct.recognition.library_index import LibraryIndex
    from articulate.reconstruct.result import MakeResult
    from articulate.render.camera import Camera

MODEL_ACTORS = ("vlm", "hybrid")
RESULT_BYTES = 20_000_000
"""Approximate size of a result [bytes]."""
MOST_LIMIT_S = 1e6
"""Largest time limit [s]."""
FRONT_EYE = (3.0, 1.5, 2.0)
FRONT_TARGET = (0.0, 0.0, 0.8)
FRONT_FOVY = 35.0


@dataclass(frozen=True, kw_only=True)
class MakeFlags:
    """Make an object from a text, an image or a video, and write a checked URDF.

    Without --parts or --library the object is generated; otherwise the joints of the known parts
    are found.

    Example: articulate make --video drawer.mp4 --text cabinet --out asset/
    """

    video: Path | None = None
    """Video in which a part moves."""
    image: Path | None = None
    """Image of the object."""
    text: str | None = None
    """Description in English, e.g. "a double-door fridge with a bottom freezer": parts, counts,
    sizes, arrangement, hinges, handles, materials. Without --parts or --library the object is
    generated from it; otherwise it describes the joints."""
    parts: Path | None = None
    """Folder with one mesh for each part, a URDF (its joints are ignored), or a GLB whose meshes
    are the parts."""
    scan: Path | None = None
    """Mesh of an entire object, e.g. a GLB from a scanner or generator, whose parts are found;
    --text, --image and --video of the object, closed at first, help to find them."""
    masks: Path | None = None
    """File with the part of each triangle of --scan: .npz with labels (0 for the body) and names,
    or .json."""
    library: str | None = None
    """Use the parts of a procedural category, e.g. cabinet:3, or of the folder of a
    PartNet-Mobility object. With a folder of many such folders, an object is generated from --image
    or --video, and its category is recognized by renders of theirs; with --actor vlm or hybrid, a
    model chooses parts from them or from procedural."""
    out: Path | None = None
    """Folder that is made; by default made/<object>. An earlier result there is replaced."""
    joint: str = "auto"
    """auto: the joint that moves in the video, otherwise all; all; or the name of a part."""
    actor: str = "auto"
    """Actor that finds the joints: vlm, hybrid, another name, or module:Class; by default a
    geometric one, without a model."""
    model: str = ""
    """Model of the actors vlm and hybrid: [gemini:|openai:|anthropic:]NAME[@URL]; by default that
    of ARTICULATE_MODEL."""
    budget: tuple[str, ...] = ()
    """Limits of the requests to the model: calls=N tokens=N usd=N; usd needs usd_in and usd_out,
    the costs of a million tokens."""
    iterations: int | None = None
    """Maximum number of proposals for the critic; by default that of the actor."""
    dry_run: bool = False
    """Write the prompts to the page <out>.prompts.html without sending requests."""
    camera_file: Path | None = None
    """JSON file with width_px, height_px, fx_px, fy_px, cx_px, cy_px and T_oc of the camera, as
    the benchmark exports it; it replaces the other camera flags."""
    camera_eye: tuple[float, float, float] = FRONT_EYE
    """Position of the camera in the frame of the parts [m]; by default that of the benchmark."""
    camera_target: tuple[float, float, float] = FRONT_TARGET
    """Point in the middle of the image [m]."""
    camera_fovy: float = FRONT_FOVY
    """Vertical field of view [deg]."""
    up: Literal["auto", "z", "y"] = "auto"
    """Upward axis of the files of --parts or --scan; auto: y for a single GLB, else z."""
    front: Literal["x", "-x", "y", "-y"] = "x"
    """Direction of the front of the object of --parts or --scan."""
    limit: float = 300.0
    """Time limit of the checks [s]."""
    size: float | None = None
    """Height of the object [m]; by default usual for the category. For objects from an image or
    video without known parts, and of --scan."""
    seed: int = 0
    """Random seed."""
    studio: bool = False
    """Open articulate studio if the result is not passed."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""

    def __post_init__(self) -> None:
        """Check the values of the flags."""
        if self.scan is not None:
            self._check_scan()
        elif self.masks is not None:
            raise ConfigError("--masks needs --scan; give the mesh that it belongs to")
        elif self.video is None and self.image is None and self.text is None:
            raise ConfigError(
                "missing: --text, --image, --video or --scan; give one that describes the object"
            )
        if self.video is not None and self.image is not None:
            raise ConfigError("--video and --image are given; give one of them")
        if self.generates:
            self._check_without_parts()
        if self.parts is not None and self.library is not None:
            raise ConfigError("--parts and --library are given; give one of them")
        self._check_values()

    @property
    def recognizes(self) -> bool:
        """True if a library of many objects is given to recognize the category."""
        from articulate.reconstruct.library_choice import PROCEDURAL, is_many

        seen = self.image is not None or self.video is not None
        if not seen or self.library in (None, PROCEDURAL) or self.actor in MODEL_ACTORS:
            return False
        return is_many(str(self.library))

    @property
    def generates(self) -> bool:
        """True if the object is generated, without known parts."""
        known = self.parts is not None or self.scan is not None
        return not known and (self.library is None or self.recognizes)

    @property
    def chooses(self) -> bool:
        """True if a model chooses the parts from a library of many objects."""
        from articulate.reconstruct.library_choice import is_many

        return self.library is not None and self.actor in MODEL_ACTORS and is_many(self.library)

    def _check_values(self) -> None:
        """Check numbers, and that the page is not combined with results for programs."""
        if self.studio and (self.json or self.dry_run):
            raise ConfigError("--studio is interactive; omit it, or --json and --dry-run")
        if self.size is not None and not 0.02 <= self.size <= 10.0:
            raise ConfigError(f"--size is {self.size:g} m; it must be 0.02 to 10")
        seen = self.image is not None or self.video is not None
        if self.size is not None and self.scan is None and not (self.generates and seen):
            how = 'write it in the text, e.g. "0.9 m high"' if self.generates else "omit it"
            raise ConfigError(f"--size is for --scan, --image and --video without parts; {how}")
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

    def _check_scan(self) -> None:
        """Check the flags for an object from one mesh."""
        for flag, is_set in (
            ("--parts", self.parts is not None),
            ("--library", self.library is not None),
            ("--actor", self.actor != "auto"),
            ("--model", bool(self.model)),
            ("--budget", bool(self.budget)),
            ("--iterations", self.iterations is not None),
            ("--dry-run", self.dry_run),
            ("--camera-file", self.camera_file is not None),
        ):
            if is_set:
                raise ConfigError(f"--scan and {flag} are given; omit one of them")
        if self.masks is not None and (self.video is not None or self.image is not None):
            raise ConfigError("--masks and a video or image are given; omit one of them")

    def _check_without_parts(self) -> None:
        """Check the flags for an object that is generated."""
        for flag, is_set in (
            ("--actor", self.actor != "auto"),
            ("--joint", self.joint not in {"auto", "all"}),
            ("--model", bool(self.model)),
            ("--budget", bool(self.budget)),
            ("--iterations", self.iterations is not None),
            ("--dry-run", self.dry_run),
            ("--camera-file", self.camera_file is not None),
        ):
            if is_set:
                raise ConfigError(
                    f"{flag} needs known parts; give --parts or --library, or omit {flag}"
                )


FLAGS = MakeFlags


def main(argv: Sequence[str]) -> int:
    """Make, write and print; 3 if the result is doubtful or did not pass."""
    flags = parse(MakeFlags, argv, prog="articulate make")
    if flags.scan is not None:
        return _print(flags, _scan(flags, flags.scan))
    if flags.generates:
        return _print(flags, _generate(flags))
    # These read meshes and videos, which --help does without.
    from articulate.reconstruct.actors.vlm.options import LEDGER, ModelOptions

    query = _query(flags)
    if flags.dry_run and flags.chooses:
        raise ConfigError(
            f"--dry-run --library {flags.library}: later requests depend on the chosen object; "
            "give one object, e.g. cabinet:3"
        )
    with tempfile.TemporaryDirectory() as folder:
        models = ModelOptions(
            model=flags.model, budget=flags.budget, ledger=str(Path(folder) / LEDGER)
        )
        if flags.model == "" and not flags.budget and not flags.chooses:
            models = ModelOptions()
        part_set = _part_set(flags, query, models)
        return _make(flags, query, part_set, models)


def _make(flags: MakeFlags, query: Query, part_set: PartSet, models: ModelOptions) -> int:
    """Find the joints of known parts, write and print."""
    from articulate.reconstruct.make import dry_run, make
    from articulate.reconstruct.result import MakeRequest

    camera = _camera(flags, query)
    out = flags.out or Path("made") / part_set.name
    require_space(out, RESULT_BYTES, f"making {part_set.name}")
    cache = cache_folder()
    request = MakeRequest(
        out=out,
        cache=cache,
        actor=flags.actor,
        models=models,
        joint=flags.joint,
        iterations=flags.iterations,
        limit_s=flags.limit,
        seed=flags.seed,
        progress=console.show_progress,
    )
    console.show_progress(f"{part_set.name}: {len(part_set.meshes)} parts, {query.description}")
    if flags.dry_run:
        page = _prompts_page(out)
        size = dry_run(query, part_set, camera, request, page)
        if flags.json:
            console.emit_json({"page": str(page), **vars(size)})
        else:
            console.emit(
                f"{size.requests} to {size.requests_max} requests, about {size.tokens_in:,} to "
                f"{size.tokens_in_max:,} input tokens; dry run, no requests sent: {page}"
            )
        return 0
    with cache_in_use(cache):
        result = make(query, part_set, camera, request)
    return _print(flags, result)


def _generate(flags: MakeFlags) -> MakeResult:
    """Make the object of a text, an image or a video without known parts."""
    from articulate.reconstruct.make_object import make_object
    from articulate.reconstruct.propose import propose_object
    from articulate.reconstruct.result import MakeRequest

    start = time.monotonic()
    query = _query(flags)
    cache = cache_folder()
    proposal = propose_object(query, height_m=flags.size, library=_library(flags, cache))
    out = flags.out or Path("made") / proposal.name
    require_space(out, RESULT_BYTES, f"making {proposal.name}")
    request = MakeRequest(
        out=out,
        cache=cache,
        limit_s=flags.limit,
        seed=flags.seed,
        progress=console.show_progress,
    )
    console.show_progress(f"{proposal.name}: {len(proposal.parts)} parts, {query.description}")
    with cache_in_use(cache):
        return make_object(query, proposal, request, proposal_s=time.monotonic() - start)


def _library(flags: MakeFlags, cache: Path) -> LibraryIndex | None:
    """Open the library that helps to recognize the category."""
    if flags.library is None:
        return None
    from articulate.reconstruct.recognition.library_index import open_index

    with cache_in_use(cache):
        return open_index(Path(flags.library), cache, console.show_progress)


def _scan(flags: MakeFlags, path: Path) -> MakeResult:
    """Make the object of one mesh."""
    from articulate.reconstruct.query import text_query
    from articulate.reconstruct.result import MakeRequest
    from articulate.reconstruct.scan.make_scan import make_scan
    from articulate.reconstruct.scan.read_scan import ScanHints

    out = flags.out or Path("made") / path.stem
    require_space(out, RESULT_BYTES, f"making {path.stem}")
    cache = cache_folder()
    request = MakeRequest(
        out=out,
        cache=cache,
        joint=flags.joint,
        limit_s=flags.limit,
        seed=flags.seed,
        progress=console.show_progress,
    )
    hints = ScanHints(
        up=flags.up,
        front="auto" if flags.front == "x" else flags.front,
        text="" if flags.text is None else text_query(flags.text).text,
        height_m=flags.size,
        masks=flags.masks,
        view=None if flags.video is None and flags.image is None else _query(flags),
    )
    with cache_in_use(cache):
        return make_scan(path, request, hints)


def _print(flags: MakeFlags, result: MakeResult) -> int:
    """Print the result and return the exit code."""
    if flags.json:
        console.emit_json(result.content())
    else:
        console.emit(_text(result))
    if flags.studio and result.verdict != "passed":
        from articulate.commands.studio import StudioFlags, serve
        from articulate.studio.source import TYPES

        query_file = flags.video or flags.image
        playable = query_file is not None and query_file.suffix.lower() in TYPES
        return serve(StudioFlags(source=result.out, input=query_file if playable else None))
    return 0 if result.verdict == "passed" else MISSED


def _prompts_page(out: Path) -> Path:
    """Return the page beside the folder ``out``, which may be ``.`` or ``..``."""
    folder = out if out.name not in {"", ".."} else out.resolve()
    return folder.parent / f"{folder.name}.prompts.html"


def _query(flags: MakeFlags) -> Query:
    from articulate.reconstruct.query import image_query, text_query, video_query

    text = "" if flags.text is None else text_query(flags.text).text
    if flags.video is not None:
        return video_query(flags.video, text)
    if flags.image is not None:
        return image_query(flags.image, text)
    return text_query(text)


def _part_set(flags: MakeFlags, query: Query, models: ModelOptions) -> PartSet:
    from articulate.reconstruct.library_choice import choose_parts
    from articulate.reconstruct.part_set import library_part_set, read_part_set

    if flags.library is not None and flags.chooses:
        return choose_parts(query, flags.library, models)
    if flags.library is not None:
        return library_part_set(flags.library)
    assert flags.parts is not None
    return read_part_set(flags.parts, up=flags.up, front=flags.front)


def _camera(flags: MakeFlags, query: Query) -> Camera:
    from articulate.reconstruct.query import QueryCamera

    view = QueryCamera(
        file=flags.camera_file,
        eye=flags.camera_eye,
        target=flags.camera_target,
        fovy=flags.camera_fovy,
    )
    return view.camera(*query.size_px)


def _text(result: MakeResult) -> str:
    """Format the result."""
    lines = [f"{result.out.name}: {result.verdict} ({result.seconds:.1f} s)"]
    lines += [f"  because  {reason}" for reason in result.reasons]
    lines += [f"  assumed  {text}" for text in result.assumptions]
    for joint in result.joints:
        x, y, z = joint.axis_o
        limits = "continuous"
        if joint.lower is not None and joint.upper is not None:
            unit = "m" if joint.kind == "prismatic" else "rad"
            limits = f"{joint.lower:.3g} to {joint.upper:.3g} {unit}"
        lines.append(
            f"  joint    {joint.part}: {joint.kind}, axis ({x:.2f}, {y:.2f}, {z:.2f}), {limits}"
        )
    lines.append(f"  page     {result.out / 'trace.html'}")
    return "\n".join(lines)
