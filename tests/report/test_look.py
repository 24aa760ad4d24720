"""The colours of every page: read by all, in both themes, also without one kind of cone."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from ecm.io.arrays import F
from ecm.report.blocks import WEB

# Machado, Oliveira, Fernandes 2009: linear RGB as seen without one kind of cone.
WITHOUT = {
    "red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998]],
    "green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
              [-0.011820, 0.042940, 0.968881]],
    "blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
             [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
CLEARLY = 20.0
"""Distance in Lab; 2.3 is just seen."""


def themes() -> list[dict[str, F]]:
    """The colours by name, as linear RGB: the light theme, then the dark one."""
    text = (WEB / "look.css").read_text(encoding="utf-8")
    found = [dict(re.findall(r"--([a-z]+): #([0-9a-f]{6})", part)) for part in text.split("@media")]
    return [{name: linear(code) for name, code in theme.items()} for theme in found[:2]]


def linear(code: str) -> F:
    return decoded(np.array([int(code[i : i + 2], 16) / 255 for i in (0, 2, 4)]))


def decoded(value: F) -> F:
    """Linear RGB of a colour as a file writes it, 0 to 1."""
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def encoded(value: F) -> F:
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def contrast(a: F, b: F) -> float:
    """Contrast of two colours as WCAG 2 defines it."""
    low, high = sorted([float(TO_XYZ[1] @ a), float(TO_XYZ[1] @ b)])
    return (high + 0.05) / (low + 0.05)


def lab(colour: F) -> F:
    x, y, z = np.cbrt(np.clip(TO_XYZ @ colour / [0.9505, 1.0, 1.089], 1e-9, None))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("theme", themes(), ids=["light", "dark"])
def test_text_stands_out_from_every_ground(theme: dict[str, F]) -> None:
    for text, ground in itertools.product(
        ("ink", "soft", "mark", "second", "good", "bad"), ("paper", "wash", "band")
    ):
        assert contrast(theme[text], theme[ground]) >= 4.5, (text, ground)
    assert contrast(theme["paper"], theme["mark"]) >= 4.5  # a button's own text
    for mark in ("point", "second", "mark"):
        assert contrast(theme[mark], theme["paper"]) >= 3.0, mark


def test_points_in_space_stand_out_from_a_dark_ground() -> None:
    dark = themes()[1]
    for name in ("low", "middle", "high"):
        assert contrast(dark[name], dark["wash"]) >= 4.5, name


@pytest.mark.parametrize("theme", themes(), ids=["light", "dark"])
def test_a_planned_pose_is_seen_and_fainter_than_text(theme: dict[str, F]) -> None:
    page = WEB.parents[1] / "workflow" / "app" / "page" / "live.js"
    share = re.search(r"PLANNED = ([0-9.]+)", page.read_text(encoding="utf-8"))
    assert share is not None
    soft, wash = encoded(theme["soft"]), encoded(theme["wash"])
    mixed = decoded(float(share[1]) * soft + (1 - float(share[1])) * wash)
    assert 3.0 <= contrast(mixed, theme["wash"]) < contrast(theme["soft"], theme["wash"])


@pytest.mark.parametrize("cone", [None, *WITHOUT])
@pytest.mark.parametrize("theme", themes(), ids=["light", "dark"])
def test_what_lies_in_one_figure_differs_without_a_cone(
    theme: dict[str, F], cone: str | None
) -> None:
    seen = {
        name: lab(colour if cone is None else np.clip(np.array(WITHOUT[cone]) @ colour, 0, 1))
        for name, colour in theme.items()
    }
    for a, b in (("point", "second"), ("mark", "second"), ("point", "band"), ("second", "band")):
        assert np.linalg.norm(seen[a] - seen[b]) > CLEARLY, (a, b)
    light = [seen[name][0] for name in ("low", "middle", "high")]
    steps = np.diff(light)
    assert (steps > 2).all() or (steps < -2).all(), light


@pytest.mark.parametrize("cone", [None, *WITHOUT])
def test_the_axes_of_a_frame_differ_without_a_cone(cone: str | None) -> None:
    text = (WEB / "space.js").read_text(encoding="utf-8")
    codes = re.findall(r'"#([0-9a-f]{6})"', text.split("const AXES = [")[1].split("]")[0])
    eye = np.eye(3) if cone is None else np.array(WITHOUT[cone])
    seen = [lab(np.clip(eye @ linear(code), 0, 1)) for code in codes]
    assert len(seen) == 3
    for a, b in itertools.combinations(seen, 2):
        assert np.linalg.norm(a - b) > CLEARLY
