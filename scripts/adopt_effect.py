"""Adopt: write an effect that the diagnosis found into a camera's twin, or take one out again.

    python scripts/adopt_effect.py CAMERA                   the verdict's next effect
    python scripts/adopt_effect.py CAMERA EFFECT            this one, with its fitted parameters
    python scripts/adopt_effect.py CAMERA --auto            go on until the diagnosis finds nothing more
    python scripts/adopt_effect.py CAMERA EFFECT --remove   take it out of the twin

The twin is config/twins/<campaign>/<camera>.yaml; comments, order and numbers of what stands there are kept, and each `fit`
is filled in. Says at the end what the change will rerun.
"""

import argparse
import io
import json
import logging
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

import job
from effects import library
from inputs.safe_yaml import load_yaml
from inputs.twins import FIT, entries_of, load_twin
from rig.errors import InputError

log = logging.getLogger("twingap")

DEFAULT_CONFIG = "config/config.default.yaml"
MAX_ROUNDS = 8
MIN_DIGITS = 4
HEADER = """\
# The twin of {camera} in the campaign {campaign}: effects on top of the ideal twin (nominal rig, pinhole, noise).
# Edit freely: a parameter is a number or `fit`; what is left out does nothing. All effects: docs/effects.md.
"""


def find_campaign(given):
    """Return (name, folder or None) of a campaign given by name, by folder, or not at all (the configured one)."""
    given = given or load_yaml(DEFAULT_CONFIG).get("campaign")
    if (Path(given) / "campaign.yaml").is_file():
        return str(load_yaml(Path(given) / "campaign.yaml").get("name")), str(given)
    if re.fullmatch(r"[A-Za-z0-9_-]+", given) and Path(f"results/{given}").is_dir():
        return given, _folder_of(given)
    raise InputError(f"--campaign {given}: neither a folder with a campaign.yaml nor the name of a folder in results/")


def _folder_of(name):
    """Return the folder of a campaign that was run before, or None."""
    run_config = Path(f"results/{name}/run_config.yaml")
    candidates = [load_yaml(run_config).get("campaign")] if run_config.is_file() else []
    for folder in (*candidates, f"data/raw/{name}"):
        if folder and (Path(folder) / "campaign.yaml").is_file():
            return folder
    return None


def read_diagnosis(campaign, camera):
    """Return the diagnosis of a camera (dict); raises InputError where there is none that can be read."""
    path = Path(f"results/{campaign}/diagnosis/{camera}.json")
    if not path.is_file():
        there = ", ".join(sorted(p.stem for p in path.parent.glob("*.json"))) or "none"
        raise InputError(f"{path}: no such diagnosis (there are: {there}); run `snakemake --cores 2 diagnose` first")
    try:
        diagnosis = json.loads(path.read_text())
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error})") from None
    for key in ("verdict", "steps", "candidates"):
        if key not in diagnosis:
            raise InputError(f"{path}: {key} is missing")
    return diagnosis


def next_effect(diagnosis, adopted):
    """Return the first effect of the verdict that the twin lacks; raises InputError where there is none."""
    for step in diagnosis["steps"]:
        if step["effect"] not in adopted:
            return step["effect"]
    raise InputError(
        f"the diagnosis of {diagnosis.get('camera')} says {diagnosis['verdict']!r} and has no effect to add that the "
        "twin lacks; name one to try it, or run `snakemake --cores 2 diagnose` where the twin has changed since"
    )


def finding(diagnosis, effect):
    """Return ({parameter: (value, standard error or None)}, origin) of an effect, wherever the diagnosis has it.

    Raises InputError where it has none.
    """
    where = f"{diagnosis.get('campaign')}/{diagnosis.get('camera')}"
    for step in diagnosis["steps"]:
        if step["effect"] == effect:
            gaps = f"held-out gap {step['gap_before']:.2f} -> {step['gap_after']:.2f} floors"
            return _values_of(step), f"verdict on {where}, {gaps}"
    for part in diagnosis.get("whole_lens", {}).get("effects", []):
        if part["effect"] == effect:
            return _values_of(part), f"fitted with the whole lens by the diagnosis of {where}"
    for candidate in diagnosis["candidates"]:
        if candidate["effect"] == effect and candidate.get("parameters"):
            values = {k: (v, None) for k, v in candidate["parameters"].items()}
            return values, f"candidate of the diagnosis of {where}, held-out gap {candidate['gap_after']:.2f} floors"
    for configured in diagnosis.get("configured", []):
        if configured["effect"] == effect:
            values = {k: (v, None) for k, v in configured["parameters"].items()}
            return values, f"refitted by the diagnosis of {where}"
    raise InputError(f"{where}: the diagnosis did not fit {effect!r}; see diagnose.candidates in the configuration")


