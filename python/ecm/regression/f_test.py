"""Lack of fit against pure error from repeats, and the omnibus test of a residual.

F = (SS_fit - SS_pure) / (cells - k) / (SS_pure / (n - cells)): the residual between cells over
that within cells (NIST/SEMATECH e-Handbook, 4.4.4.6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special
from scipy.linalg import LinAlgError, cholesky, lapack, qr, solve_triangular

from ecm.io.arrays import F, I, eigh
from ecm.regression.normal_equations import in_blocks

OUTLIER_CHANCE = 1e-4
"""Rows less likely than this under the noise count less."""


def outlying_squares(count: int) -> tuple[float, float]:
    """Sum of `count` squares of Gaussian noise beyond which a row is an outlier; the median sum.

    Examples
    --------
    >>> limit, middle = outlying_squares(1)
    >>> round(limit / middle, 1)
    33.3
    """
    limit, middle = special.chdtri(count, [OUTLIER_CHANCE, 0.5])
    return float(limit), float(middle)


_DEPENDENT = 1e-5
"""A column is dependent where this share or less is orthogonal to the others; its square is still
far above the rounding of their products."""
_INDEPENDENT = 1e-4
"""Columns with more than this share beside the others may be squared: eight digits stay."""
_ROUNDING = 1e-13
_MANY = 64
"""Products of fewer columns take less time than threads do."""
_DRAWS, _SEED = 201, 7
"""Draws of signs, the first of them the signs as they are."""


@dataclass(frozen=True)
class FTest:
    """An F ratio with its degrees of freedom.

    Parameters
    ----------
    F, p
        Ratio and its probability under the null hypothesis.
    dof, dof_error
        Degrees of freedom of numerator and denominator.
    explained, rest
        Sums of squares of numerator and denominator.

    Examples
    --------
    >>> test = FTest.of(explained=12.0, dof=2, rest=30.0, dof_error=10)
    >>> test.F, round(test.p, 3)
    (2.0, 0.186)
    """

    F: float
    p: float
    dof: float
    dof_error: float
    explained: float = 0.0
    rest: float = 0.0

    @staticmethod
    def of(explained: float, dof: float, rest: float, dof_error: float) -> FTest:
        """Explained over rest, each per degree of freedom."""
        # Columns that explain everything leave rounding errors of either sign.
        rest = max(rest, 1e-12 * abs(explained))
        if dof <= 0 or dof_error <= 0 or rest <= 0.0:
            return FTest(float("nan"), 1.0, max(dof, 0.0), max(dof_error, 0.0), explained, rest)
        ratio = max(explained, 0.0) / dof / (rest / dof_error)
        p = float(special.fdtrc(dof, dof_error, ratio))
        return FTest(ratio, p, dof, dof_error, explained, rest)


def lack_of_fit(whitened: F, cells: I, parameters: float, weights: F | None = None) -> FTest | None:
    """Lack-of-fit F test of a model against the pure error of repeats.

    Parameters
    ----------
    whitened
        (N, m) residuals in units of their noise.
    cells
        (N,) cell of each row: rows of a cell measure the same thing.
    parameters
        Number of fitted coefficients; for a single component its share of them.
    weights
        (N,) 0 leaves a row out.

    Returns
    -------
    FTest or None
        None where no cell is repeated.

    Source
    ------
    NIST/SEMATECH e-Handbook of Statistical Methods, 4.4.4.6.

    Examples
    --------
    >>> import numpy as np
    >>> residual = np.array([[1.0], [1.2], [-1.0], [-1.2], [1.1], [0.9]])
    >>> test = lack_of_fit(residual, np.array([0, 0, 1, 1, 2, 2]), parameters=1)
    >>> test.dof, test.dof_error, test.p < 0.01
    (2, 3, True)
    """
    keep = np.ones(len(whitened), dtype=np.bool_) if weights is None else weights > 0.0
    rows, own = whitened[keep], cells[keep]
    m, (within, count) = rows.shape[1], within_cells(rows, own)
    if count == len(rows):
        return None
    pure = float((within**2).sum())
    total = float((rows**2).sum())
    return FTest.of(total - pure, count * m - parameters, pure, (len(rows) - count) * m)


def within_cells(values: F, cells: I) -> tuple[F, int]:
    """Deviations of values (N, m) from the mean of their cell, and the number of cells.

    Examples
    --------
    >>> deviations, count = within_cells(np.array([[1.0], [3.0], [5.0]]), np.array([7, 7, 2]))
    >>> deviations.ravel().tolist(), count
    ([-1.0, 1.0, 0.0], 2)
    """
    _, packed = np.unique(cells, return_inverse=True)
    size = np.bincount(packed)
    means = np.stack([np.bincount(packed, column) / size for column in values.T], axis=1)
    return values - means[packed], len(size)


def omnibus_test(
    whitened: F, design: F, fitted: F, weights: F | None = None, *, overwrite: bool = False
) -> FTest:
    """F test whether columns outside the model explain the residual.

    Parameters
    ----------
    whitened
        (N, m) residuals in units of their noise.
    design
        (N, m, q) whitened columns to look for.
    fitted
        (N, m, k) whitened columns of what was fitted already; projected out.
    weights
        (N,) 0 leaves a row out.
    overwrite
        The columns to look for are not needed afterwards: their memory is used.

    Returns
    -------
    FTest
        Sum of squares that the columns explain over the rest.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1.0, 1.0, 20)[:, None]
    >>> noise = np.random.default_rng(0).standard_normal((20, 1))
    >>> test = omnibus_test(5.0 * x + noise, x[:, :, None], np.ones((20, 1, 1)))
    >>> test.dof, test.p < 1e-6
    (1, True)
    """
    return Beside.of(whitened, design, fitted, weights, overwrite=overwrite).omnibus_test()


@dataclass(frozen=True)
class Beside:
    """A residual and columns beside what was fitted already: one decomposition for both tests.

    Examples
    --------
    >>> random = np.random.default_rng(0)
    >>> error, columns = random.standard_normal((30, 2)), random.standard_normal((30, 2, 3))
    >>> beside = Beside.of(error, columns, np.ones((30, 2, 1)))
    >>> beside.omnibus_test() == omnibus_test(error, columns, np.ones((30, 2, 1)))
    True
    """

    residual: F
    """(n, m) weighted, the fitted columns projected out."""
    span: Span
    """What the weighted columns reach beside the fitted ones."""
    basis: F
    """(n m, k) orthonormal, of the weighted fitted columns."""
    size: int
    """Readings of the rows that count."""
    root: F
    """(n,) square roots of the weights."""

    @staticmethod
    def of(
        whitened: F, design: F, fitted: F, weights: F | None = None, *, overwrite: bool = False
    ) -> Beside:
        """Project the fitted columns out; arguments as for `omnibus_test`."""
        n, m = whitened.shape
        root = np.ones(n) if weights is None else np.sqrt(weights)
        y = (whitened * root[:, None]).ravel()
        basis = orthonormal((fitted * root[:, None, None]).reshape(n * m, -1))
        y = (y - basis @ (basis.T @ y)).reshape(n, m)
        span = _span_beside(basis, design, root, overwrite)
        return Beside(y, span, basis, int((root > 0.0).sum()) * m, root)

    def of_others(self, design: F) -> Beside:
        """The same residual and fitted columns with other columns (n, m, q), which are taken."""
        return replace(self, span=_span_beside(self.basis, design, self.root, True))

    def omnibus_test(self) -> FTest:
        """F test whether the columns explain the residual."""
        y = self.residual.ravel()
        explained, directions = float(self.span.explained(y[:, None])[0]), self.span.rank
        rest = float(y @ y) - explained
        return FTest.of(explained, directions, rest, self.size - self.basis.shape[1] - directions)

    @property
    def rest(self) -> F:
        """(n, m) weighted residual, the columns projected out as well."""
        y = self.residual.ravel()
        return np.asarray((y - self.span.nearest(y[:, None])[:, 0]).reshape(self.residual.shape))

    def sign_chance(self) -> float:
        """Chance of as much explained, where the components of a row may share their errors.

        The F test takes every number as independent. Where the noise of the components is only
        assumed, they are not, and columns explain more by chance. Here the rows change their signs
        at random: what errors of a row share stays. The share that is explained then has a beta
        distribution, of the mean and variance of 200 draws.

        Examples
        --------
        >>> random = np.random.default_rng(4)
        >>> error = np.repeat(random.standard_normal((30, 1)), 6, axis=1)
        >>> columns = np.einsum("nq,ij->niqj", random.standard_normal((30, 3)), np.eye(6))
        >>> beside = Beside.of(error, columns.reshape(30, 6, 18), np.zeros((30, 6, 0)))
        >>> beside.omnibus_test().p < 0.01 < beside.sign_chance()
        True
        """
        n, m = self.residual.shape
        random = np.random.default_rng(_SEED)
        signs = random.choice([-1.0, 1.0], (n, _DRAWS))
        signs[:, 0] = 1.0
        drawn = np.repeat(signs, m, axis=0)
        drawn *= self.residual.reshape(-1, 1)
        drawn -= self.basis @ (self.basis.T @ drawn)
        total = np.einsum("ij,ij->j", drawn, drawn)
        if self.span.rank == 0 or not total.min() > 0.0:
            return 1.0
        shares = np.clip(self.span.explained(drawn) / total, 0.0, 1.0)
        mean, variance = float(shares[1:].mean()), float(shares[1:].var())
        if not 0.0 < variance < mean * (1.0 - mean):
            return 1.0
        both = mean * (1.0 - mean) / variance - 1.0
        return float(special.betainc((1.0 - mean) * both, mean * both, 1.0 - shares[0]))

    def with_sign_chance(self, test: FTest) -> FTest:
        """Return the omnibus test of several components with the larger of its p and the chance."""
        if self.residual.shape[1] < 2 or test.p > 0.5 or not np.isfinite(test.F):
            return test
        return replace(test, p=max(test.p, self.sign_chance()))


def _span_beside(basis: F, design: F, root: F, overwrite: bool) -> Span:
    """The span of weighted columns (n, m, q), an orthonormal basis (n m, k) projected out."""
    z = np.multiply(design, root[:, None, None], out=design if overwrite else None)
    z = z.reshape(len(basis), design.shape[2])
    along = basis.T @ z

    def project_out(part: slice) -> None:
        z[part] -= basis[part] @ along

    in_blocks(len(z), project_out)
    return Span.of(z)


@dataclass(frozen=True)
class Span:
    """The span of some columns, decomposed once for any number of responses.

    Examples
    --------
    >>> Span.of(np.array([[1.0, 2.0], [0.0, 0.0]])).rank
    1
    """

    columns: F
    """(r, q), none without length."""
    norms: F
    """(q,) their lengths."""
    factor: F
    """(rank, rank) upper triangle of the pivoted Cholesky factor of products of unit columns."""
    order: I
    """(rank,) columns in the order of the factor."""

    @staticmethod
    def of(columns: F) -> Span:
        """Decompose columns (r, q); those without length are left out."""
        columns, norms = _with_length(columns)
        if not len(norms):
            return Span(columns, norms, np.zeros((0, 0)), np.zeros(0, dtype=np.int64))
        # The pivoted Cholesky factor of the normal equations shows dependent columns in any order
        # and costs a quarter of an orthonormal basis.
        products = _products(columns) / np.outer(norms, norms)
        return Span(columns, norms, *_pivoted(products))

    @property
    def rank(self) -> int:
        """Dimension of the span."""
        return len(self.order)

    def explained(self, responses: F) -> F:
        """(b,) sum of squares of each response (r, b) in the span."""
        return np.asarray((self._along(responses) ** 2).sum(axis=0))

    def nearest(self, responses: F) -> F:
        """(r, b) nearest vectors of the span to responses (r, b)."""
        if self.rank == 0:
            return np.zeros(responses.shape)
        own = solve_triangular(self.factor, self._along(responses), check_finite=False)
        weights = np.zeros((len(self.norms), responses.shape[1]))
        weights[self.order] = own
        return np.asarray(self.columns @ (weights / self.norms[:, None]))

    def _along(self, responses: F) -> F:
        """(rank, b) coordinates of responses in orthonormal directions of the span."""
        if self.rank == 0:
            return np.zeros((0, responses.shape[1]))
        along = (self.columns.T @ responses / self.norms[:, None])[self.order]
        return np.asarray(solve_triangular(self.factor, along, trans="T", check_finite=False))


def _with_length(columns: F) -> tuple[F, F]:
    """The columns that are not zero beside the longest one, and their lengths (q,)."""
    norms = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    keep = norms > 1e-9 * max(float(norms.max(initial=0.0)), 1e-300)
    return (columns, norms) if keep.all() else (columns[:, keep], norms[keep])


def _products(columns: F) -> F:
    """Return columns.T @ columns (q, q); of many columns the rows are shared by the cores."""
    if columns.shape[1] < _MANY:
        return np.asarray(columns.T @ columns)
    parts = in_blocks(len(columns), lambda part: columns[part].T @ columns[part])
    return np.asarray(sum(parts[1:], parts[0]))


def explained_by_span(columns: F, response: F) -> tuple[float, int]:
    """Sum of squares of the response in the columns' span, and the dimension of the span."""
    span = Span.of(columns)
    return float(span.explained(response[:, None])[0]), span.rank


