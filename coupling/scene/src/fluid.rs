//! The tables of the fluid, its boundaries, and its coupling to the grains.

use super::{Backend, Coordinates, MotionTable};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use voidage_coupling::closure::{Drag, HeatTransfer, Lift, Per, VoidageFunction};
use voidage_coupling::remesh::Remesh;
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::scheme::cut::Cutting;
use voidage_coupling::scheme::iterated::Iteration;
use voidage_coupling::scheme::sub_cycled::SubCycling;
use voidage_fluid::mesh::Rectangle;
use voidage_fluid::transport::Form;

/// The fluid: volume-averaged Navier-Stokes on a mesh.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fluid {
    /// Density, kg/m3. Above 0.
    pub density: f64,
    /// Dynamic viscosity, Pa s. Above 0.
    pub viscosity: f64,
    /// Velocity at the start, m/s. Default: at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_velocity: Option<Coordinates>,
    /// Acceleration of the fluid in addition to `gravity`, m/s2, which drives a flow between periodic sides. It acts on
    /// the fluid alone: grains feel it through drag and through the pressure gradient that balances it. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body_force: Option<Coordinates>,
    /// Time over which prescribed velocities grow linearly from 0, s. Default 0: they have their full value at the
    /// start.
    #[serde(default)]
    pub ramp: f64,
    /// Where the mesh comes from: `{rectangle = {..}}` or `{file = "name.msh"}`.
    pub mesh: MeshSource,
    /// How the mesh moves. Default: it stands still.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh_motion: Option<MeshMotion>,
    /// Temperature of the fluid. Default: none, the fluid has no temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heat: Option<FluidHeat>,
    /// Further scalars that the fluid carries: tracers, a concentration. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scalars: Vec<FluidScalar>,
    /// Drag and heat of the front and rear walls of a thin cell (plane only). Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thin_cell: Option<ThinCell>,
    /// Conditions, by the names of the boundaries. Where two boundaries meet, the later one in this list applies. Every
    /// boundary of the mesh needs one, but for periodic sides and the hole of a droplet.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boundaries: Vec<Boundary>,
    /// How the equations are solved. Default: the defaults of its keys.
    #[serde(default)]
    pub solver: FluidSolver,
    /// Which program solves them. Default: the Rust solver in the process of the grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backend: Option<Backend>,
}

/// Where the mesh comes from.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MeshSource {
    /// A rectangle, of which the program makes the mesh.
    Rectangle(Rectangle),
    /// A Gmsh .msh file (format 4.1 or 2.2, text or binary) with physical names, path relative to the scene.
    File(PathBuf),
}

/// A mesh that moves: each node is displaced by its weight times a displacement, `amplitude sin(2 pi frequency t)` or that
/// of a `table`. The weight is 1 on the boundary that moves, 0 on the others, and smooth between them. A moving no-slip
/// wall takes the fluid along, a moving slip wall pushes it. The walls that the grains meet (`[[walls]]`) have a motion of
/// their own, which may be the same table.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshMotion {
    /// Largest displacement of an oscillation, m. Without `remesh` no cell may be inverted on the way.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub amplitude: Coordinates,
    /// Frequency of the oscillation, 1/s. Above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency: Option<f64>,
    /// A table of times and places instead of an oscillation, whose first row has neither displacement nor angle. It
    /// needs `boundary`; with angles also `centre`, and an open boundary. With a `centre`, `series.csv` has the fluid's
    /// torque.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<MotionTable>,
    /// Name of the part of the boundary that moves. Default: none; only the nodes inside the mesh oscillate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub boundary: Option<String>,
    /// Names of straight parts of the boundary, parallel to the motion of a `table`, along which nodes slide, such as the
    /// walls beside a piston. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sliding: Vec<String>,
    /// When the domain is remeshed, with the same boundary. Default: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remesh: Option<Remesh>,
}

/// Temperature of the fluid.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FluidHeat {
    /// Heat capacity at constant pressure, J/(kg K). Above 0.
    pub heat_capacity: f64,
    /// Thermal conductivity, W/(m K). Above 0.
    pub conductivity: f64,
    /// Thermal expansion coefficient of the Boussinesq buoyancy, 1/K. Default 0: no buoyancy.
    #[serde(default)]
    pub expansion: f64,
    /// Temperature at which the buoyancy is zero, K. Default: the initial temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_temperature: Option<f64>,
    /// Temperature at the start, K.
    pub initial_temperature: f64,
    /// How the equation is discretised: `"consistent"` (as Henry et al.), `"lumped"` or `"monotone"`. Default
    /// `"consistent"`.
    #[serde(default)]
    pub form: Form,
}

