"""The twin of a camera, config/twins/<campaign>/<camera>.yaml: the effects that were adopted, for people to edit."""

import re
import sys
from dataclasses import dataclass
from pathlib import Path

from effects import library, pipeline
from inputs.safe_yaml import LONGEST_SHOWN, load_yaml
from rig.errors import InputError

FIT = "fit"
KNOWN_KEYS = ("extends", "effects")
KNOWN_ENTRY = ("effect", "parameters", "origin")
# YAML 1.1 takes 1e-5 for text; people, and YAML 1.2, for a number
NUMBER = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+")


@dataclass(frozen=True)
class Twin:
    """What is adopted, [(name, {parameter: value})] in physical order.

    effects  what images are made with: a parameter written as ``fit`` does nothing yet, its value is unknown
    starts   the same, such parameters at the value from which a fit starts
    free     [(effect, parameter)] that were written as ``fit``
    """

    effects: list
    starts: list
    free: list


def load_twin(path):
    """Return the Twin in a file; the ideal one where there is none. Raises InputError naming file, effect and value."""
    path = Path(path)
    if not path.is_file():
        return Twin([], [], [])
    entries = entries_of(path)
    effects, starts, free = [], [], []
    for where, entry in entries:
        name, parameters, fitted = read_effect(where, entry)
        known = library.parameters_of(name)
        effects.append((name, parameters | {key: known[key].null for key in fitted}))
        starts.append((name, parameters))
        free += [(name, key) for key in fitted]
    return Twin(pipeline.in_order(effects), pipeline.in_order(starts), free)


def entries_of(path, visited=()):
    """Return [(where, entry)] of a file and of the twin it extends, as they stand; an effect of both is taken from the file."""
    path = path.resolve()
    if path in visited:
        raise InputError(f"{path}: extends: goes round in a circle")
    data = load_yaml(path)
    for key in data:
        if key not in KNOWN_KEYS:
            raise InputError(f"{path}: unknown key {key!r}; known: {', '.join(KNOWN_KEYS)}")
    own = data.get("effects") or []
    if not isinstance(own, list) or not all(isinstance(e, dict) for e in own):
        raise InputError(f"{path}: effects: a list of entries with effect and parameters is needed")
    names = [e.get("effect") for e in own]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: effects: {name!r} stands twice")
    inherited = []
    if data.get("extends") is not None:
        base = path.parent / str(data["extends"])
        if not _is_file(base):
            raise InputError(f"{path}: extends: {data['extends']!r}: no such file (relative to this file's folder)")
        inherited = [(w, e) for w, e in entries_of(base, (*visited, path)) if e.get("effect") not in names]
    return inherited + [(f"{path}: effects, entry {k + 1}", e) for k, e in enumerate(own)]


def _is_file(path):
    """Return whether there is such a file; a name that no file can have names none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_effect(where, entry):
    """Return (name, {parameter: value}, parameters to be fitted) of an entry of a twin; InputError begins with ``where``."""
    for key in entry:
        if key not in KNOWN_ENTRY:
            raise InputError(f"{where}: unknown key {key!r}; known: {', '.join(KNOWN_ENTRY)}")
    name, given = entry.get("effect"), entry.get("parameters") or {}
    found = library.available_effects()
    if not isinstance(name, str) or name not in found:
        raise InputError(f"{where}: unknown effect {name!r}; there are {', '.join(found)}")
    if not isinstance(given, dict):
        raise InputError(f"{where}: parameters: names and values are needed")
    known, (start, *_) = library.parameters_of(name), library.starts_of(name)
    for key in given:
        if key not in known:
            raise InputError(
                f"{where}: {name} has no parameter {key!r}; it has {', '.join(known)} (units are part of the names)"
            )
    values, fitted = {}, []
    for key, p in known.items():
        value = given.get(key, p.null)
        if isinstance(value, str) and NUMBER.fullmatch(value):
            value = float(value)
        if value == FIT and not p.is_choice:
            fitted.append(key)
            value = start[key]
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not -sys.float_info.max < value < sys.float_info.max
        ):
            wanted = "a whole number" if p.is_choice else f"a number in {p.unit} or `{FIT}`"
            raise InputError(f"{where}: {name}.{key} is {value!r:.{LONGEST_SHOWN}}; {wanted} is needed")
        if not p.lower <= value <= p.upper:
            raise InputError(f"{where}: {name}.{key} is {value:g} {p.unit}; allowed are {p.lower:g} to {p.upper:g}")
        if p.is_choice and value != int(value):
            raise InputError(f"{where}: {name}.{key} is {value:g}; a whole number is needed")
        values[key] = float(value)
    return name, values, fitted
