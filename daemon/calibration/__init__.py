"""Where the cameras are and how they see: stereo, hand-eye, the quick way, verification, the watch for drift."""
