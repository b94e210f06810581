"""Whether signatures (gap.signatures) of two sets of photographs differ: by how many standard errors, and is it beyond chance?"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gap.bounds import CLOSED
from gap.changes.permutation import labellings, p_values
from gap.changes.power import TRIED
from gap.fit.split import thinned
from gap.observables import SIGNS
from gap.signatures.signature import OF_LIGHT

DIVISIONS_OF_POWER = 300  # by which a change that is laid on is held against chance
MAX_DIVISIONS = 5000  # of photographs between the sets: of 1,000 a p of 0.01 would be told to a third
LIT = [SIGNS.index(name) for name in OF_LIGHT]


@dataclass(frozen=True)
class SignDifferences:
    """Differences of k signs between two sets under m divisions of the photographs.

    t (m, k) in standard errors, error (m, k) these, whitener (m, k, k) of t
    """

    t: np.ndarray
    error: np.ndarray
    whitener: np.ndarray

    def evidence(self, ways):
        """Return the evidence (2 or 3, m) of a change: of many signs, Hotelling's statistic, its cube root; of one, the largest
        t; of the ``ways`` (d, k), if any, in which effects move signs, the largest t along one.
        """
        whitened = self.whitener @ self.t[..., None]
        evidence = [np.cbrt((whitened**2).sum((1, 2))), np.abs(self.t).max(1)]
        if len(ways):
            along = ways / self.error[:, None] @ self.whitener.transpose(0, 2, 1)
            along /= np.linalg.norm(along, axis=2, keepdims=True)
            evidence.append(np.abs(along @ whitened)[..., 0].max(1))
        return np.array(evidence)


@dataclass(frozen=True)
class Compared:
    """Signatures of two sets: which k signs count, ``counted`` (k,), their ``values`` (n, k) and which set photographs are of,
    ``belongs`` (n,), both as ``left_of`` (n, n) regresses them; ``orders`` (m, n) of photographs that permute values, the given
    one first; ``ways`` (d, k) in which effects move signs.
    """

    counted: np.ndarray
    values: np.ndarray
    belongs: np.ndarray
    left_of: np.ndarray
    orders: np.ndarray
    ways: np.ndarray

    @cached_property
    def every(self):
        """The SignDifferences under all orders."""
        return self._differences(self.values, self.orders)

    @property
    def t(self):
        """The differences (k,) of the sets in standard errors."""
        return self.every.t[0]

    @property
    def error(self):
        """The standard errors (k,) of the differences."""
        return self.every.error[0]

    @cached_property
    def p(self):
        """The share of the orders that are as telling as the given one."""
        return float(p_values(self.every.evidence(self.ways)).min())

    @property
    def whitened(self):
        """The whitened differences (k,) of the sets, nothing moved."""
        return self.every.whitener[0] @ self.t

    def distance(self, moved):
        """Return the whitened differences (k,) that a move (len(SIGNS),) of the earlier signatures leaves."""
        return self.every.whitener[0] @ (self.t - np.nan_to_num(moved[self.counted]) / self.error)

    def is_of_light(self, moved):
        """Return whether a move (len(SIGNS),) is most of all one of signs that another lamp moves as well."""
        squares = (np.nan_to_num(moved[self.counted]) / self.error) ** 2
        return bool(squares[np.isin(self.counted, LIT)].sum() > squares.sum() / 2)

    def power(self, moved, max_p):
        """Return in which share of divisions a p of ``max_p`` would tell a move (len(SIGNS),) of the later signatures."""
        more = np.outer(self.belongs, np.nan_to_num(moved[self.counted]))
        orders = np.array(thinned(self.orders, DIVISIONS_OF_POWER))

        def told(order):
            differences = self._differences(self.values[order] + more, orders)
            return p_values(differences.evidence(self.ways)).min() <= max_p

        return float(np.mean([told(order) for order in thinned(self.orders[1:], TRIED)]))

    def _differences(self, values, orders):
        """Return the SignDifferences of values (n, k) permuted by orders (m, n), regressed anew in each.

        Correlations are shrunk towards none, as n photographs tell few. Source: O. Ledoit and M. Wolf, "A well-conditioned
        estimator for large-dimensional covariance matrices" (2004).
        """
        n, k = values.shape
        permuted, belongs = self.left_of @ values[orders], self.belongs
        difference = np.einsum("n,mnk->mk", belongs, permuted) / (belongs @ belongs)
        within, free = permuted - belongs[:, None] * difference[:, None], np.trace(self.left_of) - 1
        sd = np.sqrt((within**2).sum(1) / free) + 1e-6
        error = sd / np.sqrt(belongs @ belongs)
        within /= sd[:, None]
        shrunk = k / (k + n - 2)
        correlation = (1 - shrunk) * within.transpose(0, 2, 1) @ within / free + shrunk * np.eye(k)
        return SignDifferences(difference / error, error, np.linalg.inv(np.linalg.cholesky(correlation)))


def compared(before, after, seed, poses=None, uncounted=(), ways=()):
    """Return the Compared of signatures (n, len(SIGNS)) of two sets, but for signs ``uncounted``; a seed draws permutations.

    ``ways`` (d, len(SIGNS)), if given, are moves by effects: what points along one of them is told apart from chance more surely.
    What signs follow of the photographs' ``poses`` (both sets', m), if given, is regressed out, what is left is permuted and
    regressed again: else given signs, which lost what poses take, would scatter less than permuted ones.
    Source: D. Freedman and D. Lane, "A nonstochastic interpretation of reported significance levels" (1983).
    """
    every, belongs = np.concatenate([before, after]), np.repeat([0, 1], [len(before), len(after)])
    shown = np.isfinite(every)
    showing = np.minimum(*(shown[belongs == k].mean(0) for k in (0, 1)))
    counted = np.flatnonzero((showing >= 1 - CLOSED) & ~np.isin(SIGNS, uncounted))
    values = every[:, counted]
    for k in (0, 1):
        own = belongs == k
        values[own] = np.where(np.isfinite(values[own]), values[own], np.nanmedian(values[own], axis=0))
    left_of = residual_maker(np.zeros((len(every), 0)) if poses is None else poses)
    every_order = np.array(orders(belongs, np.random.default_rng(seed)))
    ways = np.nan_to_num(np.reshape(ways, (-1, len(SIGNS)))[:, counted])
    return Compared(counted, left_of @ values, left_of @ belongs, left_of, every_order, ways[ways.any(1)])


def orders(belongs, rng):
    """Return orders (m lists of n) of captures, the given one first: each division between the sets once, within by ``rng``."""
    divisions = labellings(belongs, rng, MAX_DIVISIONS)[1:]
    drawn = [np.concatenate([rng.permutation(np.flatnonzero(labels == k)) for k in (0, 1)]) for labels in divisions]
    return [np.arange(len(belongs)), *drawn]


def residual_maker(regressors):
    """Return the matrix (n, n) that takes values to what their mean and regressors (n, m) leave, a ridge on each.

    Few photographs tell little of a slope: in standard deviations its prior is a ``1 / n^(1/4)`` of a value's.
    """
    n, m = regressors.shape
    x = (regressors - regressors.mean(0)) / np.maximum(regressors.std(0), 1e-9)
    return np.eye(n) - 1 / n - x @ np.linalg.solve(x.T @ x + np.sqrt(n) * np.eye(m), x.T)
