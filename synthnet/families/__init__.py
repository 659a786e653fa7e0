"""The families of shapes, one file each.

To add a family, write its file (:mod:`synthnet.families.family` says what belongs in it), add its
``FAMILY`` to :data:`CHARTED` below, and name it in a new recipe in synthnet/recipe/versions. The
tests run over these dictionaries, and draw a family from the newest version that has it.
"""

from __future__ import annotations

from synthnet.families import (
    annulus,
    bent_tube,
    blob,
    box_union,
    capped_cylinder,
    circular_cone,
    cone,
    conforming_split_cone,
    conforming_split_sphere,
    conical_frustum,
    cuboid,
    cylinder,
    dented_cone,
    drum,
    ellipsoid,
    elliptic_disc,
    extruded_drum,
    extruded_star,
    flat_rectangle,
    folded_ball,
    inverted_cone,
    knotted_tube,
    lattice,
    mobius_band,
    open_cylinder,
    perforated_plate,
    pretzel,
    rectangular_prism,
    rolled_sheet,
    rounded_box,
    shaft,
    sheet_metal,
    simplex,
    sphere,
    spherical_cap,
    split_cone,
    split_sphere,
    superquadric,
    tetrahedron,
    torus,
    truncated_cone,
    twisted_torus,
)
from synthnet.families.family import Family

__all__ = ["CHARTED", "FAMILIES", "PRIMITIVES", "Family"]

PRIMITIVES: dict[str, Family] = {  # 1.0: the paper's, as Open3D makes them
    family.name: family
    for family in (
        rectangular_prism.FAMILY,
        cone.FAMILY,
        cylinder.FAMILY,
        sphere.FAMILY,
        torus.FAMILY,
        tetrahedron.FAMILY,
        conical_frustum.FAMILY,
        split_sphere.FAMILY,
        split_cone.FAMILY,
        inverted_cone.FAMILY,
    )
}
# since 2.0: given by charts, each surface in several triangulations
CHARTED: dict[str, Family] = {
    family.name: family
    for family in (
        cuboid.FAMILY,
        simplex.FAMILY,
        ellipsoid.FAMILY,
        circular_cone.FAMILY,
        capped_cylinder.FAMILY,
        truncated_cone.FAMILY,
        dented_cone.FAMILY,
        conforming_split_cone.FAMILY,
        conforming_split_sphere.FAMILY,
        twisted_torus.FAMILY,
        knotted_tube.FAMILY,
        pretzel.FAMILY,
        blob.FAMILY,
        superquadric.FAMILY,
        bent_tube.FAMILY,
        extruded_star.FAMILY,
        extruded_drum.FAMILY,
        flat_rectangle.FAMILY,
        rolled_sheet.FAMILY,
        elliptic_disc.FAMILY,
        annulus.FAMILY,
        spherical_cap.FAMILY,
        open_cylinder.FAMILY,
        mobius_band.FAMILY,
        drum.FAMILY,
        box_union.FAMILY,
        lattice.FAMILY,
        perforated_plate.FAMILY,
        sheet_metal.FAMILY,
        rounded_box.FAMILY,
        shaft.FAMILY,
        folded_ball.FAMILY,
    )
}
FAMILIES: dict[str, Family] = {**PRIMITIVES, **CHARTED}
