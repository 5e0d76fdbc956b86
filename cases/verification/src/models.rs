//! Small systems whose exact behaviour is known: what verification, the map of stability and the tests are made of.

use nalgebra::SVector;
use std::sync::OnceLock;
use voidage_coupling::backend::{FluidStep, Model, RustFluid};
use voidage_coupling::closure::{Drag, HeatTransfer, Per, Surroundings, ThermalFluid, VoidageFunction};
use voidage_coupling::exchange::AtGrains;
use voidage_coupling::scheme::iterated::Iteration;
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::unsteady::Unsteady;
use voidage_coupling::{Coupled, Fluid, Interaction, Laws, Mixture, Result, System};
use voidage_dem::{Dem, Material, Particles, Settings, Wall};
use voidage_fluid::conditions::{Condition, FlowCondition};
use voidage_fluid::flow::{Numerics, State};
use voidage_fluid::forms::Properties;
use voidage_fluid::mesh::{Boundary, Diagonals, Periodic, Rectangle, Side, Sides, Structured};
use voidage_fluid::points::Points;
use voidage_fluid::transport::Scalar;
use voidage_fluid::{Flow, Mesh};

/// A vector of the plane.
pub type Vec2 = SVector<f64, 2>;

/// Where something that grows from 0 on leaves off being `below`: [0, high] halved so many times.
pub fn bisect(high: f64, halvings: usize, below: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, high);
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        if below(middle) { low = middle } else { high = middle }
    }
    low
}

/// A regular mesh of a box from the origin, its sides called left, right, bottom and top.
pub fn grid(size: [f64; 2], squares: [usize; 2]) -> Result<Mesh<2>> {
    box_mesh(size, squares, Diagonals::Alternating)
}

/// The same with diagonals that are parallel: all nodes inside have cells alike, so that a lattice of grains weighs the
/// same on each.
pub fn parallel(size: [f64; 2], squares: [usize; 2]) -> Result<Mesh<2>> {
    box_mesh(size, squares, Diagonals::Rising)
}

/// The same one square wide. Grains in its middle weigh the same on both sides of every height but the lowest and
/// highest: a column of one dimension.
pub fn column(size: [f64; 2], squares: usize) -> Result<Mesh<2>> {
    parallel(size, [1, squares])
}

/// Grains on top of each other in the middle of a column, between smooth walls and above a floor (the first wall).
pub fn pile(
    height: &[f64],
    radius: f64,
    width: f64,
    material: Material,
    settings: Settings<2>,
) -> Result<Dem<2>> {
    let places = height.iter().map(|y| Vec2::new(0.5 * width, *y)).collect();
    let particles = alike(places, radius, &material)?;
    let top = height.iter().copied().fold(0.0, f64::max) + 1e3 * radius;
    let [a, b, c, d] = [[0.0, 0.0], [width, 0.0], [0.0, top], [width, top]].map(Vec2::from);
    let walls = vec![Wall::new("floor", a, b), Wall::new("left", a, c), Wall::new("right", b, d)];
    Ok(Dem::new(particles, walls, vec![material], settings)?)
}

/// A box without order, with edges of a mean length, its sides called as those of [`grid`].
pub fn unstructured(size: [f64; 2], edge: f64) -> Result<Mesh<2>> {
    Ok(Mesh::rectangle(&Rectangle { size: Some(edge), ..box_of(size) })?)
}

fn box_mesh(size: [f64; 2], squares: [usize; 2], diagonals: Diagonals) -> Result<Mesh<2>> {
    let structured = Some(Structured { squares, diagonals });
    Ok(Mesh::rectangle(&Rectangle { structured, ..box_of(size) })?)
}

fn box_of(upper: [f64; 2]) -> Rectangle {
    let sides = Sides {
        left: Side::named("left"),
        right: Side::named("right"),
        bottom: Side::named("bottom"),
        top: Side::named("top"),
    };
    let lower = [0.0; 2];
    Rectangle { lower, upper, size: None, sides, holes: vec![], refine: vec![], structured: None }
}

