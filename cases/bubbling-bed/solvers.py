#!/usr/bin/env python3
"""Runs the bed from one checkpoint with several fluid solvers in turn, and prints the time of a step and the share of
the exchange in it.

    python3 cases/bubbling-bed/solvers.py [--fluids rust,serve,fenicsx] [--steps 100] [--rounds 5] [--threads 1]

The program is first built in release. Each solver does the same steps of scene.toml from the same state of a fluidised
bed, in a process of its own, as users start it. Times of phases are medians over the rounds, and ratios are medians of
the quotients of successive runs.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PHASES = ["overlap", "closure", "energy", "flow", "exchange", "transport", "contacts"]
# No files but those of the end.
QUIET = ["output.frame_interval=1000", "output.series_interval=1000"]


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="What the exchange with a fluid solver costs.")
    parser.add_argument("--scene", type=Path, default=ROOT / "cases/bubbling-bed/scene.toml")
    parser.add_argument("--fluids", default="rust,serve,fenicsx", help="the first is compared with")
    parser.add_argument("--transport", default="shm", help="shm or tcp")
    parser.add_argument("--warm", type=float, default=0.3, help="time of the checkpoint, s")
    parser.add_argument("--steps", type=int, default=100, help="steps of a run")
    parser.add_argument("--rounds", type=int, default=5, help="runs of each solver")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--program", type=Path, help="default: built here")
    return parser.parse_args()


def build() -> Path:
    subprocess.run(["cargo", "build", "--release", "--locked", "-q", "-p", "voidage"], cwd=ROOT, check=True)
    return ROOT / "target/release/voidage"


def run(program: Path, given: argparse.Namespace, out: Path, end: float, *more: str) -> dict:
    command = [program, "run", given.scene, "--quiet", "--out", out, "--threads", str(given.threads), *more]
    if "--restart" not in more:
        command.append("--overwrite")
    for change in [f"time.end={end!r}", *QUIET]:
        command += ["--set", change]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))}\n{done.stderr}")
    return json.loads((out / "summary.json").read_text())


def of_a_step(summary: dict) -> dict[str, float]:
    """Milliseconds of each phase, and of all."""
    count = summary["steps_of_this_process"]
    phases = {name: 1e3 * summary["phases_s"][name] / count for name in PHASES}
    return phases | {"total": sum(phases.values())}


def main() -> None:
    given = options()
    program = given.program or build()
    fluids = given.fluids.split(",")
    with tempfile.TemporaryDirectory() as folder:
        warm, out = Path(folder) / "warm", Path(folder) / "out"
        start = run(program, given, warm, given.warm)
        step = start["time_s"] / start["steps"]
        end = start["time_s"] + given.steps * step
        checkpoint = warm / "checkpoint.voidage"
        rounds = []
        for number in range(given.rounds):
            # By turns, and every other round backwards: a machine that grows warm or busy is fair to all.
            order = fluids if number % 2 == 0 else fluids[::-1]
            times = {}
            for fluid in order:
                shutil.rmtree(out, ignore_errors=True)
                shutil.copytree(warm, out)
                way = [] if fluid == "rust" else ["--transport", given.transport]
                more = ["--fluid", fluid, *way, "--restart", str(checkpoint)]
                times[fluid] = of_a_step(run(program, given, out, end, *more))
            rounds.append(times)
            print(f"round {number + 1} of {given.rounds}", flush=True)
    report(given, fluids, rounds)


def report(given: argparse.Namespace, fluids: list[str], rounds: list[dict]) -> None:
    load = os.getloadavg()[0]
    print(f"\nms per step, medians of {len(rounds)} rounds of {given.steps} steps, load of the machine {load:.1f}")
    print(f"{'':<12}" + "".join(f"{name:>11}" for name in [*PHASES, "total"]))
    for fluid in fluids:
        row = [statistics.median(times[fluid][name] for times in rounds) for name in [*PHASES, "total"]]
        print(f"{fluid:<12}" + "".join(f"{value:>11.3f}" for value in row))
    first = fluids[0]
    for fluid in fluids[1:]:
        share = statistics.median(100 * t[fluid]["transport"] / t[fluid]["total"] for t in rounds)
        slower = statistics.median(100 * (t[fluid]["total"] / t[first]["total"] - 1) for t in rounds)
        print(f"{fluid}: transport is {share:.3f} % of a step; a step takes {slower:+.2f} % more than with {first}")


if __name__ == "__main__":
    main()
