"""Which variables a residual follows: a Gaussian process with one length scale per variable (ARD).

y_c ~ GP(0, s^2 exp(-sum_j w_j (u_j - u_j')^2 / 2) + n^2), the weights w_j >= 0 of the standardised
variables u_j shared by all residual components c, by maximum likelihood. A weight near 0 means
that the residual does not depend on that variable (Rasmussen and Williams, section 5.1).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from ecm.io.arrays import F, evenly

_MOST_ROWS = 220
_ITERATIONS = 40
_LOG_BOUNDS = (-9.0, 4.0)
_FADES = 0.02


def ard_relevance(variables: F, targets: F) -> F:
    """Return (q,) the share of each variable in what the process explains; sums to 1, or all 0.

    Parameters
    ----------
    variables
        (N, q), each of zero mean and unit spread.
    targets
        (N, c) residual along the directions in which something is seen.
    """
    take = evenly(len(variables), _MOST_ROWS)
    u = variables[take]
    y = targets[take] - targets[take].mean(axis=0)
    spread = y.std(axis=0)
    if u.shape[1] == 0 or not np.any(spread > 0.0):
        return np.zeros(u.shape[1])
    y = y[:, spread > 0.0] / spread[spread > 0.0]
    squares = (u[:, None, :] - u[None, :, :]) ** 2
    start = np.concatenate([np.full(u.shape[1], -2.5), [np.log(0.5), np.log(0.5)]])
    result = minimize(
        _negative_log_likelihood,
        start,
        args=(squares, y),
        jac=True,
        method="L-BFGS-B",
        bounds=[_LOG_BOUNDS] * u.shape[1] + [(-7.0, 3.0), (-5.0, 1.0)],
        options={"maxiter": _ITERATIONS},
    )
    return _shares(result.x, squares, y)


def _negative_log_likelihood(log: F, squares: F, y: F) -> tuple[float, F]:
    weights, signal, noise = np.exp(log[:-2]), np.exp(log[-2]), np.exp(log[-1])
    kernel = signal * np.exp(-0.5 * (squares @ weights))
    covariance = kernel + (noise + 1e-8) * np.eye(len(y))
    factor = cho_factor(covariance, lower=True)
    alpha = cho_solve(factor, y)
    inverse = cho_solve(factor, np.eye(len(y)))
    count = y.shape[1]
    value = 0.5 * float((y * alpha).sum()) + count * float(np.log(np.diag(factor[0])).sum())
    # d/dx = tr((c V^-1 - alpha alpha') dV/dx) / 2.
    inner = count * inverse - alpha @ alpha.T
    weighted = inner * kernel
    slope = np.empty_like(log)
    slope[:-2] = -0.25 * weights * np.tensordot(weighted, squares, axes=([0, 1], [0, 1]))
    slope[-2] = 0.5 * weighted.sum()
    slope[-1] = 0.5 * noise * float(np.trace(inner))
    return value, slope


def _shares(log: F, squares: F, y: F) -> F:
    """Return the loss of what is explained without each variable, over the sum of the losses."""
    weights, signal, noise = np.exp(log[:-2]), np.exp(log[-2]), np.exp(log[-1])
    kernel = signal * np.exp(-0.5 * (squares @ weights))
    alpha = np.linalg.solve(kernel + (noise + 1e-8) * np.eye(len(y)), y)
    total = kernel @ alpha
    losses = np.zeros(len(weights))
    for j in range(len(weights)):
        # The kernel averaged over the variable: the prediction of the other variables alone.
        others = np.where(np.arange(len(weights)) == j, 0.0, weights)
        blind = signal * np.exp(-0.5 * (squares @ others))
        blind = blind * float(np.exp(-0.5 * weights[j] * squares[:, :, j]).mean())
        losses[j] = ((total - blind @ alpha) ** 2).mean()
    losses = np.where(losses > _FADES * losses.max(initial=0.0), losses, 0.0)
    total = losses.sum()
    return np.asarray(losses / total if total > 0.0 else losses)
