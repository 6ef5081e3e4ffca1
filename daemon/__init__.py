"""facetd: recognise parts by their facets, locate them, and bring the gripper there one bounded move at a time."""

import os

VERSION = "0.1.0"
"""Of the program and its packages: pyproject.toml and debian/build.sh read it here."""

# BLAS and OpenCV would start a thread a core for matrices of a few dozen rows and pictures of a few hundred, and spend
# their time waking them; they read these when they are first imported or first work, which is after this package.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(_name, "1")
