"""The families of shapes, one file each.

To add a family, write its file (:mod:`synthnet.families.family` says what belongs in it), add its
``FAMILY`` to :data:`CHARTED` below, and name it in a new recipe. The tests run over these
dictionaries, so they find the family by themselves.
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
    "rectangular_prism": rectangular_prism.FAMILY,
    "cone": cone.FAMILY,
    "cylinder": cylinder.FAMILY,
    "sphere": sphere.FAMILY,
    "torus": torus.FAMILY,
    "tetrahedron": tetrahedron.FAMILY,
    "conical_frustum": conical_frustum.FAMILY,
    "split_sphere": split_sphere.FAMILY,
    "split_cone": split_cone.FAMILY,
    "inverted_cone": inverted_cone.FAMILY,
}
CHARTED: dict[
    str, Family
] = {  # 2.0 and 2.1: given by charts, each surface in several triangulations
    "cuboid": cuboid.FAMILY,
    "simplex": simplex.FAMILY,
    "ellipsoid": ellipsoid.FAMILY,
    "circular_cone": circular_cone.FAMILY,
    "capped_cylinder": capped_cylinder.FAMILY,
    "truncated_cone": truncated_cone.FAMILY,
    "dented_cone": dented_cone.FAMILY,
    "conforming_split_cone": conforming_split_cone.FAMILY,
    "conforming_split_sphere": conforming_split_sphere.FAMILY,
    "twisted_torus": twisted_torus.FAMILY,
    "knotted_tube": knotted_tube.FAMILY,
    "pretzel": pretzel.FAMILY,
    "blob": blob.FAMILY,
    "superquadric": superquadric.FAMILY,
    "bent_tube": bent_tube.FAMILY,
    "extruded_star": extruded_star.FAMILY,
    "extruded_drum": extruded_drum.FAMILY,
    "flat_rectangle": flat_rectangle.FAMILY,
    "rolled_sheet": rolled_sheet.FAMILY,
    "elliptic_disc": elliptic_disc.FAMILY,
    "annulus": annulus.FAMILY,
    "spherical_cap": spherical_cap.FAMILY,
    "open_cylinder": open_cylinder.FAMILY,
    "mobius_band": mobius_band.FAMILY,
    "drum": drum.FAMILY,
    "box_union": box_union.FAMILY,
    "lattice": lattice.FAMILY,
    "perforated_plate": perforated_plate.FAMILY,
    "sheet_metal": sheet_metal.FAMILY,
    "rounded_box": rounded_box.FAMILY,
    "shaft": shaft.FAMILY,
    "folded_ball": folded_ball.FAMILY,
}
FAMILIES: dict[str, Family] = {**PRIMITIVES, **CHARTED}
