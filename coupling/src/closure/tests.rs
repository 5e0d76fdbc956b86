//! The laws against values worked out from what their authors print, and against known limits.

use super::*;
use approx::assert_relative_eq;

fn around(slip: f64, voidage: f64) -> Surroundings {
    Surroundings { slip, voidage, diameter: 1e-3, density: 1.2, viscosity: 2e-5 }
}

#[test]
fn a_single_grain_at_rest_has_the_finite_drag_of_the_viscous_limit() {
    // As |u - v| -> 0, C_d |u - v| -> 4.8^2 eta / (rho d): gamma / V = 3/4 23.04 eta / d^2.
    let drag = Drag::Dallavalle.coefficient(&around(0.0, 1.0), VoidageFunction::Henry);
    assert_relative_eq!(drag, 0.75 * 23.04 * 2e-5 / 1e-6, max_relative = 1e-14);
}

#[test]
fn drag_is_the_printed_coefficient() {
    let x = around(0.7, 0.5);
    for (g, exponent) in [
        (VoidageFunction::Henry, -1.8 + (-(1.5 - 21f64.log10()).powi(2) / 2.0).exp()),
        (VoidageFunction::HenryInterstitial, -1.8 + (-(1.5 - 42f64.log10()).powi(2) / 2.0).exp()),
        (VoidageFunction::DiFelice, -1.7 + 0.65 * (-(1.5 - 21f64.log10()).powi(2) / 2.0).exp()),
        (VoidageFunction::Migflow, -1.8 + 0.65 * (-(1.5 - 21f64.ln()).powi(2) / 2.0).exp()),
        (VoidageFunction::None, 0.0),
    ] {
        let coefficient = 0.5f64.powf(exponent) * (0.63 + 4.8 / 21f64.sqrt()).powi(2);
        let exact = 0.5 * 1.2 * 0.7 * coefficient * 1.5 / 1e-3;
        assert_relative_eq!(Drag::Dallavalle.coefficient(&x, g), exact, max_relative = 1e-12);
    }
}

/// gamma = d rho/2 C_d |u - v| and hA = pi k Nu of a disc per metre of depth, whatever of it is solid; of three quarters of
/// it that much.
#[test]
fn laws_per_disc_have_its_cross_section_and_its_surface() {
    let (x, thermal) = (around(0.7, 0.5), ThermalFluid { conductivity: 0.026, prandtl: 0.7 });
    let coefficient = (0.63 + 4.8 / 21f64.sqrt()).powi(2);
    let disc = std::f64::consts::PI * 0.25e-6;
    for (share, solidity) in [(1.0, 0.476), (1.0, 1.0), (0.75, 0.476)] {
        let inside = (share * solidity * disc, share);
        let drag = Per::Disc.in_drag(inside, 1e-3) * Drag::Dallavalle.coefficient(&x, VoidageFunction::None);
        assert_relative_eq!(drag, share * 1e-3 * 0.5 * 1.2 * 0.7 * coefficient, max_relative = 1e-12);
        let nusselt = HeatTransfer::RanzMarshall.nusselt(&x, 0.7, VoidageFunction::None);
        let law = HeatTransfer::RanzMarshall.coefficient(&x, &thermal, VoidageFunction::None);
        let transfer = Per::Disc.in_heat(inside, 1e-3) * law;
        assert_relative_eq!(transfer, share * std::f64::consts::PI * 0.026 * nusselt, max_relative = 1e-12);
        assert_eq!(
            (Per::Solid.in_drag(inside, 1e-3), Per::Solid.in_heat(inside, 1e-3)),
            (inside.0, inside.0)
        );
    }
}

#[test]
fn gidaspow_gives_the_pressure_drop_of_ergun() {
    // Steady bed of set I: eps dp/dx = phi gamma/V w, w = U/eps; Ergun (1952) for dp/dx.
    let (eps, speed) = (0.45, 0.3);
    let x = around(speed / eps, eps);
    let gradient = (1.0 - eps) / eps * Drag::Gidaspow.coefficient(&x, VoidageFunction::None) * speed / eps;
    let phi: f64 = 1.0 - eps;
    let ergun = 150.0 * phi * phi * 2e-5 * speed / (eps.powi(3) * 1e-6)
        + 1.75 * phi * 1.2 * speed * speed / (eps.powi(3) * 1e-3);
    assert_relative_eq!(gradient, ergun, max_relative = 1e-12);
}