def _values_of(found):
    """Return {parameter: (value, standard error or None)} of an effect as a diagnosis has it."""
    return {k: (v["value"], v.get("se")) for k, v in found["parameters"].items()}


def rounded(value, se, parameter):
    """Return a value with digits that its standard error (None: unknown) leaves meaning, inside its bounds."""
    if value is None or not math.isfinite(value):
        raise InputError(f"the diagnosis has no number for it ({value}): its fit did not converge")
    if value == 0:
        return 0.0
    digits = 6
    if se and math.isfinite(se):
        digits = max(MIN_DIGITS, math.ceil(math.log10(abs(value) / se)) + 2) if abs(value) > se else MIN_DIGITS
    return min(max(float(f"{value:.{digits}g}"), parameter.lower), parameter.upper)


def entry_of(effect, values, origin, standing):
    """Return a twin's entry, with a comment of unit and standard error at each parameter that does not stand yet.

    ``standing`` is {parameter: number} that a person wrote: the diagnosis fitted nothing there.
    """
    known = library.parameters_of(effect)
    parameters = CommentedMap()
    for key in sorted({*values, *standing}, key=list(known).index):
        if key in standing:
            parameters[key] = standing[key]
            continue
        value, se = values[key]
        parameters[key] = rounded(value, se, known[key])
        spread = f" +- {se:.2g}" if se else ""
        parameters.yaml_add_eol_comment(f"{known[key].unit}{spread}", key)
    return CommentedMap({"effect": effect, "parameters": parameters, "origin": origin})


# -- the twin's file ----------------------------------------------------------------------------------------------


def _yaml():
    yaml = YAML(typ="rt", pure=True)
    yaml.preserve_quotes = True
    yaml.width = 200
    yaml.indent(mapping=2, sequence=4, offset=2)
    # plain decimals: people read them, and every YAML reader takes them for numbers
    yaml.representer.add_representer(
        float,
        lambda r, v: r.represent_scalar("tag:yaml.org,2002:float", np.format_float_positional(v, trim="0")),
    )
    return yaml


def _read(path, campaign, camera):
    """Return the round-trip data of a twin's file, or of a new one with its header."""
    if not path.is_file():
        return _yaml().load(HEADER.format(campaign=campaign, camera=camera) + "effects:\n")
    load_twin(path)  # refuse to build on a file that is wrong
    return _yaml().load(path.read_text(encoding="utf-8"))


def _write(path, text):
    """Replace a twin's file, once the new text has proved to be a twin."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fd, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".yaml")
    os.close(fd)
    try:
        Path(temporary).write_text(text, encoding="utf-8")
        load_twin(temporary)
        with job.write_atomically(path) as file:
            file.write(text)
    finally:
        os.unlink(temporary)


def standing_of(path, effect):
    """Return {parameter: number} of an effect as it stands in a twin's file or in one that it extends, without each `fit`."""
    entries = entries_of(path) if path.is_file() else []
    given = next((e.get("parameters") or {} for _, e in entries if e["effect"] == effect), {})
    return {key: value for key, value in given.items() if value != FIT}


