"""The whole twin of a camera as one Python file that needs numpy and OpenCV: the project's own code of its effects."""

import ast
import pprint
from pathlib import Path

from bundle_code import bundle
from effects import library

ENTRY = "twin_api"
EMPTY = "TWIN: dict = {}"
FOUND = '''\
_EFFECTS = {{
{entries}
}}


def available_effects():
    """Return the twin's effects by name."""
    return _EFFECTS
'''


def twin_camera_file(twin):
    """Return (text of the file, [what to tell]) of a inputs.twin_sources.CameraTwin; effects of the scene are left out."""
    scene = [name for name, _ in twin.effects if library.effect_named(name).STAGE == "scene"]
    chosen = [(name, p) for name, p in twin.effects if name not in scene]
    names = [name for name, _ in chosen]
    provided = {"effects.contract": {"available_effects": "available_effects"}}
    code, entry, final = bundle(ENTRY, [f"effects.{name}" for name in names], provided)
    code = code.replace("import argparse\n", "import argparse\nfrom types import SimpleNamespace\n", 1)
    data = {
        "campaign": twin.campaign, "camera": twin.camera, "source": twin.source, "width": twin.width,
        "height": twin.height, "K": twin.K.tolist(), "exposure": twin.exposure, "encoding": twin.encoding,
        "noise_dn": twin.noise_dn, "effects": [[name, p] for name, p in chosen], "left_out": scene,
    }  # fmt: skip
    if EMPTY not in entry:
        raise ValueError(f"{ENTRY}.py no longer has the line {EMPTY!r}")
    entry = entry.replace(EMPTY, f"TWIN = {pprint.pformat(data, sort_dicts=False, width=110)}", 1)
    about = ast.get_docstring(ast.parse((Path(__file__).parent / f"{ENTRY}.py").read_text(encoding="utf-8")))
    about = about.format(**{key: data[key] for key in ("camera", "campaign", "width", "height")})
    found = FOUND.format(entries="\n".join(_namespace(name, final[f"effects.{name}"]) for name in names))
    told = [f"{len(names)} effects: {', '.join(names)}"] if names else ["no effects: the ideal twin"]
    if scene:
        told.append(f"left out, as they change what is rendered: {', '.join(scene)}")
    return f'"""{about}\n"""\n\n{code}\n\n{found}\n\n{entry}', told


def _namespace(name, names):
    has = ", ".join(f"{there}={here}" for there, here in sorted(names.items()) if not there.startswith("_"))
    return f'    "{name}": SimpleNamespace(__name__="effects.{name}", {has}),'
