"""Fiducial markers: layout on an object, detection, calibration and pose estimation."""
