r"""Descriptors of shapes and of points, by their published formulas, from a spectrum.

:math:`\lambda_i, \varphi_i` are the eigenpairs after the zero: k of them, what
:func:`synthnet.spectrum.compute` returns. Eigenvectors are orthonormal in the mass matrix.
"""

import numpy as np
from numpy.typing import ArrayLike

from synthnet.arrays import Floats, as_reals
from synthnet.errors import suggestion
from synthnet.spectrum.inputs import as_count, as_number
from synthnet.types import Spectrum

NORMALISATIONS = ("none", "area", "volume", "first")
MEASURES = {"area": "area", "volume": "enclosed_volume"}  # functions of synthnet.mesh.geometry
STEPS = 100  # times and energies of the signatures, in both papers
WIDTH = 7  # of a wave kernel's Gaussian, in steps between energies
ZERO = 1e-9  # an eigenvalue below so much of the largest is a zero


def shape_dna(
    spectrum: Spectrum | ArrayLike,
    normalisation: str = "none",
    *,
    area: float | None = None,
    volume: float | None = None,
    reweighted: bool = False,
) -> Floats:
    r"""Return ShapeDNA: the eigenvalues, normalised.

    ==========  ==================================  ======================
    ``none``    :math:`\lambda_i`                   1/length²
    ``area``    :math:`\lambda_i \, |S|`            no unit
    ``volume``  :math:`\lambda_i \, V^{2/3}`        no unit; closed surfaces
    ``first``   :math:`\lambda_i / \lambda_1`       no unit
    ==========  ==================================  ======================

    Parameters
    ----------
    spectrum : Spectrum or array-like of shape (k,)
        Eigenvalues after the zero, ascending, in 1/length².
    normalisation : str
        ``area`` is ``method="surface"`` of ``lapy.shapedna.normalize_ev``.
    area, volume : float, optional
        :math:`|S|` in length² and V in length³, where the normalisation needs one:
        :func:`synthnet.mesh.geometry.area` and :func:`synthnet.mesh.geometry.enclosed_volume`.
    reweighted : bool
        Divide the i-th by i, so that large eigenvalues do not dominate a distance, as BrainPrint
        does; ``lapy.shapedna.reweight_ev``.

    Returns
    -------
    ndarray of shape (k,), float64

    Raises
    ------
    ValueError
        If the normalisation is unknown, or what it needs is missing or not positive; if an
        eigenvalue is zero, negative or not finite, or they do not ascend.

    References
    ----------
    M. Reuter, F.-E. Wolter, N. Peinecke, "Laplace-Beltrami spectra as 'Shape-DNA' of surfaces and
    solids", Computer-Aided Design 38 (2006). C. Wachinger, P. Golland, W. Kremen, B. Fischl,
    M. Reuter, "BrainPrint: A discriminative characterization of brain morphology", NeuroImage 109
    (2015).

    Examples
    --------
    >>> shape_dna([2.0, 6.0, 12.0], "first")
    array([1., 3., 6.])
    """
    values = _eigenvalues(spectrum)
    if normalisation not in NORMALISATIONS:
        raise ValueError(
            f"normalisation must be one of {', '.join(NORMALISATIONS)}, got {normalisation!r}"
            + suggestion(str(normalisation), NORMALISATIONS)
        )
    if normalisation == "area":
        values = values * _measure("area", area)
    elif normalisation == "volume":
        values = values * _measure("volume", volume) ** (2 / 3)
    elif normalisation == "first":
        values = values / values[0]
    return values / np.arange(1, len(values) + 1) if reweighted else values


