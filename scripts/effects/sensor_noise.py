"""Shot and read noise beyond the declared noise.

Variance of a linear value mu (in grey levels of full scale 255): K mu + sigma_d^2. Source: EMVA 1288 Release 4.0,
sigma_y^2 = K^2 sigma_d^2 + K (mu_y - mu_dark); K is the system gain in levels per electron.

An expected image is no noiseless one: clipping and a bent encoding move the mean of noisy values.
"""

import numpy as np

from effects.base import Parameter
from effects.encoding import decode, encode, look_up

STAGE, ORDER = "sensor", 20
AFFECTS = "intensity"
PARAMETERS = {
    "gain_dn_per_e": Parameter(
        unit="dn/e", lower=0.0, upper=2.0, null=0.0, matters=0.005, doc="system gain: shot noise grows with it"
    ),
    "read_noise_dn": Parameter(
        unit="dn", lower=0.0, upper=30.0, null=0.0, matters=0.2, doc="read noise of the linear image, grey levels"
    ),
}
STARTS = ({"gain_dn_per_e": 0.02}, {"read_noise_dn": 1.0}, {"gain_dn_per_e": 0.1, "read_noise_dn": 1.0})


NODES = np.linspace(-5, 5, 401)  # standard deviations; even, as clipping is a kink that no polynomial follows
WEIGHTS = np.exp(-(NODES**2) / 2)
BRIGHTEST = 2.0  # linear value above which an image is white whatever the noise
ROOTS = np.linspace(0, np.sqrt(BRIGHTEST), 513)  # of linear values: finer near black, where encodings bend


def variance(linear, p):
    """Return the noise's variance of linear values, in grey levels of full scale 255."""
    return np.maximum(linear, 0) * np.float32(255 * p["gain_dn_per_e"]) + np.float32(p["read_noise_dn"] ** 2)


def expected(image, view, p):
    """Return linear values whose encoding is the mean encoding of the noisy ones."""
    if p["gain_dn_per_e"] == p["read_noise_dn"] == 0:
        return image
    linear = ROOTS[:, None] ** 2
    noisy = linear + np.sqrt(variance(linear, p)) / 255 * NODES
    means = encode(noisy.astype(np.float32), view.encoding) @ (WEIGHTS / WEIGHTS.sum())
    table = decode(means, view.encoding)
    roots = np.sqrt(np.clip(image, 0, BRIGHTEST), dtype=np.float32)
    return look_up(roots, table.astype(np.float32), 0.0, float(ROOTS[-1]))


def apply(image, view, p, rng):
    """Add Gaussian noise of the model's variance; without ``rng`` give what is expected of it."""
    if rng is None:
        return expected(image, view, p)
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    return image + np.sqrt(variance(image, p)) / np.float32(255) * noise
