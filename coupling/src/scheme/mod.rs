//! Coupling schemes: what the grains are expected to do while the fluid is solved.
//!
//! The fluid never knows the scheme. For each grain it gets the affine law of the velocity that the grain will
//! have, v* = b + a f with f = gamma u - V grad p; the force on the grain is f - gamma v*, and the fluid gets the
//! opposite by the same law, so momentum is conserved to round-off. Heat likewise. Schemes differ in a and b:
//!
//! | scheme | law | grains move by |
//! |---|---|---|
//! | [`explicit`] | a = 0, b = v_n | the force of the law |
//! | [`henry`] | the motion of a free grain under the last contact force, or under none | the force of the law |
//! | [`lagged`] | the same without contacts; the solid flux from v_n | the force of the law |
//! | [`sub_cycled`] | a = 0, b = v_n | f and the drag of each of several steps |
//! | [`strang`] | a = 0, b = v after half a step | f and implicit drag, by halves |
//! | [`anchored`] | the response of the grains, contacts included, and its slope | f and implicit drag |
//! | [`iterated`] | the same, again until grains and fluid agree | f and implicit drag |
//! | [`gauss_seidel`] | the response without its slope, again until grains and fluid agree | f and implicit drag |
//! | [`own`] | as you like | as you like |

pub mod anchored;
pub mod cut;
pub mod explicit;
pub mod gauss_seidel;
pub mod henry;
pub mod iterated;
pub mod lagged;
pub mod own;
pub mod relaxation;
pub mod strang;
pub mod sub_cycled;

use self::cut::{Cut, Cutting};
use self::gauss_seidel::GaussSeidel;
use self::iterated::{Iterated, Iteration};
use self::own::Own;
use self::strang::Strang;
use self::sub_cycled::{SubCycled, SubCycling};
use crate::agreement::{Agreement, Comparison, Temperatures};
use crate::droplet::wet::Stream;
use crate::motions::Lost;
use crate::parts::Part;
use crate::{Interaction, Mixture, Notice, StepReport, error::Result};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;
use voidage_dem::Dem;

/// A coupling scheme: one step of grains and fluid together.
pub trait Scheme<const D: usize>: Send {
    /// Advances the mixture by `dt`, with the phases that it has; the mesh is where it is at the end of the step.
    ///
    /// # Errors
    /// The fluid solver failed or a grain left the mesh.
    fn step(&mut self, mixture: &mut Mixture<D>, dt: f64) -> Result<StepReport>;
}

/// The schemes that are shipped: each with its name in scenes and on the command line, and what it does.
macro_rules! schemes {
    ($($(#[$default:ident])? $variant:ident $name:literal $about:literal;)*) => {
        /// Schemes by name.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
        pub enum SchemeName {
            $(#[doc = $about] $(#[$default])? $variant,)*
            /// A scheme of one's own.
            Own(Own),
        }

        impl SchemeName {
            /// All that are shipped.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            /// The name in scenes and on the command line.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                    Self::Own(own) => own.name(),
                }
            }

            /// What it does, in a sentence.
            pub fn about(self) -> &'static str {
                match self {
                    $(Self::$variant => $about,)*
                    Self::Own(_) => "A scheme of one's own.",
                }
            }
        }
    };
}

schemes! {
    Explicit "explicit"
        "The drag is implicit in the velocity of the fluid and takes the last velocities of the grains (A.16).";
    Henry "henry"
        "The velocities of the grains are predicted with the contact forces of the last step (A.18 as printed).";
    HenryFree "henry-free"
        "The velocities of the grains are predicted without contact forces.";
    Lagged "lagged"
        "As `henry-free` in the equation of momentum; the equation of mass takes the last velocities of the grains.";
    SubCycled "sub-cycled"
        "The fluid takes a step among grains that keep their velocity, then these take several with implicit drag.";
    SubCycledExplicit "sub-cycled-explicit"
        "The same with explicit drag.";
    Strang "strang"
        "The grains take half a step before and half a step after the fluid.";
    Anchored "anchored"
        "The grains are moved on trial first, contacts included, and the fluid is solved once with their response.";
    #[default]
    Iterated "iterated"
        "As `anchored`, repeated until fluid and grains agree.";
    GaussSeidel "gauss-seidel"
        "Fluid and grains in turn, with laws without slope and Aitken's relaxation, until they agree.";
}