/// A fluid with its conditions.
#[derive(Clone, Debug)]
pub struct FluidSet {
    /// Density and so on.
    pub properties: Properties<2>,
    /// What it transports; the temperature first, if it has one.
    pub scalars: Vec<Scalar>,
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
            body_force: Vec2::zeros(),
            thin_cell_drag: 0.0,
        };
        let conditions = ["left", "right", "bottom", "top"].map(|side| Condition {
            boundary: side.into(),
            flow: FlowCondition::NoSlip,
            scalars: vec![],
        });
        let mut numerics = Numerics::default();
        numerics.flow.tolerance = 1e-12;
        numerics.scalars.tolerance = 1e-13;
        Self { properties, scalars: vec![], conditions: conditions.to_vec(), numerics }
    }

    /// The flow condition of a side.
    pub fn flow(mut self, side: &str, flow: FlowCondition<2>) -> Self {
        self.conditions.iter_mut().filter(|c| c.boundary == side).for_each(|c| c.flow = flow.clone());
        self
    }

    /// The equations alone on a mesh, with the given fields at the start: no backend around them.
    pub fn equations(&self, mesh: Mesh<2>, start: State<2>) -> Result<Flow<2, 3>> {
        let properties = self.properties.clone();
        Ok(Flow::new(mesh, properties, &self.scalars, &self.conditions, start, &self.numerics)?)
    }

    /// The fluid on a mesh, with the given fields at the start.
    pub fn build(&self, mesh: Mesh<2>, start: State<2>) -> Result<Fluid<2>> {
        let backend = RustFluid::<2, 3>::new(Model {
            properties: self.properties.clone(),
            scalars: self.scalars.clone(),
            numerics: self.numerics.clone(),
            conditions: self.conditions.clone(),
        });
        let names = self.scalars.iter().map(|scalar| scalar.name.clone()).collect();
        Fluid::new(Box::new(backend), mesh, start, names, self.conditions.clone())
    }

    /// Fields at rest, all scalars of one value.
    pub fn rest(&self, mesh: &Mesh<2>, value: f64) -> State<2> {
        let nodes = mesh.points.len();
        State {
            velocity: vec![Vec2::zeros(); nodes],
            pressure: vec![0.0; nodes],
            scalars: vec![vec![value; nodes]; self.scalars.len()],
        }
    }

    /// Grains in the fluid; without gravity unless the settings have it.
    pub fn with_grains(
        &self,
        fluid: Fluid<2>,
        grains: Dem<2>,
        laws: Laws,
        scheme: SchemeName,
    ) -> Result<Coupled<2>> {
        let count = grains.particles.len();
        let at = AtGrains {
            velocity: vec![Vec2::zeros(); count],
            pressure_gradient: vec![Vec2::zeros(); count],
            temperature: vec![0.0; if laws.thermal.is_some() { count } else { 0 }],
        };
        let interaction = Interaction::new(laws, &fluid.mesh, &grains, at)?;
        let system = System::Mixture(Box::new(Mixture::new(grains, fluid, interaction)));
        let scheme = INSTEAD.get().copied().unwrap_or(scheme);
        Ok(Coupled::new(system, scheme.build(&Options::default())?))
    }

    /// Dallavalle's drag and the laws of Ranz and Marshall without correction for neighbours.
    pub fn laws(&self, thermal: Option<ThermalFluid>) -> Laws {
        Laws {
            drag: Drag::Dallavalle,
            voidage_function: VoidageFunction::None,
            heat: HeatTransfer::RanzMarshall,
            per: Per::Solid,
            unsteady: Unsteady::default(),
            kernel: 1.0,
            density: self.properties.density,
            viscosity: self.properties.viscosity,
            thermal,
        }
    }
}

/// Grains without rotation and heat at the given places.
pub fn grains(position: Vec<Vec2>, radius: f64, material: Material, settings: Settings<2>) -> Result<Dem<2>> {
    let particles = alike(position, radius, &material)?;
    Ok(Dem::new(particles, vec![], vec![material], settings)?)
}

/// The same with a temperature (K).
pub fn hot_grains(
    position: Vec<Vec2>,
    radius: f64,
    material: Material,
    settings: Settings<2>,
    temperature: f64,
) -> Result<Dem<2>> {
    let particles = alike(position, radius, &material)?;
    let heated = particles.heated(temperature, std::slice::from_ref(&material))?;
    Ok(Dem::new(heated, vec![], vec![material], settings)?)
}

