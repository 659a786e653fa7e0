"""Running a predictor's code, in a process of its own: the only room that runs foreign code."""
