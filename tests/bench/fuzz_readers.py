"""The readers of foreign files that the fuzzer tries: for each the valid files it starts from, and how it is called.

``readers(folder)`` writes what they need to a folder and returns {name: Reader}. A reader is right where it returns or
raises InputError with a message of one printable line.
"""

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pillow_heif
import yaml
from PIL import Image
from PIL.ExifTags import IFD, Base

from calibrations.formats import available_formats, read_calibration
from calibrations.lens import Calibration
from detect_markers import read_frames
from detect_markers import read_image as read_any_image
from fuzz_inputs import Inputs, binary_inputs, png_with_valid_checksums, text_inputs
from inputs import tables
from inputs.campaign import load_campaign, read_captures, read_description, read_markers
from inputs.config import check_config
from inputs.experiment import load_experiment, rig_markers
from inputs.images import read_image
from inputs.photo_facts import photo_facts, said_in_words
from inputs.render_store import station_file, stored_key, write_station
from inputs.safe_yaml import load_yaml
from inputs.twins import load_twin
from moving.config import load_moving
from register_captures import read_board
from tiny_campaign import description, write_campaign
from verify_data import tracked_listing, tracked_md5
from workflow_runs import PROJECT

SIZE = (640, 480)
SIDE_PX = 24
LENSES = {
    0: (),
    4: (-0.2, 0.08, 0.001, -0.0007),
    5: (-0.2, 0.08, 0.001, -0.0007, -0.01),
    2: (-0.03, 0.01),
    3: (0.01, -0.03, 0.02),
}
TWINS = (
    b"effects:\n- effect: lens_blur\n  parameters:\n    sigma_px: 0.8\n  origin: by hand\n- effect: radial_distortion\n"
    b"  parameters: {k1: fit, k2: 1e-3}\n",
    b"extends: base.yaml\neffects:\n- effect: jpeg_compression\n  parameters: {loss: 0.5}\n",
)
BOARDS = (
    b"type: charuco\ndictionary: DICT_5X5_100\ncolumns: 7\nrows: 10\nsquare_m: 0.025\nmarker_m: 0.018\nlegacy_pattern: true\n",
    b"type: chessboard\ncolumns: 9\nrows: 6\nsquare_m: 0.03\n",
    b"type: apriltag_grid\ndictionary: DICT_APRILTAG_36h11\ncolumns: 4\nrows: 5\nmarker_m: 0.038\ngap_m: 0.008\n",
)
STEREO = (
    "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.29, 0.08, 0.0001, -0.0002]\n  distortion_model: radtan\n"
    "  intrinsics: [461.6, 460.1, 362.6, 246.0]\n  resolution: [752, 480]\n  rostopic: /cam0/image_raw\n"
)
DVC = b"outs:\n- md5: 75bd2ff4075bd2ff4075bd2ff4075bd2.dir\n  size: 1\n  nfiles: 7\n  hash: md5\n  path: c\n"
POSES = (
    "capture,camera,height_m,tilt_deg,trial,image,sequence,frame,t_s,rx,ry,rz,tx,ty,tz\n"
    "left_a,left,0.3,45,0,images/left/a.png,s,0,0.0,,,,,,\n"
    "left_b,left,,,1,images/left/b.png,s,1,0.1,0.1,-0.2,3e-1,0,0.5,1\n"
    "right_a,right,,,0,images/right/a.png,,,,,,,,,\n"
)


@dataclass(frozen=True)
class Reader:
    """One reader: the file that inputs are written to, what breaks them, and the function that is called."""

    path: Path
    inputs: Inputs
    call: Callable


def readers(folder):
    """Return {name: Reader}, all files below ``folder``."""
    folder = Path(folder)
    return {
        **_of_campaigns(folder / "campaign"),
        **_of_settings(folder / "settings"),
        **_of_calibrations(folder / "calibrations"),
        **_of_images(folder / "images"),
        **_of_results(folder / "results"),
    }


def _text(path, files, call):
    return Reader(path, text_inputs([f if isinstance(f, bytes) else f.encode() for f in files]), call)