/// The grains alone.
pub fn alike(position: Vec<Vec2>, radius: f64, material: &Material) -> Result<Particles<2>> {
    let count = position.len();
    let materials = std::slice::from_ref(material);
    Ok(Particles::new(position, vec![radius; count], vec![0; count], materials)?)
}

/// One grain at the centroid of every cell: a mixture whose voidage is the same at every node.
pub fn one_per_cell(mesh: &Mesh<2>) -> Vec<Vec2> {
    (0..mesh.cell_count()).map(|cell| mesh.centroid(cell)).collect()
}

/// A box without an end, periodic along both axes, of so many squares of 1 m along each: a mixture that is the same
/// everywhere stays so.
pub fn endless(squares: usize) -> Result<Mesh<2>> {
    let mut mesh = parallel([squares as f64; 2], [squares; 2])?;
    mesh.join_sides([true; 2])?;
    Ok(mesh)
}

/// A ring round the origin between two radii (m), cut along `rings` circles whose radii grow by one factor and
/// `sectors` rays; its boundaries are called inner and outer.
pub fn annulus(inner: f64, outer: f64, rings: usize, sectors: usize) -> Mesh<2> {
    let place = |ring: usize, sector: usize| {
        let radius = inner * (outer / inner).powf(ring as f64 / rings as f64);
        let angle = 2.0 * std::f64::consts::PI * sector as f64 / sectors as f64;
        Vec2::new(radius * angle.cos(), radius * angle.sin())
    };
    let node = |ring: usize, sector: usize| (ring * sectors + sector % sectors) as u32;
    let all = (0..=rings).flat_map(|ring| (0..sectors).map(move |sector| (ring, sector)));
    let points = all.map(|(ring, sector)| place(ring, sector)).collect();
    let mut cells = Vec::new();
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b] = [node(ring, sector), node(ring + 1, sector)];
            let [c, d] = [node(ring + 1, sector + 1), node(ring, sector + 1)];
            // Diagonals that alternate like a chequerboard prefer no direction.
            match (ring + sector) % 2 {
                0 => cells.extend([a, b, c, a, c, d]),
                _ => cells.extend([a, b, d, b, c, d]),
            }
        }
    }
    // The cell with the side on the boundary: inside the first or second of each square, outside always one of two.
    let at = |ring: usize, sector: usize, second: bool| {
        (2 * (ring * sectors + sector) + usize::from(second)) as u32
    };
    let even = |ring: usize, sector: usize| (ring + sector).is_multiple_of(2);
    let inside = Boundary {
        name: "inner".into(),
        facets: (0..sectors).flat_map(|k| [node(0, k + 1), node(0, k)]).collect(),
        cells: (0..sectors).map(|k| at(0, k, even(0, k))).collect(),
    };
    let outside = Boundary {
        name: "outer".into(),
        facets: (0..sectors).flat_map(|k| [node(rings, k), node(rings, k + 1)]).collect(),
        cells: (0..sectors).map(|k| at(rings - 1, k, !even(rings - 1, k))).collect(),
    };
    Mesh { points, cells, boundaries: vec![inside, outside], periodic: Periodic::default() }
}

/// Three points in each cell that fill all but the voidage and do not move, with a drag per volume.
pub fn held_points(mesh: &Mesh<2>, voidage: f64, drag: f64) -> Points<2> {
    let places = three_per_cell(mesh);
    let area = |q: usize| mesh.measure(q / 3) / 3.0;
    let (none, still) = (vec![0.0; places.len()], vec![Vec2::zeros(); places.len()]);
    Points {
        cell: (0..places.len() as u32).map(|q| q / 3).collect(),
        coordinate: places.iter().enumerate().map(|(q, x)| mesh.barycentric(q / 3, x)).collect(),
        volume: (0..places.len()).map(|q| (1.0 - voidage) * area(q)).collect(),
        drag: (0..places.len()).map(|q| drag * area(q)).collect(),
        mobility: none.clone(),
        velocity: still.clone(),
        flux_mobility: none,
        flux_velocity: still,
        scalars: vec![],
    }
}

