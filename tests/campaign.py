#!/usr/bin/env python3
"""What may happen to a run, on purpose: kills, stops, interrupts, two runs in one folder, corrupted files, wrong scenes, strangers
that connect, and disks that are full.

    tests/campaign.py --program target/release/voidage [--count 20] [--seed 1]

prints a table: how often each was tried, and how often the program did what it should. The exit code is 1 if it once did not.
Nothing may be lost, nothing may go wrong in silence, and nothing may panic.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Callable

BED = Path(__file__).resolve().parent / "cases" / "bed.toml"
#: Checkpoints come often, so that a kill finds one.
OFTEN = ["--set", "output.checkpoint_interval=0.002"]
#: A process that takes longer hangs, s.
LONG = 60.0


class Wrong(Exception):
    """What the program should not have done."""


class Campaign:
    """The program, a folder to work in, and the run that nothing happens to."""

    def __init__(self, program: Path, work: Path, seed: int) -> None:
        self.program, self.work, self.random = program.resolve(), work, random.Random(seed)
        shutil.copy(BED, work / "scene.toml")
        self.ended(self.start("straight", *OFTEN), [0])

    def start(self, out: str, *more: str, scene: str = "scene.toml") -> subprocess.Popen[str]:
        command = [str(self.program), "run", scene, "--quiet", "--threads", "1", "--out", out, *more]
        return subprocess.Popen(
            command, cwd=self.work, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )

    def ended(self, run: subprocess.Popen[str], allowed: list[int]) -> str:
        """What a run said; it must end in time, with one of these exit codes, and without a panic."""
        try:
            _, said = run.communicate(timeout=LONG)
        except subprocess.TimeoutExpired:
            run.kill()
            run.communicate()
            raise Wrong("it hangs") from None
        if "panicked" in said or run.returncode not in allowed:
            raise Wrong(f"exit code {run.returncode}: {said.strip()[-300:]}")
        return said

    def folder(self) -> str:
        """The name of a folder that is not there."""
        shutil.rmtree(self.work / "out", ignore_errors=True)
        return "out"

    def same(self, out: str) -> None:
        """The run has the results of the one that nothing happened to."""
        for name in ["series.csv", "averages.csv", "checkpoint.voidage", "grains.pvd"]:
            if (self.work / out / name).read_bytes() != (self.work / "straight" / name).read_bytes():
                raise Wrong(f"{name} differs from that of a run that was left alone")

    def wait(self, longest: float) -> None:
        time.sleep(self.random.uniform(0.0, longest))

    def go_on(self, out: str, allowed: list[int]) -> None:
        """Restarts a run from its checkpoint, or starts it again where there is none."""
        checkpoint = self.work / out / "checkpoint.voidage"
        more = ["--restart", str(checkpoint)] if checkpoint.exists() else ["--overwrite"]
        self.ended(self.start(out, *OFTEN, *more), allowed)

    # What may happen.

    def kill(self) -> None:
        """kill -9 at any moment, then a restart: the results are those of a run that was left alone."""
        out = self.folder()
        run = self.start(out, *OFTEN)
        self.wait(0.4)
        run.kill()
        run.communicate()
        # Where it had ended before, nothing is left to do.
        self.go_on(out, [0, 2])
        self.same(out)

    def stop(self) -> None:
        """A run that is stopped and goes on has the results of one that was left alone."""
        out = self.folder()
        run = self.start(out, *OFTEN)
        self.wait(0.3)
        run.send_signal(signal.SIGSTOP)
        self.wait(0.3)
        run.send_signal(signal.SIGCONT)
        self.ended(run, [0])
        self.same(out)

    def interrupt(self) -> None:
        """Ctrl-C at any moment: the run ends within two seconds, and its rows are all there after a restart."""
        out = self.folder()
        run = self.start(out, *OFTEN)
        self.wait(0.4)
        run.send_signal(signal.SIGINT)
        asked = time.monotonic()
        # Before it listens an interrupt ends it by its signal.
        self.ended(run, [0, 1, -signal.SIGINT])
        if time.monotonic() - asked > 4.0:
            raise Wrong(f"it answered after {time.monotonic() - asked:.1f} s")
        self.go_on(out, [0, 2])
        rows = (self.work / out / "series.csv").read_text().splitlines()
        if len(rows) != 42:
            raise Wrong(f"{len(rows)} rows")

    def two_runs(self) -> None:
        """Of two runs in one folder one is refused, and the other has the results of one that was left alone."""
        out = self.folder()
        runs = [self.start(out, *OFTEN)]
        self.wait(0.1)
        runs.append(self.start(out, *OFTEN))
        for run in runs:
            self.ended(run, [0, 2])
        if sorted(run.returncode for run in runs) != [0, 2]:
            raise Wrong(f"exit codes {[run.returncode for run in runs]}")
        self.same(out)

    def corrupt_checkpoint(self) -> None:
        """A checkpoint with a wrong byte, or cut off, is refused."""
        data = bytearray((self.work / "straight" / "checkpoint.voidage").read_bytes())
        if self.random.random() < 0.3:
            data = data[: self.random.randrange(len(data))]
        else:
            at = self.random.randrange(len(data))
            data[at] ^= 1 << self.random.randrange(8)
        (self.work / "bad.voidage").write_bytes(data)
        more = ["--restart", "bad.voidage", "--set", "time.end=0.05"]
        self.ended(self.start(self.folder(), *OFTEN, *more), [2])

    def mutate_scene(self) -> None:
        """A scene with a changed number, character or line is checked or refused, in time."""
        text = BED.read_text()
        lines = text.splitlines()
        way = self.random.randrange(4)
        if way == 0:
            del lines[self.random.randrange(len(lines))]
            text = "\n".join(lines)
        elif way == 1:
            numbers = list(re.finditer(r"-?\d+(\.\d+)?(e-?\d+)?", text))
            number = self.random.choice(numbers)
            value = self.random.choice(["0", "-1", "1e300", "-1e300", "1e-300", "nan", "inf", "3", "1e9", "0.5"])
            text = text[: number.start()] + value + text[number.end() :]
        elif way == 2:
            at = self.random.randrange(len(text))
            text = text[:at] + self.random.choice("ab01[]{}\"=.,\n -") + text[at + 1 :]
        else:
            at = self.random.randrange(len(lines))
            lines.insert(at, self.random.choice(lines))
            text = "\n".join(lines)
        (self.work / "mutant.toml").write_text(text)
        command = [str(self.program), "check", "mutant.toml"]
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        check = subprocess.Popen(command, cwd=self.work, **pipes)  # type: ignore[call-overload]
        self.ended(check, [0, 2])

    def stranger(self) -> None:
        """Whoever connects in the place of a fluid solver and sends anything ends the run with an error."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        run = self.start(self.folder(), "--fluid", f"attach:tcp:127.0.0.1:{port}", "--timeout", "5")
        line = None
        begun = time.monotonic()
        while line is None and time.monotonic() - begun < 20.0:
            try:
                line = socket.create_connection(("127.0.0.1", port), timeout=1.0)
            except OSError:
                time.sleep(0.02)
        if line is None:
            run.kill()
            run.communicate()
            raise Wrong("it does not listen")
        with line:
            try:
                line.sendall(self.random.randbytes(self.random.randrange(1, 4000)))
                self.wait(0.2)
            except OSError:
                pass
        self.ended(run, [1, 2])

    def full_disk(self) -> None:
        """Where files cannot grow the run says so, and what it wrote can be read."""
        blocks = self.random.randrange(1, 40)
        out = self.folder()
        command = f"trap '' XFSZ; ulimit -f {blocks}; exec {self.program} run scene.toml --quiet --threads 1 --out {out}"
        run = subprocess.Popen(
            ["bash", "-c", command], cwd=self.work, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        said = self.ended(run, [0, 1])
        if run.returncode == 1 and "cannot" not in said:
            raise Wrong(said)
        summary = self.work / out / "summary.json"
        if summary.exists():
            json.loads(summary.read_text())

    def table(self, count: int) -> tuple[list[tuple[str, int, int]], list[str]]:
        """What was tried, how often, how often all was well; and what was wrong."""
        kinds: list[Callable[[], None]] = [
            self.kill,
            self.stop,
            self.interrupt,
            self.two_runs,
            self.corrupt_checkpoint,
            self.mutate_scene,
            self.stranger,
            self.full_disk,
        ]
        rows, wrong = [], []
        for kind in kinds:
            good = 0
            for _ in range(count):
                try:
                    kind()
                    good += 1
                except Wrong as error:
                    wrong.append(f"{kind.__name__}: {error}")
                    if kind == self.mutate_scene:
                        wrong.append((self.work / "mutant.toml").read_text())
            rows.append(((kind.__doc__ or "").strip(), count, good))
        return rows, wrong


def campaign(program: Path, count: int, seed: int) -> tuple[list[tuple[str, int, int]], list[str]]:
    """Tries everything so often, in a folder of its own."""
    with tempfile.TemporaryDirectory() as work:
        return Campaign(program, Path(work), seed).table(count)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--program", type=Path, default=Path("target/release/voidage"))
    parser.add_argument("--count", type=int, default=20, help="how often each is tried")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows, wrong = campaign(given.program, given.count, given.seed)
    print("| what happens, and what must follow | tried | as it must be |\n|---|---|---|")
    for what, tried, good in rows:
        print(f"| {what} | {tried} | {good} |")
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
