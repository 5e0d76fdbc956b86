#!/usr/bin/env python3
"""Runs the commands of all pages, as they stand there, each page in a copy of the cases.

  tests/commands.py --program target/release/voidage               all of them: hours
  tests/commands.py --program target/debug/voidage --limit 2       each for two seconds, then Ctrl-C
  tests/commands.py .. --part 1/4                                  the first of four parts of the pages

A command is wrong that ends with another code than 0, or with another than 0 and 1 after Ctrl-C. Exit code 1 if one is.
Left out, and listed: what sets up a machine, and lines with words for the reader to replace (SCENE, DIR, ..).
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Blocks of commands have no language and begin with one of these.
PROGRAMS = ("voidage ", "python3 ", "cases/", "tests/", "cargo ", "pip ")
# They set up a machine, or are the tests themselves.
SETS_UP = ("cargo ", "pip ", "tests/run", "apt-get ")
# A word for the reader to replace.
PLACEHOLDER = re.compile(r"(?<![\w.])(?:[A-Z]{3,}|THAT-MACHINE|ADDRESS)(?![\w])|\.\. |\[-")
# Seconds that a command has to end after Ctrl-C.
PATIENCE = 30.0


@dataclass
class Block:
    """Commands that stand together: later ones may need what earlier ones wrote."""

    page: str
    commands: list[str] = field(default_factory=list)


def blocks(page: str, text: str) -> list[Block]:
    """The blocks of commands of a page, with lines that go on joined and without comments."""
    found = []
    # With their languages, so that the end of one block is not taken for the start of another.
    for language, body in re.findall(r"^```([\w-]*)\n(.*?)^```$", text, re.S | re.M):
        if language or not body.startswith(PROGRAMS):
            continue
        block = Block(page)
        for line in body.replace("\\\n", " ").splitlines():
            command = re.sub(r"\s+#\s.*$", "", line).strip()
            # What is indented explains the line above.
            if command and not line.startswith(" "):
                block.commands.append(re.sub(r"\s{2,}", " ", command))
        found.append(block)
    return found


def files(text: str) -> dict[str, str]:
    """The files that a page shows: blocks whose first line is a comment with a name, `# NAME.py`."""
    shown = re.findall(r"^```python\n(# ([\w-]+\.py)\n.*?)^```", text, re.S | re.M)
    return {name: body for body, name in shown}


def pages() -> list[tuple[str, str]]:
    """All pages of the project with their texts."""
    names = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, check=True, capture_output=True, text=True)
    return [(name, (ROOT / name).read_text()) for name in sorted(names.stdout.split())]


def workplace(folder: Path, program: Path) -> dict[str, str]:
    """A copy of what commands read and write, and the environment that finds the program."""
    names = subprocess.run(["git", "ls-files", "cases", "tests"], cwd=ROOT, check=True, capture_output=True, text=True)
    for name in names.stdout.splitlines():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    path = folder / "bin"
    path.mkdir()
    (path / "voidage").symlink_to(program.resolve())
    # Schemes and solvers in Python run in this interpreter, unless the tests are told another one.
    python = {"VOIDAGE_PYTHON": os.environ.get("VOIDAGE_PYTHON", sys.executable)}
    return {**os.environ, **python, "PATH": f"{path}:{os.environ['PATH']}"}


def run(command: str, folder: Path, environment: dict[str, str], limit: float | None) -> tuple[str, str]:
    """What came of a command, one of `done`, `stopped` and what is wrong; and what it said."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    process = subprocess.Popen(
        ["bash", "-c", command], cwd=folder, env=environment, start_new_session=True, **pipes
    )  # type: ignore[call-overload]
    try:
        said, _ = process.communicate(timeout=limit)
        outcome = "done" if process.returncode == 0 else f"exit code {process.returncode}"
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGINT)
        try:
            said, _ = process.communicate(timeout=PATIENCE)
            # Before it listens the signal ends it.
            good = process.returncode in (0, 1, 130, -signal.SIGINT)
            outcome = "stopped" if good else f"exit code {process.returncode} after Ctrl-C"
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said, _ = process.communicate()
            outcome = f"does not end {PATIENCE:.0f} s after Ctrl-C"
    return ("a panic" if "panicked at" in said else outcome), said


def through(program: Path, limit: float | None, part: tuple[int, int]) -> list[str]:
    """Runs the commands of a part of the pages; what is wrong."""
    index, count = part
    wrong = []
    for page, text in pages()[index - 1 :: count]:
        with tempfile.TemporaryDirectory() as place:
            environment = workplace(Path(place), program)
            for name, body in files(text).items():
                (Path(place) / name).write_text(body)
            for block in blocks(page, text):
                wrong += [f"{page}: {what}" for what in through_block(block, Path(place), environment, limit)]
    return wrong


def through_block(block: Block, folder: Path, environment: dict[str, str], limit: float | None) -> list[str]:
    """Runs the commands of a block; what is wrong."""
    wrong = []
    stopped = not_set_up = False
    for command in block.commands:
        left_out = ""
        if PLACEHOLDER.search(command) or command.startswith(SETS_UP):
            left_out = "left out"
            not_set_up |= command.startswith("pip ")
        elif not_set_up and command.startswith("python3 "):
            left_out = "left out: it needs what was not set up"
        elif stopped and "out/" in command:
            left_out = "left out: it needs what was stopped"
        start = time.monotonic()
        outcome, said = (left_out, "") if left_out else run(command, folder, environment, limit)
        stopped |= outcome == "stopped"
        print(f"{time.monotonic() - start:8.1f} s  {outcome:<10}  {block.page}: {command}", flush=True)
        if not left_out and outcome not in ("done", "stopped"):
            wrong.append(f"{command}: {outcome}\n{said[-2000:]}")
    return wrong


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/voidage")
    parser.add_argument("--limit", type=float, help="seconds after which a command is stopped by Ctrl-C")
    parser.add_argument("--part", default="1/1", help="I/N: part I of N of the pages")
    given = parser.parse_args()
    index, count = (int(number) for number in given.part.split("/"))
    if not 1 <= index <= count:
        parser.error(f"--part {given.part}: parts are 1/{count} to {count}/{count}")
    wrong = through(given.program, given.limit, (index, count))
    print("\n".join(wrong) or "nothing is wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
