"""Numbers that keep account of what is compared with them: would half of it, or double, have decided otherwise?

``watch(modules, names)`` puts such numbers in the place of modules' constants; ``counts`` tells of each how often something was
compared with it (or with what was computed from it), and how often half and double of it would have turned the answer.
"""

import operator
from collections import Counter

import numpy as np

SCALES = (0.5, 2.0)
counts = {}  # {name of a constant: Counter of "compared", 0.5 and 2.0}

ARITHMETIC = ("add", "sub", "mul", "truediv", "pow")
COMPARISONS = ("lt", "le", "gt", "ge")


class Watched:
    """A number that came from constants: ``others`` {(constant, scale): what it would be with a scaled constant}."""

    others = {}

    def __array_ufunc__(self, ufunc, method, *inputs, **options):
        """Arrays are compared with the number itself, and the account is kept; what they become by it forgets it."""
        plain = [number(i) for i in inputs]
        answer = getattr(ufunc, method)(*plain, **options)
        if ufunc in (np.less, np.less_equal, np.greater, np.greater_equal) and method == "__call__":
            for key, value in self.others.items():
                other = ufunc(*(value if i is self else number(i) for i in inputs))
                account(key, bool(np.any(other != answer)))
        return answer


class WatchedReal(Watched, np.float64):
    """A real number."""


class WatchedInteger(Watched, int):
    """A whole number; half of it is what is left without a remainder."""


def number(value):
    """Return a plain number of a Watched one; all else as it is."""
    if isinstance(value, WatchedReal):
        return np.float64(value)
    return int(value) if isinstance(value, WatchedInteger) else value


def watched(value, others):
    """Return a number with the account of what it would be."""
    made = (WatchedInteger if isinstance(value, int) else WatchedReal)(value)
    made.others = others
    return made


def account(key, turns):
    """Count one comparison with a constant, and whether its scale turns the answer."""
    name, scale = key
    counter = counts.setdefault(name, Counter())
    counter["compared"] += scale == SCALES[0]
    counter[scale] += turns


def _keys_of(*numbers):
    return dict.fromkeys(key for n in numbers for key in getattr(n, "others", ()))


def _at(value, key):
    """Return a number as it would be with a scaled constant."""
    return number(getattr(value, "others", {}).get(key, value))


def _arithmetic(op):
    def compute(a, b):
        answer = op(number(a), number(b))
        if not np.isscalar(answer):
            return answer
        with np.errstate(divide="ignore"):
            return watched(answer, {key: op(_at(a, key), _at(b, key)) for key in _keys_of(a, b)})

    return compute


def _comparison(op):
    def compare(a, b):
        answer = op(number(a), number(b))
        for key in _keys_of(a, b):
            account(key, bool(np.any(op(_at(a, key), _at(b, key)) != answer)))
        return answer

    return compare


for _name in ARITHMETIC:
    _compute = _arithmetic(getattr(operator, _name))
    setattr(Watched, f"__{_name}__", _compute)
    setattr(Watched, f"__r{_name}__", lambda a, b, compute=_compute: compute(b, a))
for _name in COMPARISONS:
    setattr(Watched, f"__{_name}__", _comparison(getattr(operator, _name)))


def watch(modules, names):
    """Put Watched numbers in the place of all constants of some names, in modules and in the defaults of their functions."""
    made = {}
    for module in modules:
        for name in names:
            value = vars(module).get(name)
            if type(value) in (int, float):
                setattr(module, name, _of_constant(made, name, value))
        for function in vars(module).values():
            _watch_defaults(function, module, made)


def _watch_defaults(function, module, made):
    """Put Watched numbers in the place of a function's defaults that are constants of its module."""
    if getattr(function, "__module__", None) != module.__name__ or not getattr(function, "__defaults__", None):
        return
    by_value = {number(w): w for name, w in made.items() if name in vars(module)}
    function.__defaults__ = tuple(
        by_value.get(d, d) if type(d) is float and d not in (0.0, 1.0) else d for d in function.__defaults__
    )


def _of_constant(made, name, value):
    if name not in made:
        half_and_double = {
            (name, s): (round(value * s) if isinstance(value, int) else np.float64(value * s)) for s in SCALES
        }
        counts.setdefault(name, Counter())
        made[name] = watched(value, half_and_double)
    return made[name]
