"""How trials scale on Dask, what a lost worker costs, and what a second run takes.

    python benchmarks/scale_out.py          # simulates a small data set, about 5 minutes
    python benchmarks/scale_out.py --dataset DATASET --scenario gym --trials 2 --repeats 3

One worker and two on loopback, each with one thread, run the same experiment file from an empty
store, in turns, after a first run that compiles what they need. Others may use the machine
meanwhile: its load is printed, and how many cores' time the workers got (`cores`: their processor
time over the wall time). Where two workers get the time of two cores and one that of one, the ratio
of `throughput` (trials per second) is what a second worker brings. Where they get less, trials per
second of the workers' own processor time (`per core second`) says it: their ratio, times two, is
the gain that two free cores would show.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import yaml

from lcdata.evaluation import dispatch
from lcdata.evaluation.cluster import cluster_executor
from lcdata.evaluation.pool import THREAD_VARIABLES
from lcdata.experiment import load_experiment, run_experiment, status

METHODS = {"methods": ["projection", "plk"]}
STARTS = {"starts": [{"rotation_deg": [1, 3, 5], "translation_m": 0.2}]}


def simulated(folder: Path, pairs: int) -> Path:
    """A data set of simulated pairs; the commands' own output is not of interest."""
    recording, made = folder / "rec", folder / "set"
    for command in (
        f"simulate {recording} --scenario gym --poses {pairs // 2} --pairs 2 --seed 3",
        f"build {recording} -o {made} --no-calibrate",
    ):
        words = [sys.executable, "-m", "lcdata", *command.split()]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    return folder / "set"


def written(
    folder: Path, dataset: dict[str, object], trials: int, store: str, **more: object
) -> Path:
    """The experiment file."""
    path = folder / f"{store}.yaml"
    content = {"datasets": [dataset], "trials": trials, "store": store, **METHODS, **STARTS, **more}
    path.write_text(yaml.safe_dump(content))
    return path


@contextmanager
def workers(count):
    """A cluster of this machine that is warm: every worker has compiled what it needs."""
    import dask
    import distributed

    one = dict.fromkeys(THREAD_VARIABLES, "1")
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "600s"}):
        cluster = distributed.LocalCluster(
            n_workers=count, threads_per_worker=1, dashboard_address=":0", silence_logs=50, env=one
        )
        client = distributed.Client(cluster, set_as_default=False)
        client.wait_for_workers(count, timeout=120)
        try:
            yield cluster.scheduler_address, client
        finally:
            client.close(timeout=10)
            cluster.close(timeout=10)


def processor_seconds():
    return time.process_time()


def used(client):
    """Processor seconds of all workers so far."""
    return sum(client.run(processor_seconds).values())


def timed(path: Path, address: str, client) -> dict[str, float]:
    """Run an experiment on a cluster."""
    cpu, start = used(client), time.monotonic()
    found = run_experiment(load_experiment(path), executor=cluster_executor(address))
    wall = time.monotonic() - start
    trials = sum(len(results.trials) for results in found.values())
    spent = used(client) - cpu
    return {
        "wall": wall,
        "throughput": trials / wall,
        "cores": spent / wall,
        "per_core": trials / spent,
        "trials": trials,
        "failed": sum(len(results.failures) for results in found.values()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--scenario", nargs="*", default=[])
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--methods", nargs="*", default=METHODS["methods"])
    options = parser.parse_args()
    METHODS["methods"] = options.methods
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        dataset = {"path": str((options.dataset or simulated(folder, options.pairs)).resolve())}
        if options.scenario:
            dataset["scenarios"] = options.scenario
        throughput(folder, dataset, options)
        killed(folder, dataset, options)


def throughput(folder, dataset, options):
    print(
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; Dask slices {dispatch.SLICE_S} s"
    )
    rows: dict[int, list[dict[str, float]]] = {1: [], 2: []}
    with workers(1) as (one, client_one), workers(2) as (two, client_two):
        clusters = {1: (one, client_one), 2: (two, client_two)}
        for count, (address, client) in clusters.items():  # kernels are compiled here
            few = [{"rotation_deg": 1, "translation_m": 0.1}]
            timed(written(folder, dataset, 1, f"warm-{count}", starts=few), address, client)
        for repeat in range(options.repeats):
            for count, (address, client) in clusters.items():
                path = written(folder, dataset, options.trials, f"store-{count}-{repeat}")
                row = timed(path, address, client)
                rows[count].append(row)
                print(
                    f"{count} worker{'s' * (count > 1)}: {row['trials']} trials, "
                    f"{row['failed']} failed, wall {row['wall']:.1f} s, "
                    f"{row['throughput']:.2f} trials/s, cores {row['cores']:.2f}, "
                    f"{row['per_core']:.2f} trials per core second, load {os.getloadavg()[0]:.1f}",
                    flush=True,
                )
    for name in ("throughput", "cores", "per_core"):
        middle = {n: statistics.median(row[name] for row in rows[n]) for n in rows}
        print(
            f"median {name}: {middle[1]:.2f} and {middle[2]:.2f}, ratio {middle[2] / middle[1]:.2f}"
        )
    path = written(folder, dataset, options.trials, "store-2-0")
    start = time.monotonic()
    command = [sys.executable, "-m", "lcdata", "experiment", "run", str(path)]
    done = subprocess.run(
        [*command, "--scheduler", "tcp://127.0.0.1:9"], capture_output=True, text=True, check=False
    )
    print(
        f"the same file again (exit code {done.returncode}, no scheduler there): "
        f"{time.monotonic() - start:.1f} s wall"
    )


def killed(folder, dataset, options):
    """One of two workers is killed when half of the trials are there."""
    path = written(folder, dataset, options.trials, "killed")
    with workers(2) as (address, client):
        victim = next(iter(client.run(os.getpid).values()))
        stamps = []

        def progress(_stage, done, total):
            if done >= total / 2 and not stamps:
                stamps.append((done, total))
                os.kill(victim, signal.SIGKILL)

        found = run_experiment(
            load_experiment(path), executor=cluster_executor(address), progress=progress
        )
    (row, *_) = status(load_experiment(path))
    results = next(iter(found.values()))
    print(
        f"a worker killed after {stamps[0][0]} of {stamps[0][1]} trials: {len(results.trials)} "
        f"stored, {len(results.failures)} failed; {row.method} {row.done}/{row.trials}"
    )
    shutil.rmtree(folder / "killed", ignore_errors=True)


if __name__ == "__main__":
    main()
