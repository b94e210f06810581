"""Shot and read noise beyond the declared noise.

Variance of a linear value mu (in grey levels of full scale 255): K mu + sigma_d^2. Source: EMVA 1288 Release 4.0,
sigma_y^2 = K^2 sigma_d^2 + K (mu_y - mu_dark); K is the system gain in levels per electron.
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "sensor", 20
PARAMETERS = {
    "gain_dn_per_e": Parameter("dn/e", 0.0, 2.0, 0.0, (0.02, 0.0, 0.1), 0.005, "system gain: shot noise grows with it"),
    "read_noise_dn": Parameter(
        "dn", 0.0, 30.0, 0.0, (0.0, 1.0, 1.0), 0.2, "read noise of the linear image, grey levels"
    ),
}


def apply(image, view, p, rng):
    """Add Gaussian noise of the model's variance; nothing to an expected image."""
    if rng is None:
        return image
    variance = np.maximum(image, 0) * np.float32(255 * p["gain_dn_per_e"]) + np.float32(p["read_noise_dn"] ** 2)
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    return image + np.sqrt(variance) / np.float32(255) * noise
