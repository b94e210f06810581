"""The table behind docs/benchmarks.md: what was measured, when and where. A benchmark calls ``record``.

docs/benchmarks.csv has a row a figure: ``what``, ``aim``, ``figure``, ``unit``, ``commit``, ``date``, ``machine``,
``command``; all are text. Aims are written there, by hand; an empty figure is one that nobody has measured yet.
"""

import datetime
import os
import platform
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT / "scripts") not in sys.path:
    sys.path.insert(0, str(ROOT / "scripts"))

import pandas as pd

import job

TABLE = ROOT / "docs/benchmarks.csv"
COLUMNS = ["what", "aim", "figure", "unit", "commit", "date", "machine", "command"]
NOT_MEASURED = "not measured"
HEAD = """# Benchmarks

Made by `make bench` from [benchmarks.csv](benchmarks.csv), which holds one row a figure; edit aims there, and nothing here.
`python tests/bench/run_benchmarks.py NAME ...` measures some of it again (without a name all, which takes hours) and
writes this page. Times are wall time unless they say CPU. Other programs may have shared a machine: compare figures of
one row only. `+` after a commit: with changes that were not committed.
"""
GROWTH = "python tests/bench/bench_growth.py"
GROWTH_PICTURE = f"""
## Growth with the number of captures
![CPU time of the plan and of a run, memory of the plan, and results on disk, over the number of captures.](growth.png)

*`{GROWTH}`: one camera, tiny images (64 x 48), a hundredth as many stations as captures, one detector, run to Tables 1 and 2
without a diagnosis. CPU time is that of all processes of a run.*
"""


def read_figures(path):
    """Return the table of figures, all text, empty where nothing is known."""
    return pd.read_csv(path, dtype=str, keep_default_na=False)[COLUMNS]


def upsert(table, rows):
    """Return the table with rows (dicts; no ``aim``: the old one stays) in place of those of equal what and command.

    A row whose command is not known yet, since nobody has measured it, is replaced by what alone; a row without an aim takes
    the first that its figure has in another command's row.
    """
    table = table.copy()
    for row in rows:
        same = (table.what == row["what"]) & table.command.isin([row["command"], ""])
        k = table.index[same][0] if same.any() else len(table)
        aims = table.aim[(table.what == row["what"]) & (table.aim != "")]
        aim = (table.aim[k] if same.any() else "") or next(iter(aims), "")
        table.loc[k] = [{"aim": aim, **row}[column] for column in COLUMNS]
    return table


def page_of(table):
    """Return docs/benchmarks.md as text; machines are told below the table, by a letter."""
    machines = {name: chr(ord("A") + k) for k, name in enumerate(sorted(set(table.machine) - {""}))}
    figures = (table.figure + " " + table.unit).str.strip().where(table.figure != "", NOT_MEASURED)
    shown = pd.DataFrame(
        {
            "what": table.what,
            "aim": table.aim,
            "figure": figures,
            "commit": table.commit,
            "date": table.date,
            "machine": table.machine.map(lambda name: machines.get(name, "")),
            "command": table.command.map(lambda command: f"`{command}`" if command else ""),
        }
    )
    below = "".join(f"- **{letter}**: {name}\n" for name, letter in machines.items())
    grown = GROWTH_PICTURE if table.command.str.startswith(GROWTH).any() else ""
    return f"{HEAD}\n{shown.to_markdown(index=False, disable_numparse=True)}\n\nMachines:\n{below}{grown}"


def write_page(table_path=TABLE):
    """Write the page beside its table, anew."""
    with job.write_atomically(Path(table_path).with_suffix(".md")) as file:
        file.write(page_of(read_figures(table_path)))


def commit_of(project):
    """Return the short hash of a clone's commit, with ``+`` where tracked files differ from it; ``unknown`` outside."""

    def git(*arguments):
        done = subprocess.run(["git", "-C", str(project), *arguments], capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else None

    commit = git("rev-parse", "--short=7", "HEAD")
    if commit is None:
        return "unknown"
    # What is written here changes no figure.
    pages = [":(exclude)docs/benchmarks.csv", ":(exclude)docs/benchmarks.md"]
    return commit + ("+" if git("status", "--porcelain", "--untracked-files=no", "--", ".", *pages) else "")


def this_machine():
    """Return processor, cores and memory of this machine, in words."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").is_file():
        named = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        model = named[0].split(":", 1)[1].strip() if named else model
    gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{model}, {os.cpu_count()} cores, {gib:.0f} GiB"


def command_line():
    """Return how this program was started, as one types it in the project's folder."""
    script = Path(sys.argv[0]).resolve()
    return " ".join(["python", script.relative_to(ROOT).as_posix(), *sys.argv[1:]])


def record(figures, command=None, table_path=TABLE):
    """Put figures into the table and write the page.

    figures  [(what, figure, unit)]; a figure is text, or a number, which is told to two significant digits
    command  what makes them; None: the program that runs
    """
    command = command or command_line()
    stamp = {
        "commit": commit_of(ROOT), "date": datetime.date.today().isoformat(), "machine": this_machine(),
        "command": command,
    }  # fmt: skip
    rows = [{"what": what, "figure": as_text(figure), "unit": unit, **stamp} for what, figure, unit in figures]
    table = upsert(read_figures(table_path), rows)
    with job.write_atomically(table_path) as file:
        table.to_csv(file, index=False, lineterminator="\n")
    write_page(table_path)


def as_text(figure):
    """Return a figure as text; of a float two significant digits, of one from 100 on all before the point."""
    if not isinstance(figure, float):
        return str(figure)
    return f"{figure:.0f}" if abs(figure) >= 100 else f"{float(f'{figure:.2g}'):g}"
