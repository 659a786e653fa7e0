"""Checks of a dataset against its recipe, its pins and LaPy; and sealed test sets."""

from synthnet.verify.checks import verify, verify_files
from synthnet.verify.report import VerifyReport

__all__ = ["VerifyReport", "verify", "verify_files"]
