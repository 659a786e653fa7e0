"""Checks of a dataset against its recipe, its pins and LaPy; and sealed test sets."""

from synthnet.verify.checks import VerifyReport, verify, verify_files

__all__ = ["VerifyReport", "verify", "verify_files"]
