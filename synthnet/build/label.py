"""From a shape to a labelled sample, or to a rejection with its reason."""

from __future__ import annotations

from synthnet import spectrum
from synthnet.arrays import Floats
from synthnet.build import filters
from synthnet.errors import CertificateError, SpectrumError
from synthnet.families import FAMILIES
from synthnet.recipe import Recipe
from synthnet.recipe.drawing import draw_instances
from synthnet.recipe.plan import PlannedShape
from synthnet.spectrum.operators import PLAIN
from synthnet.spectrum.solve import unwarned
from synthnet.types import Mesh, Rejection, Sample, ShapeSpec, Spectrum

FEW_VERTICES = "few_vertices"  # the reason that an import of such a mesh has, too


def make_sample(shape: PlannedShape, recipe: Recipe) -> Sample | Rejection:
    """Generate, check, label and augment one shape.

    The label is computed in float64 from the float32 vertices that are stored.
    """
    spec = shape.spec
    family = FAMILIES[spec.family]
    mesh = family.generate(spec.parameters).stored()
    if refused := filters.check_mesh(mesh, recipe.filters, family.topology(spec.parameters)):
        return Rejection(spec.id, spec.family, *refused)
    label = label_or_rejection(spec, mesh, recipe)
    if isinstance(label, Rejection):
        return label
    return labelled(shape, mesh, label, draw_instances(recipe, spec))


def labelled(shape: PlannedShape, mesh: Mesh, label: Spectrum, isometries: Floats) -> Sample:
    """Return the sample of a shape, of its mesh as it is stored, its label and its instances."""
    return Sample(
        spec=shape.spec,
        mesh=mesh,
        eigenvalues=label.eigenvalues,
        trivial=label.trivial,
        certificate=label.certificate,
        isometries=isometries,
        split=shape.split,
        paper_splits=shape.paper_splits,
    )


def label_or_rejection(
    spec: ShapeSpec, mesh: Mesh, recipe: Recipe, *, sharp: bool = False
) -> Spectrum | Rejection:
    """Return the certified spectrum of a mesh, or why there is none within a recipe's limits.

    Parameters
    ----------
    spec, mesh, recipe
        The shape, its mesh as it is stored, and the recipe that has the limits.
    sharp : bool
        As for :func:`synthnet.spectrum.compute`; and the bound of the error keeps the limit of the
        residual too. The drawn versions have neither: their labels are frozen.
    """
    count, k = len(mesh.vertices), recipe.label.eigenvalues
    if count <= k:
        finding = f"{count} vertices, a spectrum needs at least {k + 1}"
        return Rejection(spec.id, spec.family, FEW_VERTICES, finding)
    try:
        if sharp:  # what a warning would say is a reason to reject the mesh, below
            checked = spectrum.as_mesh(mesh)
            label = unwarned(checked, k, PLAIN, sharp=True)
        else:
            label = spectrum.compute(mesh, k)
    except CertificateError as error:
        return Rejection(spec.id, spec.family, filters.CERTIFICATE, str(error))
    except SpectrumError as error:
        return Rejection(spec.id, spec.family, filters.SOLVER, str(error))
    refused = filters.check_spectrum(label, recipe.filters)
    if sharp and (refused is None or refused[0] == filters.residual.__name__):
        # A residual that is too large where the bound is, too, is what rounding has made of it
        refused = filters.check_error(label, recipe.filters) or refused
    return label if refused is None else Rejection(spec.id, spec.family, *refused)
