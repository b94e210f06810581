"""How large the diagnosis is: ``python tests/bench/bench_size.py`` counts its lines and its bounds and records them (record.py)."""

import argparse
import runpy

from record import ROOT, record


def lines_of(project):
    """Return the number of lines of scripts/gap and the diagnose scripts."""
    files = [*(project / "scripts/gap").rglob("*.py"), *(project / "scripts").glob("diagnose_*.py")]
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def bounds_of(project):
    """Return the number of bounds that decide a name or a verdict: all of scripts/gap/bounds.py."""
    return sum(name.isupper() for name in runpy.run_path(str(project / "scripts/gap/bounds.py")))


def main(argv=None):
    """Read the command line, count, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args(argv)
    lines, bounds = lines_of(ROOT), bounds_of(ROOT)
    print(f"scripts/gap and the diagnose scripts: {lines} lines; bounds that decide a name or a verdict: {bounds}")
    record(
        [
            ("lines in scripts/gap and the diagnose scripts", lines, "lines"),
            ("thresholds that decide a name or a verdict", bounds, "bounds"),
        ]
    )


if __name__ == "__main__":
    main()
