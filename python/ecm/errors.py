"""Errors of the package: each message says what was found, what was expected, where, what to do.

Everything derives from `EcmError`. An outcome such as a solver that did not converge is a status
in the result, not an error.
"""

from __future__ import annotations

from ecm._native import DesignError, EcmError, FemError, ModelError

__all__ = [
    "ComputationError",
    "DesignError",
    "EcmError",
    "FemError",
    "InputError",
    "MissingExtra",
    "ModelError",
    "exit_code",
]


class InputError(EcmError):
    """The input is wrong; the command line ends with exit code 2."""


class ComputationError(EcmError):
    """The computation failed (no convergence, disk); the command line ends with exit code 1."""


class MissingExtra(InputError):
    """An optional dependency is not installed."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed. "
            f"Install it with: pip install 'ecm-stiffness[{extra}]'"
        )


def exit_code(error: EcmError) -> int:
    """1 where the computation failed, 2 where the input was wrong (interfaces.md)."""
    return 1 if isinstance(error, ComputationError) else 2
