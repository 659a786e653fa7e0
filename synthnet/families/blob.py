r"""Blobs: spheres whose radius varies by random spherical harmonics."""

import numpy as np
from numpy.polynomial import legendre

from synthnet.arrays import Floats
from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.radial import radial, unit_vectors


def atlas(*, amplitude: float, degree: int, form: int) -> Atlas:
    r"""Star-shaped surface with the logarithm of the radius a random spherical harmonic sum.

    .. math::
        \log r(d) = \text{amplitude} \sum_{\ell=2}^{\text{degree}} \frac{1}{\ell}
        \sum_{j=1}^{2\ell+1} \frac{w_{\ell j}}{\sqrt{2\ell+1}} P_\ell(d \cdot n_{\ell j})

    with random directions n and weights w in [−1, 1] from the seed ``form``: zonal harmonics
    about enough axes span all of their degree.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    terms = []
    for order in range(2, degree + 1):
        count = 2 * order + 1
        z, angle, weight = 2 * rng.random((3, count)) - 1
        terms.append((order, unit_vectors(z, angle), weight * amplitude / order / np.sqrt(count)))

    def distance(directions: Floats) -> Floats:
        logarithm = np.zeros(len(directions))
        for order, axes, weights in terms:
            values = legendre.legval(directions @ axes.T, [0] * order + [1])
            logarithm += values @ weights
        return np.exp(logarithm)

    return radial(distance)


FAMILY = charted(
    "blob",
    "Blob",
    atlas,
    {"amplitude": 0.0, "degree": 2, "form": 0},
    most={"amplitude": 3.0, "degree": 12},
)
