"""Whether an effect has changed between two sets of captures: one-step differences, and captures permuted between the sets.

All is a function of the captures' information matrices and scores (gap.joint_fit.moments), poses eliminated.
"""

import itertools
import math
from dataclasses import dataclass

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
        """Return (H (n, a, a), g (n, a), k): common entries and, last, k directions of what the parameters ``mine`` may do.

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
        return D @ self.H @ D.T, self.g @ D.T, len(pick)

    def asked(self, mine, also_common, labels):
        """Return (gain (m,), evidence (m,)) of a change of parameters under labellings (m, n) of the captures.

        gain is the loss that the second set's difference from the first explains to first order. evidence is the cube
        root of Hotelling's statistic of that difference against the scatter of captures within the sets. ``mine`` and
        ``also_common`` as in ``about``.
        Sources: C. R. Rao's score test (1948); H. Hotelling, "The generalization of Student's ratio" (1931), its covariance
        shrunk as by O. Ledoit and M. Wolf (2004); E. B. Wilson and M. M. Hilferty, "The distribution of chi-square" (1931).
        """
        H, g, k = self.about(mine, also_common)
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
        gain = (delta * total).sum((1, 2))
        follow = (B.transpose(0, 2, 1) @ delta)[..., 0] @ inverse
        left = score[..., None] + (H_Jc.reshape(n * k, -1) @ follow.T).reshape(n, k, -1)
        left = left - labels.T[:, None] * (H_JJ.reshape(n * k, k) @ delta[..., 0].T).reshape(n, k, -1)
        scatter = left.transpose(2, 1, 0) @ left.transpose(2, 0, 1)
        shrunk = k / (k + n - 2)
        mean = np.trace(scatter, axis1=1, axis2=2)[:, None, None] / k
        scatter = (1 - shrunk) * scatter + shrunk * mean * np.eye(k)
        whitened = np.linalg.solve(np.linalg.cholesky(information), total)
        return gain, np.cbrt((whitened * np.linalg.solve(scatter, whitened)).sum((1, 2)))


def p_values(evidence):
    """Return (e,) of evidence (e, m) of e tests under m labellings, the given one first: each against the largest of all.

    Each is counted in its standard deviations over the labellings, so that effects of few and of many parameters compare.
    Source: P. H. Westfall and S. S. Young, "Resampling-based multiple testing" (1993).
    """
    evidence = (evidence - evidence.mean(1, keepdims=True)) / np.maximum(evidence.std(1, keepdims=True), 1e-12)
    return (evidence.max(0) >= evidence[:, :1] - 1e-9).mean(1)