def add(path, entries, campaign, camera):
    """Write entries into a twin's file; in one that stands there already numbers and comments stay."""
    data = _read(path, campaign, camera)
    if not data.get("effects"):
        # comments that hang on an empty list go with the key that follows it
        data["effects"] = CommentedSeq()
    data["effects"].fa.set_block_style()
    for entry in entries:
        old = next((e for e in data["effects"] if e["effect"] == entry["effect"]), None)
        if old is None:
            data["effects"].append(entry)
            continue
        if old.get("parameters") is None:
            old["parameters"] = CommentedMap()
        for key, value in entry["parameters"].items():
            if old["parameters"].get(key, FIT) == FIT:
                old["parameters"][key] = value
        old["origin"] = entry["origin"]
    stream = io.StringIO()
    _yaml().dump(data, stream)
    _write(path, stream.getvalue())


def remove(path, effect):
    """Take an effect out of a twin's file, by lines, so that all else stays as it was written."""
    if effect not in dict(load_twin(path).effects):
        raise InputError(f"{path}: has no {effect!r} to take out")
    text = path.read_text(encoding="utf-8")
    data = _yaml().load(text)
    names = [e["effect"] for e in data.get("effects") or []]
    if effect not in names:
        raise InputError(
            f"{path}: {effect!r} comes from the twin that this one extends ({data['extends']}); edit that one"
        )
    if data["effects"].fa.flow_style():
        raise InputError(f"{path}: effects stand in one line; take {effect!r} out by hand")
    k = names.index(effect)
    lines = text.splitlines(keepends=True)
    first = data["effects"].lc.item(k)[0]
    last = data["effects"].lc.item(k + 1)[0] if k + 1 < len(names) else _end_of_effects(lines, first)
    # comments right above what follows belong to that
    while last > first + 1 and lines[last - 1].strip()[:1] in ("", "#"):
        last -= 1
    kept = "".join(lines[:first] + lines[last:])
    if len(names) == 1:
        kept = re.sub(r"^effects:[ \t]*(?=#|$)", "effects: [] ", kept, count=1, flags=re.MULTILINE).replace(
            "[] \n", "[]\n"
        )
    _write(path, kept)


def _end_of_effects(lines, first):
    """Return the line after the list that holds line ``first``: the next key at the left edge, or the end."""
    for number in range(first + 1, len(lines)):
        if re.match(r"[A-Za-z]", lines[number]):
            return number
    return len(lines)


# -- what follows -------------------------------------------------------------------------------------------------


