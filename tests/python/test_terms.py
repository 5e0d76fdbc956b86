"""Terms that a subclass adds to the weak form, on every solver that is installed."""

import dataclasses
import importlib
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import voidage
from test_pages import PYTHON, blocks
from test_solvers import TRACER, WARM, close, with_scalars
from voidage import interpreter
from voidage.points import complete
from voidage.solver import Condition, Fields, Motion, NoSlip, Open, Outflow, Slip, Step, Velocity

from conftest import SOLVERS, problem, scatter

PACKAGE = Path(voidage.__file__).parents[1]


def tools(module: str):
    """The functions of a solver's language that forms are written with: dot, grad, div."""
    return importlib.import_module("skfem.helpers" if "scikit" in module else "ufl")


@pytest.fixture(params=SOLVERS)
def kind(request):
    """Class, options, and the functions that forms are written with."""
    module, name, options = SOLVERS[request.param]
    pytest.importorskip("skfem" if "scikit" in module else "dolfinx")
    return getattr(importlib.import_module(module), name), options, tools(module)


def accuracy(solver):
    return 1e-6 if close(solver) > 1e-8 else 1e-10


def assert_close(one, other, accuracy):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=accuracy * np.abs(b).max())


def flow_in_a_box(rng, dimension, **changes):
    """A box of random flow with points on a mesh that moves, and its step."""
    box = problem(4, dimension, tolerance=1e-13, **changes)
    old = Fields(rng.standard_normal(box.points.shape), rng.standard_normal(len(box.points)))
    box = dataclasses.replace(box, fields=old)
    jump = 0.01 * rng.standard_normal(box.points.shape)
    points, voidage = scatter(rng, box.points + jump, box.cells)
    conditions = [Condition(name, NoSlip()) for name in box.boundaries]
    conditions[0] = Condition("x0", Velocity(0.3 * np.eye(dimension)[0]))
    conditions[1] = Condition("x1", Open(0.2))
    motion = Motion(box.points + jump, jump / 0.1)
    return box, Step(0.1, conditions, voidage, points, motion=motion)


@pytest.mark.parametrize("newton", [1, 3])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_drag_as_a_term_is_the_drag_of_a_thin_cell(kind, rng, dimension, newton):
    """In the Galerkin terms, in both terms of the stabilisation and in its time."""
    make, options, language = kind
    gamma = 40.0

    class Drag(make):
        def terms(self, flow):
            return gamma * language.dot(flow.u, flow.w)

    box, step = flow_in_a_box(rng, dimension, newton=newton)
    found = []
    for solver, drag in ((Drag(**options), 0.0), (make(**options), gamma), (make(**options), 0.0)):
        solver.set_mesh(dataclasses.replace(box, thin_cell_drag=drag))
        fields = solver.solve(step).fields
        found.append((fields.velocity, fields.pressure))
    assert_close(found[0], found[1], accuracy(solver))
    assert np.abs(found[1][0] - found[2][0]).max() > 0.01


def test_terms_about_the_velocity_of_a_newton_step_converge(kind, rng):
    """A drag c |u|^2 u, linearised by the user; at the end it is what Picard's steps find as well."""
    make, options, language = kind
    c, dot = 30.0, language.dot

    class Newton(make):
        def terms(self, flow):
            u, at, w = flow.u, flow.at, flow.w
            return c * (dot(at, at) * dot(u, w) + 2 * dot(at, u) * dot(at, w))

        def loads(self, flow):
            return 2 * c * dot(flow.at, flow.at) * dot(flow.at, flow.w)

    class Picard(make):
        def terms(self, flow):
            return c * dot(flow.at, flow.at) * dot(flow.u, flow.w)

    # Both have the same time of stabilisation where the accepted state is at rest.
    box, step = flow_in_a_box(rng, 2)
    box = dataclasses.replace(box, fields=Fields(0 * box.fields.velocity, box.fields.pressure))
    found = {}
    for each, steps in ((Newton, 8), (Picard, 60), (Picard, 1)):
        solver = each(**options)
        solver.set_mesh(dataclasses.replace(box, newton=steps))
        fields = solver.solve(step).fields
        found[each, steps] = fields.velocity, fields.pressure
    assert_close(found[Newton, 8], found[Picard, 60], accuracy(solver))
    assert np.abs(found[Picard, 1][0] - found[Picard, 60][0]).max() > 0.01


