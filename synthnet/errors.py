"""Errors a user can act on.

Each message is one line that says what was wrong, where, and what to do next.
The command line prints it and exits with code 2.
"""


class SynthNetError(Exception):
    """Base of all errors raised on purpose by this package."""


class RecipeError(SynthNetError):
    """A recipe (``versions/*.toml``) is unknown, malformed or contradicts itself."""


class StoreError(SynthNetError):
    """A dataset on disk is missing, damaged or of another recipe."""


class DamagedError(StoreError):
    """A file of a dataset is missing, truncated or altered."""


class BuildError(SynthNetError):
    """A build could not go on; what it had finished is kept."""


class MeshImportError(SynthNetError):
    """There is nothing to import, or the dataset's name will not do."""


class SealError(SynthNetError):
    """A seal file or a salt is missing, malformed, or of another set."""


class MissingPackageError(SynthNetError, ImportError):
    """A package that is needed is not installed, or cannot be imported."""


class SpectrumError(SynthNetError):
    """The eigenvalue solver returned no answer for a mesh."""


class CertificateError(SpectrumError):
    """Eigenvalues were found, but not proved to be all there are."""