def orthonormal(columns: F, dependent: float = _DEPENDENT) -> F:
    """Orthonormal basis of the columns' span.

    Parameters
    ----------
    columns
        (r, q); those without length, or that the others span, are left out.
    dependent
        A column is spanned by those before it where this share or less of it is beside them.

    Examples
    --------
    >>> x = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    >>> orthonormal(x).shape
    (3, 2)
    """
    columns, norms = _with_length(columns)
    if not len(norms):
        return columns
    products = _products(columns) / np.outer(norms, norms)
    told, factor = dependent >= _DEPENDENT, None
    # More columns than rows are dependent, though rounding errors may look like a rest.
    if len(norms) <= len(columns):
        factor = independent_factor(products, dependent if told else _INDEPENDENT)
    order: I = np.arange(len(norms))
    # A dependent column gets a direction of rounding errors, which takes a part of those after it:
    # with the longest rest first, dependent ones come last.
    if factor is None and told:
        factor, order = _pivoted(products, dependent)
    if factor is None:
        unit = columns / norms
        q, r = qr(unit, mode="economic")
        if unit.shape[1] > len(unit) or np.abs(np.diag(r)).min() <= dependent:
            q, r, _ = qr(unit, mode="economic", pivoting=True)
            q = q[:, np.abs(np.diag(r)) > dependent]
        return np.asarray(q)
    # A seventh of the work of reflections. Two Cholesky factors, one after the other, leave only
    # rounding (CholeskyQR2: Yamamoto et al., ETNA 44, 2015).
    turn = np.zeros((len(norms), len(order)))
    turn[order] = np.linalg.inv(factor) / norms[order, None]
    basis = columns @ turn
    again = _products(basis)
    if np.abs(again - np.eye(len(again))).max() > _ROUNDING:
        second = np.linalg.inv(cholesky(again, check_finite=False))

        def turn_rows(part: slice) -> None:
            basis[part] = basis[part] @ second

        in_blocks(len(basis), turn_rows)
    return np.asarray(basis)


