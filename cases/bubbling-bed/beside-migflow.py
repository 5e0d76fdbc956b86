#!/usr/bin/env python3
"""Runs MigFlow 1.4.0 on the bed that it ships and voidage on scene-migflow.toml, and prints CPU time per step.

    python3 cases/bubbling-bed/beside-migflow.py [--steps 400] [--warm 300] [--rounds 3] [--work DIR]

MigFlow (GPL; it is run unchanged and nothing of it is copied) is installed with PARDISO into a virtual environment in
DIR. Its shipped case runs with timers around its own calls. Both programs take one thread; steps before --warm are not
counted. The programs run in turn for so many rounds, and the table has medians, because machines are shared.
"""

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ["migflow==1.4.0", "gmsh", "pypardiso", "mkl==2025.2.0"]  # a newer mkl falls back to SuperLU silently
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")}

# Runs inside the virtual environment: wraps the calls of the shipped case, counts steps by its last call of a step.
STOPWATCH = '''
import atexit, json, runpy, sys, time
case, out, result, warm, steps = sys.argv[1:4] + [int(a) for a in sys.argv[4:6]]
from migflow import advdiff, fluid, scontact, time_integration
spent, done, start = {}, 0, None
class Enough(Exception): pass
def watch(owner, name, phase, last=False):
    inner = getattr(owner, name)
    def timed(*a, **k):
        global done, start
        before = time.process_time()
        answer = inner(*a, **k)
        if done >= warm:
            spent[phase] = spent.get(phase, 0.0) + time.process_time() - before
        if last:
            done += 1
            if done == warm: start = time.process_time()
            if done == steps: raise Enough
        return answer
    setattr(owner, name, timed)
watch(fluid.FluidProblem, "set_particles", "overlap")
watch(advdiff.AdvDiffProblem, "set_particles", "overlap")
watch(advdiff.AdvDiffProblem, "implicit_euler", "energy")
watch(fluid.FluidProblem, "implicit_euler", "flow")
watch(fluid.FluidProblem, "write_mig", "output")
watch(scontact.ParticleProblem, "write_mig", "output")
watch(time_integration, "_advance_particles", "contacts", last=True)
sys.argv = [case, out]
try:
    runpy.run_path(case, run_name="__main__")
except Enough:
    pass
total = time.process_time() - start - spent.pop("output", 0.0)
json.dump({"total": total, **spent}, open(result, "w"))
'''


def install(work: Path) -> Path:
    """The interpreter of an environment with MigFlow."""
    python = work / "venv" / "bin" / "python"
    if not python.exists():
        venv.create(work / "venv", with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    return python


def migflow(python: Path, work: Path, warm: int, steps: int) -> dict[str, float]:
    """CPU seconds by phase of the steps after the warm-up."""
    case = next((work / "venv").rglob("2d_bubbling_fluidized_bed.py"))
    (work / "stopwatch.py").write_text(STOPWATCH)
    result = work / "migflow.json"
    arguments = [python, work / "stopwatch.py", case, work / "migflow-out", result, str(warm), str(steps)]
    with open(work / "migflow.log", "w") as log:
        subprocess.run(arguments, check=True, stdout=log, stderr=log, env={**os.environ, **ONE_THREAD})
    return json.loads(result.read_text())


def voidage(work: Path, warm: int, steps: int, first: bool) -> dict[str, float]:
    """The same for voidage: the first time a run to the end of the warm-up, then one restarted from its checkpoint."""
    if first:
        subprocess.run(["cargo", "build", "--release", "--quiet", "--bin", "voidage"], check=True, cwd=ROOT)
    program = ROOT / "target" / "release" / "voidage"
    scene, out = ROOT / "cases" / "bubbling-bed" / "scene-migflow.toml", work / "voidage-out"

    def run(end: int, *more: str) -> None:
        sets = [f"time.end={end * 1e-3}", f"output.checkpoint_interval={warm * 1e-3}"]
        options = [word for text in sets for word in ("--set", text)]
        command = [program, "run", scene, "--quiet", "--threads", "1", "--out", out, *options, *more]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)

    warmed = work / "warm.voidage"
    if first:
        run(warm, "--overwrite")
        shutil.copy(out / "checkpoint.voidage", warmed)
    run(steps, "--restart", str(warmed))
    summary = json.loads((out / "summary.json").read_text())
    phases = summary["phases_s"]
    # Set-up and pictures are no part of a step. Phases are wall time of one thread, never less than its CPU time.
    return {"total": sum(seconds for name, seconds in phases.items() if name not in ("setup", "output")), **phases}


def bed(work: Path, after: float) -> str:
    """What the bed of voidage does after a time, to compare with what MigFlow's is known to do."""
    with open(work / "voidage-out" / "series.csv") as file:
        rows = [row for row in csv.DictReader(file) if float(row["time_s"]) > after]
    drop, height = (
        sum(float(row[key]) for row in rows) / len(rows)
        for key in ("pressure_drop_Pa", "mean_grain_height_m")
    )
    return f"voidage after {after} s: pressure drop {drop:.0f} Pa, mean height {height:.4f} m"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--warm", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "beside-migflow")
    options = parser.parse_args()
    if not 0 < options.warm < options.steps or options.rounds < 1:
        parser.error("--warm must lie between 0 and --steps, and there must be a round")
    options.work.mkdir(parents=True, exist_ok=True)
    python, count = install(options.work), options.steps - options.warm
    phases = ("overlap", "energy", "flow", "contacts", "total")
    rounds = []
    for number in range(options.rounds):
        ours = voidage(options.work, options.warm, options.steps, first=number == 0)
        theirs = migflow(python, options.work, options.warm, options.steps)
        rounds.append([[1e3 * spent[phase] / count for phase in phases] for spent in (theirs, ours)])
        (*_, a), (*_, b) = rounds[-1]
        print(f"round {number + 1}: MigFlow {a:.1f}, voidage {b:.1f}, ratio {a / b:.1f}", flush=True)
    print(f"ms per step, means of {count} steps, medians of the rounds, one thread")
    print(f"{'phase':<10}{'MigFlow':>10}{'voidage':>10}{'ratio':>8}")
    for k, phase in enumerate(phases):
        a, b = (median(of[program][k] for of in rounds) for program in range(2))
        print(f"{phase:<10}{a:>10.1f}{b:>10.1f}{a / b:>8.1f}")
    print(bed(options.work, options.warm * 1e-3))
    return 0


if __name__ == "__main__":
    sys.exit(main())
