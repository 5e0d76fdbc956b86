//! What happens to a droplet over time.

use crate::results::table::Table;
use std::path::{Path, PathBuf};
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_coupling::Result;
use voidage_scene::Scene;

/// Values over which noisy curves are averaged.
const SMOOTH: usize = 10;

/// Points of a curve.
pub type Points = Vec<(f64, f64)>;

/// The series of a run with a droplet, in its scales.
pub struct Run<'a> {
    series: &'a Table,
    /// Rows in which there is a droplet: until it has vanished.
    rows: usize,
    /// Diameter D at time zero, m.
    pub diameter: f64,
    /// Time sqrt(D/g), s.
    pub time: f64,
    /// Gravity, m/s2.
    gravity: f64,
    /// Temperature of the droplet, K.
    temperature: f64,
}

impl<'a> Run<'a> {
    /// None where the scene has no droplet, or no gravity, or the series no droplet.
    pub fn new(scene: &Scene, series: &'a Table) -> Option<Run<'a>> {
        let droplet = scene.droplet.as_ref()?;
        let diameter = 2.0 * series.column("droplet_radius_m")?.first()?;
        let gravity = scene.gravity.vector::<3>().norm();
        // Once it has vanished, nothing acts on it any more.
        let acts = ["droplet_gas_force_x_N_per_m", "droplet_gas_force_y_N_per_m", "droplet_gas_heat_W_per_m"];
        let last = |name: &str| series.column(name)?.iter().rposition(|value| *value != 0.0);
        let all = series.column("time_s")?.len();
        let rows = acts.into_iter().filter_map(last).max().map_or(all, |last| last + 1);
        let run = Run {
            series,
            rows,
            diameter,
            time: (diameter / gravity).sqrt(),
            gravity,
            temperature: droplet.temperature,
        };
        (gravity > 0.0 && diameter > 0.0).then_some(run)
    }

    /// A column while there is a droplet.
    fn column(&self, name: &str) -> Option<&'a [f64]> {
        let column = self.series.column(name)?;
        column.get(..self.rows)
    }

    /// Diameter and time of a fall over it.
    pub fn size(&self) -> String {
        format!("D = {:.2} mm, \u{221a}(D/g) = {:.2} ms", 1e3 * self.diameter, 1e3 * self.time)
    }

    /// What values are divided by, as far as it is known.
    fn scales(&self) -> String {
        let mut scales = self.size();
        if let Some(Parts { scale, .. }) = self.forces() {
            scales += &format!(", W\u{2080} = {:.1} mN/m", 1e3 * scale);
        }
        if let Some(Parts { scale, .. }) = self.heats() {
            scales += &format!(", Q\u{2080} = {:.0} W/m", scale);
        }
        scales
    }

    /// Values over t/sqrt(D/g).
    fn over_time(&self, values: impl IntoIterator<Item = f64>) -> Option<Points> {
        let time = self.column("time_s")?.iter().map(|time| time / self.time);
        Some(time.zip(values).filter(|(_, value)| value.is_finite()).collect())
    }

    /// Depth of its lowest point below the bed of time zero, over D.
    pub fn depth(&self) -> Option<Points> {
        let depth = self.column("droplet_depth_m")?;
        self.over_time(depth.iter().map(|depth| depth / self.diameter))
    }

    /// Vertical velocity over sqrt(D g).
    pub fn velocity(&self) -> Option<Points> {
        let scale = (self.diameter * self.gravity).sqrt();
        self.over_time(self.column("droplet_velocity_y_m_per_s")?.iter().map(|velocity| velocity / scale))
    }

    /// Temperature of the bed at time zero, K: the mean of its grains.
    pub fn bed_temperature(&self) -> Option<f64> {
        self.column("mean_grain_temperature_K")?.first().copied()
    }

    /// A temperature on the scale from that of the droplet, 0, to that of the bed at time zero, 1.
    pub fn scaled(&self, temperature: f64) -> Option<f64> {
        let span = self.bed_temperature()? - self.temperature;
        (span != 0.0).then(|| (temperature - self.temperature) / span)
    }

