//! Acceleration of the sweeps.

/// How far the next sweep starts beyond the last one: p + beta (p - last p).
///
/// Nesterov's sequence t' = (1 + sqrt(1 + 4 t^2)) / 2, beta = (t - 1) / t', which turns the O(height^2) sweeps of
/// Gauss-Seidel into O(height). It restarts when the last change points back against the step (O'Donoghue and Candes
/// 2015). That is theory for symmetric problems; with friction and rotation a sweep has complex modes, which a
/// large beta amplifies: when the change has grown by `GROWTH` over its smallest value, beta stays below what it was
/// there.
pub(crate) struct Momentum {
    t: f64,
    pub beta: f64,
    most: f64,
    /// Smallest square of the change, and the beta that gave it.
    lowest: (f64, f64),
}

/// Growth of the squared change that tells instability from noise: 1.6 to 2 take the fewest sweeps in settled beds.
const GROWTH: f64 = 2.0;

impl Default for Momentum {
    fn default() -> Self {
        Self { t: 1.0, beta: 0.0, most: 1.0, lowest: (f64::MAX, 0.0) }
    }
}

impl Momentum {
    pub fn update(&mut self, change: f64, turn: f64) {
        if change < self.lowest.0 {
            self.lowest = (change, self.beta);
        }
        let unstable = change > GROWTH * self.lowest.0;
        if unstable {
            self.most = self.most.min(self.lowest.1.max(0.5));
            self.lowest = (change, 0.0);
        }
        if unstable || turn > 0.0 {
            (self.t, self.beta) = (1.0, 0.0);
        } else {
            let next = 0.5 * (1.0 + (1.0 + 4.0 * self.t * self.t).sqrt());
            self.beta = ((self.t - 1.0) / next).min(self.most);
            self.t = next;
        }
    }
}
