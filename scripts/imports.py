"""What Python files import of the project, read in their text: Snakemake does not see it, so rules make it inputs.

Nothing is run. What is found by being there (effects, detectors) is imported under no name: rules declare it apart. Where a
module says ``FINDS_NEIGHBOURS = True``, whoever imports it depends on all that lies beside it.
"""

import ast
import functools
import json
import re
from os.path import isdir, isfile
from pathlib import Path

FOLDERS = ("scripts", "notebooks", "tests/bench")  # where a script's imports are looked for after its own folder
# Whole files take ten times as long to parse, at every start of every job. Prose that looks like this does not parse,
# or names no module.
FINDS_NEIGHBOURS = re.compile(r"^FINDS_NEIGHBOURS = True\b", re.MULTILINE)
STATEMENT = re.compile(r"^[ \t]*(?:import\b.*|from\b.*?\bimport\b[ \t]*(?:\([^)]*\)|.*))", re.MULTILINE)


def imports_of(*files):
    """Return the sorted paths of all that scripts or notebooks import, one of another, ``__init__`` files included.

    files  paths from the project's folder, which is the working folder, or below its scripts/
    Imports inside functions count. Raises FileNotFoundError for a file that is not there.
    """
    return sorted(set().union(*(_closure(_path_of(file)) for file in files)))


def _path_of(file):
    return f"scripts/{file}" if isfile(f"scripts/{file}") else file


@functools.cache
def _closure(start):
    folders = (str(Path(start).parent), *FOLDERS)
    found, waiting = set(), [start]
    while waiting:
        new = {path for name in _names_imported(waiting.pop()) for path in _files_of(name, folders)} - found
        found |= new
        waiting += new
    return frozenset(found)


@functools.cache
def _names_imported(path):
    """Return the dotted names that a file imports; of ``from a import b`` both ``a`` and ``a.b``."""
    names, source = set(), _source_of(path)
    if FINDS_NEIGHBOURS.search(source):
        package = _package_of(path, 1)
        names |= {".".join([*package, file.stem]) for file in Path(path).parent.glob("*.py")}
    for statement in STATEMENT.findall(source):
        try:
            nodes = ast.parse(statement.strip()).body
        except SyntaxError:
            continue
        for node in nodes:
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                parts = [*_package_of(path, node.level), *filter(None, [node.module])]
                names |= {".".join([*parts, *end]) for end in [[], *([alias.name] for alias in node.names)]}
    return frozenset(names)


def _source_of(path):
    text = Path(path).read_text(encoding="utf-8")
    if path.endswith(".ipynb"):
        text = "\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code")
    return text.replace("\\\n", " ")


def _package_of(path, level):
    """Return the parts of the package that an import's ``level`` dots mean in a file; [] without dots."""
    if not level:
        return []
    inside = next(Path(path).relative_to(f) for f in (*FOLDERS, ".") if Path(path).is_relative_to(f))
    return inside.parts[:-level]


@functools.cache
def _files_of(name, folders):
    """Return the files that importing ``a.b`` runs: those of a and of a.b; none for what is not the project's."""
    files, parts = [], name.split(".")
    for n in range(1, len(parts) + 1):
        places = [f"{folder}/{'/'.join(parts[:n])}" for folder in folders]
        found = [path for place in places for path in (f"{place}/__init__.py", f"{place}.py") if isfile(path)]
        if not found and not any(map(isdir, places)):
            break
        files += found[:1]
    return files