def _pivoted(products: F, dependent: float = _DEPENDENT) -> tuple[F, I]:
    """Cholesky factor (rank, rank), upper, of products of unit columns, and its columns (rank,).

    The longest rest comes first; what is at most `dependent` long is left out.
    """
    factor, order, rank, _ = lapack.dpstrf(products, tol=dependent**2)
    return np.triu(factor[:rank, :rank]), order[:rank].astype(np.int64) - 1


def independent_factor(products: F, least: float = _INDEPENDENT) -> F | None:
    """Cholesky factor (q, q), upper, of the products of unit columns; None if nearly dependent.

    That is where a share of `least` or less of a column is beside those before it.

    Examples
    --------
    >>> independent_factor(np.array([[1.0, 0.6], [0.6, 1.0]])).round(3)
    array([[1. , 0.6],
           [0. , 0.8]])
    >>> independent_factor(np.ones((2, 2)))
    """
    try:
        factor = cholesky(products, check_finite=False)
    except LinAlgError:
        return None
    return factor if np.diag(factor).min(initial=1.0) > least else None


def root_of_inverse(products: F, least: float) -> F:
    """(k, r) root R, R R' the inverse of the products (k, k) of columns, of any rank.

    Parameters
    ----------
    least
        Eigenvalues up to this share of the largest count as zero.

    Examples
    --------
    >>> root = root_of_inverse(np.array([[4.0, 0.0], [0.0, 1.0]]), 1e-10)
    >>> (root @ root.T).tolist()
    [[0.25, 0.0], [0.0, 1.0]]
    """
    values, vectors = eigh(products)
    seen = values > least * values[-1:]
    return np.asarray(vectors[:, seen] / np.sqrt(values[seen]))
