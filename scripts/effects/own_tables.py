"""A JPEG's own tables and sampling, as its file has them, where they are not those of a quality of libjpeg.

They are (tables, each 64 steps row by row, brightness first; sampling). Source: ITU-T T.81.
"""

import io

import numpy as np

BLOCK = 8
IN_HALF = ("4:2:2", "4:4:0")  # samplings of colour in half along one axis, which no quality has
SUBSAMPLING = {"4:4:4": 0, "4:2:2": 1, "4:4:0": 1}  # as Pillow says it; 2 is 4:2:0


def own_of(facts):
    """Return the own tables and sampling in what a file says (inputs.photo_facts), None where a quality of libjpeg has them."""
    texts = [facts[key] for key in ("jpeg_brightness", "jpeg_colour")]
    steps = tuple(tuple(map(int, text.split())) for text in texts if isinstance(text, str) and text)
    is_own = facts["jpeg_tables"] == "own" or facts["jpeg_sampling"] in IN_HALF
    return (steps, facts["jpeg_sampling"]) if steps and is_own else None


def steps_of(own):
    """Return own tables of (brightness, colour), each (8, 8) float32, the same where there is one."""
    steps = [np.reshape(s, (BLOCK, BLOCK)).astype(np.float32) for s in own[0]]
    return steps[0], steps[-1]


def compressed_as_own(pixels, own):
    """Return uint8 pixels (H, W, 1 or 3; red first) after JPEG with own tables and sampling.

    Sampling that the encoder does not have (4:1:1) is taken as 4:2:0.
    """
    from PIL import Image  # only here: what is exported of an effect runs without it

    sampling, steps = own[1], steps_of(own)
    is_turned = sampling == "4:4:0"  # the encoder has it of the image on its side alone
    if is_turned:
        pixels, steps = pixels.swapaxes(0, 1), [s.T for s in steps]
    image = Image.fromarray(np.ascontiguousarray(pixels if pixels.shape[2] == 3 else pixels[..., 0]))
    file, tables = io.BytesIO(), [s.astype(int).ravel().tolist() for s in steps[: (pixels.shape[2] + 1) // 2]]
    image.save(file, "JPEG", qtables=tables, subsampling=SUBSAMPLING.get(sampling, 2))
    back = np.asarray(Image.open(file)).reshape(pixels.shape)
    return back.swapaxes(0, 1) if is_turned else back
