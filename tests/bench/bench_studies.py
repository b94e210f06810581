"""How long a study takes: ``python tests/bench/bench_studies.py id_study`` runs it whole by three trackers and records it.

All jobs are done anew, on two cores. CPU time is that of all processes: on a busy machine the clock says more of the others.
"""

import argparse
import resource
import subprocess
import sys
import time

from record import ROOT, record

sys.path[:0] = [str(ROOT / "tests")]

from workflow_runs import detectors

CORES = 2
THREE = {"aruco": {}, "aruco_subpix": {}, "bart": {}}
STUDIES = {
    "id_study": (
        "id study, 2,024 ids in 20 views by three trackers: wall time",
        "id study, 2,024 ids in 20 views by three trackers: CPU time",
    ),
    "poses_study": (
        "pose study, 2,000 poses drawn five times, by three trackers: wall time",
        "pose study, 2,000 poses drawn five times, by three trackers: CPU time",
    ),
}


def seconds_of(study):
    """Run a study; return its wall time and the CPU time of all its processes, seconds."""
    start = time.monotonic()
    arguments = ["--cores", str(CORES), "--quiet", "rules", "--forceall", study, "--config", detectors(**THREE)]
    subprocess.run([sys.executable, "-m", "snakemake", *arguments], cwd=ROOT, check=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.monotonic() - start, used.ru_utime + used.ru_stime


def main():
    """Read the command line, run the study, record its times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=sorted(STUDIES))
    study = parser.parse_args().study
    times = [s / 60 for s in seconds_of(study)]
    record([(what, minutes, "min") for what, minutes in zip(STUDIES[study], times, strict=True)])
    print(f"{study}: {times[0]:.1f} min, {times[1]:.1f} min of CPU time")


if __name__ == "__main__":
    main()
