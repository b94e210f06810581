"""Results in words: what was compared, what a camera's diagnosis says, the ladder as one reads it."""

import pandas as pd

from rig.light import hidden_groups
from rig.words import LADDER, gap_along, plain, with_error

MAX_TOLD = 12  # parameters of one effect that a sentence can hold
MAX_NAMED_AGAIN = 4  # effects of an earlier sentence
FEW_NOT_LOOKED_AT = 2
AROUND_A_BOARD = (
    "What lies about the board is not modelled: the twin has even grey ground there, and no number is taken from it."
)
NEAR_FLOOR = 1.2  # a gap up to this is told as the floor


def plural(count, word):
    """Return ``3 stations`` or ``1 station``."""
    return f"{count} {word}" + ("" if count == 1 else "s")


def compared(scene, markers, cameras, stations, captures):
    """Return sentences on what was compared with what."""
    rig = "one calibration board" if scene.get("target") else plural(len(markers), "marker")
    lines = []
    if len(captures):
        places = captures.groupby("camera").station.nunique().sum()
        kind = "simulated stand-ins for captures" if scene.get("origin") == "simulated" else "photographs"
        lines.append(
            f"{plural(len(captures), 'capture')} ({kind}) of a rig with {rig}, by "
            f"{plural(len(cameras), 'camera')} at {plural(places, 'place')}, each beside its twin."
        )
    else:
        lines.append(
            f"A designed experiment without photographs: {plural(len(stations), 'station')} of "
            f"{plural(len(cameras), 'camera')} over a rig with {rig}, the twin alone."
        )
    lines.append(
        "The twin of a capture is what Blender renders of the nominal rig through an ideal pinhole camera, "
        "with the declared noise and whatever effects the twin has been given."
    )
    return lines + assumed(scene)


def assumed(scene):
    """Return sentences on what nobody has declared and what the twin takes it for; none of a rig where all is declared."""
    left_open = scene.get("left_open", [])
    if not left_open:
        return [AROUND_A_BOARD] if scene.get("target") else []
    words = f"Not declared: {listed(plain(key) for key in left_open)}. They may differ from photograph to photograph; "
    if scene.get("target"):
        return [
            f"{words}each one's twin takes them as the board's own white and black show them.",
            *hidden_words(left_open),
            AROUND_A_BOARD,
        ]
    values = {
        "light": "the light for even",
        "exposure": f"the exposure for {scene.get('exposure')}",
        "white_balance": "the white balance for neutral",
        "reflectance": "reflectances for "
        + ", ".join(f"{name} {value:g}" for name, value in scene.get("reflectance", {}).items()),
    }
    for_all = ", reflectances for all captures alike," if "reflectance" in left_open else ""
    fitted = f"The diagnosis fits each capture's own{for_all} and blames nothing on them."
    return [f"{words}the twin's images take {listed(values[key] for key in left_open)}. {fitted}"]


def hidden_words(left_open):
    """Return a sentence on what hides one another in photographs of a board, a group each; none where nothing does."""
    groups = "; ".join(listed(group) for group in hidden_groups(left_open))
    return [f"These hide one another, and are told together alone: {groups}."] if groups else []


def listed(names):
    """Return ``a, b and c``."""
    names = list(names)
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def effect_words(step):
    """Return an effect with its parameters, such as ``radial distortion (k1 0.1712 ± 0.0020)``; of many the number."""
    parameters = step.get("parameters", {})
    if len(parameters) > MAX_TOLD:
        return f"{plain(step['effect'])} ({len(parameters)} parameters)"
    values = [f"{name} {with_error(p['value'], p.get('se'))}" for name, p in parameters.items()]
    return plain(step["effect"]) + (f" ({', '.join(values)})" if values else "")


