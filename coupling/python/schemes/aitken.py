"""Fluid and grains in turn until the grains move as the fluid expected them, with Aitken's relaxation.

voidage run SCENE --scheme python:aitken.py
"""

import numpy as np


class Aitken:
    def __init__(self, tolerance=1e-3, most=30):
        self.tolerance, self.most = tolerance, most

    def solve(self, system, dt):
        system.cut_grains()
        system.evaluate_closures()
        load, at, start = system.load, system.at_grains, system.grain_state()
        falls = np.linalg.norm(system.gravity) * dt  # a speed that counts where all are at rest
        guess, omega, last, heat = system.grains["velocity"], 1.0, None, None
        load["mobility"] = 0.0 * load["drag"]
        if "heat_mobility" in load:  # grains that no contact heats
            inertia = system.grains["heat_capacity"] / dt
            load["heat_mobility"] = 1 / (inertia + load["heat_coefficient"])
            load["temperature"] = load["heat_mobility"] * inertia * system.grains["temperature"]
        for _ in range(self.most):
            load["velocity"] = guess
            system.solve_fluid()
            force = load["drag"][:, None] * at["velocity"] + load["known"]
            force = force - load["volume"][:, None] * at["pressure_gradient"]
            if "heat_mobility" in load:
                heat = load["heat_coefficient"] * at["temperature"]
            system.restore_grains(start)
            answer, _ = system.drive_grains(force, heat)
            residual = answer - guess
            if abs(residual).max(initial=0) <= self.tolerance * (abs(answer).max(initial=0) + falls):
                break
            if last is not None and (change := residual - last).any():
                omega = -omega * (last * change).sum() / (change * change).sum()
            guess, last = guess + omega * residual, residual
