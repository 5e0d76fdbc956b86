//! What a case is and what it finds.

use voidage_campaign::Effort;
use voidage_campaign::plot::panels::Panel;
use voidage_coupling::Result;

/// A problem whose answer is known.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Name for `--only`.
    pub name: &'static str,
    /// Group, which shares its pictures: of verification `fluid`, `coupled` or `grains`.
    pub group: &'static str,
    /// What is solved, in one sentence.
    pub title: &'static str,
    /// Where the known answer comes from.
    pub source: &'static str,
    /// Solves it.
    pub run: fn(Effort) -> Result<Outcome>,
}

/// What a case gives.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Values against known ones.
    pub findings: Vec<Finding>,
    /// Small plots for the page, measured against exact.
    pub panels: Vec<Panel>,
}

/// A value against the known one.
#[derive(Clone, Debug)]
pub struct Finding {
    /// What it is, with the parameters that tell it from its neighbours.
    pub quantity: String,
    /// Its unit, `1` if it has none.
    pub unit: &'static str,
    /// The known value, or the bound.
    pub expected: f64,
    /// What was computed.
    pub measured: f64,
    /// Lowest and highest values that pass.
    pub allowed: [f64; 2],
    /// Measured order of convergence towards the known value.
    pub order: Option<f64>,
}

impl Finding {
    /// Within `tolerance`, in the unit of the quantity, of the known value.
    pub fn absolute(
        quantity: impl Into<String>,
        unit: &'static str,
        expected: f64,
        measured: f64,
        tolerance: f64,
    ) -> Self {
        let allowed = [expected - tolerance, expected + tolerance];
        Self { quantity: quantity.into(), unit, expected, measured, allowed, order: None }
    }

    /// Within `tolerance` times the known value of it.
    pub fn relative(
        quantity: impl Into<String>,
        unit: &'static str,
        expected: f64,
        measured: f64,
        tolerance: f64,
    ) -> Self {
        Self::absolute(quantity, unit, expected, measured, tolerance * expected.abs())
    }

    /// Not below a bound.
    pub fn at_least(quantity: impl Into<String>, unit: &'static str, bound: f64, measured: f64) -> Self {
        let allowed = [bound, f64::INFINITY];
        Self { quantity: quantity.into(), unit, expected: bound, measured, allowed, order: None }
    }

    /// Not above a bound.
    pub fn at_most(quantity: impl Into<String>, unit: &'static str, bound: f64, measured: f64) -> Self {
        let allowed = [f64::NEG_INFINITY, bound];
        Self { quantity: quantity.into(), unit, expected: bound, measured, allowed, order: None }
    }

    /// A measured order of convergence, the slope between the two finest of `errors`, at sizes that fall by the factor
    /// `ratio`; it is also the order of the finding.
    pub fn order(quantity: impl Into<String>, least: f64, errors: &[f64], ratio: f64) -> Self {
        let order = match errors {
            [.., coarse, fine] => (coarse / fine).ln() / ratio.ln(),
            _ => f64::NAN,
        };
        Self::at_least(quantity, "1", least, order).with_order(order)
    }

    /// The same finding with the measured order of its convergence.
    pub fn with_order(self, order: f64) -> Self {
        Self { order: Some(order), ..self }
    }

    /// Whether it passes; what is no number does not.
    pub fn passes(&self) -> bool {
        self.allowed[0] <= self.measured && self.measured <= self.allowed[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_pass_inside_of_what_is_allowed_only() {
        assert!(Finding::relative("x", "m", -2.0, -2.01, 0.01).passes());
        assert!(!Finding::relative("x", "m", -2.0, -2.03, 0.01).passes());
        assert!(!Finding::absolute("x", "m", 0.0, f64::NAN, 1.0).passes());
        assert!(!Finding::at_least("x", "m", 1.0, 0.999).passes());
        assert!(!Finding::at_most("x", "m", 1.0, f64::NAN).passes());
        let order = Finding::order("order", 1.9, &[0.9, 4e-2, 1e-2], 2.0);
        assert!(order.passes() && (order.measured - 2.0).abs() < 1e-12);
        assert!(!Finding::order("order", 0.0, &[1.0], 2.0).passes());
    }
}
