"""The designed loop as an example in C or Rust, with a plant to try it on."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from importlib.resources import files
from typing import Literal

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.models.control.design import ControlLoop


def loop_file(
    loop: ControlLoop,
    target: Literal["c", "rust"],
    name: str,
    precision: Literal["double", "single"],
    rest: F | None = None,
    gravity_m_s2: Sequence[float] = (-9.81, 0.0, 0.0),
) -> dict[str, str]:
    """Return path and text of the example of a loop that holds some pose.

    With effects of time `rest` is the pose (6,) of the long rest before; without them None.
    `gravity_m_s2` is in base axes.
    """
    c = target == "c"
    real = {"double": "f64", "single": "f32"}[precision]
    template = files("ecm.models.control") / "templates" / ("control.c" if c else "control.rs")
    text = _chosen(template.read_text(encoding="utf-8"), with_state=rest is not None)
    sentences = loop.sentences()
    # The push ends after 700 steps; the slowest error then falls by a factor of e^20.
    settled = np.ceil(20.0 / (loop.decay_per_s * loop.gains.dt_s))
    values = {
        "SUMMARY": _comment(sentences, " *     " if c else "//! "),
        "PRINTED": "\n".join(_printed(sentence, c) for sentence in sentences),
        "NAME": name,
        "REAL": real,
        "STEPS": str(int(np.clip(700 + settled, 4000, 100_000))),
        "DELAY": str(loop.gains.delay_steps),
        "DT": f"{loop.gains.dt_s:e}",
        "MASS": f"{loop.mass_kg:e}",
        "INERTIA": f"{loop.inertia_kg_m2:e}",
        "BANDWIDTH": f"{loop.gains.bandwidth_rad_s:e}",
        "GRAVITY": _numbers(np.asarray(gravity_m_s2), c),
        "HELD": _numbers(loop.held, c),
        "REST": _numbers(np.zeros(6) if rest is None else rest, c),
        "COLUMNS": ", ".join(f'"{column}"' for column in POSE),
    }
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    return {f"{name}_control.c" if c else "examples/control.rs": text}


def _chosen(template: str, *, with_state: bool) -> str:
    """Lines that begin with `@+` stand only with a state, those with `@-` only without."""
    keep, drop = ("@+", "@-") if with_state else ("@-", "@+")
    lines = template.split("\n")
    return "\n".join(line.removeprefix(keep) for line in lines if not line.startswith(drop))


def _numbers(values: F, c: bool) -> str:
    return ", ".join(f"R({x:.9e})" if c else f"{x:.9e}" for x in values)


def _comment(sentences: tuple[str, ...], prefix: str) -> str:
    lines = textwrap.wrap(" ".join(sentences), 90 - len(prefix))
    return "\n".join(prefix + line for line in lines)


def _printed(sentence: str, c: bool) -> str:
    if c:
        parts = textwrap.wrap(sentence.replace("%", "%%"), 80, drop_whitespace=False)
        quoted = "\n".join(f'           "{part}"' for part in parts).lstrip()
        return f'    printf({quoted}\n           "\\n");'
    parts = textwrap.wrap(sentence, 80)
    quoted = " \\\n         ".join(parts)
    return f'    println!(\n        "{quoted}"\n    );'
