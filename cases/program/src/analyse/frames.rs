//! What single frames of grains and fluid show.

use super::bed::{self, Heights};
use super::bubbles::{self, Bubble, Rule};
use super::mixing::{self, Mixing};
use super::profiles::{Layer, Layers};
use crate::results::Moment;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::Path;
use voidage_coupling::{Error, Notice, Result};
use voidage_dem::Period;
use voidage_scene::Scene;
use voidage_scene::build::wall as wall_at;
use voidage_scene::recorder::{Frame, read_frame};

/// Side of a cell of the mixing index over the mean diameter of the grains.
const CELL: f64 = 4.0;
/// Least thickness of a layer over the mean diameter, and most layers.
const LAYER: f64 = 2.0;
const LAYERS: f64 = 50.0;
/// Smallest equivalent diameter of a bubble over the length of the edges of the mesh.
const SMALLEST: f64 = 2.0;

/// What is asked of frames.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Voidage above which there is a bubble.
    pub bubble_voidage: f64,
    /// Smallest equivalent diameter of a bubble, m.
    pub smallest_bubble: Option<f64>,
    /// Side of a cell of the mixing index, m.
    pub mixing_cell: Option<f64>,
    /// Thickness of the layers of profiles, m.
    pub layer: Option<f64>,
}

/// What one moment shows.
#[derive(Clone, Debug)]
pub struct Seen {
    /// s.
    pub time: f64,
    /// Heights of the bed.
    pub heights: Option<Heights>,
    /// The bubbles.
    pub bubbles: Option<Vec<Bubble>>,
    /// How well grains are mixed.
    pub mixing: Option<Mixing>,
    /// The layers of the profiles.
    pub layers: Option<Vec<Layer>>,
}

/// What all frames of a run are looked at with.
#[derive(Debug)]
pub struct Lens {
    /// Lower left corner of the domain, m: the floor of the bed.
    pub lower: [f64; 2],
    /// The layers of the profiles.
    pub layers: Layers,
    /// Side of a cell of the mixing index, m.
    pub cell: f64,
    /// Smallest equivalent diameter of a bubble, m.
    pub smallest: f64,
    bubble_voidage: f64,
    /// Whether gravity points down the second axis.
    pub upright: bool,
    kinds: Kinds,
    period: Period<2>,
}

/// The two kinds of grains of the mixing index.
#[derive(Clone, Debug)]
enum Kinds {
    /// The first group of the scene, and all others.
    Groups(String),
    /// Which grains were in the lower half at first.
    Halves(HashMap<u32, bool>, f64),
}

/// Columns of the grains of a frame.
#[derive(Debug)]
struct Grains {
    id: Vec<u32>,
    /// Not known of frames of earlier versions.
    group: Option<Vec<usize>>,
    place: Vec<[f64; 2]>,
    velocity: Vec<f64>,
    radius: Vec<f64>,
    solid: Vec<f64>,
}

/// What an input error says of frames.
fn wrong(path: &Path, what: impl std::fmt::Display, help: &str) -> Error {
    Error::input(Notice::new(format!("{}: {what}", path.display()), help))
}

const AGAIN: &str = "it was damaged or is of an earlier version: run the scene again";

impl Grains {
    fn read(path: &Path, scene: &Scene) -> Result<Grains> {
        let frame = read_frame(path)?;
        let count = frame.points.len();
        let column = |name: &str, components: usize| {
            let found = frame.column(name).filter(|values| values.len() == components * count);
            found.ok_or_else(|| wrong(path, format!("has no column `{name}` of its {count} grains"), AGAIN))
        };
        let radius = column("radius_m", 1)?.to_vec();
        let velocity = column("velocity_m_per_s", 3)?.as_chunks::<3>().0.iter().map(|[_, v, _]| *v).collect();
        let group: Option<Vec<usize>> = match (scene.grains.len(), frame.column("group")) {
            (0 | 1, _) => Some(vec![0; count]),
            (_, None) => None,
            (_, Some(_)) => Some(column("group", 1)?.iter().map(|group| *group as usize).collect()),
        };
        let solidity: Vec<f64> = scene.grains.iter().map(|group| group.solidity).collect();
        let one = solidity.first().copied().filter(|first| solidity.iter().all(|other| other == first));
        let of_grain = |grain: usize| match (one, &group) {
            (Some(solidity), _) => Ok(solidity),
            (None, Some(group)) => solidity.get(group[grain]).copied().ok_or_else(|| {
                wrong(path, format!("`group` is {} of {} groups", group[grain], solidity.len()), AGAIN)
            }),
            (None, None) => {
                Err(wrong(path, "has no column `group`, and the groups differ in `solidity`", AGAIN))
            }
        };
        let mut solid = Vec::with_capacity(count);
        for (grain, radius) in radius.iter().enumerate() {
            solid.push(of_grain(grain)? * std::f64::consts::PI * radius * radius);
        }
        Ok(Grains {
            id: column("id", 1)?.iter().map(|id| *id as u32).collect(),
            group,
            place: frame.points.iter().map(|[x, y, _]| [*x, *y]).collect(),
            velocity,
            radius,
            solid,
        })
    }

    fn heights(&self) -> Vec<f64> {
        self.place.iter().map(|place| place[1]).collect()
    }
}

