"""Detect markers in any images or videos: ``detect_markers.py DETECTOR IMAGE... --out FILE.csv``.

Writes a row a marker: image, dictionary, id, x0, y0, .. x3, y3, ms. An image without markers has one row with
an empty id. A video is read frame by frame (``video.avi#frame12``); ``video.avi#frame12`` is that frame alone.
``ms`` is the detection time of the image without the decoding of its file; the first image is detected once
before, untimed, so that no compilation is counted.
"""

import argparse
import re
import time
from pathlib import Path

import cv2
import pandas as pd

import job
from detectors import contract
from inputs import images as stored
from rig.errors import InputError

CORNERS = ["x0", "y0", "x1", "y1", "x2", "y2", "x3", "y3"]
COLUMNS = ["image", "dictionary", "id", *CORNERS, "ms"]
VIDEO_SUFFIXES = (".avi", ".mp4", ".mov", ".mkv", ".webm", ".m4v")


def read_image(path):
    """Return the image of a file, grey or BGR, uint8 or uint16; InputError where it is missing or damaged.

    A campaign's formats are read as campaigns are; others, such as BMP or WebP, as OpenCV reads them.
    """
    try:
        return stored.read_image(path) if stored.is_checked(path) else stored.decode(path, Path(path).read_bytes())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


def read_frames(path, wanted=None):
    """Yield (frame number, BGR image) of a video, or of its one frame ``wanted``; InputError where unreadable."""
    if not Path(path).exists():
        raise InputError(f"{path}: No such file or directory")
    video = cv2.VideoCapture(str(path))
    try:
        number = -1
        while video.isOpened() and video.grab():
            number += 1
            if wanted is None or number == wanted:
                _, image = video.retrieve()
                yield number, image
            if number == wanted:
                return
    finally:
        video.release()
    if number < 0:
        raise InputError(f"{path}: not a video that OpenCV reads")
    if wanted is not None:
        raise InputError(f"{path}: has no frame {wanted}; it ends at frame {number}")


def read_images(names):
    """Yield (name, image) of images, videos and single frames of videos (``video.avi#frame12``)."""
    for name in names:
        frame = re.fullmatch(r"(.+)#frame(\d+)", name)
        if frame:
            for _, image in read_frames(frame[1], int(frame[2])):
                yield name, image
        elif name.lower().endswith(VIDEO_SUFFIXES):
            for number, image in read_frames(name):
                yield f"{name}#frame{number}", image
        else:
            yield name, read_image(name)


def detect_images(detector, images):
    """Return the table of all (name, image) pairs, see the head of this file."""
    rows, warm = [], False
    for name, image in images:
        try:
            if not warm:
                detector.detect(image)
                warm = True
            start = time.perf_counter()
            found = detector.detect(image)
            ms = round(1000 * (time.perf_counter() - start), 3)
        except ValueError as error:
            raise InputError(f"{name}: {error}") from None
        rows += [[name, d.dictionary, d.id, *d.corners.ravel(), ms] for d in found]
        if not found:
            rows.append([name, "", None, *[None] * 8, ms])
    return pd.DataFrame(rows, columns=COLUMNS).astype({"id": "Int64"})


def detect_markers(detector, images, out, dictionaries):
    """Write the table of the markers that ``detector`` finds in ``images`` to ``out``."""
    finder = contract.make(detector, dictionaries, where="command line")
    table = detect_images(finder, read_images(images))
    with job.write_atomically(out) as file:
        table.to_csv(file, index=False, lineterminator="\n")


def main():
    """Read the command line and do it."""
    parser = argparse.ArgumentParser(description="Detect markers in images and videos.")
    parser.add_argument("detector", help=f"one of {', '.join(contract.available())}")
    parser.add_argument("images", nargs="+", metavar="IMAGE", help="image, video, or video.avi#frame12")
    parser.add_argument("--out", required=True, metavar="FILE.csv", help="table to write")
    parser.add_argument("--dictionaries", nargs="+", default=list(contract.DEFAULT_DICTIONARIES), metavar="DICT_...")
    arguments = parser.parse_args()
    job.set_up_log()
    with job.one_message():
        detect_markers(arguments.detector, arguments.images, arguments.out, arguments.dictionaries)


if __name__ == "__main__":
    main()
