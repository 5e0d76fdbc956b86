"""Coupling schemes written in Python."""

import numpy as np
import pytest
import voidage
from test_simulation import BED, assert_same
from voidage.dummy import Dummy


class Henry:
    """The predicted velocity with the contact force of the last step, as the built-in `henry`."""

    def predict(self, system, dt):
        grains, load = system.grains, system.load
        mass, inertia = grains["mass"], grains["mass"] / dt
        mobility = 1 / (inertia + load["drag"])
        total = grains["velocity"] * inertia[:, None] + system.gravity * mass[:, None]
        load["mobility"] = mobility
        load["velocity"] = (total + grains["contact_force"]) * mobility[:, None]
        inertia = grains["heat_capacity"] / dt
        mobility = 1 / (inertia + load["heat_coefficient"])
        load["heat_mobility"] = mobility
        load["temperature"] = mobility * (inertia * grains["temperature"] + grains["contact_heat"])

    def step(self, system, dt):
        system.cut_grains()
        system.evaluate_closures()
        self.predict(system, dt)
        system.solve_fluid()
        system.move_grains()
        system.accept()


class Iterated(Henry):
    """Moves the grains, looks where they went, and solves again from the same state."""

    def step(self, system, dt):
        system.cut_grains()
        system.evaluate_closures()
        start = system.grain_state()
        self.predict(system, dt)
        for _ in range(3):
            system.solve_fluid()
            system.restore_grains(start)
            system.move_grains()
            law = system.load["mobility"][:, None] * (
                system.load["drag"][:, None] * system.at_grains["velocity"]
                - system.load["volume"][:, None] * system.at_grains["pressure_gradient"]
            )
            self.disagreement = abs(system.grains["velocity"] - system.load["velocity"] - law).max()
            system.load["velocity"] = system.grains["velocity"] - law
        system.accept()


class Implicit:
    """Implicit drag and laws around a trial response, iterated until grains and fluid agree. The built-in
    `iterated` knows the contacts and agrees sooner, but on the same."""

    def forcing(self, system):
        load, at = system.load, system.at_grains
        drag, volume = load["drag"][:, None], load["volume"][:, None]
        heat = load["heat_coefficient"] * at["temperature"]
        return drag * at["velocity"] - volume * at["pressure_gradient"] + load["known"], heat

    def step(self, system, dt):
        system.cut_grains()
        system.evaluate_closures()
        load, grains, start = system.load, system.grains, system.grain_state()
        mobility = 1 / (grains["mass"] / dt + load["drag"])
        warming = 1 / (grains["heat_capacity"] / dt + load["heat_coefficient"])
        force, heat = self.forcing(system)
        system.separate_continuity()
        for self.solves in range(1, 41):
            response, warmth = system.drive_grains(force, heat)
            system.restore_grains(start)
            load["mobility"] = np.zeros_like(mobility)
            load["velocity"] = response
            load["continuity_mobility"] = mobility
            load["continuity_velocity"] = response - mobility[:, None] * force
            load["heat_mobility"] = warming
            load["temperature"] = warmth - warming * heat
            system.solve_fluid()
            force, heat = self.forcing(system)
            velocity, _ = system.drive_grains(force, heat)
            if abs(velocity - response).max() < 1e-12:
                break
            system.restore_grains(start)
        system.accept()


def test_any_law_leads_to_the_same_step_when_iterated():
    scheme = Implicit()
    tight = ["contacts.tolerance=1e-10", "time.step=5e-4"]
    mine = voidage.Simulation(BED, tight, scheme=scheme)
    tight = [*tight, "coupling.iteration={tolerance=1e-11, heat_tolerance=1e-11, most=40}"]
    built_in = voidage.Simulation(BED, tight, scheme="iterated")
    other = voidage.Simulation(BED, ["time.step=5e-4"], scheme="explicit")
    for _ in range(3):
        for simulation in (mine, built_in, other):
            simulation.step()
        assert 1 < scheme.solves < 40
    # What the stabilisation takes from the law at the last state, four times less with half the step; and a law without
    # agreement beside it.
    for name, left in [("position", 1e-9), ("velocity", 1e-6), ("temperature", 5e-7)]:
        assert abs(mine.grains[name] - built_in.grains[name]).max() < left
        assert abs(other.grains[name] - built_in.grains[name]).max() > 10 * left


def test_a_forcing_without_the_heat_of_the_scene_is_told():
    class Cold(Henry):
        def step(self, system, dt):
            with pytest.raises(ValueError, match="`heat` is missing"):
                system.drive_grains(np.zeros((40, 2)))
            super().step(system, dt)

    voidage.Simulation(BED, scheme=Cold()).step()


