"""What draws of effects share: a sign, and a direction."""

import numpy as np


def sign(rng):
    """Return 1.0 or -1.0, each as often."""
    return 1.0 if rng.random() < 0.5 else -1.0


def direction(rng, n):
    """Return a unit vector (n,), even over all directions."""
    v = rng.standard_normal(n)
    return v / np.linalg.norm(v)