def test_a_load_is_a_force_per_volume(kind, rng):
    """rho times an acceleration, beside which the fluid has no points."""
    make, options, language = kind
    push = np.array([0.7, -0.4])

    class Pushed(make):
        def loads(self, flow):
            force = flow.problem.density * (1 + flow.x[0])
            return force * (push[0] * flow.w[0] + push[1] * flow.w[1])

    box, step = flow_in_a_box(rng, 2)
    step = dataclasses.replace(step, points=None, voidage=np.ones(len(box.points)), motion=None)
    pushed, plain = Pushed(**options), make(**options)
    pushed.set_mesh(box)
    plain.set_mesh(box)
    force = box.density * np.outer(1 + box.points[:, 0], push)
    sources = dataclasses.replace(complete(box, step).sources, momentum=force)
    one = pushed.solve(step).fields
    other = plain.solve(dataclasses.replace(step, sources=sources)).fields
    assert_close((one.velocity, one.pressure), (other.velocity, other.pressure), accuracy(plain))
    assert np.abs(other.velocity - plain.solve(step).fields.velocity).max() > 1e-3


@pytest.mark.parametrize("form", ["consistent", "lumped", "monotone"])
def test_a_scalar_decays_and_is_fed(kind, rng, form):
    """A uniform scalar follows ds/dt = (fed - rate s) / C; of two the other is left alone."""
    make, options, _ = kind
    rate, fed, dt = 2.0, 700.0, 0.1

    class Decay(make):
        def scalar_terms(self, scalar):
            return rate * scalar.s * scalar.w if scalar.k == 0 else None

        def scalar_loads(self, scalar):
            return fed * scalar.w if scalar.k == 0 else None

    box = problem(4, 2, tolerance=1e-13)
    stream = np.tile([0.3, 0.1], (len(box.points), 1))
    box = dataclasses.replace(box, fields=Fields(stream, box.fields.pressure))
    start = np.full(len(box.points), 300.0)
    scalars = [dataclasses.replace(each, form=form) for each in (WARM, TRACER)]
    solver = Decay(**options)
    solver.set_mesh(with_scalars(box, scalars, [start, start]))
    now = (WARM.capacity / dt * 300 + fed) / (WARM.capacity / dt + rate)
    conditions = [
        Condition(name, Velocity(stream), (Outflow(now), Outflow(300.0))) for name in box.boundaries
    ]
    fields = solver.solve(Step(dt, conditions, np.ones(len(start)))).fields
    np.testing.assert_allclose(fields.scalars[0], now, rtol=accuracy(solver))
    np.testing.assert_allclose(fields.scalars[1], 300.0, rtol=accuracy(solver))


def test_a_constant_of_fenicsx_changes_from_step_to_step(rng):
    """Made in ``terms``, which is called once for a mesh, and filled in ``solve``."""
    pytest.importorskip("dolfinx")
    import ufl
    from voidage.fenicsx import FEniCSx, fem

    class Switched(FEniCSx):
        def terms(self, flow):
            self.drag = fem.Constant(self.layout.domain, 0.0)
            return self.drag * ufl.dot(flow.u, flow.w)

        def solve(self, step):
            self.drag.value = 40.0 if step.dt > 0.05 else 0.0
            return super().solve(step)

    box, step = flow_in_a_box(rng, 2)
    step = dataclasses.replace(step, motion=None)
    switched = Switched()
    switched.set_mesh(box)
    for dt, drag in ((0.1, 40.0), (0.01, 0.0), (0.1, 40.0)):
        step, plain = dataclasses.replace(step, dt=dt), FEniCSx()
        plain.set_mesh(dataclasses.replace(box, thin_cell_drag=drag))
        one, other = switched.solve(step).fields, plain.solve(step).fields
        assert_close((one.velocity, one.pressure), (other.velocity, other.pressure), 1e-10)


SLAB = """
gravity = [0.0, 0.0]
time = { step = 1e-2, end = 0.05 }

[fluid]
density = 1.2
viscosity = 2e-5
boundaries = [
    { name = "sides", flow = "slip" },
    { name = "floor", flow = { velocity = [0.0, 0.5] } },
    { name = "top", flow = "open" },
]
mesh.rectangle.lower = [0.0, 0.0]
mesh.rectangle.upper = [0.04, 0.1]
mesh.rectangle.structured.squares = [4, 10]
mesh.rectangle.sides = { left = "sides", right = "sides", bottom = "floor", top = "top" }
"""


def page_block(name: str) -> str:
    """The class that the page shows for a solver."""
    (source,) = (block for block in blocks(PYTHON) if block.startswith(f"# porous_{name}.py"))
    return source


