"""Accuracy of marker detection, of the estimators and of the calibrations on rendered images.

``python benchmarks/markers.py --seeds 1000 1001 1002``: seeds below 1000 are for development. The
layout that the estimator gets has errors of measurement: 1 mm and 1 degree for each marker. The
pose of the camera is off by 2 mm and 0.2 degrees. Images are 1280x720 px with noise of 4 of 255 and
blur of 0.6 px; markers are 40 mm; both are covered for 0.5 s of each sequence of 4 s at 20 Hz. The
part is closed at the beginning. ``--preset FILE`` writes the errors of the fused estimator as
ranges of the randomization of training.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from articulate.markers.base_calibration import GripperView, calibrate_base
from articulate.markers.camera_device import Frame
from articulate.markers.detection import MarkerDetector, marker_poses
from articulate.markers.layout import Marker, MarkerLayout
from articulate.markers.object_fit import pose_difference
from articulate.markers.synthetic_images import marker_plane, render_planes
from articulate.markers.tracker import ObjectTracker
from articulate.render.camera import look_at
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import tool_pose
from articulate.task.object_placement import handle_path_of
from articulate.transforms import Array, axis_angle_to_matrix, inverse, pose, rotation_angle
from articulate_deploy.estimators.camera_tracking import SteppedTracking
from articulate_deploy.estimators.gripper_hold import ArmReading
from articulate_deploy.estimators.object_state import (
    EstimatedObject,
    EstimateLostError,
    ObjectStateEstimator,
)
from marker_scenes import HD, MarkedObject, marked_object, reach, render_object

STEP_S, STEPS = 0.05, 80
LAYOUT_M, LAYOUT_RAD = 0.001, np.radians(1.0)
BASE_M, BASE_RAD = 0.002, np.radians(0.2)
COVERED = range(45, 55)
GRASPED = 16
HEADER = "# Errors of the fused marker estimator on rendered images, see docs/guides/locate.md.\n"


def turned(rng: np.random.Generator, angle: float) -> Array:
    """Return a rotation matrix (3, 3) by ``angle`` [rad] about a random axis."""
    axis = rng.normal(size=3)
    return axis_angle_to_matrix(axis / np.linalg.norm(axis), angle)


def measured_layout(layout: MarkerLayout, rng: np.random.Generator) -> MarkerLayout:
    """Return the layout with errors of measurement."""

    def off(marker: Marker) -> Marker:
        R = turned(rng, LAYOUT_RAD)
        x, y, z = np.array(marker.center_m) + LAYOUT_M * rng.normal(size=3) / np.sqrt(3.0)
        normal, up = (R @ np.array(marker.normal)).tolist(), (R @ np.array(marker.up)).tolist()
        return replace(
            marker, center_m=(float(x), float(y), float(z)), normal=tuple(normal), up=tuple(up)
        )

    return replace(layout, markers=tuple(off(marker) for marker in layout.markers))


class Sequence:
    """One opening of a part: the camera, the arm that holds the handle, and the truth."""

    name = "rendered"

    def __init__(self, kind: Literal["slide", "hinge"], seed: int, distance_m: float) -> None:
        self.rng = np.random.default_rng([seed, 1])
        self.thing: MarkedObject = marked_object(kind, seed, distance_m=distance_m)
        self.path = handle_path_of(self.thing.asset, self.thing.joint)
        self.step, self.q, self.width = 0, 0.0, 0.08
        self.arm_q = np.asarray(PANDA.home, dtype=np.float64)
        self.seconds = 0.0

    def read(self) -> Frame:
        """Return an image of the present state."""
        covered = (0, 1) if self.step in COVERED else ()
        image = render_object(self.thing, self.q, self.rng, covered=covered)
        self.seconds -= time.process_time()  # the time of the tracker only
        return Frame(image, self.clock())

    def clock(self) -> float:
        """Return the time [s]."""
        return self.step * STEP_S

    def close(self) -> None:
        """Do nothing."""

    def reading(self) -> ArmReading:
        """Return the state of the arm."""
        return ArmReading(self.arm_q, self.width)

    def advance(self) -> None:
        """Move the part and the arm by one control step."""
        self.step += 1
        if self.step == GRASPED:
            self.width = 0.02
        share = np.clip((self.step - GRASPED - 6) / (STEPS - GRASPED - 14), 0.0, 1.0)
        smooth = share * share * (3.0 - 2.0 * share)
        self.q = float(0.8 * smooth * self.path.span)
        if self.step >= GRASPED:
            T_wh = self.path.in_world(
                T_wo=self.thing.T_wo[None],
                scale=np.ones(1),
                opened=np.array([self.q / self.path.span]),
            )
            self.arm_q = reach(self.arm_q, T_wh[0, :3, 3] + 0.015 * T_wh[0, :3, 0])


def run_sequence(
    kind: Literal["slide", "hinge"], seed: int, distance_m: float, fused: bool
) -> dict[str, Any]:
    """Return errors of the joint [m or rad] and of the handle [m], and the time of an image."""
    scene = Sequence(kind, seed, distance_m)
    thing, rng = scene.thing, np.random.default_rng([seed, 2])
    layout = measured_layout(thing.layout, rng)
    T_wc = thing.T_wc @ pose(BASE_M * rng.normal(size=3) / np.sqrt(3.0), turned(rng, BASE_RAD))
    tracker = ObjectTracker(thing.asset, thing.joint, layout, HD)
    estimator = ObjectStateEstimator(
        EstimatedObject(
            asset=thing.asset, joint=thing.joint, flip=False, T_wo=thing.T_wo, start=0.0
        ),
        clock=scene.clock,
        camera=SteppedTracking(scene, tracker, layout, delay_s=STEP_S, clock=scene.clock),
        T_wc=T_wc,
        arm=(PANDA, scene.reading) if fused else None,
    )
    estimator.reset()
    joint, handle, speed, shift_w, yaw, true_speed = [], [], [], [], [], []
    scene.seconds, lost = 0.0, False
    last = scene.q
    for _ in range(STEPS):
        scene.advance()
        try:
            estimator.update()
        except EstimateLostError:
            scene.seconds += time.process_time()
            lost = True
            break
        scene.seconds += time.process_time()
        found = estimator.estimate()
        joint.append(float(found.opened[0]) * scene.path.span - scene.q)
        true = scene.path.in_world(
            T_wo=thing.T_wo[None], scale=np.ones(1), opened=np.array([scene.q / scene.path.span])
        )
        shift_w.append(found.T_wh[0, :3, 3] - true[0, :3, 3])
        handle.append(float(np.linalg.norm(shift_w[-1])))
        turn = found.T_wh[0, :3, :3] @ true[0, :3, :3].T
        yaw.append(float(np.arctan2(turn[1, 0], turn[0, 0])))
        speed.append(abs(float(found.speed[0]) - (scene.q - last) / STEP_S))
        true_speed.append((scene.q - last) / STEP_S)
        last = scene.q
    return {
        "joint": joint,
        "shift_w": np.array(shift_w),
        "yaw": yaw,
        "true_speed": true_speed,
        "handle": handle,
        "speed": speed,
        "seconds": scene.seconds / STEPS,
        "lost": lost,
    }


def lag_steps(found: dict[str, Any]) -> float:
    """Return the age of the estimate that explains most of its error in a sequence."""
    error, speed = np.array(found["joint"]), np.array(found["true_speed"])
    error = error - error.mean()
    return float(-(error @ speed) / (speed @ speed) / STEP_S)


def preset(errors: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return ranges of the randomization from the sequences of the fused estimator by joint."""
    every = [f for found in errors.values() for f in found]
    means = np.array([f["shift_w"].mean(axis=0) for f in every])
    spread = np.concatenate([f["shift_w"] - f["shift_w"].mean(axis=0) for f in every])
    yaw = np.array([np.mean(f["yaw"]) for f in every])
    rms = {
        kind: float(np.sqrt(np.mean(np.concatenate([f["joint"] for f in found]) ** 2)))
        for kind, found in errors.items()
    }
    return {
        "estimate_bias_m": round(float(np.sqrt(np.mean(means**2))), 4),
        "estimate_noise_m": round(float(np.sqrt(np.mean(spread**2))), 4),
        "estimate_yaw_rad": round(float(np.sqrt(np.mean(yaw**2))), 4),
        "part_noise": round(max(rms["slide"] / 0.3, rms["hinge"]), 4),
        "estimate_delay_steps": [0, max(1, int(np.ceil(max(map(lag_steps, every)))))],
    }