    /// Mean temperature of the grains, scaled.
    pub fn grain_temperature(&self) -> Option<Points> {
        let mean = self.column("mean_grain_temperature_K")?;
        self.over_time(mean.iter().map_while(|mean| self.scaled(*mean)))
    }

    /// Liquid over the rate at which it boils, s; without the times at which none boils.
    pub fn lifetime(&self) -> Option<Points> {
        let lifetime = self.column("droplet_lifetime_s")?;
        self.over_time(lifetime.iter().map(|lifetime| if *lifetime > 0.0 { *lifetime } else { f64::NAN }))
    }

    /// Vertical forces on the liquid over its weight at time zero: weight, gas, grains, and the sum, which moves it.
    /// Grains act by their drag and by the pressure of the water on them.
    fn forces(&self) -> Option<Parts> {
        let mass = self.column("droplet_liquid_kg_per_m")?;
        let gas = self.column("droplet_gas_force_y_N_per_m")?;
        let drag = self.column("droplet_grain_force_y_N_per_m")?;
        let pressure = self.column("droplet_grain_pressure_force_y_N_per_m")?;
        let scale = mass.first()? * self.gravity;
        let weight: Vec<f64> = mass.iter().map(|mass| -mass * self.gravity).collect();
        let grains = drag.iter().zip(pressure).map(|(drag, pressure)| drag + pressure).collect();
        let parts = vec![("weight", weight), ("gas", gas.to_vec()), ("grains", grains)];
        (scale > 0.0).then_some(Parts { parts, scale })
    }

    /// Heat to the droplet over that of the gas in the first row after time zero: gas, grains, and the sum, which boils
    /// it.
    fn heats(&self) -> Option<Parts> {
        let gas = self.column("droplet_gas_heat_W_per_m")?;
        let grains = self.column("droplet_grain_heat_W_per_m")?;
        let scale = *gas.get(1)?;
        let parts = vec![("gas", gas.to_vec()), ("grains", grains.to_vec())];
        (scale > 0.0).then_some(Parts { parts, scale })
    }
}

