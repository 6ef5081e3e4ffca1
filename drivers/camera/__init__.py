"""V4L2 stereo camera, live and recorded: synchronous pairs of fresh frames, or a CameraError that says what to do."""
