//! Koch and Hill, Annu. Rev. Fluid Mech. 33, 619 (2001), with the viscous part of Koch and Sangani, J. Fluid Mech.
//! 400, 229 (1999).

use super::Surroundings;

/// gamma / V = 18 eta eps^2 F / d^2, F = F_0 + F_3 Re_s/2.
///
/// They print F with a Reynolds number of the radius, which is where the half comes from, and as all of the force on
/// a grain; set I has the mean pressure gradient apart, hence one eps more than in [`Surroundings::normalised`].
pub fn drag(around: &Surroundings) -> f64 {
    let eps = around.voidage;
    let force = viscous(1.0 - eps) + 0.5 * inertial(1.0 - eps) * around.superficial_reynolds();
    around.normalised(eps * force)
}

/// F_0: below a solid fraction of 0.4 a fit that has the known limit of few spheres, above it Carman's 10 phi / eps^3.
fn viscous(solid: f64) -> f64 {
    if solid >= 0.4 {
        return 10.0 * solid / (1.0 - solid).powi(3);
    }
    // phi ln phi is 0 at phi = 0.
    let logarithm = if solid > 0.0 { 135.0 / 64.0 * solid * solid.ln() } else { 0.0 };
    (1.0 + 3.0 * (0.5 * solid).sqrt() + logarithm + 16.14 * solid)
        / (1.0 + 0.681 * solid - 8.48 * solid * solid + 8.16 * solid.powi(3))
}

/// F_3.
fn inertial(solid: f64) -> f64 {
    0.0673 + 0.212 * solid + 0.0232 / (1.0 - solid).powi(5)
}
