"""Tracking of the object by a camera: in the control loop, or in a separate thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol

from articulate.errors import UsageError
from articulate.markers.camera_device import CameraDevice, CameraError, Frame
from articulate.markers.layout import MarkerLayout
from articulate.markers.tracker import ObjectMeasurement, ObjectTracker, describe_visibility

IMAGE_TIMEOUT_S = 5.0
"""Longest time without an image from a camera that is open [s]."""


class CameraTracking(Protocol):
    """Source of object states from images."""

    name: str
    """Name of the camera."""
    frames: int
    """Images since the last reset."""
    moved_m: float
    """Distance by which the object moved before the camera [m]."""

    def reset(self) -> None:
        """Forget earlier images."""

    def take_measurements(self) -> list[ObjectMeasurement]:
        """Return the states since the last call, in order; CameraError if the camera is lost."""

    def next_measurement(self) -> ObjectMeasurement | None:
        """Wait for the next image and return its state; None if it determines none."""

    def describe(self) -> str:
        """Return a text about the markers in the last image."""

    def close(self) -> None:
        """Release the camera."""


class SteppedTracking:
    """Tracking of one image per call, for simulated cameras and tests."""

    def __init__(
        self,
        device: CameraDevice,
        tracker: ObjectTracker,
        layout: MarkerLayout,
        *,
        delay_s: float = 0.0,
        clock: Callable[[], float],
    ) -> None:
        """Create a tracking that delivers states ``delay_s`` [s] after the exposure."""
        self.name, self.frames = device.name, 0
        self._device, self._tracker, self._layout = device, tracker, layout
        self._delay_s, self._clock = delay_s, clock
        self._pending: deque[ObjectMeasurement] = deque()

    @property
    def moved_m(self) -> float:
        """Distance by which the object moved before the camera [m]."""
        return self._tracker.moved_m

    @moved_m.setter
    def moved_m(self, value: float) -> None:
        self._tracker.moved_m = value

    def reset(self) -> None:
        """Forget earlier images."""
        self._tracker.reset()
        self._pending.clear()
        self.frames = 0

    def take_measurements(self) -> list[ObjectMeasurement]:
        """Read one image and return the states that are due."""
        found = self.next_measurement()
        if found is not None:
            self._pending.append(found)
        due: list[ObjectMeasurement] = []
        now = self._clock() + 1e-9
        while self._pending and self._pending[0].time_s + self._delay_s <= now:
            due.append(self._pending.popleft())
        return due

    def next_measurement(self) -> ObjectMeasurement | None:
        """Read one image and return its state without delay."""
        frame = self._device.read()
        self.frames += 1
        return self._tracker.process(frame.image, frame.time_s)

    def describe(self) -> str:
        """Return a text about the markers in the last image."""
        return describe_visibility(self._tracker.visibility, self._layout)

    def close(self) -> None:
        """Release the camera."""
        self._device.close()


class ThreadedTracking:
    """Tracking in a thread, so that the control loop never waits for an image."""

    def __init__(self, device: CameraDevice, tracker: ObjectTracker, layout: MarkerLayout) -> None:
        """Start the thread."""
        self.name, self.frames, self.moved_m = device.name, 0, 0.0
        self._device, self._tracker, self._layout = device, tracker, layout
        self._lock = threading.Condition()
        self._found: list[ObjectMeasurement] = []
        self._error: UsageError | None = None
        self._reset = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def reset(self) -> None:
        """Forget earlier images."""
        with self._lock:
            self._reset, self._found, self.frames = True, [], 0

    def take_measurements(self) -> list[ObjectMeasurement]:
        """Return the states since the last call, in order."""
        with self._lock:
            if self._error is not None:
                raise self._error
            found, self._found = self._found, []
            return found

    def next_measurement(self) -> ObjectMeasurement | None:
        """Wait for the next image and return its state; CameraError if none arrives."""
        with self._lock:
            begin = self.frames
            arrived = self._lock.wait_for(
                lambda: self.frames > begin or self._error is not None, timeout=IMAGE_TIMEOUT_S
            )
            if self._error is not None:
                raise self._error
            if not arrived:
                raise CameraError(f"camera {self.name} is lost: no image in {IMAGE_TIMEOUT_S:g} s")
            found, self._found = self._found, []
            return found[-1] if found else None

    def describe(self) -> str:
        """Return a text about the markers in the last image."""
        with self._lock:
            return describe_visibility(self._tracker.visibility, self._layout)

    def close(self) -> None:
        """End the thread and release the camera."""
        self._stop.set()
        self._thread.join(timeout=2.0)
        self._device.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._process(self._device.read())
            except UsageError as error:
                with self._lock:
                    self._error = error
                    self._lock.notify_all()
                return

    def _process(self, frame: Frame) -> None:
        with self._lock:
            if self._reset:
                self._tracker.reset()
                self._reset = False
        found = self._tracker.process(frame.image, frame.time_s)
        with self._lock:
            if self._reset:  # the image is from before the reset
                return
            self.frames += 1
            self.moved_m = self._tracker.moved_m
            if found is not None:
                self._found.append(found)
            self._lock.notify_all()
