"""Names of the types of arrays."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Int32s: TypeAlias = NDArray[np.int32]  # as kernels take sparse matrices and meshes
Int64s: TypeAlias = NDArray[np.int64]
Booleans: TypeAlias = NDArray[np.bool_]
