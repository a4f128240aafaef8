"""Camera measurements: marker detection, camera calibration, marker poses by bundle adjustment."""
