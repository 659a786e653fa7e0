"""Numbers of a closed surface that no isometry of space changes, free of scale."""

import numpy as np

from synthnet import Mesh
from synthnet.mesh.geometry import face_areas, volume

NAMES = ("volume", "inertia_1", "inertia_2", "inertia_3", "farthest", "nearest")


def invariants(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Return the area and the numbers of :data:`NAMES`, each divided by its power of the area.

    The volume is that enclosed, for an open mesh that of the cone from the origin, which a shift
    changes; the inertia are the principal second moments of the surface
    about its centroid, ascending; farthest and nearest are the extents: the distances of
    the vertices from the centroid.
    """
    areas = face_areas(mesh)
    area = areas.sum()
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    centroid = areas @ corners.mean(axis=1) / area
    corners = corners - centroid
    # The integral of x xᵀ over a triangle: area/12 · (Σ vᵢvᵢᵀ + (Σ vᵢ)(Σ vᵢ)ᵀ)
    total = corners.sum(axis=1)
    moments = (
        np.einsum("t,tci,tcj->ij", areas, corners, corners)
        + np.einsum("t,ti,tj->ij", areas, total, total)
    ) / 12
    distances = np.linalg.norm(mesh.vertices - centroid, axis=1)
    numbers = np.concatenate(
        [
            [abs(volume(mesh)) / area**1.5],
            np.linalg.eigvalsh(moments) / area**2,
            [distances.max() / area**0.5, distances.min() / area**0.5],
        ]
    )
    return float(area), numbers
