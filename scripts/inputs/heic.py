"""HEIC photographs, as phones write them: header and pixels along the sensor's axes, through libheif (pillow-heif).

A HEIC file says in boxes of its own how its pixels are to be turned, and libheif turns them; that is undone here.
"""

from pathlib import Path

import numpy as np

from rig.errors import InputError

BRANDS = (b"heic", b"heix", b"heim", b"heis", b"mif1")


def is_heic(head):
    """Return whether the first 32 bytes of a file are those of a HEIC image."""
    brands = [head[8:12], *(head[k : k + 4] for k in range(16, 32, 4))]
    return head[4:8] == b"ftyp" and brands[0] != b"avif" and any(brand in BRANDS for brand in brands)


def opened(path):
    """Return pillow-heif's image of a file, nothing decoded yet; raises InputError where it is none."""
    import pillow_heif  # a tenth of a second that most runs can spare

    try:
        return pillow_heif.open_heif(Path(path), convert_hdr_to_8bit=False, bgr_mode=True)[0]
    except (ValueError, EOFError, SyntaxError, RuntimeError, OSError, IndexError) as error:
        raise InputError(f"{path}: its HEIC header is broken or cut off ({_in_a_line(error)})") from None


def _in_a_line(error):
    return " ".join(str(error).split())


def header_of(path):
    """Return (width, height, bits, channels) of a HEIC file along the sensor's axes."""
    image = opened(path)
    width, height = image.size
    turned = sum(kind == "irot" and angle % 180 == 90 for kind, angle, *_ in image._c_image.transformations)
    size = (height, width) if turned % 2 else (width, height)
    return *size, 8 if image.info["bit_depth"] == 8 else 16, 1 if image.mode[0] in "LI" else 3


def decode(path):
    """Return the pixels of a HEIC file along the sensor's axes: (H, W) or (H, W, 3) BGR, uint8, or uint16 of full range."""
    image = opened(path)
    try:
        pixels = np.asarray(image)
    except (ValueError, EOFError, SyntaxError, RuntimeError, OSError) as error:
        raise InputError(f"{path}: damaged or truncated HEIC ({_in_a_line(error)})") from None
    for kind, value, *_ in reversed(image._c_image.transformations):
        pixels = _undone(pixels, kind, value)
    return np.ascontiguousarray(pixels if pixels.ndim == 2 else pixels[..., :3])


def _undone(pixels, kind, value):
    """Return pixels before one of the turns that a HEIC file asks for: ``irot`` by degrees, ``imir`` over an axis."""
    if kind == "irot":
        return np.rot90(pixels, -value // 90)
    if kind == "imir":
        return pixels[:, ::-1] if value == 1 else pixels[::-1]
    return pixels
