"""The program `splatweaver`, which a wheel installs: the command line inside the compiled part."""

from __future__ import annotations

import sys

from ._splatweaver import run_program

__all__ = ["main"]


def main() -> int:
    """Runs the command line of this process, and returns its exit code."""
    return run_program(["splatweaver", *sys.argv[1:]])
