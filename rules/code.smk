"""Code: the files of what is found by being there (effects, detectors, calibrations' formats), each with all that it imports.

Needs: the names of rules/common.smk and rules/twins.smk. Makes: nothing. No import names these files: a rule takes here those
that its job may run, and no others, as inputs beside ``imports_of``, so that an edit reruns what it touches.
"""


def with_imports(files):
    """Return Python files and all that they import, sorted."""
    files = list(files)
    return sorted({*files, *imports_of(*files)})


def format_code():
    """Return the code of calibrations' formats, found by being there, where a camera's intrinsics are a file's."""
    cameras = SOURCE.file.cameras.values()
    if not any(getattr(camera, "intrinsics", None) for camera in cameras):
        return []
    return with_imports(map(str, Path("scripts/calibrations").glob("*.py")))


def code_of_effects(names):
    """Return the files of effects and of what they import: they are found by being there, so no import names them."""
    return with_imports(f"scripts/effects/{name}.py" for name in names)


def effects_that_look():
    """Return the names of effects that read starts off captures, found without importing any."""
    files = sorted(Path("scripts/effects").glob("*.py"))
    return [f.stem for f in files if "\ndef starts_from(" in f.read_text("utf-8")]


def scene_effect_code(wildcards):
    """Return the code of the scene effects that a camera's twin uses."""
    return code_of_effects(name for name, _ in rendered_effects(wildcards))


def exposed_code(wildcards):
    """Return the code of the effects that act after the render."""
    return code_of_effects(name for name, _ in exposed_effects(wildcards))


def lens_code(wildcards):
    """Return the code of the effects through which a camera's photographs are registered."""
    return code_of_effects(name for name, _ in lens_effects(wildcards))


def designed_effect_code(wildcards):
    """Return the code of the effects of an experiment's twins."""
    used = {name for effects in designed_effects().values() for name, _ in effects}
    return code_of_effects(sorted(used))


def effect_code(wildcards):
    """Return the code of the effects that a camera's twin uses, or that files of photographs may say."""
    used = {name for name, _ in twin_effects(wildcards.camera)}
    found = available_effects() if BOARD else {}
    said = {name for name, module in found.items() if hasattr(module, "declared_by")}
    return code_of_effects(sorted(used | said))


def code_of_detector(name):
    """Return the files of one detector, a module or all of a package, and of what they import."""
    path = Path(f"scripts/detectors/{name}")
    single = path.with_suffix(".py")
    return with_imports(
        [str(single)] if single.is_file() else map(str, path.rglob("*.py"))
    )


def code_of_detectors(names):
    """Return the files of some detectors and of what they import."""
    return sorted({path for name in set(names) for path in code_of_detector(name)})


def detector_code(wildcards):
    """Return the files of the job's detector and of what they import."""
    return code_of_detector(wildcards.detector)


def finder_code(wildcards):
    """Return the code of the detectors that find the rig's markers where OpenCV can't, whatever is configured."""
    return code_of_detectors(FINDERS.values())


def every_finder_code(wildcards):
    """Return the code of detectors that may find what OpenCV can't, of a rig not known yet: they say which families they read."""
    names = contract.available()
    return code_of_detectors(n for n in names if hasattr(contract.load(n), "reads"))
