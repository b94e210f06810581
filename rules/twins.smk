"""Twins: the effects of each camera's twin, by its file or an experiment's, divided among the stages that form its images.

Needs: the names of rules/common.smk, config/twins/. Makes: nothing. A wrong file of a twin ends here with one message.
"""


def twin_of(wildcards):
    """Return the twin's file of wildcards.camera, where the user adopted effects."""
    path = Path(f"config/twins/{NAME}/{wildcards.camera}.yaml")
    return [str(path)] if path.is_file() else []


def twin_files():
    """Return the twins' files of all cameras."""
    paths = [Path(f"config/twins/{NAME}/{camera}.yaml") for camera in CAMERAS]
    return [str(path) for path in paths if path.is_file()]


def twin(camera):
    """Return the inputs.twins.Twin of a camera."""
    from inputs.twins import load_twin

    try:
        return load_twin(f"config/twins/{NAME}/{camera}.yaml")
    except InputError as error:
        end_with(error)


def twin_effects(camera, *stages):
    """Return [[effect, parameters], ...] of a camera's twin, of some stages (all where none is named)."""
    effects = twin(camera).effects
    return [
        [n, p]
        for n, p in effects
        if not stages or available_effects()[n].STAGE in stages
    ]


def twin_starts(camera):
    """Return [[effect, parameters], ...] of a camera's twin from which a fit starts."""
    return [list(effect) for effect in twin(camera).starts]


def twin_free(camera):
    """Return [[effect, parameter], ...] that a camera's twin leaves to be fitted."""
    return [list(f) for f in twin(camera).free]


def configured_effects(wildcards):
    """Return the effects of the camera's twin as configured, all stages; what is to be fitted at its start."""
    return twin_starts(wildcards.camera)


def free_parameters(wildcards):
    """Return the parameters that the camera's twin leaves to be fitted."""
    return twin_free(wildcards.camera)


def rendered_effects(wildcards):
    """Return the twin's effects that change the scene: all others work on the render."""
    return twin_effects(wildcards.camera, "scene")


def exposed_effects(wildcards):
    """Return the effects that act after the render."""
    return twin_effects(wildcards.camera, "lens", "shutter", "sensor", "processing")


def lens_effects(wildcards):
    """Return the twin's effects that move points: photographs of a board are registered behind them, a rig's poses are told."""
    effects = twin_effects(wildcards.camera) if BOARD else []
    return [e for e in effects if hasattr(available_effects()[e[0]], "map_points")]


def designed_effects():
    """Return {camera: [[effect, parameters], ...]} of an experiment's twins: its truth is where their lenses put markers."""
    if CAMPAIGN:
        return {}
    return {
        camera: twin_effects(camera, "lens", "shutter", "processing")
        for camera in CAMERAS
    }
