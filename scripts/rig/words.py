"""How numbers are said to people."""

import math


def with_error(value, error):
    """Return ``value ± error``, both to the error's second digit; four digits of the value where the error is unknown.

    ``error`` is a standard error, None or not finite where it is unknown.
    """
    if not error or not math.isfinite(error):
        return f"{value:.4g}"
    places = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{places}f} ± {error:.{places}f}"
