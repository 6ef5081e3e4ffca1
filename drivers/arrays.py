"""The one name for arrays of numbers; whoever uses it states shape, unit and frame."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