/// The drag over Stokes' in the superficial velocity, by the law that uses no voidage function of the scene.
fn normalised(law: Drag, eps: f64, reynolds: f64) -> f64 {
    // Re_s = eps rho d w / eta.
    let slip = reynolds * 2e-5 / (eps * 1.2 * 1e-3);
    law.normalised(&around(slip, eps), VoidageFunction::None)
}

#[test]
fn every_drag_law_is_listed_once_and_says_so_in_the_schema() {
    let names: Vec<String> = Drag::ALL.iter().map(|law| serde_json::to_string(law).unwrap()).collect();
    let schema = serde_json::to_string(&schemars::schema_for!(Drag)).unwrap();
    assert_eq!(schema.matches("\"const\":").count(), Drag::ALL.len(), "{schema}");
    for (k, name) in names.iter().enumerate() {
        assert!(schema.contains(&format!("\"const\":{name}")) && !names[..k].contains(name), "{name}");
    }
}

#[test]
fn a_single_sphere_at_rest_has_stokes_drag() {
    // Dallavalle's 4.8^2 = 23.04 stands for Stokes' 24.
    for (law, exact) in [
        (Drag::Dallavalle, 0.96),
        (Drag::DiFelice, 0.96),
        (Drag::Rong, 0.96),
        (Drag::WenYu, 1.0),
        (Drag::Gidaspow, 1.0),
        (Drag::KochHill, 1.0),
        (Drag::Beetstra, 1.0),
        (Drag::Tang, 1.0),
    ] {
        assert_relative_eq!(normalised(law, 1.0, 0.0), exact, max_relative = 1e-14);
        // And the way there is smooth.
        assert_relative_eq!(normalised(law, 1.0 - 1e-12, 1e-9), exact, max_relative = 1e-4);
    }
    assert_eq!(normalised(Drag::Ergun, 1.0, 0.0), 0.0, "no sphere is alone in a packed bed");
}

#[test]
fn dense_beds_at_rest_have_the_drag_of_carman() {
    // 180 phi^2 eta U / (eps^3 d^2) of pressure gradient is F = 10 phi / eps^2; Ergun has 150 for 180.
    for eps in [0.3, 0.4, 0.5] {
        let carman = 10.0 * (1.0 - eps) / (eps * eps);
        assert_relative_eq!(normalised(Drag::KochHill, eps, 0.0), carman, max_relative = 1e-13);
        assert_relative_eq!(normalised(Drag::Ergun, eps, 0.0), carman * 150.0 / 180.0, max_relative = 1e-13);
        // What Beetstra and Tang add is below eps^2 (1 + 1.5 sqrt(phi)).
        for law in [Drag::Beetstra, Drag::Tang] {
            let above = normalised(law, eps, 0.0) - carman;
            assert_relative_eq!(above, eps * eps * (1.0 + 1.5 * (1.0 - eps).sqrt()), max_relative = 1e-12);
        }
    }
}

#[test]
fn drag_laws_have_the_values_of_their_formulas() {
    // At phi = 1/2, Re_s = 100, in other arithmetic (100^-0.343 = 0.20606299, log10 = 2, exp(-1/8) = 0.88249690):
    // Ergun       (150/2 + 1.75 x 100) / (18/4)
    // Wen-Yu      (1 + 0.15 x 23.659197) x 2^3.65
    // Koch-Hill   F_0 = 40, F_3 = 0.0673 + 0.106 + 0.7424 = 0.9157: (40 + 45.785)/2
    // Beetstra    20 + (1 + 1.5 sqrt(1/2))/4 + 41.3/6 x (2 + 0.75 + 8.4 x 0.20606299)/(1 + 10^-1.5)
    // Tang        20 + (1 + 1.5 sqrt(1/2))/4 + 8.25 - 7.296 + (0.0845 + 1.0304) x 20.606299
    // Di Felice   1.2321 x 100/24 x 2^beta, beta = 3.7 - 0.65 x 0.88249690
    // Rong        the same with beta = 3.975 - 3.55/4 x 0.88249690
    for (law, exact) in [
        (Drag::Ergun, 55.555556),
        (Drag::WenYu, 57.103657),
        (Drag::KochHill, 42.8925),
        (Drag::Beetstra, 50.413428),
        (Drag::Tang, 44.443128),
        (Drag::DiFelice, 44.829921),
        (Drag::Rong, 46.909137),
    ] {
        assert_relative_eq!(normalised(law, 0.5, 100.0), exact, max_relative = 2e-7);
    }
}

