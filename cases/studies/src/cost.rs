//! What a run is estimated to cost, so that cheap ones come first. Only the order counts; the unit is the work on one
//! grain.

use voidage_scene::{Amount, Coordinates, Fluid, Grains, MeshSource, Placement, Scene, Solver};

/// Work on a node of the Rust solver, measured on the bubbling bed: 12,000 nodes take as long as 300,000 grains.
const NODE: f64 = 25.0;
/// How a step grows with the nodes: factorisations of nested dissection.
const GROWTH: f64 = 1.2;
/// How many nodes or grains a file is taken to hold.
const OF_A_FILE: f64 = 1e4;

/// Steps times the work of each.
pub fn of_scene(scene: &Scene) -> f64 {
    let grains: f64 = scene.grains.iter().map(count).sum();
    // Sweeps grow with the digits that are asked for.
    let tolerance = scene.contacts.as_ref().map_or(1e-3, |contacts| contacts.tolerance);
    let digits = -tolerance.clamp(1e-15, 0.5).log10();
    let fluid = scene.fluid.as_ref().map_or(0.0, fluid);
    scene.time.steps() as f64 * (grains * (1.0 + digits) + fluid)
}

/// How many times longer a solver takes than that in Rust.
pub fn of_solver(solver: &Solver) -> f64 {
    match solver {
        Solver::Rust => 1.0,
        Solver::Serve => 1.1,
        Solver::Fenicsx => 4.0,
        Solver::ScikitFem | Solver::Python(_) | Solver::Attach(_) => 8.0,
    }
}

fn fluid(fluid: &Fluid) -> f64 {
    let nodes = match &fluid.mesh {
        MeshSource::File(_) => OF_A_FILE,
        MeshSource::Rectangle(rectangle) => match &rectangle.structured {
            Some(grid) => grid.squares.iter().map(|squares| *squares as f64 + 1.0).product(),
            None => {
                let area: f64 = (0..2).map(|k| rectangle.upper[k] - rectangle.lower[k]).product();
                // Equilateral triangles: one node for every sqrt(3)/2 h^2.
                area / (0.87
                    * rectangle
                        .size_at([0, 1].map(|k| 0.5 * (rectangle.lower[k] + rectangle.upper[k])))
                        .powi(2))
            }
        },
    };
    let solver = fluid.backend.as_ref().map_or(1.0, |backend| of_solver(&backend.solver));
    NODE * nodes.powf(GROWTH) * solver * fluid.solver.newton as f64
}

fn count(group: &Grains) -> f64 {
    let area = |lower: &Coordinates, upper: &Coordinates| {
        lower.0.iter().zip(&upper.0).map(|(low, high)| (high - low).abs()).product::<f64>()
    };
    let place = match &group.placement {
        Placement::Deposit(place) => area(&place.lower, &place.upper),
        Placement::Lattice(place) => area(&place.lower, &place.upper),
        Placement::Random(place) => area(&place.lower, &place.upper),
        Placement::Csv(_) | Placement::State(_) => return OF_A_FILE,
        // Counted by `amount`, which these have.
        Placement::With(_) => return OF_A_FILE,
        // As many as the box holds, at least.
        Placement::Source(place) => area(&place.lower, &place.upper),
    };
    let disc = group.radius.as_ref().map_or(1.0, |radius| 4.0 * radius.smallest() * radius.largest());
    match group.amount {
        Amount::Count(count) => count as f64,
        Amount::Mass(_) | Amount::Fill => place / disc,
    }
}
