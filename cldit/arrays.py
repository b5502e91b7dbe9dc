"""Types of arrays, by their elements."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Reals = NDArray[np.floating]  # of the precision of a device or a file
