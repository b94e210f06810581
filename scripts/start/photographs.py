"""Which photographs lie in a folder, which cameras took them, and which can't be used, and why."""

import hashlib
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import cv2
from tqdm import tqdm

from inputs.images import read_header, read_image
from inputs.photo_facts import photo_facts
from inputs.videos import check_is_no_file
from register.boards import grey_8bit
from rig.errors import InputError

ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".heic", ".heif", ".mp4", ".mov", ".avi", ".mkv")
LARGEST_FILES = 20_000
LOOKED_AT_PX = 1920  # longer side, at which patterns are looked for
NOT_ALLOWED = re.compile(r"[{}\n\r\\]")  # in a campaign's paths


@dataclass(frozen=True)
class Photograph:
    """One usable photograph: path below the folder, (width, height), what EXIF says (dict), and its grey pixels in small."""

    path: str
    size: tuple
    facts: dict
    grey: object

    @property
    def maker(self):
        """What took it, as EXIF has it; empty where it says nothing."""
        return " ".join(str(self.facts[k]) for k in ("make", "model") if self.facts[k])


def look_through(folder):
    """Return (photographs, [(path, why it is left out)]) of a folder and those below it, in the order of their names.

    Raises InputError where there is nothing to look at.
    """
    folder = Path(folder)
    check_is_no_file(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in ENDINGS and p.is_file())
    if not files:
        raise InputError(f"{folder}: no photographs (files that end in {', '.join(ENDINGS[:7])})")
    if len(files) > LARGEST_FILES:
        raise InputError(f"{folder}: {len(files)} files; at most {LARGEST_FILES} are looked at")
    photographs, left_out, seen = [], [], {}
    for file in tqdm(files, desc="reading", unit="photograph", mininterval=5, delay=5):
        path = file.relative_to(folder).as_posix()
        try:
            photograph, key = _photograph(file, path, folder)
        except InputError as error:
            left_out.append((path, str(error).removeprefix(f"{file}: ")))
            continue
        if key in seen:
            left_out.append((path, f"the same picture as {seen[key]}"))
        else:
            seen[key] = path
            photographs.append(photograph)
    return photographs, left_out


def _photograph(file, path, folder):
    """Return (Photograph, hash of its pixels); raises InputError for what can't be a campaign's image."""
    if NOT_ALLOWED.search(path):
        raise InputError("braces, backslashes and line ends are not allowed in a campaign's paths: rename it")
    if not path.isprintable() or path != path.strip():
        raise InputError("its name has signs that can't be printed, or begins or ends with a blank: rename it")
    if not file.resolve().is_relative_to(folder.resolve()):
        raise InputError("a link that leads out of the folder")
    size = read_header(file)[:2]
    pixels = read_image(file, size)
    key = hashlib.sha256(f"{pixels.shape}".encode() + pixels.tobytes()).digest()
    grey = grey_8bit(pixels)
    scale = LOOKED_AT_PX / max(size)
    if scale < 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return Photograph(path, size, photo_facts(file), grey), key


def by_camera(photographs):
    """Return {camera name: photographs}: one camera is one maker's name and one size of images."""
    makers = sorted({p.maker for p in photographs})
    groups = {}
    for p in photographs:
        groups.setdefault((p.maker, p.size), []).append(p)
    sizes = Counter(maker for maker, _ in groups)
    names = {maker: _name(maker) or "camera" for maker in makers}
    named, doubled = {}, Counter(names.values())
    for (maker, size), group in sorted(groups.items(), key=lambda item: -len(item[1])):
        name = names[maker] if doubled[names[maker]] == 1 else f"{names[maker]}_{makers.index(maker) + 1}"
        named[f"{name}_{size[0]}x{size[1]}" if sizes[maker] > 1 else name] = group
    return named


def _name(text):
    """Return a text as a camera's name: the model without what the maker's name repeats."""
    words = list(dict.fromkeys(re.findall(r"[A-Za-z0-9]+", text.lower())))
    return "_".join(words)[:40].strip("_")
