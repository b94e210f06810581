"""Videos among photographs, or in the place of their folder: known by their first bytes, and refused with what to do."""

from rig.errors import InputError

NO_VIDEO = (
    "a video, and photographs are needed; save some sharp frames of it as PNG, such as by "
    "`ffmpeg -i VIDEO -vf fps=1 frame_%03d.png`"
)
VIDEO_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
VIDEO_STARTS = (b"\x1aE\xdf\xa3", b"\0\0\x01\xba", b"\0\0\x01\xb3")


def check_is_no_file(path):
    """Raise InputError where what should be a folder of photographs is a file: a video, or one of them."""
    if path.is_file():
        with open(path, "rb") as file:
            raise InputError(f"{path}: {NO_VIDEO if is_video(file.read(32)) else 'a file, and its folder is needed'}")


def is_video(head):
    """Return whether the first 32 bytes of a file, which is no HEIC, are those of a video: MP4, MOV, AVI, MKV, WebM, MPEG."""
    in_boxes = head[4:8] in VIDEO_BOXES and head[8:12] != b"avif"
    return in_boxes or head[:4] in VIDEO_STARTS or (head[:4] == b"RIFF" and head[8:12] == b"AVI ")
