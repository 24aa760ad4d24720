"""Errors of the package. Each message says where, what was found, what was expected, what to do.

All derive from `EcmError`. An outcome such as a solver that did not converge is a status in the
result, not an error.
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
    """Wrong input: a value, a file, an option. The command line ends with exit code 2.

    Examples
    --------
    >>> from ecm.io.mechanism import Mechanism
    >>> try:
    ...     Mechanism(poisson_ratio=0.6)
    ... except InputError as error:
    ...     print(error)
    poisson_ratio = 0.6: expected a number from 0 to 0.5 (0.49 for rubber)
    """


class ComputationError(EcmError):
    """A failed computation (no convergence, full disk). The command line ends with exit code 1.

    Examples
    --------
    >>> exit_code(ComputationError("no pose of the workspace is stable"))
    1
    """


class MissingExtra(InputError):
    """An optional dependency that is not installed.

    Parameters
    ----------
    package
        Name of the missing package.
    extra
        Extra of this package that installs it.
    purpose
        What needs it.

    Examples
    --------
    >>> print(MissingExtra("pyarrow", "data", "Reading a.parquet"))
    Reading a.parquet needs the package pyarrow, which is not installed. \
Install it with: pip install 'ecm-stiffness[data]'
    """

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed. "
            f"Install it with: pip install 'ecm-stiffness[{extra}]'"
        )


def exit_code(error: EcmError) -> int:
    """Return the exit code of the command line: 1 for a failed computation, 2 for wrong input."""
    return 1 if isinstance(error, ComputationError) else 2
