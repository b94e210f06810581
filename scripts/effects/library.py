"""The library of effects: what each says of itself."""

from effects.base import PLACE, STAGES, Scene
from effects.contract import available_effects
from rig.errors import InputError


def effect_named(name):
    """Return the module of an effect; raises InputError for a name that does not exist."""
    found = available_effects()
    if name not in found:
        raise InputError(f"unknown effect {name!r}; there are {', '.join(found)}")
    return found[name]


# -- what an effect says of itself ----------------------------------------------------------------------------------


def parameters_of(name):
    """Return {parameter: effects.base.Parameter} of an effect."""
    return effect_named(name).PARAMETERS


def nulls_of(name):
    """Return {parameter: value} at which an effect does nothing."""
    return {key: p.null for key, p in parameters_of(name).items()}


def starts_of(name):
    """Return the starting points [{parameter: value}] of an effect's fit; what a start does not name is at its null."""
    return [nulls_of(name) | start for start in getattr(effect_named(name), "STARTS", ({},))]


def begins_at_nothing(name):
    """Return whether all of an effect's starts are its nulls: it may be of either sign."""
    return all(start == nulls_of(name) for start in starts_of(name))


def starts_seen(image):
    """Return {effect: {parameter: value}}: the starts that a real image (H, W, 1 or 3) of grey levels shows by itself."""
    found = {
        n: module.starts_from(image) for n, module in available_effects().items() if hasattr(module, "starts_from")
    }
    return {name: start for name, start in found.items() if start is not None}


def declared_by(facts):
    """Return [(effect, {parameter: value})]: what a photograph's file says of itself (inputs.photo_facts) was done to it."""
    found = [
        (n, module.declared_by(facts)) for n, module in available_effects().items() if hasattr(module, "declared_by")
    ]
    return [(name, nulls_of(name) | values) for name, values in found if values is not None]


def discrete_parameters(name):
    """Return the names of the parameters with which an effect's image changes discontinuously."""
    return [key for key, p in parameters_of(name).items() if p.discrete]


def fitted_parameters(name):
    """Return the names of the parameters that a fit may move; whole values of the others are compared."""
    return [key for key, p in parameters_of(name).items() if not p.is_choice]


def place_of(name, p):
    """Return (stage, order, name) by which effects act one after the other, of parameters that may leave some at null."""
    module = effect_named(name)
    order = module.ORDER
    if isinstance(order, tuple):
        order = order[int(p.get(PLACE, module.PARAMETERS[PLACE].null))]
    return STAGES.index(module.STAGE), order, name


def acting(name, p):
    """Return the parameters of an effect but for where it acts, those that are not given at their null; None at the null."""
    nulls = nulls_of(name)
    complete = nulls | dict(p)
    if isinstance(effect_named(name).ORDER, tuple):
        del nulls[PLACE], complete[PLACE]
    return None if complete == nulls else complete


def affects(name):
    """Return what an effect changes: ``geometry``, ``point_spread`` or ``intensity``."""
    return effect_named(name).AFFECTS


def is_before_sensor(name):
    """Return whether an effect acts on light: the scene's, the lens's or the shutter's."""
    return STAGES.index(effect_named(name).STAGE) < STAGES.index("sensor")


def is_pure_geometry(name):
    """Return whether an effect only moves points, those of all colours alike: exact maps then tell all that it does."""
    return affects(name) == "geometry" and not getattr(effect_named(name), "CHROMATIC", False)


def change_levels(effects):
    """Return whether any of some effects [(name, parameters)] does more to an image than move its points."""
    return not all(is_pure_geometry(name) for name, _ in effects)


def needs_colour(name):
    """Return whether an effect does nothing to be seen in grey images."""
    return any(getattr(effect_named(name), flag, False) for flag in ("CHROMATIC", "MAKES_COLOUR"))


def adds_noise(name):
    """Return whether an effect adds something random to an image."""
    return hasattr(effect_named(name), "variance")


def needs_repeats(name):
    """Return whether only repeats of a station tell an effect from others."""
    return getattr(effect_named(name), "NEEDS_REPEATS", False)


def smooths_noise(name):
    """Return whether an effect leaves less of neighbouring pixels' noise: a filter of images, not a sensor's mosaic."""
    return max(_noise_powers(name), default=1) < 1


def sharpens(name):
    """Return whether an effect is a filter of images that leaves more of neighbouring pixels' noise, as of all that is fine."""
    return min(_noise_powers(name), default=1) > 1


def undoes(name, other):
    """Return whether an effect is a filter that sharpens, and another spreads light: together neither shows much."""
    return sharpens(name) and affects(other) == "point_spread"


def _noise_powers(name):
    """Return what a filter of images leaves of the power of white noise, at each of its starts; none of what is no filter."""
    module = effect_named(name)
    if module.STAGE != "processing" or not hasattr(module, "noise_kernel"):
        return []
    return [(module.noise_kernel(start, 1.0) ** 2).sum() for start in starts_of(name)]


def is_of_boards(name):
    """Return whether an effect competes for photographs of a calibration board alone: a rig's numbers exclude it."""
    return getattr(effect_named(name), "ONLY_BOARDS", False)


def own_where_open(left_open):
    """Return [(effect, parameter)] that each capture has for itself where a campaign leaves some things open."""
    found = [(n, getattr(module, "OWN_WHERE_OPEN", {})) for n, module in available_effects().items()]
    return [(n, key) for n, own in found for what in left_open for key in own.get(what, ())]


def shared_where_open(left_open):
    """Return the names of effects that all captures alike have where a campaign leaves some things open, and none for itself."""
    own = dict(own_where_open(left_open))
    found = [(n, getattr(module, "SHARED_WHERE_OPEN", ())) for n, module in available_effects().items()]
    return [n for n, shared in found if n not in own and set(shared) & set(left_open)]


def changes_ink(name):
    """Return whether an effect changes where black is printed, of what stays in its place."""
    change, scene = getattr(effect_named(name), "change_scene", None), Scene((), 1.0, 0.0, 0.0, 0.0)
    if change is None or is_pure_geometry(name):
        return False
    most = {key: p.upper for key, p in parameters_of(name).items()}
    return change(scene, most).ink_spread_m != scene.ink_spread_m


def is_of_lens(name):
    """Return whether an effect is the lens's, and moves points."""
    return effect_named(name).STAGE == "lens" and is_pure_geometry(name)


def moves_points(name):
    """Return whether an effect moves image points."""
    return hasattr(effect_named(name), "map_points")


def spreads_light(name):
    """Return whether an effect says where the parts of a point's light land: the synthesis then draws them all."""
    return hasattr(effect_named(name), "spread")


def places_light(name):
    """Return whether an effect has a say in where a point's light lands."""
    return moves_points(name) or spreads_light(name)


def is_drawn(name):
    """Return whether an effect takes part in drawing the radiance: the scene, where points land, how they spread."""
    return places_light(name) or hasattr(effect_named(name), "change_scene")
