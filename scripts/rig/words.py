"""How numbers are said to people, and what columns are called."""

import math

LADDER = {
    "corner_rmse_px": "corners, px",
    "intensity_rmse_dn": "grey levels, DN",
    "detection_disagreement_pct": "detection disagrees, %",
    "delta_distance_cm": "distance, cm",
    "delta_rotation_deg": "rotation, °",
    "gap": "gap, floors",
}
MIN_ERROR = 1e-9  # of a value: less is what computing with doubles leaves


def plain(name):
    """Return an identifier as words: ``some_effect`` is ``some effect``."""
    return name.replace("_", " ")


def with_error(value, error):
    """Return ``value ± error``, both to the error's second digit; four digits of the value where the error is unknown.

    ``error`` is a standard error, None, not finite or below rounding where it is unknown.
    """
    if not error or not math.isfinite(error) or error < MIN_ERROR * max(abs(value), 1.0):
        return f"{value:.4g}"
    places = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{places}f} ± {error:.{places}f}"


def gap_along(place):
    """Return the words of an entry of a verdict's ``where``: an observable, and what its gap follows."""
    if place["covariate"] == "everywhere":
        return f"{place['observable']}, alike everywhere"
    return f"{place['observable']} by {place['covariate']}"