def test_henry_in_python_is_henry():
    mine = voidage.Simulation(BED, scheme=Henry())
    built_in = voidage.Simulation(BED, scheme="henry")
    for simulation in (mine, built_in):
        simulation.run(until=0.02)
    assert_same(mine, built_in)


def test_an_iterated_scheme_conserves_momentum():
    scheme = Iterated()
    simulation = voidage.Simulation(BED, scheme=scheme)
    for _ in range(5):
        assert simulation.step()["momentum_exchange_defect"] < 1e-12
    assert simulation.steps == 5 and np.isfinite(scheme.disagreement)


def test_what_a_scheme_raises_is_the_cause():
    class Broken(Henry):
        def predict(self, system, dt):
            raise LookupError("no prediction today")

    simulation = voidage.Simulation(BED, scheme=Broken())
    with pytest.raises(RuntimeError, match="step 1, .*no prediction today") as raised:
        simulation.step()
    assert isinstance(raised.value.__cause__, LookupError)
    assert simulation.steps == 0 and simulation.grains["position"].shape == (40, 2)


def test_what_a_solver_raises_inside_a_scheme_is_the_cause_of_the_cause():
    class Curious(Dummy):
        def solve(self, step):
            self.system.load["drag"]  # which the scheme has not finished with

    class Shared(Henry):
        def step(self, system, dt):
            fluid.system = system
            super().step(system, dt)

    fluid = Curious()
    with pytest.raises(RuntimeError, match="in the middle of a phase") as raised:
        voidage.Simulation(BED, scheme=Shared(), fluid=fluid).step()
    assert raised.value.__cause__.__cause__ is not None


def test_an_interrupt_is_raised_as_it_is():
    class Interrupted:
        def step(self, system, dt):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        voidage.Simulation(BED, scheme=Interrupted()).step()


@pytest.mark.parametrize(
    "phases, first",
    [
        (["evaluate_closures"], "cut_grains"),
        (["solve_fluid"], "evaluate_closures"),
        (["cut_grains", "solve_fluid"], "evaluate_closures"),
        (["cut_grains", "evaluate_closures", "accept"], "solve_fluid"),
    ],
)
def test_phases_out_of_order_are_told(phases, first):
    class Hasty:
        def step(self, system, dt):
            for phase in phases:
                getattr(system, phase)()

    with pytest.raises(RuntimeError, match=f"`{phases[-1]}` before `{first}`"):
        voidage.Simulation(BED, scheme=Hasty()).step()


def test_a_scheme_must_accept_once():
    class Forgetful(Henry):
        def step(self, system, dt):
            self.system = system

    scheme = Forgetful()
    simulation = voidage.Simulation(BED, scheme=scheme)
    with pytest.raises(RuntimeError, match="accepted 0 solutions"):
        simulation.step()
    with pytest.raises(RuntimeError, match="inside `step` or `solve` of the scheme only"):
        scheme.system.cut_grains()


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("coupling.cut={ travel = 0.1 }", "`coupling.cut` divides steps, and the scheme makes whole ones"),
        ("events=[{ time = 2e-3, set = ['coupling.scheme=\"lagged\"'] }]", "`events` change the scheme"),
    ],
)
def test_keys_that_only_other_schemes_heed_were_ignored(setting, told):
    with pytest.raises(ValueError, match=told):
        voidage.Simulation(BED, [setting], scheme=Henry())


def test_a_scheme_works_on_its_system_and_not_on_the_simulation():
    class Greedy(Henry):
        def step(self, system, dt):
            self.simulation.grains["velocity"]

    scheme = Greedy()
    scheme.simulation = voidage.Simulation(BED, scheme=scheme)
    with pytest.raises(RuntimeError, match="in the middle of a step"):
        scheme.simulation.step()


def test_a_scheme_writes_the_load_and_reads_the_fluid():
    class Curious(Henry):
        def predict(self, system, dt):
            super().predict(system, dt)
            for name, value in [("volume", np.ones(40)), ("mobility", np.ones(3))]:
                with pytest.raises(ValueError, match=f"`{name}`"):
                    system.load[name] = value
            with pytest.raises(ValueError, match="read but not written"):
                system.at_grains["velocity"] = np.zeros((40, 2))
            assert system.steps == 0 and system.time == 0.0

    voidage.Simulation(BED, scheme=Curious()).step()


def test_a_scheme_is_a_name_or_has_a_step():
    with pytest.raises(TypeError, match="method `step"):
        voidage.Simulation(BED, scheme=3)
