"""``articulate calibrate camera|base``: intrinsics of a camera, and its pose in the base frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError

if TYPE_CHECKING:
    from articulate.markers.camera_device import Pixels
    from articulate.markers.charuco import BoardView


@dataclass(frozen=True, kw_only=True)
class CalibrateFlags:
    """Calibrate a camera, or measure its pose in the base frame of the robot.

    `camera` needs images of a ChArUco board (`articulate markers --board`) from different distances
    and angles. `base` needs images of a marker on the gripper and the joint angles of each image.

    Example: articulate calibrate camera --images board/ --camera webcam --out webcam.json
    """

    target: Annotated[Literal["camera", "base"], POSITIONAL]
    """Name of the calibration, camera or base."""
    camera: str = "camera"
    """Name of the camera, recorded in its calibration."""
    images: tuple[Path, ...] = ()
    """Images or folders of images, for camera."""
    device: str | None = None
    """Video device to record from instead: its number, path or address."""
    image_size: tuple[int, int] | None = None
    """Width and height to request from the device [px]."""
    views: int = 20
    """Images with the board to record from the device."""
    columns: int = 5
    """Squares in a row of the board."""
    rows: int = 7
    """Squares in a column of the board."""
    square_mm: float = 35.0
    """Measured side of a square of the board [mm]."""
    board_marker_mm: float = 26.0
    """Measured side of a marker of the board [mm]."""
    dictionary: Literal["4x4_50", "5x5_100", "6x6_250", "apriltag_36h11"] = "4x4_50"
    """Dictionary of the markers."""
    poses: Path | None = None
    """JSON file with the images and joint angles of the arm poses, for base."""
    calibration: Path | None = None
    """Calibration of the camera, for base."""
    marker: int = 2
    """Identifier of the marker on the gripper, for base."""
    marker_mm: float | None = None
    """Measured side of its black square [mm], for base."""
    out: Path | None = None
    """File to write (JSON); by default <camera>.json or <camera>-pose.json."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""

    def __post_init__(self) -> None:
        if self.target == "camera" and not self.images and self.device is None:
            raise ConfigError("calibrate camera: give --images or --device")
        if self.target == "base":
            for name in ("poses", "calibration", "marker_mm"):
                if getattr(self, name) is None:
                    flag = "--" + name.replace("_", "-")
                    raise ConfigError(f"calibrate base: {flag} is missing; see --help")


FLAGS = CalibrateFlags


def main(argv: Sequence[str]) -> int:
    """Calibrate, write the file and print the errors."""
    flags = parse(CalibrateFlags, argv, prog="articulate calibrate")
    return _camera(flags) if flags.target == "camera" else _base(flags)


def _camera(flags: CalibrateFlags) -> int:
    from articulate.config import to_plain
    from articulate.markers.camera_calibration import save_calibration
    from articulate.markers.charuco import Board, BoardDetector, calibrate_camera

    board = Board(
        columns=flags.columns,
        rows=flags.rows,
        square_m=flags.square_mm / 1000.0,
        marker_m=flags.board_marker_mm / 1000.0,
        dictionary=flags.dictionary,
    )
    detector = BoardDetector(board)
    views, size_px, count = _board_views(flags, detector.detect)
    found = calibrate_camera(views, size_px, flags.camera, images=count)
    out = flags.out or Path(f"{flags.camera}.json")
    save_calibration(out, found)
    if flags.json:
        console.emit_json(to_plain(found))
        return 0
    console.emit(
        f"{out}: focal length {found.matrix[0][0]:.1f} {found.matrix[1][1]:.1f} px, reprojection "
        f"error {found.error_px:.2f} px, {found.views} of {count} images, the board covers "
        f"{found.coverage:.0%} of the image area"
    )
    return 0


def _board_views(
    flags: CalibrateFlags, detect: Callable[[Pixels, str], BoardView | None]
) -> tuple[list[BoardView], tuple[int, int], int]:
    """Return the views of the board, the image size [px] and the number of images."""
    from articulate.markers.camera_device import image_files, read_gray
    from articulate.markers.capture import record_views

    if flags.device is not None:
        return record_views(
            flags.device, flags.camera, flags.image_size, flags.views, detect, console.show_progress
        )
    views: list[BoardView] = []
    size_px = (0, 0)
    files = image_files(flags.images)
    for path in files:
        image = read_gray(path)
        size = (image.shape[1], image.shape[0])
        if views and size != size_px:
            raise ConfigError(
                f"{path}: {size[0]}x{size[1]} px, but the images before are "
                f"{size_px[0]}x{size_px[1]}; all must have one size"
            )
        view = detect(image, path.name)
        if view is not None:
            size_px = size
            views.append(view)
    return views, size_px, len(files)


def _base(flags: CalibrateFlags) -> int:
    from articulate.config import to_plain
    from articulate.markers.base_calibration import calibrate_base
    from articulate.markers.camera_calibration import load_calibration, save_camera_pose
    from articulate.markers.gripper_poses import load_gripper_views

    assert flags.poses is not None
    assert flags.calibration is not None
    assert flags.marker_mm is not None
    calibration = load_calibration(flags.calibration)
    size_m = flags.marker_mm / 1000.0
    views, count = load_gripper_views(
        flags.poses, calibration, flags.marker, size_m, flags.dictionary
    )
    found, _ = calibrate_base(views, calibration, size_m)
    out = flags.out or Path(f"{calibration.camera}-pose.json")
    save_camera_pose(out, found)
    if flags.json:
        console.emit_json(to_plain(found))
        return 0
    x, y, z = found.pos_w
    console.emit(
        f"{out}: camera at {x:.3f} {y:.3f} {z:.3f} m; the marker agrees to "
        f"{1000.0 * found.error_m:.1f} mm and {57.2958 * found.error_rad:.2f} degrees over "
        f"{found.poses} of {count} poses"
    )
    return 0
