"""Photographs of boards: ``python tests/bench/bench_photographs.py [jpeg | time]``; without a name both.

jpeg  qualities laid on photographs of ../shared/real by the generator, against those that their pixels show
time  15 photographs of 1 and of 12 megapixels, of one set of ../shared/real enlarged: ``snakemake diagnose``, two cores
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2
import numpy as np
import pandas as pd

from effects import library
from generator import nominal
from generator.photographs import Retaken
from inputs.campaign import load_campaign
from record import record
from trials.real_trials import red_first, sources_in

REAL = ROOT.parent / "shared/real"
COMMAND = "python tests/bench/bench_photographs.py"
QUALITIES = (30, 50, 70, 85)
PHOTOGRAPHS = 3  # of each set
ENLARGED, NUMBER = "chess_studio_control", 15
TIMES = {  # figures of so many megapixels: time and memory
    1: (
        "15 photographs of a board, 1 megapixel: diagnosis",
        "15 photographs of a board, 1 megapixel: largest memory of a job",
    ),
    12: (
        "15 photographs of a board, 12 megapixels: diagnosis",
        "15 photographs of a board, 12 megapixels: largest memory of a job",
    ),
}


def jpeg():
    """Print and record how far off the qualities are that pixels show."""
    off, silent, rows = [], 0, []
    for source in sources_in(REAL)[0]:
        camera = nominal.Camera(source.camera, *source.size, float(max(source.size)))
        for row in source.captures[:PHOTOGRAPHS]:
            image = red_first(source.folder / row["image"])
            for quality in QUALITIES:
                laid = {"jpeg_compression": {"quality": quality, "subsampling": "4:2:0"}}
                again = Retaken(camera, laid, f"{source.folder.name}/{quality}").photograph(image, row["capture"])
                seen = library.starts_seen(again).get("jpeg_compression")
                silent += seen is None
                if seen:
                    off.append(abs(100 - seen["loss"] - quality))
                rows.append((source.folder.name, quality, 100 - seen["loss"] if seen else np.nan))
    table = pd.DataFrame(rows, columns=["set", "laid", "seen"])
    print(table.groupby(["set", "laid"]).seen.agg(["min", "max", "count"]).to_string())
    print(f"at most {max(off):.0f} off in {len(off)} photographs; {silent} show no steps: finer than the noise")
    record(
        [
            (
                "JPEG laid on at 30, 50, 70, 85: quality found from pixels, the farthest off",
                f"{max(off):.0f}",
                f"in {len(off)} photographs, {silent} said nothing",
            )
        ],
        f"{COMMAND} jpeg",
    )


def enlarged(folder, megapixels):
    """Write a campaign of NUMBER photographs of a set, scaled to so many megapixels, to a folder."""
    campaign = load_campaign(REAL / ENLARGED)
    (camera,) = campaign.file.cameras
    size = campaign.file.cameras[camera]
    scale = np.sqrt(megapixels * 1e6 / (size.width * size.height))
    width, height = round(size.width * scale), round(size.height * scale)
    rows = campaign.captures.sort_values("capture").head(NUMBER)
    for row in rows.itertuples():
        image = cv2.imread(str(REAL / ENLARGED / row.image))
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{row.capture}.png"), image)
    text = (REAL / ENLARGED / "campaign.yaml").read_text()
    for key, value in (("width", width), ("height", height), ("name", f"enlarged_{megapixels}")):
        text = re.sub(rf"^(\s*){key}:.*$", rf"\g<1>{key}: {value}", text, count=1, flags=re.M)
    (folder / "campaign.yaml").write_text(text)
    lines = [f"{row.capture},{camera},{row.capture}.png" for row in rows.itertuples()]
    (folder / "captures.csv").write_text("\n".join(["capture,camera,image", *lines]) + "\n")


def run_time():
    """Print and record how long the diagnosis of NUMBER photographs takes, and its largest memory."""
    for megapixels, (of_time, of_memory) in TIMES.items():
        results = ROOT / f"results/enlarged_{megapixels}"
        shutil.rmtree(results, ignore_errors=True)
        with tempfile.TemporaryDirectory() as folder:
            enlarged(Path(folder), megapixels)
            command = [sys.executable, "-m", "snakemake", "--cores", "2", "diagnose", "--quiet", "all", "--config"]
            start = time.perf_counter()
            subprocess.run([*command, f"campaign={folder}"], cwd=ROOT, check=True, env=os.environ)
            minutes = (time.perf_counter() - start) / 60
        logs = [pd.read_csv(p, sep="\t") for p in results.glob("benchmarks/**/*.tsv")]
        gib = max(log.max_rss.max() for log in logs) / 1024
        print(f"{megapixels} megapixels: {minutes:.1f} min, {gib:.2f} GiB")
        shutil.rmtree(results, ignore_errors=True)
        record([(of_time, f"{minutes:.1f}", "min"), (of_memory, f"{gib:.2f}", "GiB")], f"{COMMAND} time")


BENCHES = {"jpeg": jpeg, "time": run_time}


def main(argv=None):
    """Read the command line and run what is named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*BENCHES, []], metavar="NAME", help=", ".join(BENCHES))
    names = parser.parse_args(argv).names or BENCHES
    if not REAL.is_dir():
        raise SystemExit(f"needs the photographs of {REAL}")
    for name in names:
        BENCHES[name]()


if __name__ == "__main__":
    main()
