//! Grains that leave the mesh: through an open boundary they leave the run, through any other part that is an error.

use crate::exchange::{AtGrains, OnMesh, Pieces};
use crate::{Error, HEAT, Mixture, Notice, Result};
use voidage_dem::retain;
use voidage_fluid::conditions::FlowCondition;
use voidage_fluid::{Mesh, Vector};

/// Number of the part of the boundary that is nearest to a point of the plane.
pub(crate) fn nearest_part<const D: usize>(mesh: &Mesh<D>, x: &Vector<D>) -> Option<usize> {
    let distance = |facet: &[u32]| {
        let (a, b) = (mesh.points[facet[0] as usize], mesh.points[facet[1] as usize]);
        let along = b - a;
        let share = ((x - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (a + along * share - x).norm()
    };
    let nearest = |facets: &[u32]| facets.chunks_exact(D).map(distance).fold(f64::INFINITY, f64::min);
    let parts = mesh.boundaries.iter().map(|part| nearest(&part.facets)).enumerate();
    parts
        .filter(|(_, distance)| distance.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(part, _)| part)
}

impl<const D: usize> Mixture<D> {
    /// Checks that all grains outside of the mesh went there through an open boundary.
    ///
    /// # Errors
    /// One went another way; which and where.
    pub(crate) fn check_outside(&self) -> Result<()> {
        let particles = &self.grains.particles;
        for &grain in self.interaction.overlap.outside() {
            let (place, radius) = (particles.position[grain as usize], particles.radius[grain as usize]);
            let id = particles.id[grain as usize];
            if !place.iter().chain([&radius]).all(|x| x.is_finite()) {
                let place = place.as_slice();
                let text =
                    format!("grain {id}: its position {place:?} or radius {radius} is not a finite number");
                return Err(Error::run(text));
            }
            let part = nearest_part(&self.fluid.mesh, &place);
            let name = part.map_or("", |part| self.fluid.mesh.boundaries[part].name.as_str());
            let condition = self.fluid.conditions.iter().find(|condition| condition.boundary == name);
            if condition.is_some_and(|condition| matches!(condition.flow, FlowCondition::Open { .. })) {
                continue;
            }
            let place = place.as_slice();
            return Err(Error::run(Notice::new(
                format!(
                    "grain {id} at {place:?} of radius {radius} lies outside of the mesh, behind its boundary \
                     \"{name}\""
                ),
                "keep grains in by [[walls]], or open that boundary; where a long step throws them out, \
                 coupling.cut = {} or a smaller time.step",
            )));
        }
        Ok(())
    }

    /// What refuses a grain of a source.
    pub(crate) fn outside_of_mesh(&self, source: &str, place: &Vector<D>, radius: f64) -> Error {
        let place = place.as_slice();
        Error::run(Notice::new(
            format!("source \"{source}\": a grain at {place:?} of radius {radius} is not wholly in the mesh"),
            "give the source a box that lies in the mesh of the fluid",
        ))
    }

    /// Whether the last cut found a grain outside of the mesh.
    pub(crate) fn is_outside(&self, grain: usize) -> bool {
        self.interaction.overlap.outside().binary_search(&(grain as u32)).is_ok()
    }

    /// Takes out of the run the grains that the last cut found outside of the mesh, and those that sinks have `taken`,
    /// which may be empty: the end of a step.
    pub(crate) fn dismiss(&mut self, taken: &[bool]) {
        let Self { grains, interaction, .. } = self;
        let gone = interaction.overlap.outside();
        if gone.is_empty() && taken.is_empty() {
            return;
        }
        let mut keep = vec![true; grains.particles.len()];
        keep.iter_mut().zip(taken).for_each(|(keep, taken)| *keep = !taken);
        gone.iter().for_each(|&grain| keep[grain as usize] = false);
        interaction.departed += gone.len() as u64;
        interaction.departed_mass += gone.iter().map(|&i| grains.particles.mass[i as usize]).sum::<f64>();
        self.book_gone(&keep);
        self.retain(&keep);
    }

    /// Keeps the grains of these numbers, which are in order, at a restart.
    pub fn keep(&mut self, ids: &[u32]) {
        let kept = self.grains.particles.id.iter().map(|id| ids.binary_search(id).is_ok());
        let kept: Vec<bool> = kept.collect();
        self.retain(&kept);
    }

    fn retain(&mut self, keep: &[bool]) {
        self.grains.retain(keep);
        self.interaction.retain(keep);
    }
}

impl<const D: usize> crate::Interaction<D> {
    /// Adds columns for grains that come in, of these pieces and solid volumes (m3), with the fluid where they are.
    pub(crate) fn extend(&mut self, pieces: &Pieces<D>, fluid: &OnMesh<'_, D>, volumes: &[f64]) {
        let n = self.load.drag.len() + volumes.len();
        let crate::load::GrainLoad { volume, drag, mobility, velocity, continuity, heat, .. } =
            &mut self.load;
        volume.extend_from_slice(volumes);
        [drag, mobility].into_iter().for_each(|column| column.resize(n, 0.0));
        velocity.resize(n, Vector::zeros());
        if let Some(law) = continuity {
            law.mobility.resize(n, 0.0);
            law.velocity.resize(n, Vector::zeros());
        }
        if let Some(heat) = heat {
            [&mut heat.coefficient, &mut heat.mobility, &mut heat.temperature]
                .into_iter()
                .for_each(|column| column.resize(n, 0.0));
            self.heat.resize(n, 0.0);
        }
        let mut at = AtGrains::default();
        at.sample(pieces, fluid, self.load.heat.as_ref().map(|_| HEAT));
        self.at.velocity.append(&mut at.velocity);
        self.at.pressure_gradient.append(&mut at.pressure_gradient);
        self.at.temperature.append(&mut at.temperature);
        self.force.resize(n, Vector::zeros());
        self.voidage.resize(n, 1.0);
        if !self.cohesive.is_empty() {
            self.cohesive.resize(n, true);
        }
        if let Some(carried) = &mut self.carried {
            carried.impulse.resize(n, Vector::zeros());
            carried.displacement.resize(n, Vector::zeros());
            carried.lags.resize(n, false);
            if self.load.heat.is_some() {
                carried.heat.resize(n, 0.0);
            }
        }
        self.load.pieces.clear();
        self.load.added.clear();
        self.load.known.clear();
        self.overlap.forget();
    }

    /// Keeps the columns of the grains that are marked.
    fn retain(&mut self, keep: &[bool]) {
        let crate::load::GrainLoad { volume, drag, mobility, velocity, continuity, heat, .. } =
            &mut self.load;
        [volume, drag, mobility].into_iter().for_each(|column| retain(column, keep));
        retain(velocity, keep);
        if let Some(law) = continuity {
            retain(&mut law.mobility, keep);
            retain(&mut law.velocity, keep);
        }
        if let Some(heat) = heat {
            [&mut heat.coefficient, &mut heat.mobility, &mut heat.temperature]
                .into_iter()
                .for_each(|column| retain(column, keep));
        }
        [&mut self.at.velocity, &mut self.at.pressure_gradient, &mut self.force]
            .into_iter()
            .for_each(|c| retain(c, keep));
        [&mut self.at.temperature, &mut self.voidage, &mut self.heat]
            .into_iter()
            .for_each(|column| retain(column, keep));
        retain(&mut self.cohesive, keep);
        if let Some(carried) = &mut self.carried {
            [&mut carried.impulse, &mut carried.displacement]
                .into_iter()
                .for_each(|column| retain(column, keep));
            retain(&mut carried.heat, keep);
            retain(&mut carried.lags, keep);
            // What is carried of grains that leave goes with them.
            carried.change();
        }
        self.load.pieces.clear();
        self.load.added.clear();
        self.load.known.clear();
        self.overlap.forget();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use voidage_fluid::mesh::{Rectangle, Side, Sides};

    #[test]
    fn the_part_that_a_grain_went_through_is_the_nearest() {
        let [left, right, bottom, top] = ["left", "right", "bottom", "top"].map(Side::named);
        let mesh = Mesh::rectangle(&Rectangle {
            lower: [0.0; 2],
            upper: [1.0, 2.0],
            size: Some(0.3),
            sides: Sides { left, right, bottom, top },
            holes: vec![],
            refine: vec![],
            structured: None,
        })
        .expect("a valid rectangle");
        for (place, name) in
            [([0.5, 2.2], "top"), ([1.1, 0.3], "right"), ([-0.1, 1.9], "left"), ([0.5, -1.0], "bottom")]
        {
            let part = nearest_part(&mesh, &Vector::from(place)).expect("a part");
            assert_eq!(mesh.boundaries[part].name, name);
        }
        assert_eq!(nearest_part(&mesh, &Vector::<2>::repeat(f64::NAN)), None);
    }
}
