"""Run all measurements one after the other and print their tables: python tests/bench/run_benchmarks.py"""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
RUNS = [
    ["bench_geometry.py"],
    ["bench_render.py"],
    ["bench_repeatability.py"],
    ["bench_calibration.py"],
    ["bench_detectors.py"],
    ["bench_blind.py", "--kind", "none", "--count", "20"],
    ["bench_blind.py", "--kind", "single", "--count", "29"],
    ["bench_blind.py", "--kind", "pair", "--count", "20"],
    ["bench_blind.py", "--kind", "outside", "--count", "20"],
]

if __name__ == "__main__":
    failed = 0
    for script, *arguments in RUNS:
        print(f"\n## {' '.join([script, *arguments])}\n", flush=True)
        failed += subprocess.run([sys.executable, str(HERE / script), *arguments], check=False).returncode != 0
    sys.exit(min(failed, 1))
