"""facetd: recognise parts by their facets, locate them, and bring the gripper there one bounded move at a time."""

import os

# BLAS would start a thread a core for matrices of a few dozen rows, and spend its time waking them; it reads these
# when numpy is first imported, which is after this package.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
