"""Put modules of the project into one file that needs none of them: their own text, each name led by its module's.

Comments and layout stay. A name of a module's top level becomes ``MODULE_NAME`` wherever it is meant; what one module
imports of another becomes that module's name. Nothing is run.
"""

import ast
import re
from dataclasses import dataclass, field
from pathlib import Path

from imports import imports_of

SCRIPTS = Path(__file__).parent
COMPILERS = ("numba", "kernels")  # in whose place comes this:
NUMBA = """\
try:
    from numba import njit as numbas_njit

    def njit(**options):  # a division by zero is NumPy's, as in the project
        return numbas_njit(error_model="numpy", **options)

except ImportError:  # loops then run as they stand, a hundred times slower

    def njit(**options):
        return lambda function: function
"""
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


@dataclass
class Module:
    """One module's text, and what its top level calls what.

    own      names that its top level binds
    taken    {name here: (module, name there)} of what it imports from the project
    dropped  1-based first and last lines of statements that the bundle has no use for
    outside  texts of imports of other packages
    """

    name: str
    text: str
    tree: ast.Module
    own: set = field(default_factory=set)
    taken: dict = field(default_factory=dict)
    dropped: list = field(default_factory=list)
    outside: list = field(default_factory=list)

    def prefix(self):
        """Return what leads its names."""
        return self.name.rpartition(".")[2]


def bundle(entry, others, provided):
    """Return (text of all but the entry, text of the entry, {module: {name there: name in the bundle}}).

    entry     name of a module below scripts/, whose names stay as they are
    others    names of modules that it needs and imports under no name
    provided  {module: {name there: name in the bundle}} of what is not bundled
    Raises ValueError where two names would become one.
    """
    names = [_name_of(path) for path in imports_of(*(f"{n.replace('.', '/')}.py" for n in (entry, *others)))]
    inside = {n for n in (*names, *others) if n not in (*provided, *COMPILERS)} | {entry}
    modules = {n: _parsed(n, {*inside, *provided}) for n in sorted(inside)}
    modules = {n: m for n, m in modules.items() if m.own or m.taken}
    final = {n: {own: own if n == entry else f"{m.prefix()}_{own}" for own in m.own} for n, m in modules.items()}
    _check_apart(final, provided)
    outside = sorted({text for m in modules.values() for text in m.outside})
    parts = ["\n".join(outside), NUMBA.strip("\n")]
    for name in _in_order(modules, entry):
        renamed = dict(final[name])
        for here, (module, there) in modules[name].taken.items():
            renamed[here] = (final | provided)[module][there]
        text = _renamed(modules[name], renamed).strip("\n")
        parts.append(text if name == entry else f"# -- {name} {'-' * (100 - len(name))}\n\n{text}")
    return "\n\n\n".join(parts[:-1]) + "\n", parts[-1] + "\n", final


def _name_of(path):
    return str(Path(path).relative_to("scripts").with_suffix("")).replace("/", ".").removesuffix(".__init__")


def _parsed(name, known):
    path = SCRIPTS / f"{name.replace('.', '/')}.py"
    text = (path if path.is_file() else path.with_suffix("") / "__init__.py").read_text(encoding="utf-8")
    module = Module(name, text, ast.parse(text))
    for index, node in enumerate(module.tree.body):
        if isinstance(node, ast.ImportFrom) and node.module in known:
            module.taken |= {a.asname or a.name: (node.module, a.name) for a in node.names}
            module.dropped.append((node.lineno, node.end_lineno))
        elif isinstance(node, ast.Import | ast.ImportFrom):
            if getattr(node, "module", None) not in COMPILERS:
                module.outside.append(ast.unparse(node))
            module.dropped.append((node.lineno, node.end_lineno))
        elif index == 0 and isinstance(node, ast.Expr):
            module.dropped.append((node.lineno, node.end_lineno))
        else:
            module.own |= _bound([node])
    return module


def _check_apart(final, provided):
    seen = {}
    for module, names in (final | provided).items():
        for name in names.values():
            if name in seen:
                raise ValueError(f"{module} and {seen[name]} both become {name}")
            seen[name] = module


