"""Effects and detectors are found by being there: no other code knows one by its name."""

import ast
from pathlib import Path

from detectors import contract
from effects import library

SCRIPTS = Path(library.__file__).parents[1]
OTHER_THINGS = {"exposure"}  # of a campaign: a key of its description, not the effect
ALLOWED = {
    "calibrations/lensfun.py",  # what lensfun calls it in its files
    "inputs/config.py",  # defaults of the configuration
    "make_tables.py",  # what the paper published
    "trials/generate_trials.py",  # what the generator hides, which has names and parameters of its own
    "trials/summarise_trials.py",  # those parameters in the library's terms
}


def code_of(tree):
    """Return all (line, text) of a syntax tree that could name a module: strings but docstrings, imported names."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.lineno, node.value
        elif isinstance(node, ast.Import | ast.ImportFrom):
            package = getattr(node, "module", None) or ""
            for imported in [package, *(f"{package}.{alias.name}" for alias in node.names)]:
                if imported.lstrip(".").startswith(("effects.", "detectors.")):
                    yield node.lineno, imported.lstrip(".").split(".")[1]


def test_no_code_names_an_effect_or_a_detector_that_is_not_its_own():
    """Fails if a branch for one effect or detector stands elsewhere: a new one, or a renamed one, would miss it."""
    names = (set(library.available_effects()) | set(contract.available())) - OTHER_THINGS
    found = []
    for path in sorted(SCRIPTS.rglob("*.py")):
        own = path.relative_to(SCRIPTS)
        if str(own) in ALLOWED:
            continue
        itself = {part.removesuffix(".py") for part in own.parts}
        for line, text in code_of(ast.parse(path.read_text())):
            if text in names - itself:
                found.append(f"{own}:{line}: {text}")
    assert found == []