def _of_campaigns(folder):
    campaign = write_campaign(folder)
    (campaign / "camera.yaml").write_text(_calibration("opencv", 5))
    photographs = description() | {"target": yaml.safe_load(BOARDS[0]), "light": "unknown", "exposure": "auto"}
    del photographs["markers"], photographs["tolerance"]
    given = description()
    given["cameras"]["left"] = {"width": 640, "height": 480, "intrinsics": "camera.yaml"}
    texts = [yaml.safe_dump(d, sort_keys=False) for d in (description(), photographs, given)]
    cameras = read_description(campaign).cameras
    markers, captures = (campaign / name for name in ("markers.csv", "captures.csv"))
    shutil.copytree(campaign, apart := folder.with_name("campaign_apart"))
    return {
        "campaign.yaml": _text(apart / "campaign.yaml", texts, lambda path: load_campaign(path.parent)),
        "markers.csv": _text(markers, [markers.read_bytes()], read_markers),
        "captures.csv": _text(
            captures, [captures.read_bytes(), POSES], lambda path: read_captures(path, campaign, cameras)
        ),
        "board.yaml": _text(campaign / "board.yaml", BOARDS, read_board),
        ".dvc files": _text(folder.with_name("c.dvc"), [DVC], tracked_md5),
    }


def _of_settings(folder):
    shutil.copytree(PROJECT / "config", folder)
    (folder / "twins").mkdir(exist_ok=True)
    (folder / "twins/base.yaml").write_bytes(TWINS[0])

    def files(kind):
        return [path.read_bytes() for path in sorted((PROJECT / "config" / kind).glob("*.yaml"))]

    def sheet(path):
        return load_experiment(folder / "experiments/of_sheet.yaml")

    (folder / "experiments/of_sheet.yaml").write_text(
        "name: a\ncameras: {c: fuzzed.yaml}\nrig: ladders.yaml\nheights_m: [0.3]\ntilts_deg: [45.0]\n"
    )
    default = (PROJECT / "config/config.default.yaml").read_bytes()
    return {
        "twins": _text(folder / "twins/fuzzed.yaml", TWINS, load_twin),
        "experiments": _text(folder / "experiments/fuzzed.yaml", files("experiments"), load_experiment),
        "cameras by data sheet": _text(folder / "cameras/fuzzed.yaml", files("cameras"), sheet),
        "rigs": _text(folder / "rigs/fuzzed.yaml", files("rigs"), rig_markers),
        "moving experiments": _text(folder / "moving/fuzzed.yaml", files("moving"), load_moving),
        "configuration": _text(folder / "fuzzed.yaml", [default], lambda path: check_config(load_yaml(path))),
    }


def _calibration(name, count, lens="opencv"):
    camera = Calibration(*SIZE, 501.25, 501.25, 321.2, 241.7, lens, LENSES[count])
    return available_formats()[name].write("a_camera", camera)


def _of_calibrations(folder):
    folder.mkdir()
    json_file = folder / "camera.json"
    store = cv2.FileStorage(str(json_file), cv2.FILE_STORAGE_WRITE)
    for key, value in (("image_width", 640), ("image_height", 480), ("camera_matrix", np.diag([500.0, 500.0, 1.0]))):
        store.write(key, value)
    store.release()
    files = {
        "opencv": [_calibration("opencv", 5), _calibration("opencv", 4, "fisheye"), json_file.read_text()],
        "opencv_camel": [_calibration("opencv_camel", 5)],
        "ros": [_calibration("ros", 5), _calibration("ros", 4, "fisheye")],
        "kalibr": [_calibration("kalibr", 4), _calibration("kalibr", 4, "fisheye"), STEREO + STEREO.replace("cam0", "cam1")],
        "mrcal": [_calibration("mrcal", 5), _calibration("mrcal", 0)],
        "colmap": [_calibration("colmap", 4), _calibration("colmap", 0) + "2 SIMPLE_RADIAL 640 480 500 320 240 0.1\n"],
        "lensfun": [_calibration("lensfun", 2, "poly5"), _calibration("lensfun", 3, "ptlens")],
    }  # fmt: skip
    assert set(files) == set(available_formats())
    return {
        f"calibrations: {name}": _text(folder / name, texts, lambda path: read_calibration(path, SIZE))
        for name, texts in files.items()
    }


def _exif(orientation=1):
    exif = Image.Exif()
    exif[Base.Make], exif[Base.Model], exif[Base.Orientation] = "Maker", "Phone 3", orientation
    own = {Base.ExposureTime: 1 / 50, Base.ISOSpeedRatings: 320, Base.FNumber: 1.8, Base.FocalLength: 4.25}
    exif.get_ifd(IFD.Exif).update(own | {Base.FocalLengthIn35mmFilm: 26})
    return exif


