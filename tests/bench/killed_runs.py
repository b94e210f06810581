"""Kill a run of the workflow at a moment of one of its stages, and tell what happened when."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field

STAGES = {  # what Snakemake says when one of their jobs begins
    "render": r"Rendering the stations of",
    "expose": r"Exposing the twin of",
    "detect": r"Detecting markers of",
    "diagnose": r"Measuring the plates of|What does the twin of|Detecting in the twin of|Drawing captures of",
    "notebooks": r"Drawing (real|where|how|tables)|Setting Tables|Telling what the",
}
LONGEST_S = 1800


@dataclass
class Watched:
    """A run of Snakemake: its process, what it said so far, and {job: [stage or None, start, end or None]}, seconds."""

    process: subprocess.Popen
    said: list = field(default_factory=list)
    jobs: dict = field(default_factory=dict)

    def follow(self, start):
        """Read what the run says, and note when its jobs begin and end."""
        for line in self.process.stdout:
            now = time.monotonic() - start
            self.said.append(line)
            begins, ends = re.match(r"Job (\d+): (.*)", line), re.match(r"Finished jobid: (\d+)", line)
            if begins:
                stage = next((name for name, words in STAGES.items() if re.search(words, begins[2])), None)
                self.jobs[begins[1]] = [stage, now, None]
            elif ends and ends[1] in self.jobs:
                self.jobs[ends[1]][2] = now

    def begun(self, stage):
        """Return when the jobs of a stage began, in order."""
        return sorted(start for name, start, _ in list(self.jobs.values()) if name == stage)


def watch(project, *arguments):
    """Start snakemake in ``project`` as a process group of its own; return the Watched and the thread that follows it."""
    command = [sys.executable, "-m", "snakemake", *map(str, arguments)]
    process = subprocess.Popen(
        command, cwd=project, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    run = Watched(process)
    thread = threading.Thread(target=run.follow, args=(time.monotonic(),), daemon=True)
    thread.start()
    return run, thread


def finished(project, *arguments):
    """Run snakemake to its end; return the Watched."""
    run, thread = watch(project, *arguments)
    run.process.wait(LONGEST_S)
    thread.join(10)
    return run


def killed(project, arguments, stage, number, delay_s):
    """Start a run and kill all of its processes at once, ``delay_s`` after a stage's job of a ``number`` (from 0) began.

    Returns (Watched, seconds after which it was killed, None where it ended before).
    """
    run, thread = watch(project, *arguments)
    start, at = time.monotonic(), None
    try:
        while run.process.poll() is None and time.monotonic() - start < LONGEST_S:
            begun = run.begun(stage)
            now = time.monotonic() - start
            if len(begun) > number and now >= begun[number] + delay_s:
                at = now
                break
            time.sleep(0.005)
    finally:
        if run.process.poll() is None:
            os.killpg(run.process.pid, signal.SIGKILL)
        run.process.wait()
        thread.join(10)
    return run, at
