//! Shared helpers of the tests: small systems whose exact behaviour is known.

use nalgebra::SVector;
use std::sync::Arc;
use voidage_coupling::backend::{FluidBackend, FluidStep, RustFluid};
use voidage_coupling::closure::{Drag, HeatTransfer, ThermalFluid, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Fluid, Interaction, Laws};
use voidage_dem::{Dem, Material, Particles, Settings};
use voidage_fluid::Mesh;
use voidage_fluid::conditions::{Condition, FlowCondition, HeatCondition};
use voidage_fluid::exchange::AtBodies;
use voidage_fluid::flow::{HeatProperties, Numerics, State};
use voidage_fluid::forms::Properties;
use voidage_fluid::mesh::{Boundary, Diagonals, Rectangle, Side, Sides, Structured};

/// A vector of the plane.
pub type Vec2 = SVector<f64, 2>;

/// A regular mesh of a box from the origin, its sides called left, right, bottom and top.
pub fn grid(size: [f64; 2], squares: [usize; 2]) -> Mesh<2> {
    let sides = Sides {
        left: Side::named("left"),
        right: Side::named("right"),
        bottom: Side::named("bottom"),
        top: Side::named("top"),
    };
    let structured = Some(Structured { squares, diagonals: Diagonals::Alternating });
    let rectangle = Rectangle {
        lower: [0.0; 2],
        upper: size,
        size: None,
        sides,
        holes: vec![],
        refine: vec![],
        structured,
    };
    Mesh::rectangle(&rectangle).expect("a valid rectangle")
}

/// A fluid of a test.
#[derive(Clone, Debug)]
pub struct FluidSet {
    /// Density and so on.
    pub properties: Properties<2>,
    /// Heat, if any.
    pub heat: Option<HeatProperties>,
    /// Condition of each side.
    pub conditions: Vec<Condition<2>>,
    /// Solvers.
    pub numerics: Numerics,
}

impl FluidSet {
    /// A fluid without gravity and heat, all walls without slip.
    pub fn new(density: f64, viscosity: f64) -> Self {
        let properties = Properties {
            density,
            viscosity,
            gravity: Vec2::zeros(),
            thin_cell_drag: 0.0,
            drag_in_stabilisation: false,
        };
        let conditions = ["left", "right", "bottom", "top"].map(|side| Condition {
            boundary: side.into(),
            flow: FlowCondition::NoSlip,
            heat: HeatCondition::Adiabatic,
        });
        let mut numerics = Numerics::default();
        numerics.flow.tolerance = 1e-12;
        numerics.heat.tolerance = 1e-13;
        Self { properties, heat: None, conditions: conditions.to_vec(), numerics }
    }

    /// The flow condition of a side.
    pub fn flow(mut self, side: &str, flow: FlowCondition<2>) -> Self {
        self.conditions.iter_mut().filter(|c| c.boundary == side).for_each(|c| c.flow = flow.clone());
        self
    }

    /// The fluid on a mesh, with the given fields at the start.
    pub fn build(&self, mesh: Mesh<2>, start: State<2>) -> Fluid<2> {
        let mesh = Arc::new(mesh);
        let mut backend = RustFluid::<2, 3>::new(
            self.properties.clone(),
            self.heat.clone(),
            self.numerics.clone(),
            self.conditions.clone(),
        );
        backend.start(&mesh, &start).expect("a valid fluid");
        let nodal_volume = mesh.nodal_volume();
        Fluid {
            backend: Box::new(backend),
            mesh,
            conditions: self.conditions.clone(),
            ramp: 0.0,
            nodal_volume,
            motion: None,
        }
    }

    /// Fields at rest at a temperature (used with heat only).
    pub fn rest(&self, mesh: &Mesh<2>, temperature: f64) -> State<2> {
        let nodes = mesh.points.len();
        State {
            velocity: vec![Vec2::zeros(); nodes],
            pressure: vec![0.0; nodes],
            temperature: self.heat.as_ref().map(|_| vec![temperature; nodes]),
        }
    }

