#!/usr/bin/env python3
"""The longest stable step of each coupling scheme in a closed box, in relaxation times of a grain: the table of coupling.md.

The states of a mode are the velocity of the grains, that of the fluid, the forcing of the fluid in units of gamma, and what
is carried in units of gamma dt. `voidage stability --only closed-box` compares the same maps with steps of the program.
"""

import numpy as np

GRAIN_STEPS, RETURNED = 10, 0.5
MIXTURES = [("glass in air", 2500 / 1.2), ("sand in water", 2.65)]
VOIDAGES = [0.4, 0.6, 0.9]


def motion(time, b, steps, implicit):
    """A motion for a share of the step: that share, what is left of a velocity at its end, and in the mean."""
    left = (1 / (1 + b / steps) if implicit else 1 - b / steps) ** steps
    return time, left, (1 - left) / b


def splitting(name, b):
    """The motions of the grains before and after the fluid is solved."""
    nothing = (0.0, 1.0, 1.0)
    return {
        "sub-cycled": (nothing, motion(1.0, b, GRAIN_STEPS, True)),
        "sub-cycled-explicit": (nothing, motion(1.0, b, GRAIN_STEPS, False)),
        "strang": (motion(0.5, 0.5 * b, 1, True),) * 2,
    }[name]


def factor(name, b, ratio, voidage, conserve=True):
    """The largest amplification factor in a step of b relaxation times; `ratio` is grain density / fluid density."""
    solid = 1 - voidage
    r = solid / voidage / ratio
    k = b / voidage
    if name == "explicit":
        return max(abs(np.roots([1, -(1 - r - k / voidage), -r])))
    if name == "lagged":
        return max(abs(np.roots([1 + k, -(1 - r - k * solid / voidage), -r])))
    before, after = splitting(name, b)
    end = lambda motion, v, f: f + (v - f) * motion[1]
    got = lambda motion, v, f: motion[0] * (f - v) * motion[2]

    def step(v, u, f, carried):
        met = end(before, v, f)
        expected = met - RETURNED * conserve * carried
        now = -solid / voidage * met
        forcing = (now - u) / ratio / b + solid / voidage * (now - expected) + now
        lost = forcing - expected
        # Each pressure acts for a whole step, and is not carried.
        ahead = before[0] * ((f - u) - (forcing - now))
        carried += got(before, v, f) + got(after, met, forcing) - lost - ahead
        return end(after, met, forcing), now, forcing, carried

    states = np.array([step(*state) for state in np.eye(4)]).T
    return max(abs(np.linalg.eigvals(states if conserve else states[:3, :3])))


def longest(*of):
    """The longest step from which on, in steps of 1 %, the mode grows."""
    steps = 10 ** np.arange(-4, 6, np.log10(1.01))
    grows = (b for b in steps if factor(of[0], b, *of[1:]) > 1 + 1e-9)
    return next((f"{b:.2g}" for b in grows), "any")


print("| |", " | ".join(f"{name}, voidage {voidage}" for name, _ in MIXTURES for voidage in VOIDAGES), "|")
print("|---" * (1 + len(MIXTURES) * len(VOIDAGES)) + "|")
for scheme in ["explicit", "sub-cycled-explicit", "sub-cycled", "sub-cycled, not conserving", "strang", "lagged"]:
    name, _, other = scheme.partition(",")
    row = [longest(name, ratio, voidage, not other) for _, ratio in MIXTURES for voidage in VOIDAGES]
    print(f"| {scheme} |", " | ".join(row), "|")
