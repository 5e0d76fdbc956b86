//! Fields of the fluid in the mean over time, with the errors of these means.

use crate::results::Moment;
use std::path::Path;
use voidage_coupling::Result;
use voidage_dem::Vector;
use voidage_scene::recorder::{Column, Frame, FrameColumn, read_frame, write_mesh};

/// Batches whose means are compared, and half of them.
const BATCHES: usize = 16;
const PAIRS: usize = BATCHES / 2;
/// Fewest frames of a batch.
const FEWEST: usize = 2;
/// By how much the error grows, at most, where batches become twice as long.
const GROWS: f64 = 1.2;
/// Difference of the halves over its standard error, both in the root mean square over the nodes, above which fields
/// drift.
const DRIFTS: f64 = 2.0;

/// Mean fields at the nodes of a mesh.
#[derive(Debug)]
pub struct Means {
    /// The mesh.
    pub mesh: Frame,
    /// Number of frames.
    pub frames: usize,
    /// The quantities.
    pub fields: Vec<Field>,
}

/// A quantity at the nodes.
#[derive(Debug)]
pub struct Field {
    /// Name, with the unit.
    pub name: String,
    /// Numbers per node.
    pub components: usize,
    /// Means.
    pub mean: Vec<f64>,
    /// Standard errors from batches; all `NaN` where they are not known.
    pub error: Vec<f64>,
    /// Why they are not known.
    pub unknown: Option<String>,
}

/// The means over the frames of a window; or why there are none.
///
/// # Errors
/// A frame is damaged.
pub fn means(moments: &[&Moment]) -> Result<std::result::Result<Means, String>> {
    let paths: Vec<&Path> = moments.iter().filter_map(|moment| moment.fluid.as_deref()).collect();
    let each = paths.len() / BATCHES;
    if each < FEWEST {
        let needed = BATCHES * FEWEST;
        return Ok(Err(format!(
            "the window has {} frames of the fluid, and mean fields need {needed}: a shorter `output.frame_interval`, or \
             a longer run",
            paths.len()
        )));
    }
    // The last ones: what is left over is at the start.
    let paths = &paths[paths.len() - each * BATCHES..];
    let mesh = read_frame(paths[0])?;
    let mut sums: Vec<Vec<Vec<f64>>> = Vec::new();
    for batch in paths.chunks_exact(each) {
        let mut sum: Vec<Vec<f64>> =
            mesh.columns.iter().map(|column| vec![0.0; column.values.len()]).collect();
        for path in batch {
            let frame = read_frame(path)?;
            let same =
                |a: &FrameColumn, b: &FrameColumn| a.name == b.name && a.values.len() == b.values.len();
            if frame.points != mesh.points || frame.cells != mesh.cells {
                return Ok(Err(
                    "the mesh moves or is made anew, so that its nodes have no mean fields".to_owned()
                ));
            }
            if frame.columns.len() != mesh.columns.len()
                || !frame.columns.iter().zip(&mesh.columns).all(|(a, b)| same(a, b))
            {
                return Ok(Err(format!("{} has other columns than the frames before", path.display())));
            }
            for (sum, column) in sum.iter_mut().zip(&frame.columns) {
                sum.iter_mut().zip(&column.values).for_each(|(sum, value)| *sum += value / each as f64);
            }
        }
        sums.push(sum);
    }
    let field = |k: usize, column: &FrameColumn| {
        let batches: Vec<&[f64]> = sums.iter().map(|sum| sum[k].as_slice()).collect();
        Field::new(&column.name, column.components, &batches)
    };
    let fields = mesh.columns.iter().enumerate().map(|(k, column)| field(k, column)).collect();
    Ok(Ok(Means { fields, frames: paths.len(), mesh }))
}

