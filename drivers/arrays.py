"""The one name for arrays of numbers: shape, unit and frame are said where it is used."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
