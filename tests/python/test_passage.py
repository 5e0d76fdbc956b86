"""Grains that sources let in and sinks take out while a solver in Python has the fluid."""

import numpy as np
import pytest
import voidage
from test_simulation import BED

SCENE = BED.parents[1] / "python" / "scenes" / "passage.toml"
"""Grains that sink between a source and a sink, and others that leave by the open top."""


@pytest.mark.parametrize("name", ["scikit_fem:ScikitFem", "fenicsx:FEniCSx"])
def test_solvers_make_room_for_grains_alike(name):
    module, solver = name.split(":")
    module = pytest.importorskip(f"voidage.{module}", exc_type=ImportError)
    tight = ["fluid.solver.tolerance=1e-13"]
    rust = voidage.Simulation(SCENE, tight)
    python = voidage.Simulation(SCENE, tight, fluid=getattr(module, solver)())
    counts, moved = [], 0
    for _ in range(60):
        reports = [simulation.step() for simulation in (rust, python)]
        counts.append(len(rust.grains["radius"]))
        assert counts[-1] == len(python.grains["radius"])
        came = [report["solid_volume_in"] for report in reports]
        np.testing.assert_allclose(came[1], came[0], rtol=0, atol=1e-12)
        moved += abs(came[0]) > 1e-7
    assert max(counts) > 10 and min(np.diff(counts)) < 0 < max(np.diff(counts))
    assert moved > 20
    for column in rust.fluid:
        scale = abs(rust.fluid[column]).max()
        np.testing.assert_allclose(
            python.fluid[column], rust.fluid[column], rtol=0, atol=1e-6 * scale
        )


def test_a_run_with_sources_goes_on_from_its_checkpoint(tmp_path):
    straight = voidage.Simulation(SCENE)
    straight.run(until=0.06)
    straight.checkpoint(tmp_path / "checkpoint")
    again = voidage.Simulation(SCENE, restart=tmp_path / "checkpoint")
    for simulation in (straight, again):
        simulation.run(until=0.12)
    for name in straight.grains:
        np.testing.assert_array_equal(straight.grains[name], again.grains[name])
    for name in straight.fluid:
        np.testing.assert_array_equal(straight.fluid[name], again.fluid[name])