impl Lens {
    /// What a run is looked at with; none without frames.
    ///
    /// # Errors
    /// A frame is damaged.
    pub fn new(scene: &Scene, moments: &[Moment], wanted: &Wanted) -> Result<Option<Lens>> {
        let mut grains = None;
        for path in moments.iter().filter_map(|moment| moment.grains.as_deref()) {
            let there = Grains::read(path, scene)?;
            let some = !there.place.is_empty();
            grains = Some(there);
            // Those of a source come later.
            if some {
                break;
            }
        }
        let Some(grains) = grains else { return Ok(None) };
        let mesh = moments.iter().find_map(|moment| moment.fluid.as_deref()).map(read_frame).transpose()?;
        let period = scene.period();
        let points: Vec<[f64; 2]> = match &mesh {
            Some(mesh) => mesh.points.iter().map(|[x, y, _]| [*x, *y]).collect(),
            None if scene.walls.len() > 1 => {
                scene.walls.iter().flat_map(|wall| wall_at(scene, wall).at(0.0)).map(Into::into).collect()
            }
            None => grains.place.clone(),
        };
        let bound = |axis: usize, start: f64, pick: fn(f64, f64) -> f64| {
            points.iter().map(|point| point[axis]).fold(start, pick)
        };
        let mut lower = [0, 1].map(|axis| bound(axis, f64::INFINITY, f64::min));
        let mut upper = [0, 1].map(|axis| bound(axis, f64::NEG_INFINITY, f64::max));
        for (axis, [low, high]) in period.sides().iter().enumerate().filter_map(|(k, s)| Some((k, (*s)?))) {
            (lower[axis], upper[axis]) = (low, high);
        }
        if !(0..2).all(|axis| upper[axis] > lower[axis]) {
            return Ok(None);
        }
        let diameter = 2.0 * grains.radius.iter().sum::<f64>() / grains.radius.len().max(1) as f64;
        let thickness = wanted.layer.unwrap_or((LAYER * diameter).max((upper[1] - lower[1]) / LAYERS));
        let layers = Layers::of_box(lower, upper, thickness);
        let layers = mesh.as_ref().map_or(layers.clone(), |mesh| layers.of_mesh(mesh));
        let gravity = &scene.gravity.0;
        Ok(Some(Lens {
            lower,
            layers,
            cell: wanted.mixing_cell.unwrap_or(CELL * diameter),
            smallest: wanted.smallest_bubble.unwrap_or(SMALLEST * mesh.as_ref().map_or(0.0, edge)),
            bubble_voidage: wanted.bubble_voidage,
            upright: gravity[1] < 0.0 && gravity[0].abs() <= 1e-9 * gravity[1].abs(),
            kinds: Kinds::new(scene, &grains),
            period,
        }))
    }

    /// The two kinds of the mixing index, in words.
    pub fn kinds(&self) -> String {
        match &self.kinds {
            Kinds::Groups(material) => {
                format!("grains of the first group ({material}) among those of the others")
            }
            Kinds::Halves(_, height) => format!(
                "grains that were below {} mm in their first frame among those that were above",
                super::report::short(1e3 * height)
            ),
        }
    }

    /// Looks at all moments.
    ///
    /// # Errors
    /// A frame is damaged.
    pub fn look(&self, scene: &Scene, moments: &[Moment]) -> Result<Vec<Seen>> {
        moments.par_iter().map(|moment| self.at(scene, moment)).collect()
    }

    fn at(&self, scene: &Scene, moment: &Moment) -> Result<Seen> {
        let mut seen = Seen { time: moment.time, heights: None, bubbles: None, mixing: None, layers: None };
        let Some(path) = &moment.grains else { return Ok(seen) };
        let grains = Grains::read(path, scene)?;
        let y = grains.heights();
        seen.layers = Some(
            self.layers.of([&y, &grains.velocity, &grains.radius, &grains.solid], self.period.length(1)),
        );
        let marked = (0..y.len()).filter_map(|k| Some((grains.place[k], self.kinds.is_first(&grains, k)?)));
        seen.mixing = mixing::lacey(marked, self.lower, self.cell);
        if self.upright {
            seen.heights = bed::heights(&y, &grains.solid, self.lower[1]);
        }
        if let (Some(path), Some(heights)) = (&moment.fluid, &seen.heights) {
            let frame = read_frame(path)?;
            if let Some(voidage) = frame.column("voidage") {
                if voidage.len() != frame.points.len() {
                    return Err(wrong(path, "`voidage` has not a value for each node", AGAIN));
                }
                let rule = Rule {
                    voidage: self.bubble_voidage,
                    surface: self.lower[1] + heights.surface,
                    smallest: self.smallest,
                };
                seen.bubbles = Some(bubbles::find(&frame, voidage, &rule, &self.period));
            }
        }
        Ok(seen)
    }
}

impl Kinds {
    fn new(scene: &Scene, first: &Grains) -> Kinds {
        if scene.grains.len() > 1 && first.group.is_some() {
            return Kinds::Groups(scene.grains[0].material.clone());
        }
        let y = first.heights();
        let mut sorted = y.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        Kinds::Halves(first.id.iter().zip(&y).map(|(id, y)| (*id, *y < middle)).collect(), middle)
    }

    /// Whether a grain is of the first kind; none where this is not known.
    fn is_first(&self, grains: &Grains, grain: usize) -> Option<bool> {
        match self {
            Kinds::Groups(_) => Some(grains.group.as_ref()?[grain] == 0),
            Kinds::Halves(lower, _) => lower.get(&grains.id[grain]).copied(),
        }
    }
}

/// Length of the edges of a mesh, m: those of equilateral triangles of the mean area.
fn edge(mesh: &Frame) -> f64 {
    let cells = mesh.cells.as_chunks::<3>().0;
    let area = |[a, b, c]: &[u32; 3]| {
        let [a, b, c] = [a, b, c].map(|node| mesh.points[*node as usize]);
        0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs()
    };
    let mean = cells.iter().map(area).sum::<f64>() / cells.len().max(1) as f64;
    (4.0 * mean / 3f64.sqrt()).sqrt()
}
