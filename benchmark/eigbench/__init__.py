"""eigbench: score any predictor of Laplace-Beltrami eigenvalues, and what it costs."""
