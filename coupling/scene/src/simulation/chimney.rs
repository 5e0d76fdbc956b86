//! Columns of a droplet that digs: what its vapour could carry, what passes through it, and the chimney above it.

use crate::recorder::Reading;
use std::f64::consts::PI;
use voidage_coupling::Laws;
use voidage_coupling::droplet::Droplet;
use voidage_coupling::single::Single;
use voidage_dem::Particles;

/// Width of the strip above a droplet in which its chimney is looked for, and height of its slices, in mean diameters of
/// the grains.
const WIDTH: f64 = 5.0;

/// Share of a slice that discs fill at most where the chimney is open: half of what they fill in a loose bed.
const OPEN: f64 = 0.4;

/// The mean of the grains that move; none without any.
fn mean(grains: &Particles<2>) -> Option<Single> {
    let moving = (0..grains.len()).filter(|&i| grains.mass[i].is_finite());
    let sums = moving.fold([0.0; 4], |[count, diameter, volume, mass], i| {
        [count + 1.0, diameter + 2.0 * grains.radius[i], volume + grains.volume[i], mass + grains.mass[i]]
    });
    let [count, diameter, volume, mass] = sums;
    let single = Single { diameter: diameter / count, volume: volume / count, density: mass / volume };
    (count > 0.0).then_some(single)
}

/// Vapour through a chimney as wide as the droplet over the speed at which a grain falls: mdot/(2 r rho_v v_t).
fn chimney_number(droplet: &Droplet<2>, single: &Single, laws: &Laws) -> f64 {
    let (state, material) = (&droplet.state, &droplet.material);
    let falls = single.terminal(laws, material.gravity.norm());
    state.vapour / (2.0 * state.radius * falls)
}

/// Height over which the strip above a droplet is open without a break, from its top up to the surface of the bed, m.
fn open(droplet: &Droplet<2>, single: &Single, grains: &Particles<2>, surface: f64) -> f64 {
    let (state, width) = (&droplet.state, WIDTH * single.diameter);
    let top = state.centre[1] + state.radius;
    let depth = (surface - top).max(0.0);
    let mut filled = vec![0.0; (depth / width).ceil() as usize];
    for (x, radius) in grains.position.iter().zip(&grains.radius) {
        let slice = (x[1] - top) / width;
        let above = slice >= 0.0 && (x[0] - state.centre[0]).abs() < 0.5 * width;
        if let Some(filled) = filled.get_mut(slice as usize).filter(|_| above) {
            *filled += PI * radius * radius;
        }
    }
    let heights = (0..filled.len()).map(|slice| (depth - slice as f64 * width).min(width));
    heights
        .zip(&filled)
        .take_while(|(height, filled)| **filled <= OPEN * height * width)
        .fold(0.0, |sum, (h, _)| sum + h)
}

/// The columns; `surface` is the height of the bed at time zero, m.
pub(super) fn readings(
    droplet: &Droplet<2>,
    grains: &Particles<2>,
    (laws, surface): (&Laws, f64),
    readings: &mut Vec<Reading>,
) {
    let state = &droplet.state;
    let (number, open, solid) = match mean(grains) {
        _ if state.gone => (0.0, 0.0, 0.0),
        None => (f64::NAN, 0.0, 0.0),
        Some(single) => (
            chimney_number(droplet, &single, laws),
            open(droplet, &single, grains, surface),
            1.0 - state.liquid / droplet.volume(),
        ),
    };
    let above = grains.position.iter().zip(&grains.volume).filter(|(x, _)| x[1] > surface);
    readings.extend([
        ("droplet_chimney_number".into(), number),
        ("droplet_chimney_open_m".into(), open),
        ("droplet_solid_share".into(), solid),
        ("droplet_solid_in_below_m2".into(), state.passed.in_below),
        ("droplet_solid_out_above_m2".into(), state.passed.out_above),
        ("droplet_solid_above_bed_m2".into(), above.fold(0.0, |sum, (_, volume)| sum + volume)),
    ]);
}

#[cfg(test)]
mod tests {
    use super::mean;
    use crate::{Scene, Simulation};
    use voidage_dem::Particles;

    /// Height that is open, and solid above the bed: rows of discs of 0.2 mm above the droplet, but for the first ones.
    fn open_height(open_rows: usize) -> (f64, f64) {
        let text = format!(
            "gravity = [0.0, -9.81]\n[time]\nstep = 1e-4\nend = 1e-4\n[materials.a]\ndensity = 2500.0\n\
             [[grains]]\nmaterial = \"a\"\nradius = 1e-4\n\
             placement = {{ lattice = {{ lower = [0.0041, {}], upper = [0.00591, 0.01601], spacing = 1.0 }} }}\n\
             [fluid]\ndensity = 1.2\nviscosity = 2e-5\n\
             [fluid.mesh.rectangle]\nlower = [0.0, 0.0]\nupper = [0.01, 0.02]\nsize = 5e-4\n\
             holes = [{{ name = \"droplet\", centre = [0.005, 0.005], radius = 1e-3, size = 2e-4 }}]\n\
             sides = {{ left = \"w\", right = \"w\", bottom = \"w\", top = \"top\" }}\n\
             [[fluid.boundaries]]\nname = \"w\"\nflow = \"no-slip\"\n\
             [[fluid.boundaries]]\nname = \"top\"\nflow = \"open\"\n\
             [droplet]\nboundary = \"droplet\"\n",
            0.006 + 2e-4 * open_rows as f64
        );
        let scene = Scene::parse(std::path::Path::new("scene.toml"), &text, &[]).expect("a scene");
        let simulation = Simulation::new(&scene).expect("a simulation");
        let readings = simulation.readings();
        let of = |name: &str| readings.iter().find(|(column, _)| column == name).expect(name).1;
        (of("droplet_chimney_open_m"), of("droplet_solid_above_bed_m2"))
    }

    #[test]
    fn a_chimney_is_open_up_to_the_first_slice_that_discs_fill() {
        // Slices of five rows: one that is filled by three is not open, by two it is.
        for (rows, open) in [(0, 0.0), (2, 0.0), (5, 1e-3), (10, 2e-3), (23, 5e-3)] {
            let (height, above) = open_height(rows);
            assert!((height - open).abs() < 2e-4, "{rows} rows: {height} m");
            // Nothing lies above the highest grain.
            assert_eq!(above, 0.0);
        }
    }

    #[test]
    fn without_grains_there_is_no_mean_one() {
        assert_eq!(mean(&Particles::default()), None);
    }
}
