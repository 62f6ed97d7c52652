"""``articulate locate``: pose of an object from markers, as a placement file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from articulate.commands import console
from articulate.commands.flags import parse
from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class LocateFlags:
    """Measure where an object is, from markers on it, and write a placement file.

    The object and the camera are at rest. The file serves `train --placement` and the key
    `placement` of the estimator file of `deploy`.

    Example: articulate locate --asset cabinet.urdf --joint drawer --layout markers.yaml
    --calibration webcam.json --camera-pose webcam-pose.json --device 0
    """

    asset: Path
    """URDF, MJCF or SDF file of the object, or an asset folder."""
    joint: str
    """Joint with a marker on the part that it moves."""
    layout: Path
    """Marker layout of the object (YAML)."""
    calibration: Path
    """Calibration of the camera (JSON)."""
    camera_pose: Path
    """Pose of the camera in the base frame (JSON), from `articulate calibrate base`."""
    images: tuple[Path, ...] = ()
    """Images or folders of images."""
    device: str | None = None
    """Video device to record from instead: its number, path or address."""
    count: int = 10
    """Images to record from the device."""
    size: float | None = None
    """Longest side of the object [m], as for train."""
    out: Path = Path("placement.json")
    """Placement file to write (JSON)."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""

    def __post_init__(self) -> None:
        if not self.images and self.device is None:
            raise ConfigError("locate: give --images or --device")
        if not 1 <= self.count <= 1000:
            raise ConfigError(f"--count is {self.count}; it must be in [1, 1000]")


FLAGS = LocateFlags


def main(argv: Sequence[str]) -> int:
    """Measure and write the placement file."""
    flags = parse(LocateFlags, argv, prog="articulate locate")
    from articulate.cache import cache_folder, cache_in_use
    from articulate.config import to_plain
    from articulate.conversion import ConvertConfig
    from articulate.markers.camera_calibration import load_calibration, load_camera_pose
    from articulate.markers.camera_device import image_files, read_gray
    from articulate.markers.capture import record_images
    from articulate.markers.layout import load_layout
    from articulate.markers.locate import locate_object
    from articulate.preparation.prepare import load_checked_asset
    from articulate.task.floor_pose import save_location

    calibration = load_calibration(flags.calibration)
    camera_pose = load_camera_pose(flags.camera_pose)
    calibration.check_camera(camera_pose.camera)
    layout = load_layout(flags.layout)
    cache = cache_folder()
    with cache_in_use(cache):
        asset = load_checked_asset(flags.asset, cache, ConvertConfig(size_m=flags.size))
        if flags.device is not None:
            size_px = (calibration.width_px, calibration.height_px)
            images = record_images(flags.device, calibration.camera, size_px, flags.count)
        else:
            images = [(path.name, read_gray(path)) for path in image_files(flags.images)]
        found = locate_object(images, asset, flags.joint, layout, calibration, camera_pose)
    save_location(flags.out, found)
    if flags.json:
        console.emit_json(to_plain(found))
        return 0
    at = found.pose
    lines = [
        f"{flags.out}: {found.object} at x {at.x_m:.3f} m, y {at.y_m:.3f} m, z {at.z_m:.3f} m, yaw "
        f"{at.yaw_deg:.1f} degrees, from {found.images} of {len(images)} images",
        f"  spread   {1000.0 * found.spread_m:.1f} mm, {found.spread_deg:.2f} degrees; "
        f"{found.lean_deg:.1f} degrees from upright",
        *(f"  joint    {name} at {q:.4f}" for name, q in found.joints.items()),
        f"  next     train --asset {flags.asset} --placement {flags.out}",
    ]
    console.emit("\n".join(lines))
    return 0