/// What adds up to a whole, and the scale of all.
struct Parts {
    parts: Vec<(&'static str, Vec<f64>)>,
    scale: f64,
}

impl Parts {
    /// The parts and their sum over time, each as it was recorded and its moving mean.
    fn curves(self, run: &Run) -> Option<Vec<Curve>> {
        let Parts { mut parts, scale } = self;
        let rows = parts.iter().map(|(_, values)| values.len()).min()?;
        let net = (0..rows).map(|row| parts.iter().map(|(_, values)| values[row]).sum()).collect();
        parts.push(("net", net));
        let mut curves = Vec::new();
        for (name, values) in parts {
            let points = run.over_time(values.into_iter().map(|value| value / scale))?;
            // Nothing acts yet at time zero.
            let points = &points[1.min(points.len())..];
            curves.push(Curve::measured(name, moving_mean(points)));
            curves.push(Curve::faint("", points.to_vec()));
        }
        curves
            .push(Curve::faint(format!("thin: as recorded, thick: mean over {SMOOTH} records"), Vec::new()));
        Some(curves)
    }
}

/// Means over so many points around each, over their mean time; fewer at the ends.
fn moving_mean(points: &[(f64, f64)]) -> Points {
    let mean = |k: usize| {
        let window = &points[k.saturating_sub(SMOOTH / 2)..(k + SMOOTH.div_ceil(2)).min(points.len())];
        let sum = window.iter().fold((0.0, 0.0), |sum, point| (sum.0 + point.0, sum.1 + point.1));
        (sum.0 / window.len() as f64, sum.1 / window.len() as f64)
    };
    (0..points.len()).map(mean).collect()
}

/// A picture over time.
pub struct Figure {
    /// Name of the file.
    pub file: &'static str,
    label: &'static str,
    /// Values grow downwards.
    down: bool,
    /// They are positive, and are shown by decades where they span many.
    decades: bool,
    /// The curves of a run.
    curves: fn(&Run) -> Option<Vec<Curve>>,
}

const DEPTH: Figure = Figure {
    file: "droplet-depth.png",
    label: "depth of the lowest point h / D",
    down: true,
    decades: false,
    curves: |run| Some(vec![Curve::measured("", run.depth()?)]),
};

const VELOCITY: Figure = Figure {
    file: "droplet-velocity.png",
    label: "vertical velocity / \u{221a}(g D), up is positive",
    down: false,
    decades: false,
    curves: |run| Some(vec![Curve::measured("", run.velocity()?)]),
};

const TEMPERATURE: Figure = Figure {
    file: "grain-temperature.png",
    label: "mean grain temperature (T \u{2212} T_d) / (T\u{2080} \u{2212} T_d)",
    down: false,
    decades: false,
    curves: |run| Some(vec![Curve::measured("", run.grain_temperature()?)]),
};

const LIFETIME: Figure = Figure {
    file: "droplet-lifetime.png",
    label: "lifetime: liquid / rate of boiling (s)",
    down: false,
    decades: true,
    curves: |run| Some(vec![Curve::measured("", run.lifetime()?)]),
};

const FORCES: Figure = Figure {
    file: "droplet-forces.png",
    label: "vertical force on the liquid / W\u{2080}, up is positive",
    down: false,
    decades: false,
    curves: |run| run.forces()?.curves(run),
};

const HEAT: Figure = Figure {
    file: "droplet-heat.png",
    label: "heat to the droplet / Q\u{2080}",
    down: false,
    decades: false,
    curves: |run| run.heats()?.curves(run),
};

/// Pictures of one curve for each run.
pub const SINGLE: [Figure; 4] = [DEPTH, VELOCITY, TEMPERATURE, LIFETIME];

impl Figure {
    /// The curve of a run under a name, for a picture of one curve for each run; none where its series does not hold
    /// it.
    pub fn curve(&self, run: &Run, name: &str) -> Option<Curve> {
        let curve = (self.curves)(run)?.into_iter().next()?;
        (!curve.points.is_empty()).then(|| Curve { name: name.to_owned(), ..curve })
    }

    /// Draws curves over t/sqrt(D/g).
    pub fn draw(&self, path: &Path, title: &str, curves: Vec<Curve>) -> Result<()> {
        let values = || curves.iter().flat_map(|curve| &curve.points).map(|point| point.1);
        let span = values().fold(0.0, f64::max) / values().fold(f64::INFINITY, f64::min);
        let named = curves.iter().filter(|curve| !curve.name.is_empty()).count();
        let panel = Panel {
            log: [false, self.decades && span > 100.0],
            down: self.down,
            headroom: 0.06 * named as f64,
            curves,
            ..Panel::new(title, "t / \u{221a}(D/g)", self.label)
        };
        panels::large(path, 1, &[panel])
    }
}

/// Draws what the series of a run allows.
pub fn draw(folder: &Path, run: &Run) -> Result<Vec<PathBuf>> {
    let mut drawn = Vec::new();
    for figure in SINGLE.iter().chain(&[FORCES, HEAT]) {
        let curves = (figure.curves)(run);
        if let Some(curves) = curves.filter(|curves| curves.iter().any(|curve| !curve.points.is_empty())) {
            let path = folder.join(figure.file);
            figure.draw(&path, &run.scales(), curves)?;
            drawn.push(path);
        }
    }
    Ok(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_mean_keeps_lines_and_takes_away_noise() {
        let line: Points = (0..40).map(|k| (f64::from(k), 3.0 * f64::from(k))).collect();
        assert!(moving_mean(&line).iter().all(|(x, y)| (y - 3.0 * x).abs() < 1e-12));
        let noise: Points = (0..40).map(|k| (f64::from(k), f64::from(k % 2))).collect();
        assert!(moving_mean(&noise)[10..30].iter().all(|point| point.1 == 0.5));
        assert_eq!(moving_mean(&[]), []);
    }
}
