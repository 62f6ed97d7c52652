# ruff: noqa: E501  # tables of one row a line
"""Hostile inputs of deployment, of the estimators and of the studio."""

from __future__ import annotations

from collections.abc import Iterator

from tests.hostile.changes import JSON_TEXTS, MESH_CHANGES, YAML_TEXTS
from tests.hostile.reader import Reader, kinds, texts, xml
from tests.hostile.recordings import ARRAYS, LOGS, REPORTS, RESULTS
from tests.hostile.writers import Change, data, in_json, npz_of, text

FEW = ("fifo", "device", "link outside", "folder", "empty", "junk", "truncated", "290 MB")
RECORDING = {"recording": "in/recording", "bundle": "in/bundle"}
REPORT = Reader(
    argv=("deploy", "report", "in/recording"),
    inputs=RECORDING,
    file="in/recording/episode_0000.npz",
)
REPLAY = Reader(
    argv=("deploy", "replay", "in/recording", "in/bundle"), inputs=RECORDING, file=REPORT.file
)
CONVERT = Reader(
    argv=("deploy", "convert", "in/recording", "--to", "rerun", "--out", "out.rrd"),
    inputs=RECORDING,
    file=REPORT.file,
)
SIGN = Reader(
    argv=("deploy", "sign", "in/bundle", "--key", "in/author.key"),
    inputs={"bundle": "in/bundle", "key": "in/author.key"},
    file="in/author.key",
)
VERIFY = Reader(
    argv=("deploy", "verify", "in/bundle", "--public-key", "11" * 32),
    inputs={"bundle": "in/bundle", "key": "in/bundle.sig"},
    file="in/bundle.sig",
)
SENSORS = {"sensors": "in/sensors"}
ESTIMATOR = Reader(
    argv=("deploy", "in/bundle", "--estimator", "in/sensors/estimator.yaml", "--out", "out"),
    inputs={"bundle": "in/bundle", **SENSORS},
    file="in/sensors/estimator.yaml",
)
PLACE = Reader(
    argv=("train", "--asset", "in/asset", "--placement", "in/sensors/placement.json", "--dry-run"),
    inputs={"asset": "in/asset", **SENSORS},
    file="in/sensors/placement.json",
)
LOCATE = Reader(
    argv=("locate", "--asset", "in/asset", "--joint", "drawer", "--layout",
          "in/sensors/layout.yaml", "--calibration", "in/sensors/calibration.json",
          "--camera-pose", "in/sensors/pose.json", "--images", "in/sensors/view.png",
          "--out", "out"),
    inputs={"asset": "in/asset", **SENSORS},
    file="in/sensors/view.png",
)  # fmt: skip
POSES = Reader(
    argv=("calibrate", "base", "--poses", "in/sensors/poses.json", "--calibration",
          "in/sensors/calibration.json", "--marker-mm", "40", "--out", "out"),
    inputs=SENSORS,
    file="in/sensors/poses.json",
)  # fmt: skip
BOARD = Reader(
    argv=("calibrate", "camera", "--images", "in/sensors/view.png", "--out", "out"),
    inputs=SENSORS,
    file="in/sensors/view.png",
)
SCAN = Reader(
    argv=("make", "--scan", "in/scan/scan.glb", "--out", "out"),
    inputs={"scan": "in/scan"},
    file="in/scan/scan.glb",
)
MASKS = Reader(
    argv=("make", "--scan", "in/scan/scan.glb", "--masks", "in/scan/masks.npz", "--out", "out"),
    inputs={"scan": "in/scan"},
    file="in/scan/masks.npz",
)
STUDIO = Reader(
    argv=("studio", "in/asset", "--no-browser"),
    inputs={"asset": "in/asset"},
    file="in/asset/edits.json",
)