def heat_trace(
    spectrum: Spectrum | ArrayLike, times: ArrayLike, *, components: int | None = None
) -> Floats:
    r"""Return :math:`Z(t) = c + \sum_{i=1}^k e^{-\lambda_i t}`.

    The whole series is asymptotically :math:`|S| / 4\pi t` for small t; on a smooth closed surface
    of Euler characteristic χ the next term is :math:`\chi / 6`. The k terms are close to the series
    where :math:`\lambda_k t` is large: of the smooth surface, some
    :math:`e^{-\lambda_k t} |S| / 4\pi t` is missing.

    Parameters
    ----------
    spectrum : Spectrum or array-like of shape (k,)
        Eigenvalues after the zero, ascending, in 1/length².
    times : array-like of any shape
        Positive, in length².
    components : int, optional
        c, the number of zero eigenvalues; by default that of the Spectrum, or 1. A component that
        is held at zero somewhere has none.

    Returns
    -------
    ndarray of the shape of ``times``, float64

    Raises
    ------
    ValueError
        If a time is not positive, an eigenvalue is zero, negative or not finite, or the components
        are no count.

    References
    ----------
    H. P. McKean, I. M. Singer, "Curvature and the eigenvalues of the Laplacian", Journal of
    Differential Geometry 1 (1967).

    Examples
    --------
    >>> heat_trace([2.0, 2.0, 2.0], [0.5, 1.0]).round(4)
    array([2.1036, 1.406 ])
    """
    values = _eigenvalues(spectrum)
    zeros = _zeros(spectrum) if components is None else as_count(components, "components")
    if zeros < 0:
        raise ValueError(f"components must be at least 0, got {zeros}")
    decayed: Floats = np.exp(-_positive("times", times)[..., None] * values)
    return zeros + np.asarray(decayed.sum(axis=-1), dtype=np.float64)


def heat_kernel_signature(
    spectrum: Spectrum, times: ArrayLike | None = None, *, area: float | None = None
) -> Floats:
    r"""Return the heat that stays at each vertex, :math:`\sum_i e^{-\lambda_i t} \varphi_i(x)^2`.

    Parameters
    ----------
    spectrum : Spectrum
        The paper uses 300 eigenpairs.
    times : array-like of shape (c,), optional
        Positive, in length². By default the paper's: 100, uniform on a logarithmic scale from
        :math:`4 \ln 10 / \lambda_k` to :math:`4 \ln 10 / \lambda_1`.
    area : float, optional
        :math:`|S|` in length². With it the zero's term :math:`1 / |S|` is added, and a row is the
        diagonal of the heat kernel; the authors' program leaves this constant out. Where every
        component is held at zero somewhere there is no such term.

    Returns
    -------
    ndarray of shape (n, c), float64
        In 1/length².

    Raises
    ------
    ValueError
        If there are no eigenvectors, times are no list of positive numbers, the area is not
        positive, or an area is given where
        the zeros' terms differ: on a mesh of several components, or where some of it is held.

    References
    ----------
    J. Sun, M. Ovsjanikov, L. Guibas, "A concise and provably informative multi-scale signature
    based on heat diffusion", Computer Graphics Forum 28 (2009).
    """
    values, squares = _pairs(spectrum)
    if times is None:
        times = np.geomspace(4 * np.log(10) / values[-1], 4 * np.log(10) / values[0], STEPS)
    moments = _positive("times", times)
    if moments.ndim != 1:
        raise ValueError(f"times must be of shape (c,), got {moments.shape}")
    signature: Floats = squares @ np.exp(-values[:, None] * moments[None])
    if area is None:
        return signature
    constant = 1 / _measure("area", area)
    if not _zeros(spectrum):
        return signature
    if spectrum.components > 1:
        raise ValueError(
            f"the mesh has {spectrum.components} components, whose constants differ: leave out area"
        )
    if np.isnan(spectrum.trivial):
        raise ValueError("the constant is zero on components that are held: leave out area")
    return signature + constant


