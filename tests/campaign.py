#!/usr/bin/env python3
"""What may happen to a run, on purpose: kills, stops, interrupts, two runs in one folder, corrupted files, wrong
scenes, meshes and tables, solvers that die or send anything, strangers that connect, and disks that are full.

    tests/campaign.py --program target/release/voidage [--count N | --share 1] [--seed 1]

(it needs the package blake3, for checkpoints that are forged)

prints a table: how often each was tried, and how often the program did what it should. The exit code is 1 if it
once did not.
Nothing may be lost, nothing may go wrong in silence, and nothing may panic.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Callable, Sequence

from blake3 import blake3

BED = Path(__file__).resolve().parent / "cases" / "bed.toml"
#: Checkpoints come often, so that a kill finds one.
OFTEN = ["--set", "output.checkpoint_interval=0.002"]
#: A process that takes longer hangs, s.
LONG = 60.0
#: Header of a frame, and the version that the program speaks.
HEADER = struct.Struct("<QIIQIIQIIdd8Q")
MAGIC = int.from_bytes(b"VOIDAGE.", "little")
PROTOCOL = Path(__file__).resolve().parents[1] / "coupling/remote/src/protocol/header.rs"
VERSION = int(re.findall(r"VERSION: u32 = (\d+);", PROTOCOL.read_text())[0])

#: Bytes of a checkpoint before its checksum.
HEAD = 8 + 4 + 64 + 8 + 8 + 8 + 8

#: Files that are the same, byte for byte, however a run came to its end.
RESULTS = ("series.csv", "averages.csv", "checkpoint.voidage", "grains.pvd")

#: A scene whose grains come from grains.csv and whose mesh comes from mesh.msh.
FILES = """
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 0.01 }
materials.glass = { density = 2500.0, heat_capacity = 840.0 }

[[grains]]
material = "glass"
placement = { csv = { file = "grains.csv" } }