def verdict_words(diagnosis):
    """Return what a camera's diagnosis says, in words made from its numbers: a line of what is seen, and one of what is not."""
    if diagnosis.get("why"):
        return f"nothing could be diagnosed: {diagnosis['why']}."
    if diagnosis.get("baseline"):
        return changes_words(diagnosis)
    steps = diagnosis.get("steps", [])
    effects = listed(effect_words(step) + or_others(step) + residue_words(step) for step in steps)
    if diagnosis["verdict"] == "adequate":
        words = "nothing is missing; the twin explains the images down to the floor."
    elif diagnosis["verdict"] == "explained":
        closed = "the gap is the floor" if steps[-1]["gap_after"] <= NEAR_FLOOR else "most of the gap is closed"
        words = f"the twin lacks {effects}; with that, {closed}."
    else:
        words = "a gap is left that no known effect closes."
        words += f" Part of it is {effects}." if steps else ""
    if steps:
        words += f" The gap falls from {steps[0]['gap_before']:.2f} to {steps[-1]['gap_after']:.2f} floors."
    if diagnosis["verdict"] != "adequate" and diagnosis.get("where"):
        most = diagnosis["where"][0]
        words += f" It shows most in {plain(gap_along(most))}, which predicts {100 * most['share']:.0f} % of it."
    confused = sorted({plain(name) for step in steps for name in step.get("confused_with", []) if "one_of" not in step})
    if confused:
        words += f" These captures cannot tell it apart from {listed(confused)}."
    words += station_words(diagnosis) + whole_lens_words(diagnosis) + own_words(diagnosis) + motion_words(diagnosis)
    further = needs_words(diagnosis) + not_looked_at_words(diagnosis)
    return f"{words}\n{further.strip()}" if further else words


def whole_lens_words(diagnosis):
    """Return what fitting a lens's small terms too brings on left-out photographs; nothing where it brings nothing."""
    lens = diagnosis.get("whole_lens")
    if not lens or not lens["too_small_for_a_name"]:
        return ""
    names = listed(plain(name) for name in lens["too_small_for_a_name"])
    off = f"{lens['left_out_px']:.3f} px off, {lens['left_out_px_of_named']:.3f} px without"
    return (
        f" Fitted as a calibration, with what is too small for a name ({names}), the lens leaves left-out points {off}."
    )


def or_others(step):
    """Return what else a step may be, in words; nothing where its captures tell."""
    others = [plain(name) for name in step.get("one_of", []) if name != step["effect"]]
    return f" (or {listed(others)}: these captures cannot tell)" if others else ""


def residue_words(step):
    """Return what the form of a step's effect leaves above the floor, in brackets; nothing where it leaves nothing."""
    left = listed(f"{plain(group)} {gap:.2f} floors" for group, gap in step.get("residue", {}).items())
    return f" (its form leaves a residue: {left})" if left else ""


def station_words(diagnosis):
    """Return which station could tell an effect from what it is confused with, a sentence; nothing where none is suggested."""
    station = diagnosis.get("suggested_station")
    if not station:
        return ""
    pair = " from ".join(map(plain, station["tells_apart"]))
    return f" A station at {station['height_m']:g} m height and {station['tilt_deg']:g}° tilt could tell {pair}."


def needs_words(diagnosis):
    """Return what photographs of a board cannot tell, a sentence, what further ones would, a sentence an instruction, and what
    none that were tried would.
    """
    hidden = [plain(name) for name in diagnosis.get("not_told", [])]
    words = f" These photographs would not show {listed(hidden)} at a size worth naming." if hidden else ""
    by_instruction = {}
    for need in diagnosis.get("needs", []):
        what, _, instruction = need["text"].partition(": ")
        by_instruction.setdefault(instruction, []).append(what.removeprefix("to tell "))
    words += "".join(f" To tell {listed(_once(what))}: {instruction}." for instruction, what in by_instruction.items())
    told = {what for of_one in by_instruction.values() for what in of_one}
    left, alike = ([what for what in some if what not in told] for some in (hidden, alike_words(diagnosis)))
    if len(left) > MAX_NAMED_AGAIN:
        left = ["the rest of them"]
    of_none = listed([*left, *alike])
    return words + (f" None of the instructions that were tried would tell {of_none}." if of_none else "")


def _once(what):
    """Return names, and ``this from that``, without the name alone of what is told from another."""
    return [name for name in what if not any(other.startswith(f"{name} from ") for other in what)]


