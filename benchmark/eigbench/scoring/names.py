"""Names of targets: what the eigenvalues of a prediction are compared with.

A predictor's process imports them, and for that needs no dataset and no solver.
"""

SURFACE, MESH = "surface", "mesh"  # see :mod:`eigbench.scoring.targets`
TARGETS = (SURFACE, MESH)  # the headline comes first
