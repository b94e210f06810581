"""What Snakemake wrote down as a job's inputs, against what the job's code imports."""

import ast
import base64
import functools
import json
import re

FOLDERS = ("scripts", "notebooks", "tests/bench")
RULE = re.compile(r"^ *(?:use rule (\w+) as |rule )(\w+)(?: with)?:\n(.*?)(?=^ *(?:use )?rule |\Z)", re.M | re.S)


def imported(path, project):
    """Return the project's modules (relative paths) that a Python file or a notebook imports, and those that they import.

    Judged by whole syntax trees, whatever scripts/imports.py reads in their text.
    """
    found, waiting = set(), [path]
    while waiting:
        for name in names_imported(project / waiting.pop()):
            new = set(files_of(name, project)) - found
            found |= new
            waiting += new
    return found


@functools.cache
def names_imported(path):
    """Return the dotted names that a file imports; of ``from a import b`` both ``a`` and ``a.b``."""
    names = set()
    for node in ast.walk(ast.parse(source_of(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: imports are absolute here"
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


@functools.cache
def files_of(name, project):
    """Return the files that importing ``a.b`` runs: ``a/__init__.py`` and ``a/b.py``, or ``a.py`` where b is no module."""
    parts = name.split(".")
    heads = ["/".join(parts[: n + 1]) for n in range(len(parts))]
    choices = [f"{folder}/{head}{end}" for folder in FOLDERS for head in heads for end in ("/__init__.py", ".py")]
    return [path for path in choices if (project / path).is_file()]


def source_of(path):
    """Return the Python text of a module or of a notebook's code cells."""
    if path.suffix == ".py":
        return path.read_text()
    cells = json.loads(path.read_text())["cells"]
    return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")


def scripts_of_rules(project):
    """Return {rule: the Python file that it runs, by ``script`` or ``shell``}; a rule that runs none is left out."""
    found = {}
    for file in sorted((project / "rules").glob("*.smk")):
        for used, rule, body in RULE.findall(file.read_text()):
            script = re.search(r'^ +script:\n +"\.\./(.+)"', body, re.M)
            command = re.search(r'^ +shell:\n +".*?([\w/]+\.py)\b', body, re.M)
            if script or command or used in found:
                found[rule] = (script or command).group(1) if script or command else found[used]
    return found


def jobs_of(project):
    """Return {output: (rule, inputs)} as Snakemake wrote them down."""
    jobs = {}
    for file in (project / ".snakemake/metadata").rglob("*"):
        if file.is_file():
            record = json.loads(file.read_text())
            encoded = str(file.relative_to(project / ".snakemake/metadata")).replace("/@", "")
            jobs[base64.b64decode(encoded).decode()] = (record["rule"], record["input"])
    return jobs
