"""The twins that a study looks at: without effects, with each alone, all but each, all; and all with another choice."""

from dataclasses import dataclass

IDEAL, ALONE, WITHOUT, WHOLE, CHOICE = "ideal", "alone", "without", "whole", "choice"


@dataclass(frozen=True)
class Variant:
    """One twin of a study.

    kind     IDEAL, ALONE, WITHOUT, WHOLE or CHOICE
    name     of ALONE and WITHOUT the effect, of CHOICE the choice, else empty
    open     of CHOICE what is left open, else empty
    effects  ((name, {parameter: value}), ...)
    """

    kind: str
    name: str
    open: str
    effects: tuple


def variants_of(effects, camera, choices):
    """Return the Variants of a camera whose twin has effects [(name, {parameter: value})].

    choices  dicts with open, choice, cameras, effects and times as inputs.twin_study.Choice; what a twin lacks can't be
             multiplied, so such a choice is not among its Variants
    """
    whole = tuple((name, dict(p)) for name, p in effects)
    found = [Variant(IDEAL, "", "", ())]
    found += [Variant(ALONE, name, "", ((name, p),)) for name, p in whole]
    found += [Variant(WITHOUT, name, "", tuple(e for e in whole if e[0] != name)) for name, _ in whole]
    found.append(Variant(WHOLE, "", "", whole))
    for c in choices:
        if (not c["cameras"] or camera in c["cameras"]) and set(c["times"]) <= {name for name, _ in whole}:
            found.append(Variant(CHOICE, c["choice"], c["open"], changed(whole, c["effects"], c["times"])))
    return found


def changed(effects, values, times):
    """Return effects with some parameters' values replaced {effect: {parameter: value}}, and with others multiplied."""
    made = {name: dict(p) for name, p in effects}
    for name, parameters in values.items():
        made[name] = made.get(name, {}) | parameters
    for name, factors in times.items():
        made[name] |= {key: made[name][key] * factor for key, factor in factors.items()}
    return tuple(made.items())
