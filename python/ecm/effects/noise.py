"""Noise effects: they change the scatter of the rows and not their mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ecm.effects.protocol import Effect, LookAlike, Missing, Parameter, needs_figure, needs_twelve
from ecm.io.arrays import F
from ecm.io.se3 import wrench_adjoint
from ecm.io.table import Table
from ecm.regression.folds import repeat_visits
from ecm.regression.noise import covariance_parts, declared_noise
from ecm.regression.rows import Rows

_LEAST_REPEATS = 10


def needs_repeats(table: Table) -> Missing | None:
    """Missing where poses are not visited again."""
    repeats = repeat_visits(table)
    if repeats < _LEAST_REPEATS:
        return Missing(f"{repeats} repeats", "repeats at small and large poses")
    return None


class NoiseEffect(Effect):
    """An effect that adds `variance` to the rows' covariance and nothing to their mean."""

    side = "measurement"
    kind = "noise"

    def correction(self, rows: Rows, values: F) -> F:
        """Zero."""
        return np.zeros((len(rows), len(rows.base.outputs)))

    def jacobian(self, rows: Rows, values: F) -> F:
        """Zero."""
        return np.zeros((len(rows), len(rows.base.outputs), len(self.parameters)))

    def variance(self, rows: Rows, values: F) -> F:
        """(N, m, m) what it adds to the covariance of each row; here nothing."""
        m = len(rows.base.outputs)
        return np.zeros((len(rows), m, m))


class Outliers(NoiseEffect):
    """A few rows that are not Gaussian: they get small weights, and the report lists them."""

    id = "outliers"
    physics = "Single readings went wrong: a marker mistaken, a knock against the table."
    outside = LookAlike("any rare wrong reading", "measure those poses again")
    signature = "few rows, no covariate"
    rivals = {"led_occlusion": "repeat_those_poses"}


class HeteroscedasticNoise(NoiseEffect):
    """sigma^2 (1 + (g h)^2) on each axis, sigma that of the sensor.

    Parameters: force_growth: growth of the scatter with the force, over the scatter without load;
    torque_growth: the same with the torque.
    """

    id = "heteroscedastic_noise"
    physics = "The sensor scatters more under load."
    parameters = (
        Parameter("force_growth", "1/N", 0.02, 0.0, 10.0),
        Parameter("torque_growth", "1/(N m)", 0.5, 0.0, 1e3),
    )
    outside = LookAlike(
        "any scatter that grows with the load: vibration, slip",
        "repeats at small and at large poses",
    )
    signature = "variance grows with the load, the mean stays"
    needs = "repeats of small and large poses"
    requires = (needs_twelve, needs_repeats)
    rivals = {"pose_noise": "repeat_small_and_large"}

    def variance(self, rows: Rows, values: F) -> F:
        """(N, 6, 6) diagonal (sigma g h)^2."""
        force, torque = values.tolist()
        noise = declared_noise(rows.table)
        return replace(noise, growth_per_N=force, growth_per_Nm=torque).grown(rows)


class PoseNoise(NoiseEffect):
    """K_s Sigma_p K_s': scatter of the pose beyond what is declared, through the stiffness.

    Parameters: position: standard deviation of a position beside the declared one; rotation: that
    of a rotation.
    """

    id = "pose_noise"
    physics = "The pose scatters, and the stiff axes turn it into force."
    parameters = (
        Parameter("position", "m", 2e-5, 0.0, 1e-2),
        Parameter("rotation", "rad", 2e-4, 0.0, 0.1),
    )
    outside = LookAlike(
        "any scatter that grows with stiffness: vibration of the platform",
        "a static stream of 60 s",
    )
    signature = "variance of stiff axes first: fx dominates"
    needs = "repeats of small and large poses"
    requires = (needs_twelve, needs_repeats)
    rivals = {"heteroscedastic_noise": "static_stream"}

    def variance(self, rows: Rows, values: F) -> F:
        """K_s diag(position^2, rotation^2) K_s'."""
        parts = covariance_parts(rows)
        return np.asarray(values[0] ** 2 * parts[0] + values[1] ** 2 * parts[1])


class FtsQuantisation(NoiseEffect):
    """B A diag(step^2 / 12) A' B': rounding to the sensor's steps.

    Parameters: steps: size of the steps over the declared resolution.

    Source: Sheppard, On the calculation of the most probable values of frequency-constants, for
    data arranged according to equidistant divisions of a scale, Proc. London Mathematical Society
    29, 1898 (step^2 / 12).
    """

    id = "fts_quantisation"
    physics = "The sensor's converter has steps, and readings are rounded to them."
    parameters = (Parameter("steps", "1", 1.0, 0.0, 100.0),)
    outside = LookAlike("any reading in steps: a rounded file, a slow logger", "the raw counts")
    signature = "stepped histogram of the residual"
    needs = "the sensor's resolution ([instrument] fts_resolution)"
    requires = (needs_figure("fts_resolution", "the sensor's steps are"), needs_twelve)
    rivals = {"heteroscedastic_noise": "longer_average"}

    def variance(self, rows: Rows, values: F) -> F:
        """Per axis steps^2 resolution^2 / 12, in sensor axes turned to base axes."""
        instrument = rows.table.meta.instrument
        resolution = np.asarray(instrument.fts_resolution, dtype=np.float64)
        turn = rows.base_from_top @ wrench_adjoint(instrument.top_from_sensor)
        spread = turn * (values[0] * resolution / np.sqrt(12.0))
        return np.asarray(spread @ np.swapaxes(spread, 1, 2))


EFFECTS = (Outliers(), HeteroscedasticNoise(), PoseNoise(), FtsQuantisation())