/// A scalar s that is convected and diffuses in the fluid: eps Ds/Dt = div(eps diffusivity grad s).
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FluidScalar {
    /// Its name, in conditions and output. Letters, digits and `_`.
    pub name: String,
    /// Diffusivity, m2/s. Above 0.
    pub diffusivity: f64,
    /// Value at the start. Default 0.
    #[serde(default)]
    pub initial: f64,
    /// Expansion coefficient of the Boussinesq buoyancy, per unit of the scalar. Default 0: no buoyancy.
    #[serde(default)]
    pub expansion: f64,
    /// Value at which the buoyancy is zero. Default: the initial value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<f64>,
    /// How the equation is discretised: `"consistent"`, `"lumped"` or `"monotone"`. Default `"consistent"`.
    #[serde(default)]
    pub form: Form,
}

/// Front and rear walls of a thin cell, averaged over its thickness.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ThinCell {
    /// Drag coefficient per volume, kg/(m3 s): `12 viscosity / thickness^2` for a Poiseuille profile.
    pub drag: f64,
    /// Heat exchanged with the two walls. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heat: Option<ThinCellHeat>,
}

/// Heat exchanged with the front and rear walls of a thin cell.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ThinCellHeat {
    /// Coefficient per volume, W/(m3 K).
    pub coefficient: f64,
    /// Temperature of the walls, K.
    pub temperature: f64,
}

/// The conditions on one named part of the boundary.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Boundary {
    /// Name of the part, as the mesh has it.
    pub name: String,
    /// Condition of the flow: `{velocity = [..]}`, `{superficial_velocity = [..]}`, `"no-slip"`, `"slip"` or
    /// `{open = {pressure = 0.0}}`, in short `"open"`.
    pub flow: Flow,
    /// Rows `[time, factor]`: a prescribed velocity is multiplied by the factor, which is linear between rows and
    /// constant before the first and after the last. Default: none, the velocity stays.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub schedule: Vec<[f64; 2]>,
    /// Condition of the temperature: `{temperature = T}`, `{newton = {coefficient = h, temperature = T}}`,
    /// `"adiabatic"` or `{open = {temperature = T}}`. Default: adiabatic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heat: Option<HeatBoundary>,
    /// Conditions of other scalars by name: `{tracer = {value = 1.0}}`, `{transfer = {coefficient = h, outside = s}}`,
    /// `"insulated"` or `{outflow = {outside = s}}`, in short `"outflow"`. Default: insulated.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub scalars: BTreeMap<String, ScalarBoundary>,
}

/// Condition of the flow.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Flow {
    /// Prescribed interstitial velocity, m/s.
    Velocity(Coordinates),
    /// Prescribed velocity times voidage, m/s.
    #[serde(rename = "superficial_velocity")]
    SuperficialVelocity(Coordinates),
    /// The fluid has the velocity of the wall.
    NoSlip,
    /// The fluid slides along the wall.
    Slip,
    /// Open to an outer pressure; fluid may leave and enter.
    Open {
        /// Outer pressure, Pa. Default 0.
        #[serde(default)]
        pressure: f64,
    },
}

/// Condition of the temperature.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum HeatBoundary {
    /// Prescribed temperature, K.
    Temperature(f64),
    /// Newton cooling.
    Newton {
        /// Heat-transfer coefficient, W/(m2 K).
        coefficient: f64,
        /// Temperature outside, K.
        temperature: f64,
    },
    /// No heat passes.
    Adiabatic,
    /// Heat leaves with the fluid.
    Open {
        /// Temperature of fluid that enters, K. Default: fluid enters with the temperature it has at the boundary.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        temperature: Option<f64>,
    },
}

/// Condition of a scalar.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ScalarBoundary {
    /// Prescribed value.
    Value(f64),
    /// Transfer from outside.
    Transfer {
        /// Transfer coefficient, m/s. At least 0.
        coefficient: f64,
        /// Value outside.
        outside: f64,
    },
    /// Nothing passes.
    Insulated,
    /// The scalar leaves with the fluid.
    Outflow {
        /// Value of fluid that enters. Default: fluid enters with the value it has at the boundary.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        outside: Option<f64>,
    },
}

/// How the equations of the fluid are solved.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FluidSolver {
    /// Linear solver. Default `"auto"`: the fastest for the dimension.
    pub linear: LinearMethod,
    /// Relative residual of the linear systems. Above 0 and at most 1e-2, because with more, wrong fields would count
    /// as solved. Default 1e-8.
    pub tolerance: f64,
    /// Newton iterations per time step. Default 1.
    pub newton: usize,
}

impl Default for FluidSolver {
    fn default() -> Self {
        FluidSolver { linear: LinearMethod::Auto, tolerance: 1e-8, newton: 1 }
    }
}

/// Linear solvers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LinearMethod {
    /// The fastest for the dimension: in the plane a factorisation that is kept over several steps, with iterative
    /// refinement.
    #[serde(alias = "kept")]
    Auto,
    /// A new factorisation in every step, which is the safe choice.
    Direct,
    /// GMRES with an incomplete factorisation as preconditioner.
    Ilu,
}

