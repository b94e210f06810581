"""Whether an effect has changed between two sets of captures: one-step differences, and captures permuted between the sets.

All is a function of the captures' information matrices and scores (joint_fit.moments), poses eliminated.
"""

import itertools
import math
from dataclasses import dataclass
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

    def towards(self, mine, also_common):
        """Return (D (a, s + p), k): common entries and, last, k directions of what parameters may do, by all entries.

        ``mine`` (q,) are their numbers among those that may change.
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
        return np.concatenate([np.eye(s, self.H.shape[1]), *[pick] * (1 + also_common)]), len(told)

    def differences(self, mine, also_common, labels):
        """Return the Differences of parameters under labellings (m, n) of the captures, arguments as of ``towards``."""
        D, k = self.towards(mine, also_common)
        H, by_parameters = D @ self.H @ D.T, D @ self.H[:, :, len(self.precision) + mine]
        n, a = H.shape[:2]
        c, J, labels = slice(0, a - k), slice(a - k, a), labels.astype(float)
        ridge = np.concatenate([self.precision, np.full(a - k - len(self.precision), RIDGE)])
        inverse = np.linalg.pinv(H[:, c, c].sum(0) + np.diag(ridge), rcond=1e-10, hermitian=True)
        beside = (labels @ H[:, J, c].reshape(n, -1)).reshape(-1, k, a - k)
        information = (labels @ H[:, J, J].reshape(n, -1)).reshape(-1, k, k)
        information += RIDGE * np.eye(k) - beside @ inverse @ beside.transpose(0, 2, 1)
        return Divided(H, by_parameters, labels, inverse, beside, information).differences(self.g @ D.T)


@dataclass(frozen=True)
class Divided:
    """Captures' information on common entries and, last, k directions of some parameters, divided by m labellings: what scores do
    not change.

    H (n, a, a), by_parameters (n, a, q) of these entries beside the q parameters, labels (m, n), inverse (a - k, a - k) of all
    captures' on the common entries; beside (m, k, a - k) and information (m, k, k) of the second set
    """

    H: np.ndarray
    by_parameters: np.ndarray
    labels: np.ndarray
    inverse: np.ndarray
    beside: np.ndarray
    information: np.ndarray

    def differences(self, g):
        """Return the Differences that the captures' scores (n, a) make.

        Sources: C. R. Rao's score test (1948); O. Ledoit and M. Wolf, "A well-conditioned estimator for large-dimensional
        covariance matrices" (2004).
        """
        (n, a), k = g.shape, self.information.shape[-1]
        c, J = slice(0, a - k), slice(a - k, a)
        H_Jc, H_JJ = self.H[:, J, c], self.H[:, J, J]
        score = g[:, J] - H_Jc @ self.inverse @ g[:, c].sum(0)
        total = (self.labels @ score)[..., None]
        delta = np.linalg.solve(self.information, total)
        follow = (self.beside.transpose(0, 2, 1) @ delta)[..., 0] @ self.inverse
        left = score[..., None] + (H_Jc.reshape(n * k, -1) @ follow.T).reshape(n, k, -1)
        left = left - self.labels.T[:, None] * (H_JJ.reshape(n * k, k) @ delta[..., 0].T).reshape(n, k, -1)
        scatter = left.transpose(2, 1, 0) @ left.transpose(2, 0, 1)
        shrunk = k / (k + n - 2)
        mean = np.trace(scatter, axis1=1, axis2=2)[:, None, None] / k
        return Differences(self, g, total, (1 - shrunk) * scatter + shrunk * mean * np.eye(k))


@dataclass(frozen=True)
class Differences:
    """One-step differences of the second set from the first in k directions of some parameters, under m labellings.

    total (m, k, 1) of the second set's scores, of all captures' ``g`` (n, a), scatter (m, k, k) of the scores within the sets
    """

    divided: Divided
    g: np.ndarray
    total: np.ndarray
    scatter: np.ndarray

    @property
    def labels(self):
        """The labellings (m, n)."""
        return self.divided.labels

    def gain(self):
        """Return the loss (m,) that the differences explain to first order."""
        return (np.linalg.solve(self.divided.information, self.total) * self.total).sum((1, 2))

    @cached_property
    def evidence(self):
        """The evidence (m,) of a change: the cube root of Hotelling's statistic of the difference against the scatter.

        Sources: H. Hotelling, "The generalization of Student's ratio" (1931); E. B. Wilson and M. M. Hilferty, "The
        distribution of chi-square" (1931).
        """
        whitened = np.linalg.solve(np.linalg.cholesky(self.divided.information), self.total)
        return np.cbrt((whitened * np.linalg.solve(self.scatter, whitened)).sum((1, 2)))

    def with_more(self, more, given):
        """Return the Differences where the second set of labelling ``given`` has ``more`` (q,) of the parameters besides."""
        of_second = self.labels[given][:, None] * (self.divided.by_parameters @ more)
        return self.divided.differences(self.g + of_second)


def p_values(evidence, given=0):
    """Return (e,) of evidence (e, m) of e tests under m labellings, one of them given: each against the largest of all.

    Each is counted in its standard deviations over the labellings, so that effects of few and of many parameters compare.
    Source: P. H. Westfall and S. S. Young, "Resampling-based multiple testing" (1993).
    """
    evidence = (evidence - evidence.mean(1, keepdims=True)) / np.maximum(evidence.std(1, keepdims=True), 1e-12)
    return (evidence.max(0) >= evidence[:, [given]] - 1e-9).mean(1)
