"""The certificate of a spectrum: residuals that bound errors, and a count that nothing is missing.

A residual proves that there is an eigenvalue near each value, not that there is no other. A
factorisation of A − σB counts the eigenvalues below σ (Sylvester's law of inertia). Where the
count in a gap is the number of pairs below it, and no residual reaches across, none is missing.

References
----------
B. N. Parlett, "The Symmetric Eigenvalue Problem" (1998), sections 3.3, 11.5 and 15.9. A. J.
Wathen, "Realistic eigenvalue bounds for the Galerkin mass matrix", IMA J. Numer. Anal. 7 (1987).
"""

from dataclasses import dataclass, replace

import numpy as np

from synthnet.arrays import Floats
from synthnet.errors import CertificateError, SpectrumError
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.ldl import Factor, factorise
from synthnet.spectrum.ordering import Ordering
from synthnet.types import Certificate

NEAR_ZERO = 1e-3  # of Weyl's k-th eigenvalue: below it, residuals are relative to this instead
SAFETY = 100  # times the rounding errors' first-order effect on the shift of a count
# Of a gap, from its lower end: their middles are apart from its own, where a pivot may be zero by
# symmetry, and from each other.
PARTS = (0.62, 0.8, 0.38, 0.9, 0.7, 0.5, 0.25)


@dataclass(frozen=True, slots=True)
class Candidate:
    """Pairs that are claimed to be all between zero and a gap.

    Parameters
    ----------
    values : ndarray of shape (c,), float64
        Eigenvalues in 1/length², ascending, without the zero of the constant function.
    vectors : ndarray of shape (c, n), float64
        B-orthonormal rows.
    residual : float
        The largest relative residual of a pair; see :func:`largest_residual`.
    gap : tuple of float
        The last eigenvalue below the gap, and a lower bound of the first above it.
    floor : float
        The residual of a smaller value is relative to this; see :func:`near_zero`.
    """

    values: Floats
    vectors: Floats
    residual: float
    gap: tuple[float, float]
    floor: float = 0.0

    @property
    def middle(self) -> float:
        """The middle of the gap, where eigenvalues are counted."""
        return sum(self.gap) / 2

    @property
    def reach(self) -> float:
        """How far from the values eigenvalues may be, in 1/length².

        As many different ones as there are B-orthonormal vectors are within the norm of all their
        residuals together, which is at most the root of their number times the largest (Kahan).
        """
        largest = self.residual * max(float(self.values[-1]), self.floor)
        return float(np.sqrt(len(self.values))) * largest


def inertia(matrices: Matrices, ordering: Ordering, shift: float) -> Factor:
    """Return the pivots of A − σB, whose signs count the eigenvalues below the shift σ.

    Raises
    ------
    SpectrumError
        If a pivot is zero.
    """
    return _finite(factorise(matrices, ordering, shift, pivots_only=True), shift)


def _finite(factor: Factor, shift: float) -> Factor:
    if not factor.finite:
        raise SpectrumError(f"a pivot of A - {shift:g} B is zero")
    return factor


def count_in_gap(
    matrices: Matrices, ordering: Ordering, candidate: Candidate, *, elsewhere: bool = False
) -> tuple[Candidate, Factor]:
    """Return a candidate and the pivots in the middle of its gap.

    A pivot may be next to zero there by chance, which moves the count far. With ``elsewhere``, the
    middles of parts of the gap are tried as well, and the candidate has the part that serves.

    Raises
    ------
    SpectrumError
        If a pivot is zero in the middle, and no other place serves.
    """
    low, high = candidate.gap
    tried, counts = [candidate], []
    if elsewhere:
        tried += [replace(candidate, gap=(low, low + share * (high - low))) for share in PARTS]
    for part in tried:
        counts.append(factorise(matrices, ordering, part.middle, pivots_only=True))
        if counts[-1].finite and SAFETY * counts[-1].uncertainty <= part.middle - low:
            return part, counts[-1]
    return candidate, _finite(counts[0], candidate.middle)


def certify(candidate: Candidate, counted: Factor, zeros: int = 1) -> Certificate:
    """Return the certificate of a candidate from the pivots in the middle of its gap.

    Parameters
    ----------
    candidate : Candidate
        All pairs between the zeros and its gap.
    counted : Factor
        See :func:`inertia`.
    zeros : int
        Zero eigenvalues, which the candidate leaves out.

    Raises
    ------
    CertificateError
        If rounding could change the count, the count is not that of the pairs and the zeros, or a
        pair could belong above the gap.
    """
    (low, high), shift = candidate.gap, candidate.middle
    if SAFETY * counted.uncertainty > (high - low) / 2:
        raise CertificateError(
            f"rounding moves the shift {shift:g} of the count by {counted.uncertainty:.2g}, "
            f"more than 1/{SAFETY} of half the gap from {low:g} to {high:g}"
        )
    pairs = len(candidate.values)
    if counted.negative != pairs + zeros:
        raise CertificateError(
            f"{counted.negative} eigenvalues are below {shift:g}, but {pairs + zeros} were found"
        )
    if not candidate.values[-1] + candidate.reach < shift:
        raise CertificateError(
            f"an eigenvalue of residual {candidate.residual:.2g} may be above {shift:g}"
        )
    return Certificate(counted.negative, shift, candidate.residual, zeros=zeros)


def largest_residual(matrices: Matrices, defects: Floats, values: Floats) -> float:
    r"""Return the largest relative residual of B-orthonormal vectors.

    With :math:`r = A\varphi - \lambda B\varphi`, M the lumped mass and B ≥ cM, it is

    .. math:: \frac{1}{\lambda} \sqrt{r^T M^{-1} r / c},

    and an eigenvalue is within so much of λ, relative to λ. For linear elements and consistent
    mass c is a quarter (Wathen). Below :data:`NEAR_ZERO` of Weyl's value it is relative to that
    instead.

    Parameters
    ----------
    matrices : Matrices
        A and B.
    defects : ndarray of shape (c, n), float64
        Rows r.
    values : ndarray of shape (c,), float64
        The λ, in 1/length².
    """
    bounds = np.sqrt(1 / matrices.least) * np.sqrt(np.square(defects) @ (1 / matrices.lumped))
    return float(np.max(bounds / np.maximum(values, near_zero(matrices, len(values)))))


def near_zero(matrices: Matrices, count: int) -> float:
    """Return :data:`NEAR_ZERO` of Weyl's value of an index, in 1/length²."""
    return NEAR_ZERO * 4 * float(np.pi) * count / float(matrices.lumped.sum())
