"""Start-up and the main job: `lcdata --help` and `lcdata build recordings/`.

    python benchmarks/command_line.py [--main-job]

Target: `lcdata --help` under 0.4 s; the main job on the sample recordings under 3 minutes on two
cores after installation (first run: kernels are compiled).
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]


def seconds(*arguments: str, cache: str | None = None) -> float:
    environment = {**os.environ, **({"NUMBA_CACHE_DIR": cache} if cache else {})}
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "lcdata", *arguments],
        check=True,
        stdout=subprocess.DEVNULL,
        env=environment,
    )
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--main-job", action="store_true", help="also time the main job")
    arguments = parser.parse_args()
    seconds("--help")
    runs = [seconds("--help") for _ in range(7)]
    print(f"lcdata --help: median {statistics.median(runs):.2f} s (target 0.40 s)")
    if arguments.main_job:
        with tempfile.TemporaryDirectory() as folder:
            cold = seconds("build", str(ROOT / "recordings"), "-o", f"{folder}/a", cache=folder)
            warm = seconds("build", str(ROOT / "recordings"), "-o", f"{folder}/b", cache=folder)
        print(
            f"lcdata build recordings/: {cold:.0f} s with kernels to compile, {warm:.0f} s without "
            f"(target 180 s, {os.cpu_count()} cores)"
        )


if __name__ == "__main__":
    main()
