"""Cases for the gap's tests: generated campaigns (an image formation of their own) read into gap.problem.Case."""

from case_files import load_case, read_capture
from expand_tables import expand_tables
from generator import draw_effect, generate_campaign, nominal
from register_captures import register_captures
from trials.generate_trials import generate_trial


def generated_case(folder, kind, effect=None, seed="gap tests", strength=1.0, index=0, size="small"):
    """Return (Case with everything measured, truth) of a campaign generated in a folder."""
    name, truth = generate_trial(
        folder / "c", folder / "e", kind, index, seed, effect=effect, strength=strength, size=size
    )
    return measured_case(folder / "c" / name, folder), truth


def case_of_several(folder, names, seed="gap tests", size="tiny"):
    """Return the Case, everything measured, of a campaign generated in a folder that hides some effects at clear strength."""
    camera = nominal.RIGS[size].cameras[0]
    effects = [(n, draw_effect(n, 1.0, camera, f"{seed}/{n}")) for n in names]
    generate_campaign(folder / "c", folder / "e", effects, seed, size=size, camera=camera.name)
    return measured_case(folder / "c", folder)


def measured_case(campaign, folder):
    """Return the Case of a generated campaign, everything measured; what is made on the way lies in a folder."""
    expand_tables(campaign, None, None, folder / "expand")
    camera = next((campaign / "images").iterdir()).name
    register_captures(folder / "expand", campaign, camera, folder / "r.csv", folder / "r.json")
    case, captures = load_case(folder / "expand", folder / "r.json", camera)
    images = dict(zip(captures.capture, captures.image, strict=True))
    for capture in case.captures:
        case.observe_real(capture, read_capture(campaign, images[capture.view.capture]))
    return case
