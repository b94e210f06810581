"""Which effects there are, found by being there, and whether each keeps the contract (docs/effects.md)."""

import difflib
import functools
import importlib.util
import inspect
import pkgutil

import effects
from effects.base import AFFECTED, PLACE, STAGES, Parameter
from rig.errors import InputError
from rig.light import LEFT_OPEN

SHARED_MODULES = (
    "base",
    "contract",
    "encoding",
    "exponential",
    "filters",
    "library",
    "medians",
    "noise_kernels",
    "own_tables",
    "pipeline",
    "quantisation",
    "resampling",
)
HOOKS = {  # functions that an effect may have, with their parameters
    "change_scene": ("scene", "p"),
    "map_points": ("xy", "view", "p", "channel"),
    "points_by_parameters": ("xy", "view", "p", "keys"),
    "spread": ("xy", "view", "p", "n"),
    "left_to_blur": ("p",),
    "apply": ("image", "view", "p", "rng"),
    "variance": ("linear", "p"),
    "noise_kernel": ("p", "noise_dn"),
    "reach_px": ("p",),
    "starts_from": ("image",),
    "declared_by": ("facts",),
}
NEEDED = ("STAGE", "ORDER", "AFFECTS", "PARAMETERS")
OPTIONAL = (
    "STARTS",
    "CHROMATIC",
    "MAKES_COLOUR",
    "MIXES_CHANNELS",
    "NEEDS_REPEATS",
    "ONLY_BOARDS",
    "OWN_WHERE_OPEN",
    "SHARED_WHERE_OPEN",
)
ALIKE = 0.82  # difflib's ratio from which a name is taken for a misspelt one; spread_px and spread have 0.80


@functools.cache
def available_effects():
    """Return {name: module} of all effects: the modules beside this one.

    Raises InputError naming the file that does not import or breaks the contract.
    """
    names = sorted(m.name for m in pkgutil.iter_modules(effects.__path__))
    return {n: _load(n) for n in names if n not in SHARED_MODULES and not n.startswith("_")}


def _load(name):
    path = importlib.util.find_spec(f"effects.{name}").origin
    try:
        module = importlib.import_module(f"effects.{name}")
    except Exception as error:
        raise InputError(f"{path}: does not import: {type(error).__name__}: {error}") from None
    try:
        _check_contract(module)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return module


def _check_contract(module):
    """Raise InputError, without the file's name, where a module is no effect as docs/effects.md says."""
    _check_names(module)
    for constant in NEEDED:
        if not hasattr(module, constant):
            raise InputError(f"breaks the contract: {constant} is missing (see docs/effects.md)")
    if module.STAGE not in STAGES:
        raise InputError(f"STAGE is {module.STAGE!r}; allowed: {', '.join(STAGES)}")
    orders = module.ORDER if isinstance(module.ORDER, tuple) else (module.ORDER,)
    if not orders or not all(isinstance(order, int | float) for order in orders):
        raise InputError(f"ORDER is {module.ORDER!r}; a number, or a tuple of numbers, is needed")
    if not (module.__doc__ or "").strip():
        raise InputError("breaks the contract: a docstring that says what the effect is is missing")
    _check_hooks(module)
    _check_parameters(module)
    _check_starts(module)
    _check_left_open(module)


def _check_names(module):
    """Refuse public functions and constants that look like misspelt ones of the contract: nothing would call them."""
    known = [*HOOKS, *NEEDED, *OPTIONAL]
    for name, value in vars(module).items():
        own = getattr(value, "__module__", None) == module.__name__
        if name in known or name.startswith("_") or not (name.isupper() or (callable(value) and own)):
            continue
        nearest = difflib.get_close_matches(name, [k for k in known if k.isupper() == name.isupper()], 1, ALIKE)
        if nearest:
            raise InputError(f"{name}: the contract has no such name; {nearest[0]} is meant? (see docs/effects.md)")


def _check_hooks(module):
    """Refuse functions that the contract calls with other parameters, and effects that do not do what they say."""
    for name, parameters in HOOKS.items():
        hook = getattr(module, name, None)
        if hook is None:
            continue
        if not callable(hook):
            raise InputError(f"{name} is {hook!r}; a function is needed")
        has = [p.name for p in inspect.signature(hook).parameters.values() if p.default is p.empty]
        if has != list(parameters):
            raise InputError(f"{name}({', '.join(has)}): the contract has {name}({', '.join(parameters)})")
    wanted = ("change_scene",) if module.STAGE == "scene" else ("map_points", "apply")
    if not any(hasattr(module, hook) for hook in wanted):
        raise InputError(f"a {module.STAGE} effect needs {' or '.join(wanted)}")
    if module.AFFECTS not in AFFECTED:
        raise InputError(f"AFFECTS is {module.AFFECTS!r}; allowed: {', '.join(AFFECTED)}")
    if module.AFFECTS == "geometry" and (hasattr(module, "apply") or hasattr(module, "spread")):
        raise InputError(
            "AFFECTS is 'geometry', but it has apply or spread: geometry moves points and does nothing else"
        )


def _check_parameters(module):
    if not isinstance(module.PARAMETERS, dict) or not module.PARAMETERS:
        raise InputError("PARAMETERS must be a dict of at least one effects.base.Parameter")
    for key, p in module.PARAMETERS.items():
        if not isinstance(p, Parameter):
            raise InputError(f"PARAMETERS[{key!r}] is no effects.base.Parameter")
        if not p.lower <= p.null <= p.upper:
            raise InputError(f"PARAMETERS[{key!r}]: null is {p.null}; it must lie in [{p.lower}, {p.upper}]")
    if isinstance(module.ORDER, tuple):
        place = module.PARAMETERS.get(PLACE)
        if place is None or not place.is_choice or (place.lower, place.upper) != (0, len(module.ORDER) - 1):
            raise InputError(
                f"ORDER is {module.ORDER!r}: a discrete auxiliary parameter {PLACE!r}, 0 to {len(module.ORDER) - 1}, is "
                "needed that says which"
            )


def _check_starts(module):
    starts = getattr(module, "STARTS", ({},))
    if not isinstance(starts, tuple) or not starts or not all(isinstance(start, dict) for start in starts):
        raise InputError(f"STARTS is {starts!r}; a tuple of at least one dict {{parameter: value}} is needed")
    for start in starts:
        for key, value in start.items():
            if key not in module.PARAMETERS:
                raise InputError(f"STARTS: no parameter {key!r}; there are {', '.join(module.PARAMETERS)}")
            p = module.PARAMETERS[key]
            if not p.lower <= value <= p.upper:
                raise InputError(f"STARTS: {key} is {value}; it must lie in [{p.lower}, {p.upper}]")


def _check_left_open(module):
    own, shared = getattr(module, "OWN_WHERE_OPEN", {}), getattr(module, "SHARED_WHERE_OPEN", ())
    if not isinstance(own, dict) or not isinstance(shared, tuple) or not {*own, *shared} <= LEFT_OPEN.keys():
        raise InputError(
            "OWN_WHERE_OPEN must be a dict, SHARED_WHERE_OPEN a tuple, of what a campaign may leave open: "
            f"{', '.join(LEFT_OPEN)}"
        )
    unknown = sorted({key for keys in own.values() for key in keys} - module.PARAMETERS.keys())
    if unknown:
        raise InputError(f"OWN_WHERE_OPEN: no parameter {unknown[0]!r}; there are {', '.join(module.PARAMETERS)}")
