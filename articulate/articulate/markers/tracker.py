"""Object pose and joint position over a sequence of images of a fixed camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from articulate.assets.asset import Asset
from articulate.markers.camera_calibration import CameraCalibration
from articulate.markers.detection import Detections, MarkerDetector, Pixels
from articulate.markers.layout import MarkerLayout, MarkerModel, marker_model
from articulate.markers.object_fit import ObjectFit, PosePrior, fit_object, pose_difference
from articulate.transforms import Array

FLOOR_STD = np.array([5e-4] * 3 + [2e-3] * 3)
"""Least standard deviation of the pose of a body at rest [m, rad]: errors of corners repeat."""
DRIFT_STD = np.array([1e-4] * 3 + [2e-4] * 3)
"""Standard deviation of the motion of that pose between images [m, rad]."""
MAX_CONTRADICTIONS = 5
"""Successive images that contradict the pose before it is estimated again from one image."""
CONTRADICTION_PX = 1.5
"""Residual at which an image contradicts the pose [px]."""


@dataclass(frozen=True, eq=False)
class ObjectMeasurement:
    """State of the object in one image."""

    time_s: float
    """Time of the exposure [s]."""
    T_co: Array
    """Pose of the object in the camera frame (4, 4) [m], over all images so far."""
    q: float | None
    """Position of the joint in this image [m or rad]; None if its markers were not visible."""
    q_std: float
    """Standard deviation of ``q`` [m or rad]."""
    ids: tuple[int, ...]
    """Identifiers of the visible markers of the layout."""


class Visibility(NamedTuple):
    """Markers in the last image."""

    known: tuple[int, ...]
    """Identifiers in the layout."""
    unknown: tuple[int, ...]
    """Identifiers in the dictionary but not in the layout."""


class ObjectTracker:
    """Tracker of one object at rest, with one moving part, before a camera at rest."""

    def __init__(
        self,
        asset: Asset,
        joint: str,
        layout: MarkerLayout,
        calibration: CameraCalibration,
    ) -> None:
        """Create a tracker.

        Args:
            asset: Object.
            joint: Joint whose position is estimated.
            layout: Markers on the object.
            calibration: Intrinsics of the camera.

        Raises:
            ConfigError: No marker is on the body or on the moving part.
        """
        self.model: MarkerModel = marker_model(asset, joint, layout)
        """Corners of the markers."""
        self.visibility = Visibility((), ())
        """Markers in the last image."""
        self._layout, self._calibration = layout, calibration
        self._detector = MarkerDetector(layout.dictionary)
        self.reset()

    def reset(self) -> None:
        """Forget earlier images."""
        self._prior: PosePrior | None = None
        self._contradictions = 0
        self.moved_m = 0.0
        """Distance by which the object moved before the camera after the first image [m]."""

    def process(self, image: Pixels, time_s: float) -> ObjectMeasurement | None:
        """Return the state in an image; None if no marker on the body has been visible yet.

        Args:
            image: Image (H, W) or (H, W, 3), values 0 to 255.
            time_s: Time of the exposure [s].

        Raises:
            ConfigError: The image has another size than the calibration.
        """
        self._calibration.check_image(image.shape[0], image.shape[1], "camera")
        return self.process_detections(self._detector.detect(image), time_s)

    def process_detections(self, detections: Detections, time_s: float) -> ObjectMeasurement | None:
        """Return the state for detected corners; see :meth:`process`."""
        self.visibility = _visibility(self._layout, detections)
        found = fit_object(self.model, self._calibration, detections, prior=self._prior)
        seen = [number for number in self.model.ids if number in detections]
        if self._prior is not None and seen and (found is None or found.rms_px > CONTRADICTION_PX):
            self._contradictions += 1
            if self._contradictions < MAX_CONTRADICTIONS:
                return None
            found = fit_object(self.model, self._calibration, detections)
            if found is not None:
                moved = pose_difference(self._prior.T_co, found.T_co)[:3]
                self.moved_m = max(self.moved_m, float(np.linalg.norm(moved)))
        if found is None:
            return None
        self._contradictions = 0
        self._prior = _next_prior(found)
        return ObjectMeasurement(time_s, found.T_co, found.q, found.q_std, found.ids)


def _visibility(layout: MarkerLayout, detections: Iterable[int]) -> Visibility:
    numbers = sorted(detections)
    return Visibility(
        tuple(n for n in numbers if n in layout.ids),
        tuple(n for n in numbers if n not in layout.ids),
    )


def _next_prior(found: ObjectFit) -> PosePrior:
    """Return the prior of the next image, with bounded confidence."""
    spread = np.diag(np.maximum(FLOOR_STD - np.sqrt(np.diag(found.covariance)), 0.0) ** 2)
    return PosePrior(found.T_co, found.covariance + spread + np.diag(DRIFT_STD**2))


def describe_visibility(visibility: Visibility, layout: MarkerLayout) -> str:
    """Return a text about markers that are missing or unknown, for messages."""
    missing = [n for n in layout.ids if n not in visibility.known]
    text = f"markers {_listed(missing)} are not visible" if missing else "all markers are visible"
    if visibility.unknown:
        text += f"; markers {_listed(visibility.unknown)} are visible but not in the layout"
    return text


def _listed(numbers: Iterable[int]) -> str:
    items = list(numbers)
    text = ", ".join(map(str, items[:8]))
    return text if len(items) <= 8 else f"{text}, …"
