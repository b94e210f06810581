"""Whether an effect has changed between two sets of captures: one-step differences, and captures permuted between the sets.

All is a function of the captures' information matrices and scores (gap.joint_fit.moments), poses eliminated.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

MOST_LABELLINGS = 1000
RIDGE = 1e-4  # of an effect's information in its own units: what no capture tells stays where it is


def labellings(belongs, rng):
    """Return labels (m, n), 0 or 1, of captures: every way to divide them alike where these are few, the given one first.

    Else the given one and others drawn by ``rng``, ``MOST_LABELLINGS`` in all.
    """
    n, ones = len(belongs), int(belongs.sum())
    if math.comb(n, ones) <= MOST_LABELLINGS:
        ways = itertools.combinations(range(n), ones)
        every = np.array([np.isin(np.arange(n), way) for way in ways], int)
        return np.concatenate([belongs[None], every[(every != belongs).any(1)]])
    drawn = [rng.permutation(belongs) for _ in range(MOST_LABELLINGS - 1)]
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

    def about(self, mine, own):
        """Return (H (n, a, a), g (n, a), a - k) by common entries and, last, the k parameters ``mine``, brought to one scale.

        Common is as well what ``own`` (n, r) times these parameters makes: 1 a value of theirs in all captures, a covariate
        what they seem to be by a capture's pose. Also returns scale (k,), by which the parameters were multiplied.
        """
        s, k = len(self.precision), len(mine)
        scale = np.sqrt(np.maximum(np.diagonal(self.H.sum(0))[s + mine], 1e-12))
        pick = np.zeros((k, self.H.shape[1]))
        pick[np.arange(k), s + mine] = 1 / scale
        rows = [pick * w for w in (*own.T[:, :, None, None], np.ones((len(own), 1, 1)))]
        D = np.concatenate([np.tile(np.eye(s, self.H.shape[1]), (len(own), 1, 1)), *rows], axis=1)
        return D @ self.H @ D.transpose(0, 2, 1), np.einsum("nab,nb->na", D, self.g), scale

    def asked(self, mine, own, labels):
        """Return (delta (m, k), gain (m,), evidence (m,)) of a change of k parameters under labellings (m, n) of captures.

        delta is the second set's less the first's, gain the loss that it explains, evidence -log10 of the tail of the F
        distribution of that gain against the scatter of captures within the sets. ``mine`` and ``own`` as in ``about``.
        Sources: C. R. Rao's score test (1948); D. Freedman and D. Lane, "A nonstochastic interpretation of reported
        significance levels" (1983), for what depends on the pose.
        """
        H, g, scale = self.about(mine, own)
        (n, a), k = g.shape, len(mine)
        c, J = slice(0, a - k), slice(a - k, a)
        ridge = np.concatenate([self.precision, np.full(a - k - len(self.precision), RIDGE)])
        inverse = np.linalg.pinv(H[:, c, c].sum(0) + np.diag(ridge), rcond=1e-10, hermitian=True)
        score = g[:, J] - H[:, J, c] @ inverse @ g[:, c].sum(0)
        labels = labels.astype(float)
        H_Jc, H_JJ = H[:, J, c], H[:, J, J]
        B = (labels @ H_Jc.reshape(n, -1)).reshape(-1, k, a - k)
        information = (labels @ H_JJ.reshape(n, -1)).reshape(-1, k, k) - B @ inverse @ B.transpose(0, 2, 1)
        total = labels @ score
        delta = np.linalg.solve(information + RIDGE * np.eye(k), total[..., None])[..., 0]
        gain = (delta * total).sum(1)
        follow = (B.transpose(0, 2, 1) @ delta[..., None])[..., 0] @ inverse
        left = score[..., None] + (H_Jc.reshape(n * k, -1) @ follow.T).reshape(n, k, -1)
        left = left - labels.T[:, None] * (H_JJ.reshape(n * k, k) @ delta.T).reshape(n, k, -1)
        freedom = max(n - 2 - own.shape[1], 1)
        whiten = np.linalg.inv(np.linalg.cholesky(H_JJ.sum(0) + RIDGE * np.eye(k)))
        within = ((whiten @ left) ** 2).sum((0, 1)) * n / (k * freedom)
        tail = f_distribution.logsf(gain / k / np.maximum(within, 1e-9), k, k * freedom)
        return delta / scale, gain, -tail / np.log(10)


def p_values(evidence):
    """Return (e,) of evidence (e, m) of e effects under m labellings, the given one first: each against the largest of all.

    Source: P. H. Westfall and S. S. Young, "Resampling-based multiple testing" (1993).
    """
    largest = evidence.max(axis=0)
    return (largest[None] >= evidence[:, :1] - 1e-9).mean(axis=1)
