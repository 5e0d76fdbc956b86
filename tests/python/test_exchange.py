"""A fluid solver in Python and a run that exchange frames, here mostly in two threads."""

import gc
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import voidage
from test_simulation import BED, OF_THE_LAST_STEP, ROOT, assert_same
from voidage import adapter
from voidage.dummy import Dummy

CAVITY = ROOT / "cases" / "cavity" / "scene.toml"
numbers = itertools.count()


@pytest.fixture(params=["shm", "tcp"])
def address(request):
    if request.param == "shm":
        return f"shm:test-{os.getpid()}-{next(numbers)}"
    return f"tcp:127.0.0.1:{20000 + os.getpid() % 20000 + next(numbers)}"


class Run:
    """A simulation with its fluid at an address, in a thread of its own."""

    def __init__(self, address, work, scene=BED):
        self.result, self.error = None, None
        self.thread = threading.Thread(target=self._run, args=(address, work, scene))
        self.thread.start()

    def _run(self, address, work, scene):
        try:
            simulation = voidage.Simulation(scene, fluid=f"attach:{address}")
            self.result = work(simulation)
        except Exception as error:
            # The traceback would keep the simulation, and the run would not say goodbye.
            self.error = error.with_traceback(None)

    def join(self):
        self.thread.join(20)
        assert not self.thread.is_alive()
        return self.result


def three_steps(simulation):
    simulation.run(until=0.003)
    return [dict(simulation.grains), dict(simulation.fluid)]


def test_a_solver_elsewhere_equals_one_in_the_process(address):
    run = Run(address, three_steps)
    adapter.serve(Dummy, address)
    grains, fluid = run.join()
    here = voidage.Simulation(BED, fluid=Dummy())
    here.run(until=0.003)
    for columns, others in [(here.grains, grains), (here.fluid, fluid)]:
        for name in columns:
            assert columns[name].tobytes() == others[name].tobytes(), name


def test_a_scene_without_grains(address):
    def work(simulation):
        simulation.step()
        return dict(simulation.fluid)

    run = Run(address, work, CAVITY)
    adapter.serve(Dummy, address)
    here = work(voidage.Simulation(CAVITY, fluid=Dummy()))
    there = run.join()
    assert here.keys() == there.keys() == {"velocity", "pressure"}
    for name in here:
        np.testing.assert_array_equal(there[name], here[name])


def test_a_restart_gives_the_solver_a_state(address, tmp_path):
    def work(simulation):
        simulation.run(until=0.002)
        simulation.checkpoint(tmp_path / "two.voidage")  # tells the solver to start anew from here
        return simulation.run(until=0.003)

    run = Run(address, work)
    adapter.serve(Dummy, address)
    assert run.join()["momentum_exchange_defect"] < 1e-12


def to_step(peer):
    """Answers until the first step, and returns its frame and a driver of a dummy."""
    driver = adapter.Driver(Dummy(), peer.setup)
    while True:
        frame = peer.receive(5.0)
        if frame.kind == "mesh":
            driver.start(frame.mesh(), frame.fields())
            peer.done()
        elif frame.kind == "step":
            return driver, frame


def reply(driver, peer, frame):
    """An answer to a step."""
    columns = frame.dt, frame.text, frame.points(), frame.voidage(), frame.motion()
    peer.send(driver.solve(*columns))


def test_views_of_a_frame_are_read_only_and_keep_its_memory(address):
    run = Run(address, lambda simulation: simulation.run(until=0.006))
    peer = voidage.Peer(address, "test")
    driver, frame = to_step(peer)
    points = frame.points()
    velocity, drag = points["velocity"], points["drag"][::2]
    count = len(points["cell"])
    assert count >= 40 and velocity.shape == (count, 2) and velocity.base is not None
    names = {"cell", "shape", "volume", "drag", "mobility", "velocity"}
    assert points.keys() == names | {"flux_mobility", "flux_velocity", "scalars"}
    assert points["shape"].shape == (count, 3) and points["cell"].dtype.kind == "i"
    assert [len(column) for column in points["scalars"][0]] == [count] * 3
    with pytest.raises(ValueError, match="read-only"):
        velocity[0] = 1.0
    with pytest.raises(ValueError):
        velocity.flags.writeable = True
    copies = velocity.copy(), drag.copy()
    del points
    for _ in range(5):  # the run writes its next frames; ours must stay where it is
        reply(driver, peer, frame)
        del frame
        gc.collect()
        frame = peer.receive(5.0)
        np.testing.assert_array_equal(velocity, copies[0])
        np.testing.assert_array_equal(drag, copies[1])
    reply(driver, peer, frame)
    while frame.kind != "bye":
        frame = peer.receive(5.0)
    del peer
    run.join()
    np.testing.assert_array_equal(velocity, copies[0])


def changed(solution, **fields):
    """The solution with other fields."""
    return replace(solution, fields=replace(solution.fields, **fields))


def test_a_solution_is_checked_before_it_is_sent(address):
    run = Run(address, lambda simulation: simulation.step())
    peer = voidage.Peer(address, "test")
    driver, frame = to_step(peer)
    columns = frame.dt, frame.text, frame.points(), frame.voidage(), frame.motion()
    solution = driver.solve(*columns)
    nan = np.full_like(solution.fields.pressure, np.nan)
    wrong = {"velocity": np.zeros(2), "pressure": nan, "scalars": ()}
    for name, value in wrong.items():
        with pytest.raises(ValueError):
            peer.send(changed(solution, **{name: value}))
    peer.send(solution)
    assert peer.receive(5.0).kind == "bye"
    run.join()
    assert run.error is None