def _saved(pixels, kind, **options):
    file = io.BytesIO()
    if kind == "HEIF":
        pillow_heif.from_pillow(Image.fromarray(pixels)).save(file, **options)
    else:
        Image.fromarray(pixels).save(file, kind, **options)
    return file.getvalue()


def _of_images(folder):
    folder.mkdir()
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 255, (SIDE_PX, SIDE_PX + 8, 3), dtype=np.uint8)
    grey, deep = colour[..., 0], colour[..., 0].astype(np.uint16) * 257
    files = {
        "PNG": ("a.png", [_saved(p, "PNG", exif=_exif()) for p in (colour, grey, deep)]),
        "JPEG": (
            "a.jpg",
            [_saved(colour, "JPEG", exif=_exif(6)), _saved(grey, "JPEG", quality=30), _saved(colour, "JPEG", progressive=True)],
        ),
        "TIFF": (
            "a.tif", [_saved(colour, "TIFF"), _saved(deep, "TIFF", exif=_exif()), _saved(grey, "TIFF", compression="tiff_lzw")]
        ),
        "HEIC": ("a.heic", [_saved(colour, "HEIF", exif=_exif(6).tobytes()), _saved(grey, "HEIF")]),
    }  # fmt: skip
    made = {}
    for kind, (name, images) in files.items():
        inputs = binary_inputs(images, png_with_valid_checksums if kind == "PNG" else None)
        made[f"images: {kind}"] = Reader(folder / name, inputs, read_image)
        made[f"EXIF and tables: {kind}"] = Reader(folder / f"facts_{name}", inputs, _all_facts)
    others = [cv2.imencode(end, colour)[1].tobytes() for end in (".bmp", ".webp", ".ppm")]
    made["images: BMP, WebP, PPM"] = Reader(folder / "a.bmp", binary_inputs(others), read_any_image)
    video = folder / "valid.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"MJPG"), 10, colour.shape[1::-1])
    for _ in range(3):
        writer.write(colour)
    writer.release()
    made["videos"] = Reader(folder / "a.avi", binary_inputs([video.read_bytes()]), lambda path: list(read_frames(path)))
    return made


def _all_facts(path):
    """Read what a file says of itself, and put it into words."""
    return said_in_words([photo_facts(path) | {"capture": "a"}], SIZE)


def _of_results(folder):
    """Files of the project's own that people edit, copy from elsewhere or find cut short. Of tables some columns of each
    kind: they are all checked alike, and each costs time.
    """
    folder.mkdir()
    detections = "source,capture,id,x0,rx\nreal,left_a,3,1.5,0.1\nreal,left_b,3,1e2,\ntwin,left_a,3,1.5,0.1\n"
    few_detections = tables.DETECTIONS.select_columns(["source", "capture", "id", "x0", "rx"])
    few_poses = tables.REGISTERED.select_columns(["capture", "station", "n_markers", "rms_px"])
    poses = "capture,station,n_markers,rms_px\nleft_a,h1,3,0.1\nleft_b,h1,0,\n"
    listing = [{"md5": "d41d8cd98f00b204e9800998ecf8427e", "relpath": f"images/left/{k}.png"} for k in "ab"]
    (store := folder / "store/files/md5/75").mkdir(parents=True)
    hash_ = tracked_md5(_written(folder / "c.dvc", DVC))
    write_station(folder, "h1", np.zeros((4, 5), np.float32), 1, "a key")
    render = station_file(folder, "h1")
    return {
        "detections": _text(folder / "d.csv", [detections], lambda path: tables.read_table(path, few_detections)),
        "registered poses": _text(folder / "r.csv", [poses], lambda path: tables.read_table(path, few_poses)),
        "DVC's listings": _text(
            store / hash_[2:], [json.dumps(listing)], lambda path: tracked_listing(hash_, [folder / "store"])
        ),
        "renders": Reader(
            render, binary_inputs([render.read_bytes(), _stored()]), lambda path: stored_key(folder, "h1")
        ),
    }


def _written(path, data):
    path.write_bytes(data)
    return path


def _stored():
    """Return a render that is not compressed: what is broken in it is seen by numpy, not by zlib."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, value in (("radiance", np.zeros((4, 5), np.float32)), ("margin", np.int64(1)), ("key", np.str_("k"))):
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(value))
            archive.writestr(f"{name}.npy", member.getvalue())
    return file.getvalue()
