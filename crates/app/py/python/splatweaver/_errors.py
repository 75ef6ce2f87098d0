"""Exceptions of the package."""

from __future__ import annotations

__all__ = ["Error", "InputError", "FileError", "MemoryPlanError", "NumericError"]


class Error(Exception):
    """Any failure of the package; its text is that of the command line."""


class InputError(Error, ValueError):
    """Arguments that mean nothing or do not belong together: what was expected, and what was found."""


class FileError(Error, OSError):
    """A file that cannot be read or written, or does not hold what it should."""


class MemoryPlanError(Error, MemoryError):
    """More memory than there is, found before it is taken."""


class NumericError(Error, ArithmeticError):
    """Numbers that grew beyond all bounds."""


for _kind in (Error, InputError, FileError, MemoryPlanError, NumericError):
    _kind.__module__ = "splatweaver"
del _kind