/// How grains and fluid act on each other.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Coupling {
    /// Coupling scheme: `"iterated"`, `"anchored"`, `"henry"`, `"henry-free"`, `"lagged"`, `"explicit"`, `"strang"`,
    /// `"sub-cycled"`, `"sub-cycled-explicit"`, `"gauss-seidel"`, or one of your own, `"python:FILE[:CLASS]"`, whose file
    /// is beside the scene where its path is relative. Default `"iterated"`.
    pub scheme: SchemeName,
    /// Tolerance and relaxation of the schemes `"iterated"` and `"gauss-seidel"`. Default: the defaults of its keys.
    pub iteration: Iteration,
    /// Steps of the grains in one of the fluid, of the schemes `"sub-cycled"` and `"sub-cycled-explicit"`. Default: the
    /// defaults of its keys.
    #[serde(skip_serializing_if = "is_default")]
    pub sub_cycling: SubCycling,
    /// What a scheme of your own is made with, by keyword: `{ tolerance = 1e-3 }` for `Mine(tolerance=1e-3)`. Default:
    /// nothing.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub scheme_options: BTreeMap<String, serde_json::Value>,
    /// Steps in parts: a step in which a grain moves further than `travel`, or in which the scheme `"iterated"` does
    /// not reach its tolerance, is done in halves, quarters and so on, down to parts of 1/64. `{}` means the defaults
    /// of its keys. Default: steps are not divided.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut: Option<Cutting>,
    /// Drag law; `voidage closures` draws them. All but `"dallavalle"` contain the effect of neighbouring grains and do
    /// not use `voidage_function`. Default `"dallavalle"`.
    pub drag: Drag,
    /// Voidage function of the drag law `"dallavalle"` and of the heat-transfer law `"henry"`: `"henry"`,
    /// `"henry-interstitial"`, `"di-felice"`, `"migflow"` or `"none"`. Default `"henry"`.
    pub voidage_function: VoidageFunction,
    /// Law of heat transfer between grains and fluid: `"henry"` (times the voidage function), `"gunn"`,
    /// `"ranz-marshall"` or `"wakao"`. Default `"henry"` when both have a temperature, else none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heat: Option<HeatTransfer>,
    /// What of a grain the laws of drag and heat transfer act on, in the fluid and in the water of a droplet: `"solid"`,
    /// its solid volume, as of so many spheres of its diameter; or `"disc"`, its whole disc, with the cross-section d and
    /// the surface pi d per metre of depth, whatever `solidity` it has. Default "solid".
    #[serde(skip_serializing_if = "is_default")]
    pub per: Per,
    /// Width over which the fluid meets a grain, in diameters of the grain: its solid, drag and heat are spread over a
    /// disc so wide. At least 1, the grain itself. Beds with elements smaller than a grain need 2, since a law of drag
    /// is a mean over grains and gaps. Default 1.
    pub kernel: f64,
    /// Added mass of a grain over the mass of the fluid that it displaces: 0.5 for spheres, 1 for long cylinders. It
    /// matters where the fluid is not much lighter than the grains. Not for the scheme `"explicit"`, which knows no
    /// acceleration of the grains, and not beside a droplet. Default 0.
    pub added_mass: f64,
    /// Law of lift of grains in a fluid that shears: `"saffman-mei"`. Not beside a droplet. Default: no
    /// lift.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lift: Option<Lift>,
    /// Values of scalars of the fluid, by name, below which contacts are cohesive (`contacts.cohesion`):
    /// `{vapour = 0.9}`. The value is the mean over a grain at the start of the step, and it must be below the bound
    /// for both grains of a contact. Default: none, cohesion acts everywhere.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub cohesion_below: BTreeMap<String, f64>,
    /// Length l over which cohesion recovers round the droplet, in radii r of it: at a distance s from its centre
    /// contacts have the share 1 - exp(-(s^2 - r^2)/(l r)^2) of `contacts.cohesion.force`, and none in the water. Above
    /// 0. Default: it does not fall off.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cohesion_halo: Option<f64>,
}

impl Coupling {
    /// What the scheme is told.
    pub fn options(&self) -> voidage_coupling::scheme::Options {
        voidage_coupling::scheme::Options {
            iteration: self.iteration.clone(),
            cut: self.cut,
            sub_cycling: self.sub_cycling,
            own: self.scheme_options.clone(),
        }
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for Coupling {
    fn default() -> Self {
        Coupling {
            scheme: SchemeName::default(),
            iteration: Iteration::default(),
            sub_cycling: SubCycling::default(),
            scheme_options: BTreeMap::new(),
            cut: None,
            drag: Drag::Dallavalle,
            voidage_function: VoidageFunction::Henry,
            heat: None,
            per: Per::Solid,
            kernel: 1.0,
            added_mass: 0.0,
            lift: None,
            cohesion_below: BTreeMap::new(),
            cohesion_halo: None,
        }
    }
}