def estimator_rows(
    seeds: list[int], distances: list[float]
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return a row for each kind of joint, estimator and distance, and the preset."""
    rows = []
    errors: dict[str, list[dict[str, Any]]] = {"slide": [], "hinge": []}
    kinds: tuple[Literal["slide", "hinge"], ...] = ("slide", "hinge")
    for kind in kinds:
        unit, scale = ("mm", 1000.0) if kind == "slide" else ("deg", 57.29578)
        for fused in (False, True):
            for distance_m in distances:
                found = [run_sequence(kind, seed, distance_m, fused) for seed in seeds]
                joint = scale * np.abs(np.concatenate([f["joint"] for f in found]))
                if fused:
                    errors[kind] += found
                handle = 1000.0 * np.concatenate([f["handle"] for f in found])
                rows.append(
                    {
                        "joint": kind,
                        "estimator": "fused" if fused else "markers",
                        "distance_m": distance_m,
                        "unit": unit,
                        "lost": sum(f["lost"] for f in found),
                        "median": float(np.median(joint)),
                        "p95": float(np.percentile(joint, 95)),
                        "max": float(joint.max()),
                        "handle_mm_median": float(np.median(handle)),
                        "handle_mm_p95": float(np.percentile(handle, 95)),
                        "speed_p95": float(
                            scale * np.percentile(np.concatenate([f["speed"] for f in found]), 95)
                        ),
                        "ms_per_image": float(1000.0 * np.mean([f["seconds"] for f in found])),
                    }
                )
                print_row(rows[-1])
    return rows, preset(errors)


def detection_rows(seeds: list[int]) -> list[dict[str, Any]]:
    """Return the accuracy of one marker of 50 mm with and without fitted edges."""
    rows = []
    marker = Marker(id=3, link="x", size_m=0.05, center_m=(0, 0, 0), normal=(1, 0, 0))
    for lines in (False, True):
        detector = MarkerDetector("4x4_50", refine_edges=lines)
        for distance in (0.5, 1.0):
            errors, seconds = [], 0.0
            for seed in seeds:
                rng = np.random.default_rng([seed, 3])
                for _ in range(8):
                    azimuth, tilt = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(11, 57))
                    axis = (np.cos(azimuth), np.sin(azimuth), 0.0)
                    R = axis_angle_to_matrix(axis, tilt) @ np.diag([1.0, -1.0, -1.0])
                    T_cm = pose((*(0.2 * distance * rng.uniform(-1, 1, 2)), distance), R)
                    image = render_planes(HD, [marker_plane("4x4_50", marker, T_cm)], rng)
                    begin = time.process_time()
                    corners = detector.detect(image).get(3)
                    seconds += time.process_time() - begin
                    if corners is None:
                        continue
                    found = marker_poses(corners, 0.05, HD.K, HD.dist)[0].T_cm
                    e = found[:3, 3] - T_cm[:3, 3]
                    turn = np.degrees(rotation_angle(found[:3, :3].T @ R))
                    errors.append((1000 * np.hypot(e[0], e[1]), 1000 * abs(e[2]), turn))
            n = 8 * len(seeds)
            middle, worst = np.median(errors, axis=0), np.max(errors, axis=0)
            rows.append(
                {
                    "corners": "fitted edges" if lines else "SUBPIX",
                    "distance_m": distance,
                    "missed": n - len(errors),
                    "of": n,
                    "lateral_mm": [float(middle[0]), float(worst[0])],
                    "depth_mm": [float(middle[1]), float(worst[1])],
                    "rotation_deg": [float(middle[2]), float(worst[2])],
                    "ms": 1000.0 * seconds / n,
                }
            )
            print_row(rows[-1])
    return rows


def base_row(seeds: list[int]) -> dict[str, Any]:
    """Return the error of the camera's pose from 15 rendered images of a marker on the gripper."""
    shifts, turns = [], []
    marker = Marker(id=2, link="x", size_m=0.04, center_m=(0, 0, 0), normal=(1, 0, 0))
    detector = MarkerDetector("4x4_50")
    middle = np.array([0.1, 0.0, 0.1, -2.2, 0.1, 2.3, 0.8])
    for seed in seeds:
        rng = np.random.default_rng([seed, 4])
        T_tm = pose((0.0, 0.03, -0.05), axis_angle_to_matrix((1, 0, 0), -2.0 + 0.2 * rng.normal()))
        T_wm = tool_pose(PANDA, middle) @ T_tm
        eye = T_wm[:3, 3] + 0.7 * T_wm[:3, 2] + 0.1 * rng.normal(size=3)
        T_wc = look_at(eye, T_wm[:3, 3])
        views: list[GripperView] = []
        while len(views) < 15:
            q = middle + 0.7 * rng.uniform(-1, 1, 7) * (0.2, 0.3, 0.3, 0.3, 0.7, 0.7, 0.9)
            plane = marker_plane("4x4_50", marker, inverse(T_wc) @ tool_pose(PANDA, q) @ T_tm)
            corners = detector.detect(render_planes(HD, [plane], rng)).get(2)
            if corners is not None:
                found = marker_poses(corners, 0.04, HD.K, HD.dist)[0].T_cm
                views.append(GripperView("", tool_pose(PANDA, q), found, corners))
        error = pose_difference(T_wc, calibrate_base(views, HD, 0.04)[0].T_wc)
        shifts.append(1000 * float(np.linalg.norm(error[:3])))
        turns.append(float(np.degrees(np.linalg.norm(error[3:]))))
    row = {
        "base calibration": len(seeds),
        "position_mm": [float(np.median(shifts)), max(shifts)],
        "rotation_deg": [float(np.median(turns)), max(turns)],
    }
    print_row(row)
    return row


def print_row(row: dict[str, Any]) -> None:
    """Print a row, unless only JSON is printed."""
    if QUIET:
        return

    def text(value: Any) -> str:
        if isinstance(value, list):
            return "/".join(map(text, value))
        return f"{value:.3g}" if isinstance(value, float) else str(value)

    print("  ".join(f"{name} {text(value)}" for name, value in row.items()), flush=True)


QUIET = False


def main() -> None:
    """Run all measurements."""
    global QUIET  # noqa: PLW0603
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1], help="seeds of the scenes")
    parser.add_argument(
        "--distances",
        type=float,
        nargs="+",
        default=[0.5, 0.75, 1.0],
        help="distances of the camera [m]",
    )
    parser.add_argument("--preset", type=Path, help="file of the randomization to write")
    parser.add_argument("--json", action="store_true", help="print the complete result as JSON")
    arguments = parser.parse_args()
    QUIET = arguments.json
    rows, ranges = estimator_rows(arguments.seeds, arguments.distances)
    print_row(ranges)
    if arguments.preset is not None:
        seeds = " ".join(map(str, arguments.seeds))
        command = f"python benchmarks/markers.py --seeds {seeds} --preset {arguments.preset}"
        lines = "".join(f"  {name}: {value}\n" for name, value in ranges.items())
        arguments.preset.write_text(f"{HEADER}# {command}\nrandomization:\n{lines}")
    result = {
        "seeds": arguments.seeds,
        "estimators": rows,
        "preset": ranges,
        "detection": detection_rows(arguments.seeds),
        "base": base_row(arguments.seeds),
    }
    if arguments.json:
        print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
