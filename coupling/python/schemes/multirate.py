"""The fluid takes several steps among grains that keep their velocity, then these take one under the mean force.

voidage run SCENE --scheme python:multirate.py --set coupling.scheme_options.count=4
"""

import numpy as np


class Multirate:
    def __init__(self, count=2):
        self.count = count

    def step(self, system, dt):
        grains, load = system.grains, system.load
        got = {name: 0.0 for name in ("force", "heat") if name in grains}
        for k in range(self.count):
            system.begin(dt / self.count)
            system.cut_grains()
            system.evaluate_closures()
            load["mobility"] = np.zeros_like(load["drag"])
            load["velocity"] = grains["velocity"]
            if "heat" in got:
                load["heat_mobility"] = np.zeros_like(load["drag"])
                load["temperature"] = grains["temperature"]
            system.solve_fluid()
            got = {name: mean + grains[name] / self.count for name, mean in got.items()}
            if k == self.count - 1:
                system.move_grains(dt, **got)
            system.accept()
