"""Long spectra in slices: each is searched for around a shift of its own, and counted.

A basis that holds hundreds of eigenvectors costs more to keep orthogonal than all solutions that
it was made from. A few slices, each with a factorisation, a short basis and a count of its own,
cost a multiple of their number, and their memory does not grow with it.

References
----------
R. G. Grimes, J. G. Lewis, H. D. Simon, "A shifted block Lanczos algorithm for solving sparse
symmetric generalized eigenproblems", SIAM J. Matrix Anal. Appl. 15 (1994), section 4.
"""

from __future__ import annotations

import numpy as np

from synthnet.errors import CertificateError
from synthnet.spectrum.certificate import Candidate, certify
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.ordering import Ordering
from synthnet.spectrum.search import Setting, Window, search
from synthnet.types import Certificate

SLICE = 48  # pairs of each, about: fastest of 32 to 128 at 7,000 and at 100,000 vertices
LONG = 128  # more pairs than these are searched for in slices: fewer take no longer in one search
BESIDE = 16  # vectors of the slice before that a search stays orthogonal to


def search_in_slices(
    matrices: Matrices, ordering: Ordering, k: int, setting: Setting
) -> tuple[Candidate, Certificate]:
    """Search for k pairs slice by slice, each certified before the next.

    Within a slice vectors are B-orthonormal, and as many eigenvalues are counted in it as there are
    vectors, whose residuals do not reach across its ends: so none is missed, and none is in two.

    Parameters
    ----------
    matrices, ordering : Matrices, Ordering
        Of one component.
    k : int
        Number of pairs.
    setting : Setting
        How to look for them.

    Returns
    -------
    Candidate
        At least k pairs.
    Certificate
        The count above the last, and the largest residual.

    Raises
    ------
    SpectrumError
        If a slice cannot be found or certified.
    """
    slices: list[Candidate] = []
    window, done, residual = None, 0, 0.0
    while True:
        left = k - done
        size = left if left < 1.5 * SLICE else SLICE
        part, counted = search(matrices, ordering, size, setting, window)
        below = matrices.zeros if window is None else window.count
        proof = certify(part, counted, below)
        if window is not None and not part.values[0] - part.reach > window.low:
            raise CertificateError(
                f"an eigenvalue of residual {part.residual:.2g} may be below {window.low:g}"
            )
        slices.append(part)
        done += len(part.values)
        residual = max(residual, part.residual)
        if done >= k:
            break
        low = 0.0 if window is None else window.low
        spacing = (proof.shift - low) / len(part.values)
        window = Window(proof.shift, proof.count, part.vectors[-BESIDE:], spacing)
    values = np.concatenate([part.values for part in slices])
    vectors = np.concatenate([part.vectors for part in slices])
    whole = Candidate(values, vectors, residual, slices[-1].gap)
    return whole, Certificate(proof.count, proof.shift, residual, zeros=matrices.zeros)