#[test]
fn drag_laws_do_not_jump_where_their_formulas_change() {
    let jump = |law, low: f64, high: f64| {
        let (below, above) = (normalised(law, low, 0.0), normalised(law, high, 0.0));
        (above / below - 1.0).abs()
    };
    // Koch and Hill's two fits of F_0 meet to 1.1 % at phi = 0.4, as printed: 18.33 and 18.52.
    let printed = jump(Drag::KochHill, 0.6 - 1e-9, 0.6 + 1e-9);
    assert!((0.009..0.011).contains(&printed), "{printed}");
    // Beyond the range of its fit Tang's drag coefficient is held.
    let coefficient =
        |reynolds: f64| (normalised(Drag::Tang, 0.9, reynolds) - normalised(Drag::Tang, 0.9, 0.0)) / reynolds;
    assert_relative_eq!(
        coefficient(1000.0 * (1.0 + 1e-9)),
        coefficient(1000.0 * (1.0 - 1e-9)),
        max_relative = 1e-8
    );
    assert_relative_eq!(coefficient(1e5), coefficient(1000.0), max_relative = 1e-12);
}

#[test]
fn drag_grows_with_speed_and_with_crowding() {
    let voidages: Vec<f64> = (0..=13).map(|k| 0.35 + 0.05 * f64::from(k)).collect();
    let numbers: Vec<f64> = (0..=24).map(|k| 10f64.powf(-2.0 + 0.25 * f64::from(k))).collect();
    for law in Drag::ALL {
        for &eps in &voidages {
            let force = |re: &f64| normalised(law, eps, *re) * re;
            assert!(
                numbers.windows(2).all(|pair| force(&pair[1]) > force(&pair[0])),
                "{law:?} at eps = {eps}"
            );
        }
        if law == Drag::Dallavalle {
            continue;
        }
        for re in &numbers {
            let falls = |pair: &&[f64]| normalised(law, pair[0], *re) < normalised(law, pair[1], *re);
            let uphill: Vec<&[f64]> = voidages.windows(2).filter(falls).collect();
            assert!(uphill.is_empty(), "{law:?} at Re = {re}: {uphill:?}");
        }
    }
}

#[test]
fn lift_is_saffmans_in_creeping_flow_and_falls_off_as_mei_says() {
    // Saffman (1965, 1968): 6.46 eta |u - v| a^2 sqrt(K/nu) in a shear of K.
    let creeping = around(1e-4, 1.0);
    let (eta, nu, a, shear) = (2e-5, 2e-5 / 1.2, 5e-4, 0.04);
    let volume = std::f64::consts::PI * 1e-9 / 6.0;
    let force =
        |x: &Surroundings, shear: f64| Lift::SaffmanMei.coefficient(x, shear) * volume * x.slip * shear;
    let saffman = |x: &Surroundings, shear: f64| 6.46 * eta * x.slip * a * a * (shear / nu).sqrt();
    assert_relative_eq!(force(&creeping, shear), saffman(&creeping, shear), max_relative = 1e-3);
    // Re = 30 and 300 at (d/2) K / |u - v| = 0.1: (1 - 0.1048) exp(-3) + 0.1048, and 0.0524 sqrt(0.1 300).
    for (slip, ratio) in [(0.5, 0.149369), (5.0, 0.287007)] {
        let (x, shear) = (around(slip, 1.0), 0.1 * slip / a);
        assert_relative_eq!(force(&x, shear) / saffman(&x, shear), ratio, max_relative = 1e-4);
    }
    assert_eq!(Lift::SaffmanMei.coefficient(&around(0.0, 1.0), 0.0), 0.0);
    assert!(Lift::SaffmanMei.coefficient(&around(0.0, 1.0), 1.0).is_finite());
}
