"""The names for arrays of numbers: shape, unit and frame are said where they are used."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Flags = NDArray[np.bool_]
Image32 = NDArray[np.float32]
Real = NDArray[np.floating[Any]]
