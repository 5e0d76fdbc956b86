//! Functions of the plane and time with their derivatives: exact fields are written once, as formulas, and the sources
//! of manufactured solutions follow from them without differences and without hand-made derivatives.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value with its derivatives at one point (x, y, t).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet {
    /// Value.
    pub value: f64,
    /// Derivatives along x, y and t.
    pub slope: [f64; 3],
    /// Second derivatives xx, xy and yy.
    pub curve: [f64; 3],
}

/// Which first derivatives make up each second one.
const PAIRS: [(usize, usize); 3] = [(0, 0), (0, 1), (1, 1)];

impl Jet {
    /// The coordinate x (0), y (1) or time (2) itself, with the given value.
    pub fn variable(axis: usize, value: f64) -> Self {
        let mut slope = [0.0; 3];
        slope[axis] = 1.0;
        Self { value, slope, curve: [0.0; 3] }
    }

    /// A number.
    pub const fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; 3], curve: [0.0; 3] }
    }

    /// Second derivative along two axes of the plane.
    pub fn second(&self, i: usize, j: usize) -> f64 {
        self.curve[i + j]
    }

    /// Sine.
    pub fn sin(self) -> Self {
        self.map(self.value.sin(), self.value.cos(), -self.value.sin())
    }

    /// Cosine.
    pub fn cos(self) -> Self {
        self.map(self.value.cos(), -self.value.sin(), -self.value.cos())
    }

    /// Exponential.
    pub fn exp(self) -> Self {
        let e = self.value.exp();
        self.map(e, e, e)
    }

    /// f of this, from f, f' and f'' here: (f(a))_i = f' a_i, (f(a))_ij = f' a_ij + f'' a_i a_j.
    fn map(self, f: f64, first: f64, second: f64) -> Self {
        let a = self.slope;
        Self {
            value: f,
            slope: a.map(|a| first * a),
            curve: std::array::from_fn(|k| first * self.curve[k] + second * a[PAIRS[k].0] * a[PAIRS[k].1]),
        }
    }
}

impl Add for Jet {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            slope: std::array::from_fn(|k| self.slope[k] + other.slope[k]),
            curve: std::array::from_fn(|k| self.curve[k] + other.curve[k]),
        }
    }
}

impl Neg for Jet {
    type Output = Self;
    fn neg(self) -> Self {
        self * -1.0
    }
}

impl Sub for Jet {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul<f64> for Jet {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self {
            value: factor * self.value,
            slope: self.slope.map(|s| factor * s),
            curve: self.curve.map(|c| factor * c),
        }
    }
}

impl Add<f64> for Jet {
    type Output = Self;
    fn add(self, number: f64) -> Self {
        Self { value: self.value + number, ..self }
    }
}

impl Mul for Jet {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        product(&self, &other)
    }
}

/// (a b)_i = a_i b + a b_i, (a b)_ij = a_ij b + a_i b_j + a_j b_i + a b_ij.
fn product(a: &Jet, b: &Jet) -> Jet {
    let curve = |k: usize| {
        let (i, j) = PAIRS[k];
        let mixed = a.slope[i] * b.slope[j] + a.slope[j] * b.slope[i];
        a.curve[k] * b.value + mixed + a.value * b.curve[k]
    };
    Jet {
        value: a.value * b.value,
        slope: std::array::from_fn(|k| a.slope[k] * b.value + a.value * b.slope[k]),
        curve: std::array::from_fn(curve),
    }
}

impl Div for Jet {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let v = other.value;
        self * other.map(1.0 / v, -1.0 / (v * v), 2.0 / (v * v * v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// f = exp(x y) sin(t) / (x + y) at (0.3, 0.7, 0.4): f_x = f (y - 1/(x+y)), f_t = f cot t, and so on.
    #[test]
    fn derivatives_are_those_of_the_formula() {
        let (x, y, t) = (0.3, 0.7, 0.4);
        let [jx, jy, jt] = [Jet::variable(0, x), Jet::variable(1, y), Jet::variable(2, t)];
        let f = (jx * jy).exp() * jt.sin() / (jx + jy);
        let (value, s) = ((x * y).exp() * t.sin() / (x + y), x + y);
        assert_relative_eq!(f.value, value, max_relative = 1e-14);
        let exact = [value * (y - 1.0 / s), value * (x - 1.0 / s), value / t.tan()];
        for k in 0..3 {
            assert_relative_eq!(f.slope[k], exact[k], max_relative = 1e-13);
        }
        let square = 1.0 / (s * s);
        let second = [
            value * ((y - 1.0 / s).powi(2) + square),
            value * ((y - 1.0 / s) * (x - 1.0 / s) + 1.0 + square),
            value * ((x - 1.0 / s).powi(2) + square),
        ];
        for k in 0..3 {
            assert_relative_eq!(f.curve[k], second[k], max_relative = 1e-13);
        }
        assert_eq!(f.second(1, 0), f.curve[1]);
        let c = (jx * 2.0 - jy + 0.5).cos();
        assert_relative_eq!(c.second(1, 1), -(2.0 * x - y + 0.5f64).cos(), max_relative = 1e-14);
    }
}
