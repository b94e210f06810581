"""Run all measurements one after the other and print their tables: python tests/bench/run_benchmarks.py"""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
RUNS = [
    ["bench_geometry.py"],
    ["bench_render.py"],
    ["bench_repeatability.py"],
    ["bench_diagnose.py"],
    ["bench_calibration.py"],
    ["bench_detectors.py"],
    ["bench_moving.py"],
]
BLIND_TRIALS = [
    *("-m", "snakemake", "--quiet", "all", "--cores", "2", "blind_trials"),
    *("--config", "blind_trials={single: 174, pair: 60, none: 100, outside: 60, power: 87}"),
]

if __name__ == "__main__":
    failed = 0
    for script, *arguments in RUNS:
        print(f"\n## {' '.join([script, *arguments])}\n", flush=True)
        failed += subprocess.run([sys.executable, str(HERE / script), *arguments], check=False).returncode != 0
    print("\n## snakemake blind_trials\n", flush=True)
    failed += subprocess.run([sys.executable, *BLIND_TRIALS], cwd=HERE.parents[1], check=False).returncode != 0
    print((HERE.parents[1] / "results/blind_trials/summary.md").read_text())
    sys.exit(min(failed, 1))
