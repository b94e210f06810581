"""How large the diagnosis is: ``python tests/bench/bench_size.py`` counts its lines and records them (record.py)."""

from record import ROOT, record


def lines_of(project):
    """Return the number of lines of scripts/gap and the diagnose scripts."""
    files = [*(project / "scripts/gap").rglob("*.py"), *(project / "scripts").glob("diagnose_*.py")]
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


if __name__ == "__main__":
    lines = lines_of(ROOT)
    print(f"scripts/gap and the diagnose scripts: {lines} lines")
    record([("lines in scripts/gap and the diagnose scripts", lines, "lines")])
