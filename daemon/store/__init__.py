"""What is on disk, read and written so that a crash loses nothing: models, taught views, runs, the run log.

What the values mean is known to the rooms they come from.
"""