/// What the schemes can be told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Of [`SchemeName::Iterated`] and [`SchemeName::GaussSeidel`].
    pub iteration: Iteration,
    /// Steps in parts; absent where they are whole.
    pub cut: Option<Cutting>,
    /// Of [`SchemeName::SubCycled`] and [`SchemeName::SubCycledExplicit`].
    pub sub_cycling: SubCycling,
    /// Of a scheme of one's own: what it is made with, by keyword.
    pub own: BTreeMap<String, serde_json::Value>,
}

impl SchemeName {
    /// Whether the grains take steps of their own beside those of the fluid. The water of a droplet, which expects one
    /// implicit step of the grains in it, cannot be part of these.
    pub fn splits(self) -> bool {
        matches!(self, Self::SubCycled | Self::SubCycledExplicit | Self::Strang)
    }

    /// Whether the law has the velocity that the grains will have, so that added mass acts on their acceleration.
    pub fn knows_acceleration(self) -> bool {
        self != Self::Explicit && !self.splits()
    }

    /// The same with a file of one's own that is beside `folder` where its path is relative.
    pub fn within(self, folder: &Path) -> Self {
        if let Self::Own(own) = self { Self::Own(own.within(folder)) } else { self }
    }

    /// Sees to it that the scheme can be made: [`own::require`].
    ///
    /// # Errors
    /// Those of [`own::require`].
    pub fn require(self) -> Result<()> {
        if let Self::Own(own) = self { own::require(own) } else { Ok(()) }
    }

    /// The scheme of this name.
    ///
    /// # Errors
    /// One's own cannot be made.
    pub fn build<const D: usize>(self, options: &Options) -> Result<Box<dyn Scheme<D>>> {
        let Options { iteration, cut, sub_cycling, .. } = options;
        let cut = *cut;
        Ok(match self {
            Self::Explicit => Box::new(Cut::new(explicit::Explicit, cut)),
            Self::Henry => Box::new(Cut::new(henry::Henry { contacts: true }, cut)),
            Self::HenryFree => Box::new(Cut::new(henry::Henry { contacts: false }, cut)),
            Self::Lagged => Box::new(Cut::new(lagged::Lagged, cut)),
            Self::SubCycled => Box::new(Cut::new(SubCycled::new(*sub_cycling, true), cut)),
            Self::SubCycledExplicit => Box::new(Cut::new(SubCycled::new(*sub_cycling, false), cut)),
            Self::Strang => Box::new(Cut::new(Strang::default(), cut)),
            Self::Anchored => Box::new(Cut::new(Iterated::new(Iteration::once()), cut)),
            Self::Iterated => Box::new(Cut::new(Iterated::new(iteration.clone()), cut)),
            Self::GaussSeidel => Box::new(Cut::new(GaussSeidel::new(iteration.clone()), cut)),
            Self::Own(own) => own::build(own, options)?,
        })
    }
}

impl std::fmt::Display for SchemeName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// The scheme of a [name](SchemeName::name); the error says which there are.
impl FromStr for SchemeName {
    type Err = Notice;

    fn from_str(name: &str) -> std::result::Result<Self, Notice> {
        let shipped = Self::ALL.into_iter().find(|scheme| scheme.name() == name);
        shipped.or_else(|| Own::named(name).map(Self::Own)).ok_or_else(|| {
            let known: Vec<&str> = Self::ALL.iter().map(|scheme| scheme.name()).collect();
            let help = format!("use one of {}, or python:FILE[:CLASS]", known.join(", "));
            Notice::new(format!("`{name}`: there is no such coupling scheme"), help)
        })
    }
}

