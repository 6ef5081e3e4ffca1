"""Camera calibration: intrinsics, stereo, hand-eye, verification, drift detection, files of other tools."""
