"""A small mechanism in closed form, the repository's root, and what a command leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ecm.errors import EcmError, Remedy
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH

ROOT = Path(__file__).parents[2]


SHARED_DATA = ROOT.parent / "shared" / "data"


LENGTH_M = 0.1034


NECK_TOML = """[mechanism]
builtin = "cylinder"
length_m = 0.1034
radius_m = 0.033
young_modulus_Pa = 0.65e6
poisson_ratio = 0.49
"""
"""Its body, as a file describes it."""


# The paper's equation (11), signs of our frame.
STIFFNESS = np.diag([24585.0, 3461.0, 3468.0, 4.0, 16.0, 16.0])
STIFFNESS[1, 5] = STIFFNESS[5, 1] = -179.0
STIFFNESS[2, 4] = STIFFNESS[4, 2] = 178.0


@dataclass(frozen=True)
class Done:
    """What a command left: exit code and both streams."""

    code: int
    out: str
    err: str

    def good(self) -> Done:
        """The same, of a command that did its work."""
        assert self.code == 0, f"{self.code}: {self.out}{self.err}"
        return self

    def refused(self) -> Done:
        """The same, of a command that refused its input."""
        assert self.code == 2, f"{self.code}: {self.out}{self.err}"
        return self


def way_out(error: EcmError) -> Remedy:
    """The remedy of an error, which must have one."""
    assert error.remedy is not None, error
    return error.remedy


Command = Callable[..., Done]
"""The fixture `ecm_command`: arguments to what the command left."""


def saved(path: Path, text: str) -> Path:
    """The path of a file into which this text is written."""
    path.write_text(text, encoding="utf-8")
    return path


def neck_rows(n: int, seed: int = 0) -> tuple[F, F]:
    """Poses (n, 6) and wrenches (n, 6) of a body that hardens a little with deflection."""
    random = np.random.default_rng(seed)
    poses = random.uniform(-1.0, 1.0, (n, 6)) * [0.002, 0.01, 0.01, 0.4, 0.3, 0.3]
    wrenches = poses @ STIFFNESS * (1.0 + 0.1 * np.sum(poses[:, 3:] ** 2, axis=1))[:, None]
    poses[:, 0] += LENGTH_M
    return poses, wrenches


def columns_of(poses: F, wrenches: F) -> dict[str, F]:
    """The twelve columns of poses (n, 6) and wrenches (n, 6)."""
    return dict(zip((*POSE, *WRENCH), np.hstack([poses, wrenches]).T, strict=True))


def neck_columns(n: int = 60, seed: int = 0) -> dict[str, F]:
    """The twelve columns of such rows with a little noise."""
    poses, wrenches = neck_rows(n, seed)
    random = np.random.default_rng([seed, 1])
    noise = random.standard_normal((n, 6)) * [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    return columns_of(poses, wrenches + noise)


def csv_text(columns: dict[str, F]) -> str:
    """A CSV as a user's program writes it."""
    lines = [",".join(columns)]
    lines += [",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join(lines) + "\n"
