"""A fluid solver in Python and a run that exchange frames, here mostly in two threads."""

import gc
import itertools
import os
import signal
import subprocess
import sys
import threading
import time

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


def to_step(peer, run_one=False):
    """Answers until the first step, and returns its frame."""
    driver = adapter.Driver(Dummy(), peer.setup)
    while True:
        frame = peer.receive(5.0)
        if frame.kind == "mesh":
            driver.start(frame.mesh(), frame.fields())
            peer.done()
        elif frame.kind == "step":
            return driver, frame


def reply(peer, frame):
    """An answer of zeros to a step."""
    grains = len(frame["radius"])
    answer = peer.solution(grains, "heat_coefficient" in frame)
    answer["velocity"] = answer["pressure_gradient"] = np.zeros((grains, 2))
    answer["temperature"] = np.full(grains, 290.0)
    answer.report(voidage.Report(force=np.zeros(2)))
    return answer


def test_views_of_a_frame_are_read_only_and_keep_its_memory(address):
    run = Run(address, lambda simulation: simulation.run(until=0.006))
    peer = voidage.Peer(address, "test")
    _, frame = to_step(peer)
    position, drag = frame["position"], frame["drag"][::2]
    assert position.shape == (40, 2) and position.base is frame
    assert set(frame.keys()) >= {"position", "radius", "volume", "drag", "mobility", "velocity"}
    with pytest.raises(ValueError, match="read-only"):
        position[0] = 1.0
    with pytest.raises(ValueError):
        position.flags.writeable = True
    with pytest.raises(KeyError, match="no column `pressure` here"):
        frame["pressure"]
    copies = position.copy(), drag.copy()
    for _ in range(5):  # the run writes its next frames; ours must stay where it is
        peer.send(reply(peer, frame))
        del frame
        gc.collect()
        frame = peer.receive(5.0)
        np.testing.assert_array_equal(position, copies[0])
        np.testing.assert_array_equal(drag, copies[1])
    peer.send(reply(peer, frame))
    while frame.kind != "bye":
        frame = peer.receive(5.0)
    del peer
    run.join()
    np.testing.assert_array_equal(position, copies[0])


def test_an_answer_is_sent_whole_and_only_without_views(address):
    run = Run(address, lambda simulation: simulation.step())
    peer = voidage.Peer(address, "test")
    _, frame = to_step(peer)
    answer = peer.solution(40, True)
    answer["velocity"] = np.zeros((40, 2))
    with pytest.raises(ValueError, match="`temperature` of the answer was not written"):
        peer.send(answer)
    for name, value in [("velocity", np.zeros(2)), ("temperature", np.full(40, np.nan))]:
        with pytest.raises(ValueError, match=f"`{name}`"):
            answer[name] = value
    view = answer["temperature"]
    view[:] = 291.0
    answer["pressure_gradient"] = np.zeros((40, 2))
    with pytest.raises(ValueError, match="the report of the answer was not written"):
        peer.send(answer)
    answer.report(voidage.Report(force=np.zeros(2)))
    part = view[3:5]
    del view
    with pytest.raises(BufferError, match="still in use"):
        peer.send(answer)
    del part
    peer.send(answer)
    for use in (lambda: answer["velocity"], lambda: peer.send(answer)):
        with pytest.raises(RuntimeError, match="has been sent"):
            use()
    assert peer.receive(5.0).kind == "bye"
    run.join()
    assert run.error is None


def test_an_answer_that_is_never_sent_harms_nobody(address):
    run = Run(address, lambda simulation: simulation.step())
    peer = voidage.Peer(address, "test")
    _, frame = to_step(peer)
    view = peer.solution(40, True)["velocity"]
    peer.send(reply(peer, frame))
    assert peer.receive(5.0).kind == "bye"
    run.join()
    view[:] = 1.0
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
    _, frame = to_step(peer)
    kept, copies = [], []
    try:
        for _ in range(10):
            kept.append(frame["velocity"])
            copies.append(kept[-1].copy())
            peer.send(reply(peer, frame))
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