@pytest.mark.parametrize(("name", "needs"), [("fenicsx", "dolfinx"), ("scikit", "skfem")])
def test_the_slab_of_the_page_has_the_pressure_drop_of_darcy(tmp_path, name, needs):
    pytest.importorskip(needs)
    source = page_block(name)
    assert len(source.splitlines()) <= 15
    scene, names = tmp_path / "slab.toml", {}
    scene.write_text(SLAB)
    exec(source, names)
    simulation = voidage.Simulation(scene, fluid=names["Porous"]())
    simulation.run()
    pressure, height = simulation.fluid["pressure"], 0.02
    darcy = 2e-5 / names["PERMEABILITY"] * 0.5 * height
    assert np.ptp(pressure) == pytest.approx(darcy, rel=1e-10)
    np.testing.assert_allclose(simulation.fluid["velocity"], [[0.0, 0.5]] * len(pressure), atol=1e-10)


@pytest.mark.parametrize("permeability", [1e-10, 1e-13])
def test_a_dense_slab_between_the_nodes_holds_as_much_as_its_cells(kind, permeability):
    """Without the drag in the stabilisation time the drop is off by up to two orders of magnitude."""
    make, options, language = kind
    if options:
        pytest.skip("what is off is not the solver of the linear systems")

    class Slab(make):
        def terms(self, flow):
            y, drag = flow.x[1], flow.problem.viscosity / permeability
            inside = (y > 0.43) & (y < 0.63) if make.__name__ == "ScikitFem" else within(y)
            return inside * drag * language.dot(flow.u, flow.w)

    def within(y):
        return language.conditional(language.And(y > 0.43, y < 0.63), 1.0, 0.0)

    box = problem(10, 2, tolerance=1e-12)
    stream = np.tile([0.0, 0.5], (len(box.points), 1))
    box = dataclasses.replace(box, fields=Fields(stream, box.fields.pressure))
    conditions = [Condition("x0", Slip()), Condition("x1", Slip())]
    conditions += [Condition("y0", Velocity(stream)), Condition("y1", Open(0.0))]
    solver = Slab(**options)
    solver.set_mesh(box)
    for _ in range(2):
        pressure = solver.solve(Step(0.01, conditions, np.ones(len(stream)))).fields.pressure
        solver.accept()
    darcy = box.viscosity / permeability * 0.5 * 0.2
    assert pressure[np.unique(box.boundaries["y0"])].mean() == pytest.approx(darcy, rel=0.1)

def run_slab(program, folder, **changes):
    """The program with the slab of the page in FEniCSx, started with this interpreter by default."""
    (folder / "slab.toml").write_text(SLAB)
    (folder / "porous_fenicsx.py").write_text(page_block("fenicsx"))
    command = [program, "run", "slab.toml", "--quiet", "--out", "out", "--fluid", "python:porous_fenicsx.py"]
    env = os.environ | {"VOIDAGE_PYTHON": sys.executable, "VOIDAGE_PYTHONPATH": str(PACKAGE)} | changes
    command += ["--set", 'output.pressure_drop={from="floor",to="top"}']
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)


def test_a_file_that_needs_fenicsx_goes_on_in_the_python_that_has_it(program, tmp_path):
    """From any interpreter; that of Debian is where FEniCSx is if it is not here."""
    if importlib.util.find_spec("dolfinx") is None and not interpreter.has_fenicsx("/usr/bin/python3"):
        pytest.skip("there is no FEniCSx")
    done = run_slab(program, tmp_path)
    assert done.returncode == 0, done.stderr
    header, *rows = (tmp_path / "out" / "series.csv").read_text().splitlines()
    drop = float(rows[-1].split(",")[header.split(",").index("pressure_drop_Pa")])
    assert drop == pytest.approx(20.0, rel=1e-10)


def test_where_no_python_has_fenicsx_the_variable_is_named(tmp_path):
    if importlib.util.find_spec("dolfinx") is not None:
        pytest.skip("this interpreter has it")
    for source in ("import petsc4py", "from voidage.fenicsx import FEniCSx"):
        (tmp_path / "needs.py").write_text(source + "\n")
        command = [sys.executable, "-m", "voidage.adapter", "needs.py", "--connect", "tcp:127.0.0.1:1"]
        for other in ([], ["--or-python", "/no/python"], ["--or-python", sys.executable]):
            env = os.environ | {"PYTHONPATH": str(PACKAGE)}
            done = subprocess.run(
                [*command, *other], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
            )
            assert done.returncode == 1
            assert "No module named 'petsc4py'" in done.stderr
            assert done.stderr.count("VOIDAGE_PYTHON") == 1
            assert sys.executable in done.stderr