impl Field {
    /// From the means of batches that follow each other.
    fn new(name: &str, components: usize, batches: &[&[f64]]) -> Field {
        let count = batches[0].len();
        let over = |parts: std::ops::Range<usize>, k: usize| {
            parts.clone().map(|batch| batches[batch][k]).sum::<f64>() / parts.len() as f64
        };
        let mean: Vec<f64> = (0..count).map(|k| over(0..BATCHES, k)).collect();
        // The squared error of the mean from parts of so many batches.
        let square = |each: usize, k: usize| {
            let parts = (BATCHES / each) as f64;
            let means = (0..BATCHES / each).map(|part| over(part * each..(part + 1) * each, k));
            means.map(|part| (part - mean[k]).powi(2)).sum::<f64>() / (parts * (parts - 1.0))
        };
        let long: Vec<f64> = (0..count).map(|k| square(2, k)).collect();
        let (sum, short) = (long.iter().sum::<f64>(), (0..count).map(|k| square(1, k)).sum::<f64>());
        let grows = (sum / short).sqrt();
        // The error without what a straight line takes away: a drift would hide in the scatter of the batches.
        let (mut halves, mut rest) = (0.0, 0.0);
        for k in 0..count {
            let means: Vec<f64> = (0..PAIRS).map(|pair| over(2 * pair..2 * pair + 2, k)).collect();
            let place = |pair: usize| pair as f64 - 0.5 * (PAIRS - 1) as f64;
            let along = means.iter().enumerate().map(|(pair, mean)| place(pair) * mean).sum::<f64>()
                / (0..PAIRS).map(|pair| place(pair).powi(2)).sum::<f64>();
            let left = |(pair, value): (usize, &f64)| (value - mean[k] - along * place(pair)).powi(2);
            rest += means.iter().enumerate().map(left).sum::<f64>() / ((PAIRS - 2) * PAIRS) as f64;
            halves += (over(PAIRS..BATCHES, k) - over(0..PAIRS, k)).powi(2);
        }
        let drifts = 0.5 * (halves / rest).sqrt();
        let unknown = if !sum.is_finite() {
            Some("some values are no number".to_owned())
        } else if drifts > DRIFTS {
            Some(format!(
                "the halves of the window differ by {drifts:.1} standard errors: begin later, or run longer"
            ))
        } else if grows > GROWS {
            Some(format!("they grow by a factor of {grows:.1} where batches are twice as long: run longer"))
        } else {
            None
        };
        let error = match unknown {
            None => long.iter().map(|square| square.sqrt()).collect(),
            Some(_) => vec![f64::NAN; count],
        };
        Field { name: name.to_owned(), components, mean, error, unknown }
    }
}

impl Means {
    /// Writes a VTU file.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let points: Vec<Vector<2>> =
            self.mesh.points.iter().map(|[x, y, _]| Vector::<2>::new(*x, *y)).collect();
        let mut named: Vec<(String, usize, &[f64], Vec<Vector<2>>)> = Vec::new();
        for field in &self.fields {
            let error = format!("{}_standard_error", field.name);
            for (name, values) in [(field.name.clone(), &field.mean), (error, &field.error)] {
                let vectors = match field.components {
                    3 => values.as_chunks::<3>().0.iter().map(|[u, v, _]| Vector::<2>::new(*u, *v)).collect(),
                    _ => Vec::new(),
                };
                named.push((name, field.components, values, vectors));
            }
        }
        let columns: Vec<Column<2>> = named
            .iter()
            .map(|(name, components, values, vectors)| match components {
                3 => Column::vectors(name, vectors),
                _ => Column::scalars(name, values),
            })
            .collect();
        write_mesh(path, &points, &self.mesh.cells, &columns)
    }

    /// The means as a frame.
    pub fn frame(&self) -> Frame {
        let column = |field: &Field| FrameColumn {
            name: field.name.clone(),
            components: field.components,
            values: field.mean.clone(),
        };
        Frame { columns: self.fields.iter().map(column).collect(), ..self.mesh.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    /// The mean of batches of frames at many nodes, each with noise of its own and of a memory, and a drift.
    fn field(factor: f64, drift: f64) -> Field {
        let (nodes, each) = (200, 10);
        let mut random = Pcg64::seed_from_u64(1);
        let mut state = vec![0.0; nodes];
        let mut batches = vec![vec![0.0; nodes]; BATCHES];
        for frame in 0..each * (BATCHES + 10) {
            for (k, value) in state.iter_mut().enumerate() {
                let kick = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
                *value = factor * *value + (1.0 - factor * factor).sqrt() * kick;
                if let Some(frame) = frame.checked_sub(10 * each) {
                    let rise = drift * frame as f64 / (each * BATCHES) as f64;
                    batches[frame / each][k] += (*value + rise) / each as f64;
                }
            }
        }
        let batches: Vec<&[f64]> = batches.iter().map(Vec::as_slice).collect();
        Field::new("a", 1, &batches)
    }

    #[test]
    fn errors_of_mean_fields_are_known_where_batches_are_long_enough() {
        let good = field(0.3, 0.0);
        assert_eq!(good.unknown, None);
        let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        let exact = (1.3_f64 / 0.7 / 160.0).sqrt();
        assert!((rms(&good.error) / exact - 1.0).abs() < 0.1, "{} {exact}", rms(&good.error));
        assert!((rms(&good.mean) / exact - 1.0).abs() < 0.1, "{} {exact}", rms(&good.mean));
        let short = field(0.96, 0.0);
        assert!(short.unknown.is_some() && short.error[0].is_nan());
        let drifting = field(0.3, 1.5);
        assert!(drifting.unknown.as_ref().is_some_and(|why| why.contains("halves")), "{drifting:?}");
    }
}
