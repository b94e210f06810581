"""Generate blind campaigns: python scripts/trials/generate_trials.py --out FOLDER --truths FOLDER --kind KIND
--count N --seed NAME.

Campaign folders get names that reveal nothing; what is hidden in FOLDER/<name> is in TRUTHS/<name>/truth.json alone.
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

from generator import LIBRARY, OUTSIDE, draw_effect, generate_campaign, nominal
from rig.errors import InputError
from trials.real_trials import generate_real_trial
from trials.trial_names import KINDS, POWER_STRENGTHS, identity

# What a whole camera is drawn from: the parts, of each how many at least and at most; of effects in brackets one.
PARTS = (
    (2, 4, ("radial_distortion", "vignetting", ("lens_blur", "defocus", "field_curvature"),
            "lateral_chromatic_aberration", "principal_point", "focal_length")),
    (1, 3, ("sensor_noise", "fixed_pattern_noise", "bayer_demosaic", "exposure", "rolling_shutter")),
    (1, 4, ("colour_balance", "tone_curve", "denoising", "sharpening", "jpeg_compression")),
    (0, 2, ("ink_spread", "ink_reflectance", "marker_scale", "illumination_gradient", "specular_highlight",
            "veiling_glare", "camera_pose_offset", "rail_sag")),
)  # fmt: skip
MAX_WHOLE = 9  # effects of a whole camera
# Of each of these a whole camera has one at most: beside the other it can hardly be told.
ALIKE = (
    {"tone_curve", "veiling_glare", "ink_reflectance"},
    {"tone_curve", "exposure"},
    {"sensor_noise", "fixed_pattern_noise"},
    {"camera_pose_offset", "focal_length"},
)
WHOLE_STRENGTHS = (0.25, 1.0)


def _dealt(names, index, *seed):
    """Deal ``names`` like a shuffled pack, a new pack after each round, so that every name comes equally
    often.
    """
    names = list(names)
    order = nominal.rng_of("pack", index // len(names), *seed).permutation(len(names))
    return names[order[index % len(names)]]


def _whole_camera(index, seed):
    """Return the four to nine names of a whole camera: drawn again until they are few enough and none are alike."""
    rng = nominal.rng_of("whole", seed, index)
    while True:
        names = []
        for least, most, part in PARTS:
            for k in rng.permutation(len(part))[: rng.integers(least, most + 1)]:
                names.append(part[k] if isinstance(part[k], str) else str(rng.choice(part[k])))
        if len(names) <= MAX_WHOLE and all(len(alike.intersection(names)) <= 1 for alike in ALIKE):
            return names


def hidden_effects(kind, index, seed, effect=None):
    """Return the names hidden in trial ``index`` of a kind of ``trial_names.KINDS``."""
    if kind == "none":
        return []
    if kind == "whole":
        return _whole_camera(index, seed)
    if kind == "outside":
        return [effect or _dealt(OUTSIDE, index, seed)]
    if kind == "power":
        return [effect or list(LIBRARY)[index // len(POWER_STRENGTHS) % len(LIBRARY)]]
    first = effect or _dealt(LIBRARY, index, seed, "first")
    if kind == "single":
        return [first]
    rest = [name for name in LIBRARY if name != first]
    return [first, rest[nominal.rng_of("second", seed, index).integers(len(rest))]]


def generate_trial(out, truths, kind, index, seed, effect=None, strength=None, size="standard"):
    """Generate trial ``index`` below ``out`` and its sealed truth below ``truths``; return the campaign's name
    and truth.

    Without ``strength``: 1, and for ``power`` the ``POWER_STRENGTHS`` in turn; each effect of a whole camera has that
    times a draw from ``WHOLE_STRENGTHS``. The same seed and index give the same campaign whatever else is generated;
    power trials of one effect and round share the draw and differ in strength only.
    """
    name, trial_seed, strength = identity(kind, index, seed, effect, strength, size)
    cameras = nominal.RIGS[size].cameras
    draw_seed = f"{seed}/{index // len(POWER_STRENGTHS)}" if kind == "power" else trial_seed
    camera = cameras[nominal.rng_of("camera", draw_seed).integers(len(cameras))]
    strengths = dict.fromkeys(hidden_effects(kind, index, seed, effect), strength)
    notes = {"kind": kind, "index": index, "strength": strength}
    if kind == "whole":
        for hidden in strengths:
            strengths[hidden] *= float(nominal.rng_of("strength", hidden, draw_seed).uniform(*WHOLE_STRENGTHS))
        notes["strengths"] = strengths
    effects = [(n, draw_effect(n, s, camera, draw_seed)) for n, s in strengths.items()]
    truth = generate_campaign(Path(out) / name, Path(truths) / name, effects, trial_seed, size, camera.name, notes)
    return name, truth


def main(argv=None):
    """Read the command line and generate the trials, printing each one's name and nothing of what it hides."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, help="folder for the campaigns")
    parser.add_argument("--truths", required=True, help="another folder, for what is hidden")
    parser.add_argument("--kind", required=True, choices=KINDS)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="index of the first trial, to go on or to share the work")
    parser.add_argument("--seed", required=True, help="a name; the same name gives the same trials")
    parser.add_argument("--effect", choices=[*LIBRARY, *OUTSIDE], help="hide this one instead of a drawn one")
    parser.add_argument("--strength", type=float, help="1 is clear; 0.25 and 0.5 for power curves")
    parser.add_argument("--photographs", help="folder of campaigns of boards, for --kind real")
    parser.add_argument("--size", choices=list(nominal.RIGS), default="standard")
    a = parser.parse_args(argv)
    if Path(a.truths).resolve().is_relative_to(Path(a.out).resolve()):
        parser.error("--truths must not be in the folder of the campaigns")
    if a.strength is not None and a.strength <= 0:
        parser.error("--strength must be above 0; for nothing hidden use --kind none")
    allowed = {"none": (), "whole": (), "outside": OUTSIDE, "single": LIBRARY, "pair": LIBRARY}.get(a.kind)
    if a.effect and allowed is not None and a.effect not in allowed:
        parser.error(f"--kind {a.kind} does not go with --effect {a.effect}")
    if (a.kind == "real") != bool(a.photographs):
        parser.error("--kind real needs --photographs FOLDER, and nothing else does")
    for index in range(a.first, a.first + a.count):
        if a.kind == "real":
            try:
                print(
                    generate_real_trial(a.out, a.truths, a.photographs, index, a.seed, a.effect, a.strength), flush=True
                )
            except InputError as error:
                parser.exit(1, f"error: {error}\n")
            continue
        name, _ = generate_trial(a.out, a.truths, a.kind, index, a.seed, a.effect, a.strength, a.size)
        print(name, flush=True)


if __name__ == "__main__":
    main()