CALIBRATIONS: dict[str, Change] = {
    "size of 1e9": in_json("width_px", value=1_000_000_000),
    "negative size": in_json("height_px", value=-1),
    "focal length of zero": in_json("matrix", 0, 0, value=0.0),
    "no matrix": in_json("matrix", value=3),
    "long name": in_json("camera", value="x" * 100_000),
    "distortion of texts": in_json("distortion", value=["a"] * 5),
}
CAMERA_POSES: dict[str, Change] = {
    "zero quaternion": in_json("quat_w", value=[0, 0, 0, 0]),
    "quaternion of three": in_json("quat_w", value=[0, 0, 1]),
    "other schema": in_json("schema", value="x" * 100_000),
}
PLACEMENTS: dict[str, Change] = {
    "far away": in_json("pose", "x_m", value=1e30),
    "text": in_json("pose", "x_m", value="here"),
    "list": in_json("pose", value=[1, 2, 3]),
}
LAYOUTS: dict[str, Change] = {
    "no markers": text("markers: []\n"),
    "marker of text": text("markers: [0]\n"),
    "marker far away": text("markers:\n - {id: 0, link: body, size_m: 0.04, center_m: [.inf, 0, 0], normal: [1, 0, 0]}\n"),
    "marker without size": text("markers:\n - {id: 0, link: body, center_m: [0, 0, 0], normal: [1, 0, 0]}\n"),
    "100,000 markers": text("markers:\n" + " - {id: 1, link: body, size_m: 0.04, center_m: [0, 0, 0], normal: [1, 0, 0]}\n" * 10_000),
    "unknown dictionary": text("dictionary: %s\nmarkers: []\n" % ("x" * 10_000)),
}  # fmt: skip
ESTIMATORS: dict[str, Change] = {
    "layout of nothing": text("kind: markers\nlayout: /dev/zero\n"),
    "layout is a folder": text("kind: markers\nlayout: .\ncalibration: calibration.json\ncamera_pose: pose.json\n"),
    "unknown kind": text("kind: %s\n" % ("x" * 10_000)),
    "endless age": text("kind: arm\nmax_age_s: .inf\n"),
    "unknown key": text("kind: arm\n%s: 1\n" % ("x" * 10_000)),
    "list": text("- kind\n"),
}  # fmt: skip
POSE_LISTS: dict[str, Change] = {
    "image outside": in_json("poses", 0, "image", value="/etc/passwd"),
    "image is a device": in_json("poses", 0, "image", value="/dev/zero"),
    "angles of three": in_json("poses", 0, "q", value=[0, 0, 0]),
    "angles of texts": in_json("poses", 0, "q", value=["a"] * 7),
    "100,000 poses": text('{"poses": [' + '{"image": "a", "q": []}, ' * 100_000 + "{}]}"),
    "unknown robot": in_json("robot", value="x" * 10_000),
}
MASK_FILES: dict[str, Change] = {
    "array of 1e12": data(npz_of("(1000000, 1000000)")),
    "bomb": data(npz_of("(40000000,)", bytes(320_000_000))),
    "deep shape": data(npz_of("(" * 5000)),
    "labels of floats": data(npz_of("(12,)", bytes(96))),
}
HISTORIES: dict[str, Change] = {
    "no schema": text('{"edits": []}'),
    "edit is a number": text('{"schema": "articulate.edits", "edits": [1]}'),
    "unknown edit": text('{"schema": "articulate.edits", "edits": [{"type": "%s"}]}' % ("x" * 9999)),
    "fields of another type": text('{"schema": "articulate.edits", "edits": [{"type": "set_joint", "part": 3, "axis_o": "up"}]}'),
}  # fmt: skip


def arm_rows() -> Iterator[tuple[str, Reader, dict[str, Change]]]:
    """Yield groups of cases: a name, the reader, and the changes."""
    yield (
        "log of report",
        REPORT,
        kinds("fifo", "device", "folder", "empty", "junk", "290 MB") | LOGS,
    )
    yield "recording of replay", REPLAY, kinds("fifo", "junk") | LOGS
    yield "recording of convert", CONVERT, kinds("fifo", "junk") | LOGS
    yield "arrays of report", REPORT, ARRAYS
    yield "arrays of convert", CONVERT, ARRAYS
    results = REPLAY.at("in/recording/episodes.jsonl")
    yield "results of replay", results, kinds("fifo", "device", "folder", "290 MB") | RESULTS
    summary = REPORT.at("in/recording/report.json")
    yield "report of report", summary, kinds(*FEW) | REPORTS
    yield "key", SIGN, kinds(*(k for k in FEW if k != "truncated")) | {"short": text("1122\n")}
    yield "signature", VERIFY, kinds(*FEW) | texts(JSON_TEXTS)
    yield "estimator", ESTIMATOR, kinds(*FEW) | texts(YAML_TEXTS) | ESTIMATORS
    layout = ESTIMATOR.at("in/sensors/layout.yaml")
    yield "layout", layout, kinds(*FEW) | texts(YAML_TEXTS) | LAYOUTS
    calibration = ESTIMATOR.at("in/sensors/calibration.json")
    yield "calibration", calibration, kinds(*FEW) | texts(JSON_TEXTS) | CALIBRATIONS
    pose = ESTIMATOR.at("in/sensors/pose.json")
    yield "camera pose", pose, kinds(*FEW) | texts(JSON_TEXTS) | CAMERA_POSES
    yield "placement", PLACE, kinds(*FEW) | texts(JSON_TEXTS) | PLACEMENTS
    yield "image of locate", LOCATE, kinds(*FEW, "5 GB")
    yield "poses", POSES, kinds(*FEW) | texts(JSON_TEXTS) | POSE_LISTS
    yield "image of the board", BOARD, kinds(*FEW, "5 GB")
    yield "scan", SCAN, kinds(*FEW) | MESH_CHANGES[".glb"]
    yield "masks", MASKS, kinds(*FEW, "pickle") | MASK_FILES
    yield "edits", STUDIO, texts(JSON_TEXTS) | HISTORIES
    urdf = STUDIO.at("in/asset/object.urdf")
    yield "urdf of the studio", urdf, kinds("fifo", "folder", "empty", "junk") | xml("robot")
