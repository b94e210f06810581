"""lensfun's XML: distortion of radii, magnification by colour, fall-off of light.

Radii are 1 at half the short edge, of the fall-off at half the diagonal; edges are the outer pixels' centres. Distorted
from undistorted. Source: lensfun's mod-coord.cpp, mod-subpix.cpp, mod-color.cpp; tested against lensfun itself.
"""

import itertools
import math
from xml.etree import ElementTree

from defusedxml import ElementTree as untrusted
from defusedxml.common import DefusedXmlException

from calibrations.lens import Calibration, half_short_edge_px
from rig.errors import InputError

TITLE, SUFFIX = "lensfun XML", ".xml"
HOLDS = (("poly5", 2), ("ptlens", 3))
FIXED = ("aspect",)
SEPARATES_COLOURS = HAS_FALLOFF = True
FULL_FRAME_MM = math.hypot(36, 24)
TERMS = {"poly3": ("k1",), "poly5": ("k1", "k2"), "ptlens": ("a", "b", "c")}
MOUNT = "none"
# One fall-off wherever it is asked for: lensfun takes none that is farther than 1 in 4 / aperture and 0.1 / distance
APERTURES, DISTANCES_M = (1.0, 1.5, 2.5, 5.0, 45.0), (0.1, 1000.0)


def is_one(text):
    """Return whether a text is a lens database."""
    return "<lensdatabase" in text


def read(text, where):
    """Return {lens: Calibration} of a file; the size is that of the camera it is used for, and not in it (0).

    Entities are refused: they may name other files or grow without end.
    """
    try:
        root = untrusted.fromstring(text.encode())
    except DefusedXmlException as error:
        raise InputError(f"{where}: XML entities are not read ({type(error).__name__})") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the latter of encodings
        raise InputError(f"{where}: not XML ({error})") from None
    return {_text(lens, "model", where): _lens(lens, where) for lens in root.iter("lens")}


def _lens(lens, where):
    where = f"{where}: {_text(lens, 'model', where)}"
    if (lens.findtext("type") or "rectilinear").strip() != "rectilinear":
        raise InputError(f"{where}: type is {lens.findtext('type')!r}; only rectilinear lenses are read")
    crop = _number(_text(lens, "cropfactor", where), f"{where}: cropfactor")
    found = lens.findall("calibration/distortion")
    if len(found) != 1:
        there = ", ".join(str(d.get("focal")) for d in found) or "none"
        raise InputError(f"{where}: distortion at the focal lengths {there}; one is needed: keep yours in the file")
    distortion, model = found[0], found[0].get("model", "")
    if model not in TERMS:
        raise InputError(f"{where}: distortion model {model[:40]!r}; read are {', '.join(TERMS)}")
    focal_mm = _number(distortion.get("real-focal") or distortion.get("focal", ""), f"{where}: focal")
    terms = tuple(_number(distortion.get(t, "0"), f"{where}: {t}") for t in TERMS[model])
    tca = lens.find("calibration/tca[@model='linear']")
    red, blue = (_number(tca.get(k, "1"), f"{where}: {k}") if tca is not None else 1.0 for k in ("kr", "kb"))
    falloff = lens.findall("calibration/vignetting[@model='pa']")
    kinds = {tuple(_number(v.get(k, "0"), f"{where}: {k}") for k in ("k1", "k2", "k3")) for v in falloff}
    light = kinds.pop() if len(kinds) == 1 else (0.0, 0.0, 0.0)  # one for all apertures, or unknown
    centre = lens.find("center")
    moved = [0.0 if centre is None else _number(centre.get(k, "0"), f"{where}: center {k}") for k in ("x", "y")]
    # in units that the size of the image gives later
    return Calibration(0, 0, focal_mm, focal_mm, *moved, model, terms, focal_mm, crop, red, blue, light)


def for_size(calibration, width, height):
    """Return a Calibration that was read here, in pixels of an image."""
    c = calibration
    pixels_per_mm = math.hypot(width - 1, height - 1) * c.crop / FULL_FRAME_MM
    size = half_short_edge_px(width, height)
    focal = c.focal_mm * pixels_per_mm
    cx, cy = (width - 1) / 2 + c.cx * size, (height - 1) / 2 + c.cy * size
    return Calibration(
        width, height, focal, focal, cx, cy, c.lens, c.coefficients, c.focal_mm, c.crop, c.red, c.blue, c.falloff
    )


def _text(element, key, where):
    text = (element.findtext(key) or "").strip()
    if not text:
        raise InputError(f"{where}: a lens without {key}")
    return text


def _number(text, where):
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where} is {str(text)[:40]!r}; a number is needed")
    return value


def write(name, calibration):
    """Return the text of a database with one camera and its lens; full frame where no crop factor is known."""
    c = calibration
    crop = c.crop or 1.0
    focal_mm = c.fx * FULL_FRAME_MM / crop / math.hypot(c.width - 1, c.height - 1)
    size = half_short_edge_px(c.width, c.height)
    root = ElementTree.Element("lensdatabase")
    _add(_add(root, "mount"), "name", MOUNT)
    for kind, model in (("camera", name), ("lens", f"{name} lens")):
        made = _add(root, kind)
        _add(made, "maker", "twingap")
        _add(made, "model", model)
        _add(made, "mount", MOUNT)
        _add(made, "cropfactor", repr(crop))
    _add(made, "aspect-ratio", repr((max(c.width, c.height) - 1) / (min(c.width, c.height) - 1)))
    centre = {"x": (c.cx - (c.width - 1) / 2) / size, "y": (c.cy - (c.height - 1) / 2) / size}
    _add(made, "center", **centre)
    calibration = _add(made, "calibration")
    terms = dict(zip(TERMS[c.lens], c.coefficients, strict=True))
    _add(calibration, "distortion", model=c.lens, focal=focal_mm, **terms)
    if (c.red, c.blue) != (1.0, 1.0):
        _add(calibration, "tca", model="linear", focal=focal_mm, kr=c.red, kb=c.blue)
    if any(c.falloff):
        k1, k2, k3 = c.falloff
        for aperture, distance in itertools.product(APERTURES, DISTANCES_M):
            shot = {"focal": focal_mm, "aperture": aperture, "distance": distance}
            _add(calibration, "vignetting", model="pa", **shot, k1=k1, k2=k2, k3=k3)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _add(parent, tag, text=None, **attributes):
    values = {k: v if isinstance(v, str) else repr(float(v)) for k, v in attributes.items()}
    made = ElementTree.SubElement(parent, tag, values)
    made.text = text
    return made
