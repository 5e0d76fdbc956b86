"""Sources of manufactured solutions by computer algebra, for the fluid of ``coupling/model.md``.

Without grains, with a field of voidage eps that is given (section 5; set I, so that the pressure
gradient is not multiplied by eps), the equations are

    mass       div(eps u) = s
    momentum   eps rho (du/dt + (u . grad) u) + grad p - div(eps eta (grad u + grad u^T)) = f
    heat       eps rho c (dT/dt + u . grad T) - div(eps k grad T) = q

The model takes d(eps)/dt from the flux of the solid, which is zero here: a voidage that moves has
no place in s. C1 and C2 have the fields of the verification of the VANS solver of Lethe.

``python3 tests/manufactured.py`` prints fields and sources at a point, with all properties one. It
needs sympy.
"""

from dataclasses import dataclass

import sympy as sp

x, y, z, t = sp.symbols("x y z t")
pi = sp.pi


@dataclass(frozen=True)
class Exact:
    """Exact fields in the plane or in space; ``u`` has one component per dimension."""

    eps: sp.Expr
    u: list[sp.Expr]
    p: sp.Expr
    T: sp.Expr

    def sources(self, rho=1, eta=1, c=1, k=1) -> tuple[sp.Expr, list[sp.Expr], sp.Expr]:
        """s, f and q."""
        eps, u, T = self.eps, self.u, self.T
        X = (x, y, z)[: len(u)]

        def div(flux):
            return sum(sp.diff(part, at) for part, at in zip(flux, X, strict=True))

        def change(field):
            along = sum(v * sp.diff(field, at) for v, at in zip(u, X, strict=True))
            return sp.diff(field, t) + along

        force = []
        for i, own in enumerate(X):
            strain = [sp.diff(u[i], at) + sp.diff(u[j], own) for j, at in enumerate(X)]
            stress = div([eps * eta * part for part in strain])
            force.append(eps * rho * change(u[i]) + sp.diff(self.p, own) - stress)
        heat = eps * rho * c * change(T) - div([eps * k * sp.diff(T, at) for at in X])
        return div([eps * v for v in u]), force, heat


def curl(a):
    """Of a vector potential in space."""
    slope = [[sp.diff(part, at) for at in (x, y, z)] for part in a]
    return [slope[(i + 2) % 3][(i + 1) % 3] - slope[(i + 1) % 3][(i + 2) % 3] for i in range(3)]


sx, cx, sy, cy = sp.sin(pi * x), sp.cos(pi * x), sp.sin(pi * y), sp.cos(pi * y)
hump, saddle = sx * sy, cx * cy
swirl = [-2 * sx**2 * cy * sy, 2 * cx * sx * sy**2]
still = sp.Rational(1, 2) + hump / 4
moving = sp.Rational(1, 2) + sp.sin(pi * x - 2 * t) * sp.cos(pi * y + sp.Rational(1, 2)) / 4
falling = sp.exp(-hump - 1)
hump_3d, saddle_3d = hump * sp.sin(pi * z), saddle * sp.cos(pi * z)
still_3d = sp.Rational(1, 2) + hump_3d / 4

FIELDS = {
    "C1": Exact(still, swirl, hump, saddle),
    "C2": Exact(falling, [sp.exp(hump - 1)] * 2, (1 + hump) / 2, saddle),
    # As C2, with a flow without divergence that slides along the walls.
    "sliding": Exact(falling, [sx * cy, -cx * sy], (1 + hump) / 2, saddle),
    # As C1, in a voidage that moves.
    "moving": Exact(moving, swirl, hump, saddle),
    # eps u is the curl of a potential that is flat on the walls of [-1, 1]^3: s = 0, u = 0 there.
    "C4-3D": Exact(
        still_3d, [part / still_3d for part in curl([hump_3d**2 / pi] * 3)], hump_3d, saddle_3d
    ),
}
"""Sets of fields by name."""


def main() -> None:
    """Prints all sets at (0.3, -0.6, 0.1) and t = 0."""
    place = {x: sp.Rational(3, 10), y: -sp.Rational(3, 5), z: sp.Rational(1, 10), t: 0}

    def value(field) -> str:
        return f"{float(sp.sympify(field).subs(place)):.8g}"

    for name, exact in FIELDS.items():
        s, f, q = exact.sources()
        print(f"{name}: eps {value(exact.eps)}, u {', '.join(map(value, exact.u))}, ", end="")
        print(f"p {value(exact.p)}, T {value(exact.T)}; ", end="")
        print(f"s {value(s)}, f {', '.join(map(value, f))}, q {value(q)}")


if __name__ == "__main__":
    main()