def test_balances_reach_the_run(address):
    class Balanced(Dummy):
        def solve(self, step):
            solution = super().solve(step)
            found = {
                condition.boundary: voidage.Balance(
                    k, np.array([1.0, k]), np.array([4.0 * k]), (2.0 * k,), (3.0 * k,)
                )
                for k, condition in enumerate(step.conditions)
            }
            return replace(solution, balances=dict(reversed(found.items())))

    run = Run(address, lambda simulation: simulation.step())
    adapter.serve(Balanced, address)
    run.join()
    assert run.error is None


def test_what_a_solver_raises_reaches_the_run(address):
    class Broken(Dummy):
        def solve(self, step):
            raise ArithmeticError("the matrix is singular")

    run = Run(address, lambda simulation: simulation.step())
    adapter.serve(Broken, address)
    run.join()
    assert isinstance(run.error, RuntimeError)
    for text in ("step 1", "Broken", "ArithmeticError: the matrix is singular", "in solve"):
        assert text in str(run.error)


def test_a_run_that_goes_away_ends_the_solver(address):
    run = Run(address, lambda simulation: None)
    adapter.serve(Dummy, address)  # returns at the goodbye
    run.join()


def test_nobody_at_the_address():
    start = time.monotonic()
    with pytest.raises(RuntimeError, match="no run listens at shm:nobody"):
        voidage.Peer("shm:nobody", "test", wait=0.2)
    assert time.monotonic() - start < 5
    with pytest.raises(ValueError, match="is no address"):
        voidage.Peer("nobody", "test")


def test_waiting_lets_other_threads_go_on_and_sees_signals():
    counter = itertools.count()
    stop = threading.Event()

    def count():
        while not stop.is_set():
            next(counter)

    thread = threading.Thread(target=count)
    thread.start()
    # Ignored by those that are started in the background of a shell.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        voidage.Peer("shm:nobody-either", "test", wait=30.0)
    assert time.monotonic() - start < 10
    signal.signal(signal.SIGINT, before)
    stop.set()
    thread.join()
    assert next(counter) > 1000


def test_the_process_of_a_solver(program, tmp_path):
    """`voidage run --fluid attach:..` and `python -m voidage.adapter` with a file and an option."""
    (tmp_path / "mine.py").write_text(
        "from voidage.dummy import Dummy\n\n"
        "class Mine(Dummy):\n"
        "    def __init__(self, factor, name):\n"
        "        assert factor == 2.5 and name == 'x'\n"
    )
    address = f"shm:test-{os.getpid()}-process"
    run = subprocess.Popen(
        [program, "run", BED, "--quiet", "--out", tmp_path / "out", "--fluid", f"attach:{address}"]
    )
    command = [sys.executable, "-m", "voidage.adapter", tmp_path / "mine.py", "--connect", address]
    subprocess.run([*command, "--option", "factor=2.5", "--option", "name=x"], check=True)
    assert run.wait(20) == 0
    there = voidage.Simulation(BED, restart=tmp_path / "out" / "checkpoint.voidage", fluid=Dummy())
    here = voidage.Simulation(BED, fluid=Dummy())
    here.run()
    assert_same(there, here, OF_THE_LAST_STEP)


def test_a_run_that_is_killed_in_a_long_solve_ends_the_solver(address, program, tmp_path):
    (tmp_path / "slow.py").write_text(
        "import sys, time\n"
        "from voidage.dummy import Dummy\n\n"
        "class Slow(Dummy):\n"
        "    def solve(self, step):\n"
        "        print('solving', file=sys.stderr, flush=True)\n"
        "        time.sleep(60)\n"
        "        return super().solve(step)\n"
    )
    out = ["--quiet", "--out", tmp_path / "out"]
    run = subprocess.Popen([program, "run", BED, *out, "--fluid", f"attach:{address}"])
    command = [sys.executable, "-m", "voidage.adapter", tmp_path / "slow.py", "--connect", address]
    solver = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert solver.stderr.readline() == "solving\n"
    run.kill()
    start = time.monotonic()
    assert solver.wait(20) == 1 and time.monotonic() - start < 2
    assert "the run is gone" in solver.stderr.read()
    run.wait()


def test_frames_that_are_kept_for_long(address):
    """More of them than there is room for are an error here, and end the run; nothing is overwritten."""
    run = Run(address, lambda simulation: simulation.run(until=0.02))
    peer = voidage.Peer(address, "test")
    driver, frame = to_step(peer)
    kept, copies = [], []
    try:
        for _ in range(10):
            kept.append(frame.points()["velocity"])
            copies.append(kept[-1].copy())
            reply(driver, peer, frame)
            frame = peer.receive(5.0)
    except RuntimeError as error:
        assert "cannot receive" in str(error)
    for view, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(view, copy)
    assert len(kept) == 10 or address.startswith("shm") and len(kept) >= 3
    del peer
    run.join()
    assert "gone" in str(run.error)


def test_the_command_line_names_what_is_wrong(tmp_path):
    command = [sys.executable, "-m", "voidage.adapter"]
    done = subprocess.run(
        [*command, "voidage.dummy", "--connect", "shm:nobody", "--wait", "0.1"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1 and "no run listens" in done.stderr
    (tmp_path / "two.py").write_text(
        "class A:\n    def solve(self): 0\nclass B:\n    def solve(self): 0\n"
    )
    with pytest.raises(ValueError, match="one class.*A, B"):
        adapter.find(str(tmp_path / "two.py"))
    assert adapter.find(f"{tmp_path / 'two.py'}:A").__name__ == "A"
    assert adapter.find("voidage.dummy") is Dummy
