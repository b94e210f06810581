"""Whether an earlier campaign can be a baseline: the same cameras and the same board or rig, other photographs."""

import itertools
from pathlib import Path

from inputs.campaign import load_campaign
from inputs.images import check_captures
from inputs.photo_facts import a_few, photo_facts
from rig.errors import InputError

MIN_CAPTURES = 5  # of a camera, in either campaign
SAME = ("target", "encoding")  # of campaign.yaml, what both must describe alike


def check_baseline(campaign, folder):
    """Raise InputError where what has changed from a folder to an inputs.campaign.Campaign cannot be asked; return nothing."""
    if campaign.folder.resolve() == _resolved(folder):
        raise InputError(
            f"configuration: baseline: {folder} is the campaign itself; name the folder of earlier photographs"
        )
    baseline = load_campaign(folder)
    check_captures(baseline)
    if baseline.file.name == campaign.file.name:
        raise InputError(
            f"{baseline.folder}/campaign.yaml: name is {baseline.file.name!r}, as of {campaign.folder}; results go by names, "
            "so give one of the two another"
        )
    _check_rig(campaign, baseline)
    for camera in sorted(set(campaign.captures.camera)):
        _check_camera(campaign, baseline, camera)
        _check_makers(campaign, baseline, camera)
    _check_photographs(campaign, baseline)


def _resolved(folder):
    """Return the real path of a folder; raises InputError for a path that cannot be one."""
    try:
        return Path(folder).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"configuration: baseline: {str(folder)!r}: {error}") from None


def _check_rig(campaign, baseline):
    """Refuse a baseline of another board or of other markers."""
    for key in SAME:
        mine, other = getattr(campaign.file, key), getattr(baseline.file, key)
        if mine != other:
            raise InputError(
                f"{baseline.folder}/campaign.yaml: {key} is not that of {campaign.folder}; photograph what was photographed "
                "before, and describe it alike"
            )
    if campaign.file.target is None and not campaign.markers.equals(baseline.markers):
        raise InputError(
            f"{baseline.folder}/{baseline.file.markers}: not the markers of {campaign.folder}; photograph the rig that was "
            "photographed before, and describe it alike"
        )


def _check_camera(campaign, baseline, camera):
    """Refuse a camera that the baseline lacks, of another size, of other nominal intrinsics, or with too few captures."""
    if camera not in set(baseline.captures.camera):
        raise InputError(
            f"{baseline.folder}: camera {camera!r} took no capture there; a baseline has captures by the same camera, under "
            f"the same name (it has {', '.join(sorted(set(baseline.captures.camera)))})"
        )
    mine, other = campaign.file.cameras[camera], baseline.file.cameras[camera]
    if (mine.width, mine.height) != (other.width, other.height):
        raise InputError(
            f"{baseline.folder}/campaign.yaml: camera {camera!r} has {other.width} x {other.height} pixels, in "
            f"{campaign.folder} {mine.width} x {mine.height}; photographs of one size are compared"
        )
    if (mine.fx, mine.fy, mine.cx, mine.cy) != (other.fx, other.fy, other.cx, other.cy):
        raise InputError(
            f"{baseline.folder}/campaign.yaml: camera {camera!r} has other nominal intrinsics than in {campaign.folder}; give "
            "both the same: what has changed is then found"
        )
    for where in (baseline, campaign):
        number = int((where.captures.camera == camera).sum())
        if number < MIN_CAPTURES:
            raise InputError(
                f"{where.folder}/{where.file.captures}: {number} captures by {camera!r}; at least {MIN_CAPTURES} are needed to "
                "say what has changed: take more"
            )


def _check_makers(campaign, baseline, camera):
    """Refuse captures that another camera took, as the files of both campaigns say."""
    paths = [
        [c.folder / image for image in c.captures.image[c.captures.camera == camera]] for c in (campaign, baseline)
    ]
    if not _are_others(*(makers_of(a_few(some)) for some in paths)):  # to look into all files takes long, of PNG most
        return
    mine, other = map(makers_of, paths)
    if _are_others(mine, other):
        words = [", ".join(sorted(" ".join(filter(None, maker)) for maker in makers)) for makers in (other, mine)]
        raise InputError(
            f"{baseline.folder}: by their EXIF the photographs by {camera!r} are of another camera, {words[0]}, than those of "
            f"{campaign.folder}, {words[1]}; compare photographs by one camera"
        )


def makers_of(paths):
    """Return {(make, model)} of files, as they say (inputs.photo_facts), None for what they do not."""
    facts = map(photo_facts, paths)
    return {(f["make"], f["model"]) for f in facts} - {(None, None)}


def _are_others(mine, other):
    """Return whether each {(make, model)} contradicts each of others; of nothing said nothing does."""
    pairs = list(itertools.product(mine, other))
    return bool(pairs) and all(any(a and b and a != b for a, b in zip(*pair, strict=True)) for pair in pairs)


def _check_photographs(campaign, baseline):
    """Refuse a photograph that is in both: it would tell that nothing has changed."""
    sizes = {}
    for image in baseline.captures.image:
        path = baseline.folder / image
        sizes.setdefault(path.stat().st_size, []).append(path)
    for image in campaign.captures.image:
        path = campaign.folder / image
        for other in sizes.get(path.stat().st_size, ()):
            if other.read_bytes() == path.read_bytes():
                raise InputError(
                    f"{path}: the same photograph as {other} of the baseline; compare photographs taken before with others "
                    "taken after"
                )
