"""Whether an effect has changed between two sets of captures: one-step differences, and captures permuted between the sets.

All is a function of the captures' information matrices and scores (gap.joint_fit.moments), poses eliminated.
"""

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

MAX_LABELLINGS = 1000
MAX_DIRECTIONS = 24  # of one effect's parameters: a free warp's are more than captures tell
RIDGE = 1e-4  # of an effect's information in its own units: what no capture tells stays where it is


def labellings(belongs, rng, most=MAX_LABELLINGS):
    """Return labels (m, n), 0 or 1, of captures: every way to divide them alike where these are few, the given one first.

    Else the given one and others drawn by ``rng``, ``most`` in all.
    """
    n, ones = len(belongs), int(belongs.sum())
    if math.comb(n, ones) <= most:
        ways = itertools.combinations(range(n), ones)
        every = np.array([np.isin(np.arange(n), way) for way in ways], int)
        return np.concatenate([belongs[None], every[(every != belongs).any(1)]])
    drawn = [rng.permutation(belongs) for _ in range(most - 1)]
    return np.array([belongs, *drawn], int)


@dataclass(frozen=True)
class Moments:
    """The captures' information and scores by the entries that a joint fit moves, and by those that may change.

    H (n, s + p, s + p), g (n, s + p): first s common entries, then p parameters of the capture's own set
    precision (s,)  of the common entries' priors
    """

    H: np.ndarray
    g: np.ndarray
    precision: np.ndarray

    def about(self, mine, also_common):
        """Return (H (n, a, a), g (n, a), directions (k, p)): common entries and, last, k directions of what parameters may do.

        ``mine`` (p,) are their numbers among those that may change.
        Directions tell alike much in all captures together, and of many parameters only those that tell most are kept. They are
        common entries as well where they are ``also_common``: a value that all captures may have.
        """
        s = len(self.precision)
        about = self.H.sum(0)[np.ix_(s + mine, s + mine)]
        scale = np.sqrt(np.maximum(np.diagonal(about), 1e-12))
        told, basis = np.linalg.eigh(about / np.outer(scale, scale))
        told, basis = told[-MAX_DIRECTIONS:], basis[:, -MAX_DIRECTIONS:]
        pick = np.zeros((len(told), self.H.shape[1]))
        pick[:, s + mine] = (basis / np.sqrt(told + RIDGE)).T / scale
        D = np.concatenate([np.eye(s, self.H.shape[1]), *[pick] * (1 + also_common)])
        return D @ self.H @ D.T, self.g @ D.T, pick[:, s + mine]

    def differences(self, mine, also_common, labels):
        """Return the Differences of parameters under labellings (m, n) of the captures, arguments as of ``about``.

        Sources: C. R. Rao's score test (1948); O. Ledoit and M. Wolf, "A well-conditioned estimator for large-dimensional
        covariance matrices" (2004).
        """
        H, g, directions = self.about(mine, also_common)
        k = len(directions)
        n, a = g.shape
        c, J = slice(0, a - k), slice(a - k, a)
        ridge = np.concatenate([self.precision, np.full(a - k - len(self.precision), RIDGE)])
        inverse = np.linalg.pinv(H[:, c, c].sum(0) + np.diag(ridge), rcond=1e-10, hermitian=True)
        score = g[:, J] - H[:, J, c] @ inverse @ g[:, c].sum(0)
        labels = labels.astype(float)
        H_Jc, H_JJ = H[:, J, c], H[:, J, J]
        B = (labels @ H_Jc.reshape(n, -1)).reshape(-1, k, a - k)
        information = (labels @ H_JJ.reshape(n, -1)).reshape(-1, k, k) - B @ inverse @ B.transpose(0, 2, 1)
        information += RIDGE * np.eye(k)
        total = (labels @ score)[..., None]
        delta = np.linalg.solve(information, total)
        follow = (B.transpose(0, 2, 1) @ delta)[..., 0] @ inverse
        left = score[..., None] + (H_Jc.reshape(n * k, -1) @ follow.T).reshape(n, k, -1)
        left = left - labels.T[:, None] * (H_JJ.reshape(n * k, k) @ delta[..., 0].T).reshape(n, k, -1)
        scatter = left.transpose(2, 1, 0) @ left.transpose(2, 0, 1)
        shrunk = k / (k + n - 2)
        mean = np.trace(scatter, axis1=1, axis2=2)[:, None, None] / k
        scatter = (1 - shrunk) * scatter + shrunk * mean * np.eye(k)
        return Differences(self, mine, also_common, labels, total, information, scatter, directions)


@dataclass(frozen=True)
class Differences:
    """One-step differences of the second set from the first in k directions of some parameters, under m labellings.

    moments, mine, also_common and labels (m, n) they are made of; total (m, k, 1) of the second set's scores, information
    (m, k, k) on the difference, scatter (m, k, k) of the scores within the sets; directions (k, p) of the parameters
    """

    moments: Moments
    mine: np.ndarray
    also_common: bool
    labels: np.ndarray
    total: np.ndarray
    information: np.ndarray
    scatter: np.ndarray
    directions: np.ndarray

    def gain(self):
        """Return the loss (m,) that the differences explain to first order."""
        return (np.linalg.solve(self.information, self.total) * self.total).sum((1, 2))

    @cached_property
    def evidence(self):
        """The evidence (m,) of a change: the cube root of Hotelling's statistic of the difference against the scatter.

        Sources: H. Hotelling, "The generalization of Student's ratio" (1931); E. B. Wilson and M. M. Hilferty, "The
        distribution of chi-square" (1931).
        """
        whitened = np.linalg.solve(np.linalg.cholesky(self.information), self.total)
        return np.cbrt((whitened * np.linalg.solve(self.scatter, whitened)).sum((1, 2)))

    def with_more(self, more, given):
        """Return the Differences where the second set of labelling ``given`` has ``more`` (p,) of the parameters besides."""
        made = self.moments
        of_second = self.labels[given][:, None] * (made.H[:, :, len(made.precision) + self.mine] @ more)
        return replace(made, g=made.g + of_second).differences(self.mine, self.also_common, self.labels)


def p_values(evidence, given=0):
    """Return (e,) of evidence (e, m) of e tests under m labellings, one of them given: each against the largest of all.

    Each is counted in its standard deviations over the labellings, so that effects of few and of many parameters compare.
    Source: P. H. Westfall and S. S. Young, "Resampling-based multiple testing" (1993).
    """
    evidence = (evidence - evidence.mean(1, keepdims=True)) / np.maximum(evidence.std(1, keepdims=True), 1e-12)
    return (evidence.max(0) >= evidence[:, [given]] - 1e-9).mean(1)