def snakemake(folder, *arguments):
    """Run Snakemake for a campaign's folder; return the finished process, its output as text."""
    command = [sys.executable, "-m", "snakemake", *arguments]
    if folder:
        command += ["--config", f"campaign={folder}"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def rerun_summary(output):
    """Return what a dry run says: 'rule x 3, ...' from its table of jobs."""
    found = re.search(r"^job +count\n-+ +-+\n(.*?)^total +(\d+)", output, re.MULTILINE | re.DOTALL)
    if not found:
        return "nothing" if "Nothing to be done" in output else None
    jobs = [line.split() for line in found[1].splitlines() if line.strip()]
    return ", ".join(f"{name} x {count}" for name, count in jobs if name not in ("all", "diagnose"))


def say_what_reruns(folder):
    """Print what a change of the twin will cost; where Snakemake can't say, say that."""
    if folder is None:
        print("What will rerun: unknown, as the campaign's folder is not known (give --campaign FOLDER).")
        return
    done = snakemake(folder, "-n", "--rerun-incomplete", "--quiet", "rules")
    summary = rerun_summary(done.stdout + done.stderr)
    if done.returncode or summary is None:
        print("What will rerun: Snakemake's dry run fails:\n" + (done.stdout + done.stderr)[-2000:])
        return
    print(f"What will rerun: {summary}.")
    if "render_stations" not in summary:
        print("Nothing is rendered again.")


def describe(entry):
    """Return 'effect (a = 1, b = 2)'."""
    return f"{entry['effect']} (" + ", ".join(f"{k} = {float(v):g}" for k, v in entry["parameters"].items()) + ")"


def adopt(path, campaign, camera, effects):
    """Write effects (names; empty: the next one) with what the diagnosis says into the twin's file; return the entries."""
    diagnosis = read_diagnosis(campaign, camera)
    adopted = dict(load_twin(path).effects)
    entries = []
    for effect in effects or [next_effect(diagnosis, adopted)]:
        library.effect_named(effect)
        values, origin = finding(diagnosis, effect)
        standing = standing_of(path, effect)
        if not values.keys() - standing.keys():
            raise InputError(
                f"{path}: {effect} has its numbers, which stay; write `{FIT}` for what a diagnosis is to fit"
            )
        entries.append(entry_of(effect, values, origin, standing))
    if any(library.moves_points(entry["effect"]) for entry in entries):
        entries += fitted_beside(diagnosis, adopted)
    add(path, entries, campaign, camera)
    return entries


def fitted_beside(diagnosis, adopted):
    """Return entries of what moves points in all twins of a diagnosis and gets no name: the focal length beside a lens."""
    origin = f"fitted beside the lens by the diagnosis of {diagnosis.get('campaign')}/{diagnosis.get('camera')}"
    return [
        entry_of(effect, {k: (v, None) for k, v in p.items()}, origin, {})
        for effect, p in diagnosis.get("nuisances", {}).items()
        if library.moves_points(effect) and effect not in adopted
    ]


def say_what_was_adopted(path, entries):
    """Print a line an entry of the twin's file."""
    for entry in entries:
        print(f"{path}: {describe(entry)}; {entry['origin']}.")


def adopt_all(path, campaign, camera, folder, cores):
    """Adopt what the diagnosis finds and diagnose again, until it finds nothing more.

    The twin's file and the diagnosis belong together, so nothing is printed between them: a closed pipe ends it
    before or after both.
    """
    if folder is None:
        raise InputError(
            f"--auto needs the campaign's folder to diagnose again: give --campaign FOLDER, not {campaign}"
        )
    for _ in range(MAX_ROUNDS):
        diagnosis = read_diagnosis(campaign, camera)
        adopted = dict(load_twin(path).effects)
        missing = [step["effect"] for step in diagnosis["steps"] if step["effect"] not in adopted]
        if not missing:
            print(f"The verdict on {camera} is now: {diagnosis['verdict']}.")
            return
        print(f"Adopting {', '.join(missing)} and diagnosing again ...", flush=True)
        entries = adopt(path, campaign, camera, missing)
        target = f"results/{campaign}/diagnosis/{camera}.json"
        done = snakemake(folder, target, "--cores", str(cores), "--rerun-incomplete", "--quiet", "all")
        if done.returncode:
            raise InputError(f"the diagnosis failed:\n{(done.stdout + done.stderr)[-3000:]}")
        say_what_was_adopted(path, entries)
    print(f"Stopped after {MAX_ROUNDS} rounds; the verdict is {read_diagnosis(campaign, camera)['verdict']}.")


def adopt_effect(camera, effect, campaign, take_out, auto, cores):
    """Do what the command line says."""
    if auto and (effect or take_out):
        raise InputError("--auto takes no EFFECT and no --remove")
    if take_out and not effect:
        raise InputError("--remove needs the EFFECT to take out")
    name, folder = find_campaign(campaign)
    path = Path(f"config/twins/{name}/{camera}.yaml")
    if auto:
        adopt_all(path, name, camera, folder, cores)
    elif take_out:
        remove(path, effect)
        print(f"{path}: {effect} is out.")
    else:
        say_what_was_adopted(path, adopt(path, name, camera, [effect] if effect else []))
    say_what_reruns(folder)


def main(arguments=None):
    """Parse the command line and adopt; exit status 1 with one message for bad input."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("camera", metavar="CAMERA")
    parser.add_argument("effect", metavar="EFFECT", nargs="?")
    parser.add_argument("--campaign", metavar="NAME|FOLDER", help="default: the configured campaign")
    parser.add_argument("--remove", action="store_true", help="take EFFECT out of the twin")
    parser.add_argument("--auto", action="store_true", help="go on until the diagnosis finds nothing more")
    parser.add_argument("--cores", type=int, default=2, help="for --auto (default 2)")
    given = parser.parse_intermixed_args(arguments)
    job.set_up_log()
    with job.one_message():
        adopt_effect(given.camera, given.effect, given.campaign, given.remove, given.auto, given.cores)


if __name__ == "__main__":
    main()