def _in_order(modules, entry):
    """Return the modules' names, each after those it imports from."""
    done = []

    def visit(name):
        for module, _ in modules[name].taken.values():
            if module in modules and module not in done:
                visit(module)
        if name not in done:
            done.append(name)

    for name in (*sorted(set(modules) - {entry}), entry):
        visit(name)
    return done


def _bound(nodes):
    """Return the names that statements bind in their own scope."""
    names, waiting = set(), list(nodes)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store | ast.Del):
            names.add(node.id)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
            continue
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(a.asname or a.name).partition(".")[0] for a in node.names}
        elif isinstance(node, ast.ExceptHandler) and node.name:
            names.add(node.name)
        if not isinstance(node, (ast.Lambda, *COMPREHENSIONS)):
            waiting += ast.iter_child_nodes(node)
        else:  # a walrus inside binds outside
            waiting += [n for n in ast.walk(node) if isinstance(n, ast.NamedExpr)]
    return names


def _renamed(module, renamed):
    """Return a module's text without what is dropped, its global names as ``renamed`` says."""
    lines = module.text.split("\n")
    places = []
    for node in module.tree.body:
        _find(node, renamed, frozenset(), places, lines)
    for line, column, old in sorted(set(places), reverse=True):
        before = lines[line - 1].encode()
        head, tail = before[:column], before[column + len(old.encode()) :]
        lines[line - 1] = (head + renamed[old].encode() + tail).decode()
    for first, last in module.dropped:
        lines[first - 1 : last] = [None] * (last - first + 1)
    return re.sub(r"\n{3,}", "\n\n\n", "\n".join(line for line in lines if line is not None))


def _find(node, renamed, hidden, places, lines):
    """Collect (line, byte column, name) of names below a node that mean the module's; ``hidden`` are bound nearer."""
    if isinstance(node, ast.Name) and node.id in renamed and node.id not in hidden:
        places.append((node.lineno, node.col_offset, node.id))
    if isinstance(node, FUNCTIONS):
        arguments = {a.arg for a in ast.walk(node.args) if isinstance(a, ast.arg)}
        body = node.body if isinstance(node.body, list) else [node.body]
        if not isinstance(node, ast.Lambda):
            _definition(node, renamed, hidden, places, lines)
            for part in node.decorator_list:
                _find(part, renamed, hidden, places, lines)
        annotations = [a.annotation for a in ast.walk(node.args) if isinstance(a, ast.arg)]
        for part in filter(None, (*node.args.defaults, *node.args.kw_defaults, *annotations)):
            _find(part, renamed, hidden, places, lines)
        inner = hidden | arguments | (_bound(body) if isinstance(node.body, list) else set())
        for part in body:
            _find(part, renamed, inner, places, lines)
        return
    if isinstance(node, ast.ClassDef):
        _definition(node, renamed, hidden, places, lines)
        for part in (*node.decorator_list, *node.bases):
            _find(part, renamed, hidden, places, lines)
        fields = _bound(node.body)
        for part in node.body:
            method = isinstance(part, ast.FunctionDef)
            _find(part, {k: v for k, v in renamed.items() if k != part.name} if method else renamed,
                  hidden if method else hidden | fields, places, lines)  # fmt: skip
        return
    if isinstance(node, COMPREHENSIONS):
        hidden = hidden | {n.id for g in node.generators for n in ast.walk(g.target) if isinstance(n, ast.Name)}
    for child in ast.iter_child_nodes(node):
        _find(child, renamed, hidden, places, lines)


def _definition(node, renamed, hidden, places, lines):
    """Collect the place of the name that a ``def`` or ``class`` statement gives."""
    if node.name in renamed and node.name not in hidden:
        found = re.search(rf"(def|class)\s+({re.escape(node.name)})\b", lines[node.lineno - 1])
        places.append((node.lineno, len(lines[node.lineno - 1][: found.start(2)].encode()), node.name))
