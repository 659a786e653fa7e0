"""The scaling track: predictors on a fixed set of surfaces, from 1,000 vertices to 1,000,000."""
