"""What Snakemake wrote down as a job's inputs, against what the job's code imports."""

import ast
import base64
import json


def imported(path, project):
    """Return the project's modules (relative paths) that a Python file or a notebook imports, and those that they import."""
    found, waiting = set(), [path]
    while waiting:
        here = waiting.pop()
        for name in names_imported(source_of(project / here)):
            for folder in ("scripts", "notebooks", "tests/bench"):
                module = f"{folder}/{name.replace('.', '/')}.py"
                if (project / module).is_file() and module not in found:
                    found.add(module)
                    waiting.append(module)
    return found


def source_of(path):
    """Return the Python text of a module or of a notebook's code cells."""
    if path.suffix == ".py":
        return path.read_text()
    cells = json.loads(path.read_text())["cells"]
    return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")


def names_imported(source):
    """Return the dotted names that a text imports; of ``from a import b`` both ``a`` and ``a.b``."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def jobs_of(project):
    """Return {output: (rule, inputs)} as Snakemake wrote them down."""
    jobs = {}
    for file in (project / ".snakemake/metadata").rglob("*"):
        if file.is_file():
            record = json.loads(file.read_text())
            encoded = str(file.relative_to(project / ".snakemake/metadata")).replace("/@", "")
            jobs[base64.b64decode(encoded).decode()] = (record["rule"], record["input"])
    return jobs


def inputs_behind(output, jobs):
    """Return all files that an output was made from, directly or by way of others."""
    seen, waiting = set(), [output]
    while waiting:
        _, inputs = jobs.get(waiting.pop(), ("", []))
        waiting += [i for i in inputs if i not in seen]
        seen |= set(inputs)
    return seen
