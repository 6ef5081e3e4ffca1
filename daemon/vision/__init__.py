"""A stereo pair -> parts with facets in space, names, poses and covariances: arrays and values in and out.

No file, no clock, no device; what is done about a part is not known here.
"""