/// Moves the points of a mesh of the unit square towards its sides: x becomes x - share sin(2 pi x) / (2 pi), likewise
/// y.
pub fn crowd_at_walls(mesh: &mut Mesh<2>, share: f64) {
    let full = 2.0 * std::f64::consts::PI;
    mesh.points.iter_mut().for_each(|x| *x -= x.map(|x| share * (full * x).sin() / full));
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
pub fn steps_alone(fluid: &mut Fluid<2>, dt: f64, count: u64) -> Result<()> {
    for number in 1..=count {
        let time = (number - 1) as f64 * dt;
        let step =
            FluidStep { number, time, dt, immersed: None, conditions: &fluid.conditions, motion: None };
        fluid.backend.solve(&step, &mut fluid.solution)?;
        fluid.accept(dt)?;
    }
    Ok(())
}

/// Contacts off the stage: no gravity.
pub fn weightless() -> Settings<2> {
    Settings { gravity: Vec2::zeros(), ..Settings::default() }
}

/// Speeds so small that drag is linear and convection is below round-off.
pub const CREEP: f64 = 1e-18;

/// A homogeneous mixture without an end whose grains move as one, the fluid at rest: no strain and no divergence, so that
/// nothing but drag acts. The slip decays at the sum of the rates.
pub struct SlipBox {
    /// Grains and fluid.
    pub system: Coupled<2>,
    /// Drag per volume of mixture over the density of the fluid per volume, 1/s.
    pub fluid_rate: f64,
    /// The same of the grains.
    pub grain_rate: f64,
}

impl SlipBox {
    /// The box with a coupling scheme.
    pub fn new(scheme: SchemeName, options: &Options) -> Result<Self> {
        let (rho_f, eta, rho_s, radius, phi) = (3.0, 1e-2, 7.0, 0.01, 0.4);
        let mut set = FluidSet::new(rho_f, eta);
        set.conditions.clear();
        let mesh = endless(4)?;
        let start = set.rest(&mesh, 0.0);
        let mut grains = grains(three_per_cell(&mesh), radius, Material::default(), weightless())?;
        let particles = &mut grains.particles;
        let volume = phi * mesh.measure(0) / 3.0;
        particles.volume.fill(volume);
        particles.mass.fill(rho_s * volume);
        particles.velocity.fill(Vec2::new(0.6, 0.8) * CREEP);
        let (voidage, diameter) = (1.0 - phi, 2.0 * radius);
        let around = Surroundings { slip: 0.0, voidage, diameter, density: rho_f, viscosity: eta };
        let laws = set.laws(None);
        let beta = phi * laws.drag.coefficient(&around, VoidageFunction::None);
        let (fluid_rate, grain_rate) = (beta / ((1.0 - phi) * rho_f), beta / (phi * rho_s));
        let mut system = set.with_grains(set.build(mesh, start)?, grains, laws, scheme)?;
        system.set_scheme(scheme.build(options)?);
        Ok(Self { system, fluid_rate, grain_rate })
    }

    /// Velocity of a node of the fluid less that of a grain, m/s.
    pub fn slip(&self) -> f64 {
        slip(&self.system, false)
    }
}

/// The scheme that a command of this process puts in the place of those of all problems.
static INSTEAD: OnceLock<SchemeName> = OnceLock::new();

/// From now on all problems with grains in a fluid take this scheme; the first word counts.
pub fn take_scheme(scheme: SchemeName) {
    INSTEAD.get_or_init(|| scheme);
}

/// The same as a change of a scene, `KEY=VALUE`; none where problems keep their schemes.
pub fn scheme_setting() -> Option<String> {
    INSTEAD.get().map(|scheme| format!("coupling.scheme={:?}", scheme.name()))
}

/// Options with which a scheme follows its closed form to rounding: what iterates without the slopes of free grains
/// does so until grains and fluid agree.
pub fn exact_options(scheme: SchemeName) -> Options {
    match scheme {
        SchemeName::GaussSeidel => Options {
            iteration: Iteration { tolerance: 1e-8, heat_tolerance: 1e-8, most: 60, ..Iteration::default() },
            ..Options::default()
        },
        _ => Options::default(),
    }
}

/// Horizontal velocity of a node of the fluid, less that of a grain unless they are held, m/s.
pub fn slip(system: &Coupled<2>, held: bool) -> f64 {
    let fluid = system.fluid().map_or(f64::NAN, |fluid| fluid.accepted.velocity[1].x);
    let grain = system.grains().map_or(f64::NAN, |grains| grains.particles.velocity[10].x);
    if held { fluid } else { fluid - grain }
}
