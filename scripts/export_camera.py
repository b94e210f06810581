"""Write what a camera's twin says of it in another program's format, or convert a calibration file.

    python scripts/export_camera.py CAMERA --format opencv               to CAMERA.yaml
    python scripts/export_camera.py CAMERA --format twin_camera          the whole twin: a Python file for any image
    python scripts/export_camera.py CAMERA --format ros --verdict        what the diagnosis says, not config/twins
    python scripts/export_camera.py camchain.yaml#cam0 --format colmap   from one format to another

Formats: opencv, opencv_camel, ros, kalibr, mrcal, colmap, lensfun, twin_camera. Says by how many pixels a format that can't
hold the lens misses it, and which effects it leaves out.
"""

import argparse
import logging
import re
from pathlib import Path

import job
from adopt_effect import find_campaign, read_diagnosis
from calibrations.formats import available_formats, read_calibration
from calibrations.refit import LARGEST_ERROR_PX, check_error, fitting, rays_of_frame
from calibrations.twin_lens import colours_and_falloff, lens_of, nominal_pinhole
from inputs.twin_sources import camera_twin
from rig.errors import InputError
from twin_bundle import twin_camera_file

log = logging.getLogger("twingap")
WHOLE_TWIN = "twin_camera"


def export_twin(twin, module, allowed_px):
    """Return (text, [what to tell]) of a CameraTwin in a format.

    Raises InputError where its lens is farther than ``allowed_px`` from all that the format holds.
    """
    rays, pixels, held = lens_of(twin)
    found, told = _fitted(module, rays, pixels, nominal_pinhole(twin), allowed_px)
    found, also_held = colours_and_falloff(twin, found, module)
    left_out = [name for name, _ in twin.effects if name not in held | also_held]
    if left_out:
        told.append(f"{module.TITLE} has no place for {', '.join(left_out)}; --format {WHOLE_TWIN} holds all of it")
    return module.write(f"{twin.campaign}_{twin.camera}", found), told


def convert(calibration, name, module, allowed_px):
    """Return (text, [what to tell]) of a Calibration in another format."""
    rays, pixels = rays_of_frame(calibration)
    found, told = _fitted(module, rays, pixels, calibration, allowed_px)
    return module.write(name, found), told


def _fitted(module, rays, pixels, start, allowed_px):
    best = fitting(module, rays, pixels, start)
    check_error(best, module.TITLE, allowed_px)
    found, rms, largest = best
    model = f"{found.lens}, {len(found.coefficients)} coefficients"
    exact = "as it is" if largest < 1e-6 else f"refitted, RMS {rms:.2g} px, at most {largest:.2g} px off"
    return found, [f"lens model {model}: {exact}"]


def _twin(given):
    name, folder = find_campaign(given.campaign)
    if folder is None:
        raise InputError(f"{name}: its folder with campaign.yaml is not known; name it: --campaign FOLDER")
    from_verdict = given.verdict or not Path(f"config/twins/{name}/{given.camera}.yaml").is_file()
    return camera_twin(name, folder, given.camera, read_diagnosis(name, given.camera) if from_verdict else None)


def export_camera(given):
    """Carry out the command line; return the path that was written."""
    formats = available_formats()
    if given.format not in (*formats, WHOLE_TWIN):
        raise InputError(f"--format {given.format}: there are {', '.join((*formats, WHOLE_TWIN))}")
    told, source = [], given.camera
    is_file = re.search(r"[./]", given.camera)
    if given.format == WHOLE_TWIN:
        if is_file:
            raise InputError(f"--format {WHOLE_TWIN}: {given.camera} is no camera of a campaign")
        twin = _twin(given)
        text, told, source = *twin_camera_file(twin), twin.source
        path = Path(given.out or f"{WHOLE_TWIN}.py")
    elif is_file:
        name = re.sub(r"\W", "_", Path(given.camera.partition("#")[0]).stem)
        text, told = convert(
            read_calibration(given.camera, given.size), name, formats[given.format], given.largest_error_px
        )
        path = Path(given.out or f"{name}_{given.format}{formats[given.format].SUFFIX}")
    else:
        twin = _twin(given)
        text, told = export_twin(twin, formats[given.format], given.largest_error_px)
        source, path = twin.source, Path(given.out or f"{given.camera}{formats[given.format].SUFFIX}")
    with job.write_atomically(path) as file:
        file.write(text)
    log.info("%s: from %s", path, source)
    for line in told:
        log.info("  %s", line)
    return path


def size_of(text):
    """Return (width, height) of a text such as 1280x720."""
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT")
    return int(found[1]), int(found[2])


def main(arguments=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Write a camera's twin in another program's format.")
    parser.add_argument("camera", help="camera of the campaign, or a calibration file (FILE#NAME of several cameras)")
    parser.add_argument("--format", required=True, help=f"{', '.join(available_formats())} or {WHOLE_TWIN}")
    parser.add_argument("--campaign", help="folder, or name below results/; default: the configured one")
    parser.add_argument("--verdict", action="store_true", help="what the last diagnosis says, not config/twins")
    parser.add_argument("--out", help="file to write")
    parser.add_argument("--size", type=size_of, help="WIDTHxHEIGHT, of formats that have none (lensfun)")
    parser.add_argument(
        "--largest-error-px",
        type=float,
        default=LARGEST_ERROR_PX,
        help="a refitted lens that misses by more is refused",
    )
    given = parser.parse_args(arguments)
    job.set_up_log()
    with job.one_message():
        export_camera(given)


if __name__ == "__main__":
    main()