impl Serialize for SchemeName {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for SchemeName {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> std::result::Result<Self, T::Error> {
        let name = String::deserialize(deserializer)?;
        name.parse().map_err(|Notice { what, help }| serde::de::Error::custom(format!("{what}: {help}")))
    }
}

impl JsonSchema for SchemeName {
    fn schema_name() -> Cow<'static, str> {
        "SchemeName".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let named =
            |name: &str, about: &str| json_schema!({"description": about, "type": "string", "const": name});
        let mut choices: Vec<Schema> =
            Self::ALL.iter().map(|scheme| named(scheme.name(), scheme.about())).collect();
        choices.push(json_schema!({
            "description": "One of your own, `python:FILE[:CLASS]`.",
            "type": "string",
            "pattern": "^python:."
        }));
        json_schema!({ "oneOf": choices })
    }
}

/// Fills the laws of grains that keep their velocity and temperature while the fluid is solved over `dt`: that of the
/// momentum, which what is carried may change, and that of the solid flux.
fn expect_frozen<const D: usize>(mixture: &mut Mixture<D>, dt: f64) {
    let stream = mixture.fluid.droplet.as_ref().map(|droplet| droplet.stream());
    let Mixture { grains, interaction, .. } = mixture;
    explicit::expect(grains, interaction, stream, dt);
    let flux = interaction.load.continuity.get_or_insert_default();
    explicit::freeze(grains, &mut flux.mobility, &mut flux.velocity);
}

/// Carries what the grains got beyond what the fluid `lost` in a part of a step, where anything is carried.
fn carry<const D: usize>(
    mixture: &mut Mixture<D>,
    lost: &Lost<D>,
    Part { dt, whole }: Part,
    agreement: Agreement,
) -> Agreement {
    Agreement { carried: mixture.carry(lost, dt, whole), ..agreement }
}

/// Solves the fluid once, with the law that `predict` fills, and moves the grains by the force of the law.
fn once<const D: usize>(
    mixture: &mut Mixture<D>,
    dt: f64,
    report: &mut StepReport,
    predict: impl FnOnce(&Dem<D>, &mut Interaction<D>, Option<Stream<D>>),
) -> Result<Agreement> {
    mixture.cut_grains(report)?;
    mixture.evaluate_closures(dt, report)?;
    // A scheme before this one may have left a law of its own for the solid flux, and what it carried.
    (mixture.interaction.load.continuity, mixture.interaction.carried) = (None, None);
    let stream = mixture.fluid.droplet.as_ref().map(|droplet| droplet.stream());
    predict(&mixture.grains, &mut mixture.interaction, stream);
    mixture.solve_fluid(dt, report)?;
    mixture.move_grains(dt, report);
    Ok(agreement(mixture, dt))
}

/// How far grains that moved by the force of the law in a solution over `dt` are from it.
pub fn agreement<const D: usize>(mixture: &Mixture<D>, dt: f64) -> Agreement {
    let (grains, Interaction { load, at, laws, force, .. }) = (&mixture.grains, &mixture.interaction);
    let velocity = &grains.particles.velocity;
    let comparison = Comparison { grains, load, density: laws.density, dt, force };
    let mut agreement = comparison.motion(|i| {
        ((load.expected(at, i) - velocity[i]) * load.drag[i], load.expected_in_flux(at, i) - velocity[i])
    });
    if let (Some(law), Some(heat)) = (&load.heat, &grains.particles.heat) {
        let temperatures = Temperatures::of(at, &heat.temperature, mixture.interaction.heat_tolerance);
        agreement.heat_disagreement =
            temperatures.disagreement(law, |i| law.missed(at, heat.temperature[i], i));
    }
    Agreement { converged: Iteration::default().accepts(&agreement), ..agreement }
}