    /// Grains in the fluid; without gravity unless the settings have it.
    pub fn with_grains(&self, fluid: Fluid<2>, grains: Dem<2>, laws: Laws, scheme: SchemeName) -> Coupled<2> {
        let count = grains.particles.len();
        let at = AtBodies {
            velocity: vec![Vec2::zeros(); count],
            pressure_gradient: vec![Vec2::zeros(); count],
            temperature: vec![0.0; if laws.thermal.is_some() { count } else { 0 }],
        };
        let interaction = Interaction::new(laws, &fluid.mesh, &grains, at).expect("a valid mesh");
        Coupled::new(Some(grains), Some(fluid), Some(interaction), scheme.build())
    }

    /// Dallavalle's drag and the laws of Ranz and Marshall without correction for neighbours.
    pub fn laws(&self, thermal: Option<ThermalFluid>) -> Laws {
        Laws {
            drag: Drag::Dallavalle,
            voidage_function: VoidageFunction::None,
            heat: HeatTransfer::RanzMarshall,
            density: self.properties.density,
            viscosity: self.properties.viscosity,
            thermal,
        }
    }
}

/// Grains without rotation and heat at the given places.
pub fn grains(position: Vec<Vec2>, radius: f64, material: Material, settings: Settings<2>) -> Dem<2> {
    let particles = alike(position, radius, &material);
    Dem::new(particles, vec![], vec![material], settings).expect("valid grains")
}

/// The same with a temperature (K).
pub fn hot_grains(
    position: Vec<Vec2>,
    radius: f64,
    material: Material,
    settings: Settings<2>,
    temperature: f64,
) -> Dem<2> {
    let particles = alike(position, radius, &material);
    let heated = particles.heated(temperature, std::slice::from_ref(&material)).expect("valid heat");
    Dem::new(heated, vec![], vec![material], settings).expect("valid grains")
}

fn alike(position: Vec<Vec2>, radius: f64, material: &Material) -> Particles<2> {
    let count = position.len();
    let materials = std::slice::from_ref(material);
    Particles::new(position, vec![radius; count], vec![0; count], materials).expect("valid grains")
}

/// One grain at the centroid of every cell: a mixture whose voidage is the same at every node.
pub fn one_per_cell(mesh: &Mesh<2>) -> Vec<Vec2> {
    (0..mesh.cell_count()).map(|cell| mesh.centroid(cell)).collect()
}

/// A regular polygon of `sides` corners round the origin, radius 1 m, cut like a cake; its boundary is called rim.
pub fn cake(sides: usize) -> Mesh<2> {
    let corner = |k: usize| {
        let angle = 2.0 * std::f64::consts::PI * k as f64 / sides as f64;
        Vec2::new(angle.cos(), angle.sin())
    };
    let points = std::iter::once(Vec2::zeros()).chain((0..sides).map(corner)).collect();
    let next = |k: usize| 1 + (k + 1) % sides;
    let cells = (0..sides).flat_map(|k| [0, 1 + k as u32, next(k) as u32]).collect();
    let facets = (0..sides).flat_map(|k| [1 + k as u32, next(k) as u32]).collect();
    let rim = Boundary { name: "rim".into(), facets, cells: (0..sides as u32).collect() };
    Mesh { points, cells, boundaries: vec![rim] }
}

/// Three grains in every cell, where a rule with equal weights is exact to degree 2: sums over them equal the
/// integrals of products of linear fields.
pub fn three_per_cell(mesh: &Mesh<2>) -> Vec<Vec2> {
    let places = mesh.cells.chunks_exact(3).flat_map(|cell| {
        let corner = |k: usize| mesh.points[cell[k % 3] as usize];
        (0..3).map(move |k| corner(k) * (2.0 / 3.0) + (corner(k + 1) + corner(k + 2)) / 6.0)
    });
    places.collect()
}

/// Steps of `dt` of a fluid without grains.
pub fn steps_alone(fluid: &mut Fluid<2>, dt: f64, count: u64) {
    for number in 1..=count {
        let time = (number - 1) as f64 * dt;
        let step = FluidStep { number, time, dt, grains: None, conditions: &fluid.conditions, motion: None };
        fluid.backend.solve(&step, &mut AtBodies::default()).expect("a step");
        fluid.backend.accept();
    }
}

/// Contacts off the stage: no gravity.
pub fn weightless() -> Settings<2> {
    Settings { gravity: Vec2::zeros(), ..Settings::default() }
}
