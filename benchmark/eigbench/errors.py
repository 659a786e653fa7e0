"""Errors a user can act on: one line each, printed by the command line, exit code 2."""


class EigbenchError(Exception):
    """Base of all errors raised on purpose by this package."""


class OutsideError(EigbenchError):
    """A file that somebody hands in is not what may be read."""


class PredictorError(EigbenchError):
    """A predictor's file or its answer is not what it must be."""


class OverTime(PredictorError):
    """A predictor took longer than it may."""


class OverMemory(PredictorError):
    """A predictor's process took more memory than it may."""


class Died(PredictorError):
    """A predictor's process has ended by itself, or was killed by the system."""


class WorksUnasked(PredictorError):
    """A predictor's process computes while it is not asked."""


class PredictionsError(EigbenchError):
    """A file of predictions is damaged or does not match the split."""


class ResultError(EigbenchError):
    """A result file is damaged, of another schema, or contradicts itself."""
