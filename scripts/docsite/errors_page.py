"""The page of errors and exit codes, from the classes themselves."""

from __future__ import annotations

from inspect import cleandoc

import ecm.errors as module
from ecm.errors import EcmError, exit_code

_HEAD = """# Errors and exit codes

| code | meaning | on the error stream |
|---|---|---|
| 0 | done, whatever the verdict | warnings, each on a line that begins with `warning:` |
| 1 | the computation failed: no convergence, a full disk | one line that begins with `error:` |
| 2 | bad input: value, file, option | one line: file, row, column, what is wrong, what to do |
| 130 | interrupted by Ctrl-C or a signal | what was kept, and how to go on |

Rows are counted from 1 below the header. `ECM_DEBUG=1` adds the Python traceback.

A solver that does not converge in one load case is no error: the case has a *status* in the result
(`solved`, `unstable`, `not_converged`, `inverted`, `cancelled`) and the others go on.

## Errors in Python

All derive from `ecm.EcmError`; `except ecm.EcmError` catches what the package raises on purpose.
"""


def page() -> str:
    """Return the page of errors."""
    parts = [_HEAD, "| error | derives from | exit code | meaning |", "|---|---|---|---|"]
    for name in module.__all__:
        error = getattr(module, name)
        if isinstance(error, type) and issubclass(error, EcmError):
            code = exit_code(error.__new__(error))
            base = error.__mro__[1].__name__
            line = cleandoc(error.__doc__ or "").partition("\n")[0]
            parts.append(f"| `{name}` | `{base}` | {code} | {line} |")
    return "\n".join(parts) + "\n"