def alike_words(diagnosis):
    """Return [``this from that``] of the effects that a board's photographs cannot tell apart, as in the texts of ``needs``."""
    steps = diagnosis["steps"] if "needs" in diagnosis else []
    pairs = [(other, s["effect"]) for s in steps for other in s.get("one_of", []) if other != s["effect"]]
    return [f"{plain(other)} from {plain(effect)}" for other, effect in pairs]


def changes_words(diagnosis):
    """Return what a camera's diagnosis says has changed since its baseline, a sentence a change."""
    since, (before, after) = diagnosis["baseline"], diagnosis["captures"]
    words = [f"Since {since} {change_words(step)}." for step in diagnosis["steps"]]
    if not words:
        words.append(
            f"Nothing that has a name has changed since {since}, as far as {before} captures then and {after} now tell."
        )
    if diagnosis["verdict"] == "unexplained":
        words.append("Something has changed that no known effect explains.")
    if hidden := [plain(name) for name in diagnosis.get("not_told", [])]:
        words.append(f"Of {listed(hidden)} even a clear change would most likely go unseen in these captures.")
    why = diagnosis.get("alone", {}).get("why")
    alone = f" Of what these captures show by themselves nothing could be diagnosed: {why}." if why else ""
    return " ".join(words) + alone + not_looked_at_words(diagnosis)


def change_words(step):
    """Return a change in words, such as ``focal length has changed: ratio from 1.001 to 1.020 ± 0.002``."""
    name = plain(step["effect"]) + or_others(step)
    name += " (or the light is another)" if step.get("like_light") else ""
    beyond = f", beyond what the {step['beyond']} captures have of it" if "beyond" in step else ""
    parameters = step["parameters"]
    if len(parameters) > MAX_TOLD:
        return f"{name} has changed ({len(parameters)} parameters){beyond}"
    values = (f"{k} from {p['from']:.4g} to {with_error(p['to'], p['se'])}" for k, p in parameters.items())
    return f"{name} has changed: {', '.join(values)}{beyond}"


def own_words(diagnosis):
    """Return between what values the captures' own numbers lie, a sentence with a space before it; none where all is declared."""
    own = diagnosis.get("own", {})
    ranges = [f"{plain(name)} {min(v.values()):.3g} to {max(v.values()):.3g}" for name, v in own.items()]
    return f" Each capture has its own {listed(ranges)}." if ranges else ""


def motion_words(diagnosis):
    """Return that photographs moved while they were read, a sentence with a space before it; none of photographs at rest."""
    motion = diagnosis.get("motion")
    if not motion:
        return ""
    return (
        " The camera reads its rows one after the other, and each photograph moved meanwhile in its own way, as in a hand: that"
        f" is fitted in each and names no effect; at rest, points would stay {motion['gap_at_rest']:.2f} floors off. Camera and"
        " board on something firm, or more light, would do away with it."
    )


def not_looked_at_words(diagnosis):
    """Return how many effects that the twin has not were not looked at for the commonest reason; nothing of one or two."""
    known = {effect["effect"] for effect in diagnosis.get("configured", [])}
    reasons = [why for name, why in diagnosis.get("not_looked_at", {}).items() if name not in known]
    most = max(sorted(set(reasons)), key=reasons.count, default=None)
    number = reasons.count(most)
    return f" {number} effects were not looked at: {most}." if number > FEW_NOT_LOOKED_AT else ""


def ladder_rows(path):
    """Return (headings, rows of text) of the ladder as one reads it: a row a twin, then the camera's floors."""
    rows = []
    for camera, steps in pd.read_csv(path).groupby("camera", sort=False):
        for step in steps.to_dict("records"):
            twin = plain(step["effect"]) if step["step"] == 0 else f"+ {plain(step['effect'])}"
            rows.append([camera, twin, *(_short(step[measure]) for measure in LADDER)])
        rows.append([camera, "floor", *(_short(step[f"{measure}_floor"]) for measure in LADDER)])
    return ["camera", "twin", *LADDER.values()], rows


def _short(value):
    return "" if pd.isna(value) else f"{value:.3g}"
