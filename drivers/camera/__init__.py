"""V4L2 stereo pairs, live and recorded: fresh pairs of one moment, or a CameraError that says what to do.

What is in the pictures is nobody's business here.
"""
