"""Outcomes of a search kept under what they depend on, so that an edited effect is tried anew and the others are not.

A store has ``get(names, text)``, which returns what is kept of some effects under a text, None where there is nothing, and
``put(names, text, value)``. That the rest (captures, scene, code that all effects share) is the same is the store's to know.
"""

import functools
import hashlib

import numpy as np

from gap.select.twin import Candidate, Twin


def kept(method):
    """Keep what a method of a Search returns under its arguments, where the search has a store; its cost counts either way."""

    @functools.wraps(method)
    def outcome(self, *args):
        if self.store is None:
            return method(self, *args)
        names, parts = set(), [method.__name__]
        _describe(args, names, parts)
        text = hashlib.sha256("\x1f".join(parts).encode()).hexdigest()
        found = self.store.get(names, text)
        if found is None:
            before = self.cost
            found = method(self, *args), self.cost - before
            self.store.put(names, text, found)
        else:
            self.solver.cost += found[1]
        return found[0]

    return outcome


def _describe(value, names, parts):
    """Add to ``parts`` what tells a value from others, and to ``names`` all strings in it, effects among them."""
    if isinstance(value, Twin):
        _describe((value.effects, value.poses, value.floors, value.loss), names, parts)
    elif isinstance(value, Candidate):
        _describe((value.effect, value.parameters, value.twin, value.complete), names, parts)
    elif isinstance(value, dict):
        _describe(list(value.items()), names, parts)
    elif isinstance(value, list | tuple):
        parts.append(f"{len(value)} of")
        for part in value:
            _describe(part, names, parts)
    elif isinstance(value, np.ndarray):
        parts.append(f"{value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}")
    else:
        if isinstance(value, str):
            names.add(value)
        parts.append(repr(value if value is None or isinstance(value, str | bool) else float(value)))
