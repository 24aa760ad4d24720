"""Leverage: uncertainty of a prediction over the noise of one row.

With Phi (m, k) the columns of a pose, P the covariance of the coefficients and Sigma the noise of
one row there, the leverage is the largest eigenvalue of Sigma^-1/2 Phi P Phi' Sigma^-1/2: 1 says
that the prediction is as uncertain as one measurement in its worst direction. A free polynomial is
fitted output by output: there it is the largest ratio of the components' own variances, which
hold the misfit of the polynomial too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.steps import Progress
from ecm.io.table import Table
from ecm.models.maps import PolynomialMap, StiffnessMap
from ecm.regression.blocks import in_blocks
from ecm.regression.noise import Noise, whiteners
from ecm.regression.rows import Rows


def wrench_variances(base: StiffnessMap, covariance: F, poses: F) -> F:
    """(N, m) variances of the wrench at poses (N, n) from those of the coefficients, in N and N m.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 9)
    >>> model = ecm.fit({"x_m": x, "fx_N": 1e4 * x + 0.1 * np.sin(9e4 * x)}, "linear")
    >>> wrench_variances(model.base, model.covariance, np.zeros((2, 1))).shape
    (2, 1)
    """
    if isinstance(base, PolynomialMap):
        shares = _OwnVariances.of(base, covariance)
        return np.concatenate([np.zeros((0, len(base.outputs))), *in_blocks(
            len(poses), lambda block: shares.at(np.ascontiguousarray(poses[block])))])  # fmt: skip

    def of_block(block: slice) -> F:
        return variances_of(base.columns(np.ascontiguousarray(poses[block])), covariance)

    blocks = in_blocks(len(poses), of_block)
    return np.concatenate([np.zeros((0, len(base.outputs))), *blocks])


def variances_of(columns: F, covariance: F) -> F:
    """(N, m) c' P c of columns c (N, m, k), by one product of two matrices.

    Examples
    --------
    >>> variances_of(np.ones((1, 1, 2)), np.diag([1.0, 4.0]))
    array([[5.]])
    """
    images = (columns.reshape(-1, columns.shape[2]) @ covariance).reshape(columns.shape)
    return np.asarray(np.einsum("nmk,nmk->nm", images, columns))


def leverages(
    base: StiffnessMap, covariance: F, noise: Noise, poses: F, progress: Progress | None = None
) -> F:
    """(N,) leverage of poses (N, 6); `progress` is told the rows that are done, of all."""
    known = {} if base.length_m is None else {"length_m": base.length_m}
    shares = _OwnVariances.of(base, covariance) if isinstance(base, PolynomialMap) else None
    # P = R R', so that only the columns' images are needed, block by block.
    values, vectors = (np.zeros(0), np.zeros(0)) if shares else np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))

    def of_block(block: slice) -> F:
        part = np.ascontiguousarray(poses[block])
        table = Table(dict(zip(POSE, part.T, strict=True)), Meta(mechanism=known), "poses")
        row_covariance = noise.covariance(Rows(table, base))
        if shares is not None:
            own = shares.at(part) / np.einsum("njj->nj", row_covariance)
            return np.asarray(own.max(axis=1))
        columns = base.columns(part)
        # One product of two matrices: many small ones are slow.
        images = (columns.reshape(-1, columns.shape[2]) @ root).reshape(columns.shape)
        whitener = whiteners(row_covariance)
        own = whitener @ (images @ np.swapaxes(images, 1, 2)) @ np.swapaxes(whitener, 1, 2)
        return np.asarray(np.linalg.eigvalsh(own)[:, -1])

    return np.concatenate([np.zeros(0), *in_blocks(len(poses), of_block, progress)])


@dataclass(frozen=True)
class _OwnVariances:
    """Variance of each output of a polynomial: each has coefficients of its own, in blocks."""

    base: PolynomialMap
    blocks: tuple[F, ...]
    """(k, k) covariances that are no multiple of one before."""
    outputs: tuple[tuple[int, float], ...]
    """Number of each output's block, and the factor on it."""

    @staticmethod
    def of(base: PolynomialMap, covariance: F) -> _OwnVariances:
        """Outputs fitted by ordinary least squares share their block up to a factor."""
        k = len(covariance) // len(base.outputs)
        blocks: list[F] = []
        outputs: list[tuple[int, float]] = []
        for j in range(len(base.outputs)):
            own = covariance[j * k : (j + 1) * k, j * k : (j + 1) * k]
            for i, block in enumerate(blocks):
                factor = float(np.trace(own) / max(np.trace(block), 1e-300))
                if np.allclose(own, factor * block, rtol=1e-12, atol=0.0):
                    outputs.append((i, factor))
                    break
            else:
                outputs.append((len(blocks), 1.0))
                blocks.append(own)
        return _OwnVariances(base, tuple(blocks), tuple(outputs))

    def at(self, poses: F) -> F:
        """(N, m) x' P_jj x."""
        x = self.base.regressor(poses)
        forms = [np.einsum("nk,nk->n", x @ block, x) for block in self.blocks]
        return np.stack([factor * forms[i] for i, factor in self.outputs], axis=1)
