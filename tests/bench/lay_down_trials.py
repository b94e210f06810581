"""Lay down blind campaigns: python tests/bench/lay_down_trials.py --out FOLDER --envelopes FOLDER --kind KIND
--count N --seed NAME.

Campaign folders get names that reveal nothing; what is hidden in FOLDER/<name> is in
ENVELOPES/<name>/truth.json alone.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from generator import LIBRARY, OUTSIDE, draw_effect, generate_campaign, nominal
from trial_names import POWER_STRENGTHS, identity


def _dealt(names, index, *seed):
    """Deal ``names`` like a shuffled pack, a new pack after each round, so that every name comes equally
    often.
    """
    names = list(names)
    order = nominal.rng_of("pack", index // len(names), *seed).permutation(len(names))
    return names[order[index % len(names)]]


def hidden_effects(kind, index, seed, effect=None):
    """Return the names hidden in trial ``index`` of ``kind`` single, pair, none, outside or power."""
    if kind == "none":
        return []
    if kind == "outside":
        return [effect or _dealt(OUTSIDE, index, seed)]
    if kind == "power":
        return [effect or list(LIBRARY)[index // len(POWER_STRENGTHS) % len(LIBRARY)]]
    first = effect or _dealt(LIBRARY, index, seed, "first")
    if kind == "single":
        return [first]
    rest = [name for name in LIBRARY if name != first]
    return [first, rest[nominal.rng_of("second", seed, index).integers(len(rest))]]


def lay_down_trial(out, envelopes, kind, index, seed, effect=None, strength=None, size="standard"):
    """Lay down trial ``index`` below ``out`` and its envelope below ``envelopes``; return the campaign's name
    and truth.

    Without ``strength``: 1, and for ``power`` the ``POWER_STRENGTHS`` in turn. The same seed and
    index give the same campaign whatever else is laid down; power trials of one effect and round share the
    draw and differ in strength only.
    """
    name, trial_seed, strength = identity(kind, index, seed, effect, strength, size)
    cameras = nominal.CAMERAS[size]
    draw_seed = f"{seed}/{index // len(POWER_STRENGTHS)}" if kind == "power" else trial_seed
    camera = cameras[nominal.rng_of("camera", draw_seed).integers(len(cameras))]
    names = hidden_effects(kind, index, seed, effect)
    effects = [(n, draw_effect(n, strength, camera, draw_seed)) for n in names]
    notes = {"kind": kind, "index": index, "strength": strength}
    truth = generate_campaign(Path(out) / name, Path(envelopes) / name, effects, trial_seed, size, camera.name, notes)
    return name, truth


def main(argv=None):
    """Read the command line and lay the trials down, printing each one's name and nothing of what it
    hides.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, help="folder for the campaigns")
    parser.add_argument("--envelopes", required=True, help="another folder, for the truth")
    parser.add_argument("--kind", required=True, choices=["single", "pair", "none", "outside", "power"])
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="index of the first trial, to go on or to share the work")
    parser.add_argument("--seed", required=True, help="a name; the same name gives the same trials")
    parser.add_argument("--effect", choices=[*LIBRARY, *OUTSIDE], help="hide this one instead of a drawn one")
    parser.add_argument("--strength", type=float, help="1 is clear; 0.25 and 0.5 for power curves")
    parser.add_argument("--size", choices=list(nominal.CAMERAS), default="standard")
    a = parser.parse_args(argv)
    if Path(a.envelopes).resolve().is_relative_to(Path(a.out).resolve()):
        parser.error("--envelopes must not be in the folder of the campaigns")
    if a.strength is not None and a.strength <= 0:
        parser.error("--strength must be above 0; for nothing hidden use --kind none")
    if (a.kind == "outside" and a.effect in LIBRARY) or (a.kind in ("single", "pair") and a.effect in OUTSIDE):
        parser.error(f"--kind {a.kind} does not go with --effect {a.effect}")
    for index in range(a.first, a.first + a.count):
        name, _ = lay_down_trial(a.out, a.envelopes, a.kind, index, a.seed, a.effect, a.strength, a.size)
        print(name, flush=True)


if __name__ == "__main__":
    main()
