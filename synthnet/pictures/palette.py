"""The colours of every chart, in one place; those of drawn meshes are in ``raster.py``.

They are Okabe and Ito's, which colour-blind readers can tell apart, and two greys.
"""

BLUE = "#0072B2"
VERMILION = "#D55E00"
ORANGE = "#E69F00"
GREEN = "#009E73"
SKY = "#56B4E9"
PURPLE = "#CC79A7"
GREY = "#767676"  # stands out from white and from black pages alike
PALE = "#999999"
INK = "#000000"