[fluid]
density = 1.2
viscosity = 2e-5
mesh.file = "mesh.msh"
heat = { heat_capacity = 1010.0, conductivity = 0.025, initial_temperature = 290.0 }
boundaries = [{ name = "walls", flow = "no-slip" }, { name = "top", flow = "open", heat = "open" }]
"""


def mesh(n: int = 6, width: float = 0.03) -> str:
    """A square of 2 n^2 triangles as Gmsh writes it, with the boundaries `walls` and `top`."""
    number = lambda i, j: 1 + i + (n + 1) * j
    points = [(i, j) for j in range(n + 1) for i in range(n + 1)]
    top = [(number(i, n), number(i + 1, n)) for i in range(n)]
    walls = [(number(i, 0), number(i + 1, 0)) for i in range(n)]
    walls += [(number(i, j), number(i, j + 1)) for i in (0, n) for j in range(n)]
    squares = [[number(i + a, j + b) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))] for i, j in points if i < n > j]
    cells = [cell for a, b, c, d in squares for cell in ((a, b, c), (a, c, d))]
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat"]
    lines += ["$PhysicalNames", "3", '1 1 "walls"', '1 2 "top"', '2 3 "fluid"', "$EndPhysicalNames"]
    lines += ["$Entities", "0 2 1 0", "1 0 0 0 1 1 0 1 1 0", "2 0 0 0 1 1 0 1 2 0"]
    all_of = len(points)
    lines += ["1 0 0 0 1 1 0 1 3 0", "$EndEntities", "$Nodes", f"1 {all_of} 1 {all_of}", f"2 1 0 {all_of}"]
    lines += [str(k + 1) for k in range(len(points))]
    lines += [f"{width * i / n} {width * j / n} 0" for i, j in points]
    count = len(walls) + len(top) + len(cells)
    lines += ["$EndNodes", "$Elements", f"3 {count} 1 {count}"]
    tag = 0
    for head, nodes in (("1 1 1", walls), ("1 2 1", top), ("2 1 2", cells)):
        lines.append(f"{head} {len(nodes)}")
        for one in nodes:
            tag += 1
            lines.append(" ".join(map(str, (tag, *one))))
    return "\n".join([*lines, "$EndElements", ""])


def table(n: int = 5) -> str:
    """Grains on a lattice, with velocities and temperatures."""
    rows = [f"{0.004 + 0.005 * i},{0.004 + 0.005 * j},0.001,0,-0.01,300" for i in range(n) for j in range(n)]
    return "\n".join(["x,y,r,vx,vy,T", *rows, ""])


def varint(data: bytes | bytearray, at: int) -> tuple[int, int]:
    """The number of variable length at a place, seven bits a byte, and where it ends."""
    value, shift = 0, 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at


class Wrong(Exception):
    """What the program should not have done."""


class Campaign:
    """The program, a folder to work in, and the run that nothing happens to."""

    def __init__(self, program: Path, work: Path, seed: int) -> None:
        self.program, self.work, self.random = program.resolve(), work, random.Random(seed)
        shutil.copy(BED, work / "scene.toml")
        self.ended(self.start("straight", *OFTEN), [0])

    def start(self, out: str, *more: str, limit: int = resource.RLIM_INFINITY) -> subprocess.Popen[str]:
        """A run, which may have so many bytes of memory."""
        command = [str(self.program), "run", "scene.toml", "--quiet", "--threads", "1", "--out", out, *more]
        run = subprocess.Popen(
            command, cwd=self.work, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        resource.prlimit(run.pid, resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
        return run

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

    def same(self, out: str, files: Sequence[str] = RESULTS) -> None:
        """The run has the results of the one that nothing happened to."""
        for name in files:
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
        """Ctrl-C at any moment: the run ends within four seconds, and its rows are all there after a restart."""
        self.signalled(signal.SIGINT)

    def batch_signal(self) -> None:
        """A signal of a batch system at any moment: the run ends within four seconds, and its rows are all there after a
        restart."""
        names = ["USR1", "USR2", "XCPU", "XFSZ", "ALRM", "VTALRM", "PROF", "HUP", "TERM"]
        self.signalled(signal.Signals[f"SIG{self.random.choice(names)}"])

    def signalled(self, sent: signal.Signals) -> None:
        """A run that gets a signal at any moment, and goes on."""
        out = self.folder()
        run = self.start(out, *OFTEN)
        self.wait(0.4)
        run.send_signal(sent)
        asked = time.monotonic()
        # Before it listens a signal ends it.
        self.ended(run, [0, 1, -sent])
        if time.monotonic() - asked > 4.0:
            raise Wrong(f"it answered after {time.monotonic() - asked:.1f} s")
        self.go_on(out, [0, 2])
        rows = (self.work / out / "series.csv").read_text().splitlines()
        if len(rows) != 42:
            raise Wrong(f"{len(rows)} rows")

    def empty_box(self) -> None:
        """A box with or without periodic sides, fluid, sources that begin later and sinks that take the last grain is
        computed to its end."""
        pick = self.random.choice
        axes = pick(["x", "y", "xy", ""])
        sides = ", ".join(f"{axis} = [0.0, {0.1 if axis == 'x' else 0.06}]" for axis in axes)
        start = pick([0.0, 0.0, 0.02, 1.0])
        end = start + pick([0.004, 0.02, 0.1])
        lines = ["gravity = [0.0, %s]" % pick([-9.81, 0.0, -100.0]), "time = { step = 1e-3, end = 0.06 }"]
        lines += [f"periodic = {{ {sides} }}"] if axes else []
        lines += ["materials.m = { density = 2500.0, friction = 0.5, restitution = %s }" % pick([0.0, 0.9])]
        if pick([True, False]):
            lines += ['sinks = [{ name = "out", lower = [0.0, 0.0], upper = [0.1, 0.025] }]']
        if "y" not in axes and pick([True, False]):
            lines += ['walls = [{ name = "floor", from = [0.0, 0.0], to = [0.1, 0.0] }]']
        lines += ["output.energy = true", "[[grains]]", 'material = "m"', "radius = 2e-3"]
        rate = pick([20.0, 400.0])
        lines += [
            'placement = { source = { name = "feed", lower = [0.0, 0.03], upper = [0.1, 0.05], '
            f"start = {start}, end = {end}, rate = {{ grains = {rate} }} }} }}"
        ]
        # A fluid makes room for grains through an open boundary.
        if axes != "xy" and pick([True, False]):
            scheme = pick(["explicit", "henry", "henry-free", "lagged", "anchored", "iterated"])
            lines += ["[coupling]", f'scheme = "{scheme}"', "[fluid]", "density = 1.2", "viscosity = 2e-5"]
            names = {"x": ["left", "right"], "y": ["bottom", "top"]}
            closed = [name for axis in "xy" if axis not in axes for name in names[axis]]
            flow = {name: pick(["slip", "no-slip", "open"]) for name in closed}
            flow[pick(closed)] = "open"
            flows = [f'{{ name = "{name}", flow = "{flow[name]}" }}' for name in closed]
            lines += ["boundaries = [%s]" % ", ".join(flows)]
            every = ", ".join(f'{name} = "{name}"' for name in ("left", "right", "bottom", "top"))
            lines += [
                "mesh.rectangle = { lower = [0.0, 0.0], upper = [0.1, 0.06], size = 8e-3, sides = { %s } }" % every
            ]
        (self.work / "box.toml").write_text("\n".join(lines))
        out = self.folder()
        command = [str(self.program), "run", "box.toml", "--threads", "1", "--quiet", "--out", out]
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        run = subprocess.Popen(command, cwd=self.work, **pipes)  # type: ignore[call-overload]
        # Grains may leave the mesh where no floor holds them, which is said.
        said = self.ended(run, [0, 1])
        if run.returncode == 1 and "outside" not in said and "mesh" not in said:
            raise Wrong(said + "\n".join(lines))

    def wide_disc(self) -> None:
        """A solid disc of many elements that falls in a box moves the fluid no faster than it could be driven, or the
        run says that it does."""
        pick = self.random.choice
        radius = 0.015
        size = 2.0 * radius / self.random.uniform(2.0, 16.0)
        density, viscosity = pick([(1000.0, 1e-3), (1000.0, 1.0), (1.2, 2e-5)])
        heavy = density * pick([0.5, 1.5, 2.5, 10.0])
        law = pick(["dallavalle", "gidaspow", "di-felice", "koch-hill", "tang"])
        sides = 'left = "walls", right = "walls", bottom = "floor", top = "top"'
        lines = [
            "gravity = [0.0, -9.81]",
            "time = { step = %s, end = 0.05 }" % pick([5e-4, 2e-3, 5e-3]),
            f"materials.m = {{ density = {heavy} }}",
            'walls = [{ name = "f", along = "floor" }, { name = "s", along = "walls" }]',
            f'[[grains]]\nmaterial = "m"\nradius = {radius}',
            "placement = { lattice = { lower = [0.005, 0.03], upper = [0.035, 0.06] } }",
            f"[fluid]\ndensity = {density}\nviscosity = {viscosity}",
            f"mesh.rectangle = {{ lower = [0.0, 0.0], upper = [0.04, 0.08], size = {size}, sides = {{ {sides} }} }}",
            'boundaries = [{ name = "walls", flow = "no-slip" }, { name = "floor", flow = "slip" }, '
            '{ name = "top", flow = "open" }]',
            f'[coupling]\ndrag = "{law}"',
        ]
        (self.work / "disc.toml").write_text("\n".join(lines))
        out = self.folder()
        command = [str(self.program), "run", "disc.toml", "--threads", "1", "--quiet", "--out", out]
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        run = subprocess.Popen(command, cwd=self.work, **pipes)  # type: ignore[call-overload]
        said = self.ended(run, [0, 1])
        rows = [row.split(",") for row in (self.work / out / "series.csv").read_text().splitlines()]
        name = "max_fluid_speed_m_per_s"
        if len(rows) < 2 or name not in rows[0]:
            raise Wrong(f"series.csv has {len(rows)} rows, the first is {rows[:1]}")
        fastest = max(float(row[rows[0].index(name)]) for row in rows[1:])
        # A free fall of 0.05 s, with a tenth of the width of the box left beside the disc.
        if run.returncode == 0 and fastest > 10.0 * 9.81 * 0.05 * 4.0:
            raise Wrong(f"{fastest} m/s\n{said}" + "\n".join(lines))

    def fast_motion(self) -> None:
        """What changes faster than the step is said, and what does not is not."""
        frequency = 10.0 ** self.random.uniform(0.0, 5.0)
        motion = f"motion = {{ oscillate = {{ amplitude = [0.0, 1e-4], frequency = {frequency} }} }}"
        text = BED.read_text().replace('name = "bottom"', f'name = "bottom"\n{motion}')
        (self.work / "shaken.toml").write_text(text)
        command = [str(self.program), "check", "shaken.toml"]
        done = subprocess.run(command, cwd=self.work, capture_output=True, text=True, check=False)
        if done.returncode or ("a period takes" in done.stdout) != (frequency > 100.0):
            raise Wrong(f"{frequency} Hz: {done.stdout}{done.stderr}")

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

    def forge_checkpoint(self) -> None:
        """A checkpoint whose checksum is right and whose content is forged is refused, within 4 GiB of memory."""
        data = (self.work / "straight" / "checkpoint.voidage").read_bytes()
        if len(data) < 1000:
            raise Wrong(f"its checkpoint has {len(data)} bytes")
        head, parts = bytearray(data[:HEAD]), data[HEAD + 32 :]
        sizes = struct.unpack_from("<QQ", head, HEAD - 16)
        state, recorder = bytearray(parts[: sizes[0]]), parts[sizes[0] :]
        # The state begins with its time, the number of steps, a mark, the time of the grains and their number; their
        # places and, after the number again, their velocities follow.
        _, mark = varint(state, 8)
        number = mark + 1 + 8
        count, places = varint(state, number)
        way = self.random.randrange(5)
        if way == 0:
            wrong = self.random.choice([b"\0", bytes([1]), b"\xff" * 9 + b"\x01", b"\xff\xff\xff\xff\x0f"])
            state[number:places] = wrong
        elif way == 1:
            column = self.random.choice([places, places + 16 * count + places - number])
            at = column + 8 * self.random.randrange(2 * count)
            state[at : at + 8] = struct.pack("<d", self.random.choice([float("nan"), float("inf"), -float("inf")]))
        elif way == 2:
            struct.pack_into("<d", state, 0, self.random.choice([float("nan"), -1.0, 1e300, float("inf")]))
        elif way == 3:
            del state[self.random.randrange(len(state)) :]
        else:
            state += self.random.randbytes(self.random.randrange(1, 4000))
        struct.pack_into("<QQ", head, HEAD - 16, len(state), len(recorder))
        checksum = blake3(bytes(head) + bytes(state) + recorder).digest()
        (self.work / "forged.voidage").write_bytes(bytes(head) + checksum + bytes(state) + recorder)
        more = ["--restart", "forged.voidage", "--set", "time.end=0.05"]
        run = self.start(self.folder(), *OFTEN, *more, limit=4 * 2**30)
        if not self.ended(run, [2]).strip():
            raise Wrong("it says nothing")

    def mutate_files(self) -> None:
        """A scene is checked or refused, in time, whose mesh or table of grains has a changed number, character or
        line."""
        texts = {"mesh.msh": mesh(), "grains.csv": table()}
        changed = self.random.choice(list(texts))
        texts[changed] = self.mutated(texts[changed])
        for name, text in texts.items():
            (self.work / name).write_text(text)
        self.check(FILES)

    def mutate_scene(self) -> None:
        """A scene with a changed number, character or line is checked or refused, in time."""
        self.check(self.mutated(BED.read_text()))

    def mutated(self, text: str) -> str:
        """A text with one change."""
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
        return text

    def check(self, text: str) -> None:
        """`voidage check` says of a scene in time whether it is good."""
        (self.work / "mutant.toml").write_text(text)
        command = [str(self.program), "check", "mutant.toml"]
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        check = subprocess.Popen(command, cwd=self.work, **pipes)  # type: ignore[call-overload]
        self.ended(check, [0, 2])

    def solver_ends(self) -> None:
        """A fluid solver in a process of its own is killed, stopped or interrupted: the run says so, and can go on from
        its checkpoint."""
        out = self.folder()
        serve = ["--fluid", "serve", "--transport", self.random.choice(["shm", "tcp"]), "--timeout", "1"]
        run = self.start(out, *OFTEN, *serve)
        self.wait(0.4)
        children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
        pids = children.read_text().split() if children.exists() else []
        series = self.work / out / "series.csv"
        under_way = series.exists() and len(series.read_text().splitlines()) > 2
        # A solver that is stopped before its first word has two minutes for it, as those have that compile.
        signals = ["-KILL", "-STOP", "-INT"] if under_way else ["-KILL", "-INT"]
        for pid in pids:
            subprocess.run(["kill", self.random.choice(signals), pid], check=False)
        self.ended(run, [0, 1])
        self.go_on(out, [0, 2])
        # A run that fails leaves a frame of its last step, which the others have not.
        self.same(out, ["series.csv", "averages.csv", "checkpoint.voidage"])

    def attached(self) -> tuple[subprocess.Popen[str], int, str]:
        """A run that waits for its fluid solver at a port."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        out = self.folder()
        run = self.start(out, *OFTEN, "--fluid", f"attach:tcp:127.0.0.1:{port}", "--timeout", "2")
        return run, port, out

    def line(self, run: subprocess.Popen[str], port: int) -> socket.socket:
        """A connection to a run."""
        begun = time.monotonic()
        while time.monotonic() - begun < 20.0:
            try:
                return socket.create_connection(("127.0.0.1", port), timeout=5.0)
            except OSError:
                time.sleep(0.02)
        run.kill()
        run.communicate()
        raise Wrong("it does not listen")

    def stranger(self) -> None:
        """Whoever connects in the place of a fluid solver and sends anything, or nothing, is turned away: the solver
        that comes later is taken, and the results are those of a run that was left alone."""
        run, port, out = self.attached()
        lines = []
        for _ in range(self.random.randrange(1, 4)):
            line = self.line(run, port)
            lines.append(line)
            try:
                line.sendall(self.random.randbytes(self.random.choice([0, 1, 60, 152, 4000])))
                if self.random.random() < 0.5:
                    line.close()
            except OSError:
                pass
        serve = [str(self.program), "serve", "--connect", f"tcp:127.0.0.1:{port}"]
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        solver = subprocess.Popen(serve, **pipes)  # type: ignore[call-overload]
        try:
            self.ended(run, [0])
            self.ended(solver, [0])
        finally:
            solver.kill()
            for line in lines:
                line.close()
        self.same(out)

    def hostile(self) -> None:
        """A fluid solver that identifies itself correctly and then sends wrong messages ends the run with an error."""
        run, port, _ = self.attached()
        welcome = False
        with self.line(run, port) as line:
            try:
                greeting = json.dumps({"solver": "hostile", "protocol": VERSION}).encode()
                line.sendall(self.frame(1, text=len(greeting)) + greeting + bytes(-len(greeting) % 8))
                number, mesh_nodes = 0, 0
                for kind in (1, 2):
                    header = HEADER.unpack(self.read(line, HEADER.size))
                    self.read(line, 8 * header[-1])
                    number, mesh_nodes = header[3], header[11]
                welcome = True
                if self.random.random() < 0.7:
                    line.sendall(self.frame(2, run=number))
                    header = HEADER.unpack(self.read(line, HEADER.size))
                    self.read(line, 8 * header[-1])
                for _ in range(self.random.randrange(1, 5)):
                    line.sendall(self.wrong_frame(number, mesh_nodes))
            except OSError:
                pass
        self.ended(run, [1])
        if not welcome:
            raise Wrong("its greeting was not taken")

    @staticmethod
    def read(line: socket.socket, count: int) -> bytes:
        """So many bytes."""
        data = b""
        while len(data) < count:
            more = line.recv(count - len(data))
            if not more:
                raise ConnectionError
            data += more
        return data

    @staticmethod
    def frame(kind: int, run: int = 0, text: int = 0) -> bytes:
        """The header of a frame with a text of so many bytes only."""
        return HEADER.pack(MAGIC, VERSION, kind, run, 0, 0, 0, 0, 0, 0.0, 0.0, *[0] * 6, text, -(-text // 8))

    def wrong_frame(self, run: int, nodes: int) -> bytes:
        """A frame that looks like an answer to the first step, with something wrong."""
        pick = self.random.choice
        stride = -(-nodes // 8) * 8
        length = pick([0, 1, 5 * stride + 6, 4 * stride + 6, 2**20, 2**40])
        kind, rows = pick([1, 2, 3, 4, 5, 5, 5, 5, 7, 8, 9]), pick([nodes, nodes, 0, nodes + 1, 2**60])
        counts = [rows, pick([stride, stride, 1]), 0, 0, pick([0, 4, 2**31]), 0, pick([0, 0, 8, 2**50]), length]
        step, iteration, scalars = pick([0, 1, 1, 2]), 0, pick([0, 1, 1, 3, 2**32 - 1])
        header = HEADER.pack(MAGIC, VERSION, kind, run, 1, pick([0, 7]), step, iteration, scalars, 0.0, 0.0, *counts)
        value = pick([float("nan"), float("inf"), 1e300, -1e300, 1e150, 1e30])
        return header + struct.pack("<d", value) * min(length, 2**18)

    def full_disk(self) -> None:
        """Where files cannot grow the run says so, and what it wrote can be read."""
        blocks = self.random.randrange(1, 40)
        out = self.folder()
        run_it = f"exec {self.program} run scene.toml --quiet --threads 1 --out {out}"
        ignored = self.random.choice(["trap '' XFSZ; ", ""])
        command = f"{ignored}ulimit -f {blocks}; {run_it}"
        run = subprocess.Popen(
            ["bash", "-c", command], cwd=self.work, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        said = self.ended(run, [0, 1])
        if run.returncode == 1 and "cannot" not in said:
            raise Wrong(said)
        summary = self.work / out / "summary.json"
        if summary.exists():
            json.loads(summary.read_text())

    def table(self, given: int | float) -> tuple[list[tuple[str, int, int]], list[str]]:
        """What was tried, how often (so many times, or as a share of the full campaign), how often all was well; and
        what was wrong."""
        kinds: list[tuple[Callable[[], None], int]] = [
            (self.kill, 84),
            (self.stop, 30),
            (self.interrupt, 30),
            (self.batch_signal, 40),
            (self.empty_box, 200),
            (self.wide_disc, 40),
            (self.fast_motion, 100),
            (self.two_runs, 20),
            (self.solver_ends, 180),
            (self.corrupt_checkpoint, 535),
            (self.forge_checkpoint, 300),
            (self.mutate_scene, 1720),
            (self.mutate_files, 900),
            (self.stranger, 50),
            (self.hostile, 500),
            (self.full_disk, 40),
        ]
        rows, wrong = [], []
        for kind, full in kinds:
            good, count = 0, max(1, round(given * full)) if isinstance(given, float) else given
            for _ in range(count):
                try:
                    kind()
                    good += 1
                except Wrong as error:
                    wrong.append(f"{kind.__name__}: {error}")
                    if kind in (self.mutate_scene, self.mutate_files):
                        wrong.append((self.work / "mutant.toml").read_text())
            rows.append((" ".join((kind.__doc__ or "").split()), count, good))
            print(f"{kind.__name__}: {good} of {count}", file=sys.stderr)
        return rows, wrong


def campaign(program: Path, count: int | float, seed: int) -> tuple[list[tuple[str, int, int]], list[str]]:
    """Tries everything so often, in a folder of its own."""
    with tempfile.TemporaryDirectory() as work:
        return Campaign(program, Path(work), seed).table(count)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--program", type=Path, default=Path("target/release/voidage"))
    parser.add_argument("--count", type=int, help="how often each is tried")
    parser.add_argument("--share", type=float, default=1.0, help="of the full campaign of 4,769 trials")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows, wrong = campaign(given.program, given.count or given.share, given.seed)
    print("| what happens, and what must follow | trials | passed |\n|---|---|---|")
    for what, tried, good in rows:
        print(f"| {what} | {tried} | {good} |")
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