def wave_kernel_signature(
    spectrum: Spectrum, energies: ArrayLike | None = None, *, sigma: float | None = None
) -> Floats:
    r"""Return how likely a quantum particle of each energy is at each vertex.

    .. math::
        \frac{\sum_i w_i(e)\, \varphi_i(x)^2}{\sum_i w_i(e)},
        \qquad w_i(e) = \exp\left(-\frac{(e - \log \lambda_i)^2}{2 \sigma^2}\right)

    Parameters
    ----------
    spectrum : Spectrum
        The paper uses 300 eigenpairs.
    energies : array-like of shape (c,), optional
        Logarithms e of energies in 1/length². By default the paper's: 100, uniform from
        :math:`\log \lambda_1 + 2\sigma` to :math:`\log \lambda_k - 2\sigma`.
    sigma : float, optional
        Width of the Gaussians. By default the paper's:
        :math:`7 (\log \lambda_k - \log \lambda_1) / 100`.

    Returns
    -------
    ndarray of shape (n, c), float64
        In 1/length².

    Raises
    ------
    ValueError
        If there are no eigenvectors, an energy is not finite, sigma is not positive, or so small or
        large that weights have no float64, or the default leaves no room: all eigenvalues agree, or
        sigma is too large for the range.

    References
    ----------
    M. Aubry, U. Schlickewei, D. Cremers, "The wave kernel signature: a quantum mechanical approach
    to shape analysis", ICCV Workshops (2011).
    """
    values, squares = _pairs(spectrum)
    logs = np.log(values)
    if sigma is None:
        sigma = WIDTH * float(logs[-1] - logs[0]) / STEPS
    sigma = as_number(sigma, "sigma")
    doubled = 2 * (sigma * sigma)
    if not (sigma > 0 and 0 < doubled < np.inf):
        raise ValueError(
            f"sigma must be positive, with a square that is a float64, got {sigma:g}: "
            "pass a width, or more eigenpairs"
        )
    if energies is None:
        low, high = logs[0] + 2 * sigma, logs[-1] - 2 * sigma
        if low > high:
            raise ValueError(
                f"sigma {sigma:.3g} is too large for eigenvalues from {values[0]:.3g} to "
                f"{values[-1]:.3g}: pass a smaller one, or energies"
            )
        energies = np.linspace(low, high, STEPS)
    levels = as_reals(energies, "energies")
    if levels.ndim != 1 or not np.isfinite(levels).all():
        raise ValueError("energies must be a list of finite numbers")
    with np.errstate(over="ignore"):  # of an infinite one the weight is zero
        exponents = -((levels[None] - logs[:, None]) ** 2) / doubled
    if not np.isfinite(exponents.max(axis=0)).all():
        raise ValueError(
            f"sigma {sigma:.3g} is too small: an energy is so far from all log λ that every weight "
            "is zero: pass a larger one"
        )
    weights = np.exp(exponents - exponents.max(axis=0))  # a common factor cancels
    signature: Floats = squares @ (weights / weights.sum(axis=0))
    return signature


def _eigenvalues(spectrum: Spectrum | ArrayLike) -> Floats:
    given = spectrum.eigenvalues if isinstance(spectrum, Spectrum) else spectrum
    values = as_reals(given, "eigenvalues")
    if values.ndim != 1 or not values.size or not np.isfinite(values).all():
        raise ValueError(f"eigenvalues must be finite, of shape (k,), got shape {values.shape}")
    if (np.diff(values) < 0).any():
        raise ValueError("eigenvalues must ascend: sort them first")
    if values[0] <= ZERO * values[-1]:
        raise ValueError(f"the first eigenvalue is zero, {values[0]:.3g}: leave it out")
    return values


def _zeros(spectrum: Spectrum | ArrayLike) -> int:
    """Return how many zeros are left out: that of a spectrum, one of plain eigenvalues."""
    if not isinstance(spectrum, Spectrum):
        return 1
    zeros = spectrum.certificate.zeros
    return spectrum.components if zeros is None else zeros


def _pairs(spectrum: Spectrum) -> tuple[Floats, Floats]:
    """Return the eigenvalues, and the squares of the eigenvectors, shape (n, k)."""
    if not isinstance(spectrum, Spectrum):
        raise ValueError(  # noqa: TRY004 - one kind of error for all bad input
            "a signature needs eigenvectors: pass what synthnet.spectrum.compute returns, "
            f"got {type(spectrum).__name__}"
        )
    return _eigenvalues(spectrum), spectrum.eigenvectors**2


def _measure(name: str, value: float | None) -> float:
    if value is None:
        raise ValueError(
            f"pass {name}=, that of the surface: synthnet.mesh.geometry.{MEASURES[name]}(mesh)"
        )
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be positive, got {value}")
    return value


def _positive(name: str, values: ArrayLike) -> Floats:
    numbers = as_reals(values, name)
    if not ((numbers > 0) & np.isfinite(numbers)).all():
        raise ValueError(f"{name} must be positive and finite")
    return numbers
