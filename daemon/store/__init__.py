"""Files on disk, read and written so that a crash loses nothing: models, taught views, calibrations, runs, the run log.

The packages that make the values define what they mean.
"""
