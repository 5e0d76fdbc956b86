//! `voidage analyse`: means with their errors, spectra, and what frames show, from the folder of a run.

mod bed;
mod bubbles;
mod draw;
mod fields;
mod frames;
mod mixing;
mod profiles;
mod report;
mod spectrum;
mod statistics;
mod tables;
mod window;

use crate::plot;
use crate::results::table::{DROP, TIME, Table};
use crate::results::{FOLDER, Moment, moments, read_scene};
use clap::Args;
use frames::{Lens, Seen, Wanted};
use report::{Row, short};
use serde::Serialize;
use spectrum::Spectrum;
use statistics::{Estimate, Verdict, estimate};
use std::path::PathBuf;
use tables::{BedRow, BubbleRow, Density, ProfileRow, SpectrumRow, bubble_rows, bubbles_by_height, diameter};
use voidage_campaign::table;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Scene;
use voidage_scene::recorder::{ANALYSES, ANALYSIS, create_folder};
use window::{Even, Window};

/// Options of `voidage analyse`.
#[derive(Args)]
pub struct Options {
    /// Folder of a run.
    folder: PathBuf,
    /// Folder of the results. Default: `analysis` in the folder of the run.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Time at which means begin, s. Default: that of `output.average`, or half of the run.
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// Time at which means end, s. Default: that of `output.average`, or the end.
    #[arg(long, value_name = "S")]
    to: Option<f64>,
    /// Column of series.csv whose spectrum is computed (may be repeated). Default: `pressure_drop_Pa`, if it is there.
    #[arg(long = "spectrum", value_name = "COLUMN")]
    spectra: Vec<String>,
    /// Segments that a spectrum is the mean of: more of them for less noise, fewer for a finer resolution.
    #[arg(long, value_name = "N", default_value_t = spectrum::SEGMENTS)]
    segments: usize,
    /// Voidage above which the fluid is a bubble.
    #[arg(long, value_name = "EPS", default_value_t = 0.7)]
    bubble_voidage: f64,
    /// Smallest equivalent diameter of a bubble, m. Default: two edges of the mesh.
    #[arg(long, value_name = "M")]
    smallest_bubble: Option<f64>,
    /// Side of the cells in which grains are counted for the mixing index, m. Default: four mean diameters.
    #[arg(long, value_name = "M")]
    mixing_cell: Option<f64>,
    /// Thickness of the layers of profiles over the height, m. Default: two mean diameters, or 1/50 of the height.
    #[arg(long, value_name = "M")]
    layer: Option<f64>,
}

/// What an analysis has found so far.
struct Analysis<'a> {
    options: &'a Options,
    folder: PathBuf,
    scene: Scene,
    window: Window,
    rows: Vec<Row>,
    /// What a reader should know of it.
    notes: Vec<String>,
    /// Files that were written.
    made: Vec<PathBuf>,
}

/// Analyses a run; the number is the exit code.
pub fn analyse(options: &Options) -> Result<u8> {
    options.check()?;
    let scene = read_scene(&options.folder)?;
    let path = options.folder.join("series.csv");
    let series = if path.is_file() { Some(Table::series(&path, &scene)?) } else { None };
    let times = series.as_ref().and_then(|series| series.column(TIME)).unwrap_or_default();
    let moments = moments(&options.folder)?;
    let ends = times.first().into_iter().chain(times.last()).copied();
    let ends: Vec<f64> = ends.chain(moments.iter().map(|moment| moment.time)).collect();
    if ends.is_empty() {
        let what = format!("{}: holds neither rows of series.csv nor frames", options.folder.display());
        return Err(Error::input(Notice::new(what, FOLDER)));
    }
    let [first, last] =
        [ends.iter().copied().fold(f64::INFINITY, f64::min), ends.iter().copied().fold(0.0, f64::max)];
    let window = Window::new([options.from, options.to], &scene, [first, last])?;
    let folder = options.out.clone().unwrap_or_else(|| options.folder.join(ANALYSIS));
    let mut analysis = Analysis { options, folder, scene, window, rows: vec![], notes: vec![], made: vec![] };
    // All that can be wrong with the options and the series, before anything is written.
    let even = series.as_ref().map(|series| analysis.series(series)).transpose()?;
    let spectra = match (&series, even) {
        (Some(series), Some(even)) => analysis.spectra(series, &even)?,
        (None, _) if !options.spectra.is_empty() => {
            let what = format!("{}: holds no series.csv, of which --spectrum is", options.folder.display());
            return Err(Error::input(Notice::new(what, FOLDER)));
        }
        _ => vec![],
    };
    let wanted = options.wanted();
    let lens = Lens::new(&analysis.scene, &moments, &wanted)?;
    let seen = match &lens {
        Some(lens) => lens.look(&analysis.scene, &moments)?,
        None => vec![],
    };
    analysis.prepare()?;
    analysis.write_spectra(&spectra)?;
    if let Some(lens) = &lens {
        analysis.frames(lens, &seen)?;
    } else if moments.is_empty() {
        analysis
            .notes
            .push("there are no frames (`output.frame_interval`): no bed, bubbles, mixing, profiles".into());
    }
    analysis.fields(&moments)?;
    analysis.finish()?;
    Ok(0)
}

impl Options {
    fn check(&self) -> Result<()> {
        let lengths = [
            ("--smallest-bubble", self.smallest_bubble),
            ("--mixing-cell", self.mixing_cell),
            ("--layer", self.layer),
        ];
        for (name, length) in lengths {
            if let Some(length) = length.filter(|length| !(*length > 0.0 && length.is_finite())) {
                return Err(Error::input(format!("{name} {length}: it is a length above 0, in m")));
            }
        }
        if !(self.bubble_voidage > 0.0 && self.bubble_voidage < 1.0) {
            let what = format!("--bubble-voidage {}: it is between 0 and 1", self.bubble_voidage);
            return Err(Error::input(what));
        }
        if self.segments == 0 {
            return Err(Error::input("--segments 0: a spectrum has at least one"));
        }
        for (name, time) in [("--from", self.from), ("--to", self.to)] {
            if let Some(time) = time.filter(|time| !time.is_finite()) {
                return Err(Error::input(format!("{name} {time}: it is a time, in s")));
            }
        }
        Ok(())
    }

    fn wanted(&self) -> Wanted {
        Wanted {
            bubble_voidage: self.bubble_voidage,
            smallest_bubble: self.smallest_bubble,
            mixing_cell: self.mixing_cell,
            layer: self.layer,
        }
    }
}

/// A quantity of a frame.
type Quantity = fn(&BedRow) -> f64;

impl Analysis<'_> {
    /// The rows of the series in the window, and what is known of their columns.
    ///
    /// # Errors
    /// They are not at even times.
    fn series(&mut self, series: &Table) -> Result<Even> {
        let times = series.column(TIME).unwrap_or_default();
        let rows = self.window.rows(times);
        let even = Even::new(times, rows.clone()).map_err(|row| {
            let what = format!(
                "{}: rows are not at even times: {} s is followed by {} s",
                series.path().display(),
                times[row - 1],
                times[row]
            );
            let help = "give a window with even rows by --from and --to; an interval changes where a run goes on with \
                        another `time.step` or `output.series_interval`";
            Error::input(Notice::new(what, help))
        })?;
        if even.rows.len() < rows.len() {
            let left_out = rows.len() - even.rows.len();
            self.notes.push(format!(
                "{left_out} row(s) at the ends of the window are off its even times and left out"
            ));
        }
        for name in series.names().iter().filter(|name| *name != TIME) {
            let values = &series.column(name).unwrap_or_default()[even.rows.clone()];
            let row = Row::new("series", name, &self.window, even.step, &estimate(values));
            self.rows.push(row);
        }
        Ok(even)
    }

    /// The spectra that are asked for.
    ///
    /// # Errors
    /// A column is not there, or has no spectrum.
    fn spectra(&mut self, series: &Table, even: &Even) -> Result<Vec<(String, Spectrum)>> {
        let asked = !self.options.spectra.is_empty();
        let mut names = self.options.spectra.clone();
        if !asked && series.names().iter().any(|name| name == DROP) {
            names.push(DROP.to_owned());
        }
        let mut found = Vec::new();
        for name in names {
            let Some(column) = series.column(&name).filter(|_| name != TIME) else {
                let there: Vec<&str> =
                    series.names().iter().map(String::as_str).filter(|name| *name != TIME).collect();
                let what = format!("--spectrum {name}: {} has no such column", series.path().display());
                return Err(Error::input(Notice::new(what, format!("it has {}", there.join(", ")))));
            };
            let values = &column[even.rows.clone()];
            let missing = values.iter().filter(|value| !value.is_finite()).count();
            let why = match Spectrum::new(values, even.step, self.options.segments) {
                _ if missing > 0 => format!("{missing} of its {} rows are no number", values.len()),
                Some(spectrum) => {
                    found.push((name, spectrum));
                    continue;
                }
                None if values.windows(2).all(|pair| pair[0] == pair[1]) && values.len() > 1 => {
                    "it is constant".to_owned()
                }
                None => format!(
                    "the window has {} rows, and {} segments need {} (--segments, a longer window, or a shorter \
                     `output.series_interval`)",
                    values.len(),
                    self.options.segments,
                    spectrum::FEWEST * (self.options.segments + 1) / 2
                ),
            };
            if asked {
                return Err(Error::input(format!("--spectrum {name}: {why}")));
            }
            self.notes.push(format!("no spectrum of {name}: {why}"));
        }
        Ok(found)
    }

    /// Makes the folder of the results, without those of an earlier analysis.
    fn prepare(&self) -> Result<()> {
        create_folder(&self.folder)?;
        if self.options.out.is_none() {
            for path in ANALYSES.map(|name| self.folder.join(name)).iter().filter(|path| path.is_file()) {
                std::fs::remove_file(path).map_err(|error| Error::file(path, "remove", error))?;
            }
        }
        Ok(())
    }

    fn table<T: Serialize>(&mut self, name: &str, rows: &[T]) -> Result<()> {
        let path = self.folder.join(name);
        table::Table::create(&path)?.add(rows)?;
        self.made.push(path);
        Ok(())
    }

    fn write_spectra(&mut self, spectra: &[(String, Spectrum)]) -> Result<()> {
        if spectra.is_empty() {
            return Ok(());
        }
        let mut densities = Vec::new();
        for (column, found) in spectra {
            let lines = found.frequency.iter().zip(&found.density).zip(&found.noise);
            densities.extend(lines.map(|((frequency, density), noise)| Density {
                column,
                frequency_per_s: *frequency,
                power_spectral_density: *density,
                red_noise: *noise,
            }));
        }
        let row = |(column, found): &(String, Spectrum)| SpectrumRow {
            column: column.clone(),
            segments: found.segments,
            resolution_per_s: found.resolution,
            highest_per_s: found.highest,
            above_red_noise: found.above_noise,
            by_chance: found.by_chance,
            dominant_per_s: found.dominant().unwrap_or(f64::NAN),
            variance: found.variance,
            integral: found.integral,
        };
        self.table("spectra.csv", &spectra.iter().map(row).collect::<Vec<_>>())?;
        self.table("spectrum.csv", &densities)?;
        let path = self.folder.join("spectrum.png");
        draw::spectra(&path, spectra)?;
        self.made.push(path);
        for (column, found) in spectra {
            let (highest, resolution) = (short(found.highest), short(found.resolution));
            let times = short(found.above_noise);
            let chance = short(found.by_chance);
            let said = match found.dominant() {
                Some(_) => format!("dominant frequency {highest} Hz, resolution {resolution} Hz"),
                None => format!("no dominant frequency; highest at {highest} Hz, resolution {resolution} Hz"),
            };
            self.notes.push(format!(
                "spectrum of {column}: {said}, {} segments; there the density is {times} times that of red noise, where \
                 chance makes up to {chance}",
                found.segments
            ));
        }
        Ok(())
    }

    /// Tables and pictures of what frames show.
    fn frames(&mut self, lens: &Lens, seen: &[Seen]) -> Result<()> {
        let rows: Vec<BedRow> = seen.iter().map(BedRow::new).collect();
        self.table("bed.csv", &rows)?;
        let path = self.folder.join("bed.png");
        match draw::bed(&path, &rows)? {
            true => self.made.push(path),
            false => self
                .notes
                .push("no frame has a height of the bed or a mixing index: no picture of them".into()),
        }
        if !lens.upright {
            self.notes.push("gravity does not point along -y: no height of the bed, and no bubbles".into());
        }
        let bubbles: Vec<BubbleRow> = seen.iter().flat_map(bubble_rows).collect();
        if seen.iter().any(|one| one.bubbles.is_some()) {
            self.table("bubbles.csv", &bubbles)?;
            self.notes.push(format!(
                "bubbles: voidage above {}, equivalent diameter of {} mm or more",
                self.options.bubble_voidage,
                short(1e3 * lens.smallest)
            ));
        }
        if seen.iter().any(|one| one.mixing.is_some()) {
            self.notes.push(format!(
                "Lacey index: {}, in cells of {} mm",
                lens.kinds(),
                short(1e3 * lens.cell)
            ));
        } else {
            self.notes.push(format!(
                "no Lacey index in cells of {} mm: it needs two kinds of grains, several cells, and three grains in each \
                 in the mean (--mixing-cell)",
                short(1e3 * lens.cell)
            ));
        }
        let times: Vec<f64> = seen.iter().map(|one| one.time).collect();
        let even = match Even::new(&times, self.window.rows(&times)) {
            Ok(even) if !even.rows.is_empty() => even,
            Ok(_) => {
                self.notes
                    .push("the window has no frames: no profiles, and no means of what frames show".into());
                return Ok(());
            }
            Err(row) => {
                self.notes.push(format!(
                    "frames are not at even times ({} s is followed by {} s): no profiles, and no means of what frames \
                     show",
                    times[row - 1],
                    times[row]
                ));
                return Ok(());
            }
        };
        let inside = &seen[even.rows.clone()];
        self.means_of_frames(&rows[even.rows.clone()], inside, even.step);
        self.profiles(lens, inside)?;
        if inside.iter().any(|one| one.bubbles.as_ref().is_some_and(|all| !all.is_empty())) {
            let by_height = bubbles_by_height(inside, lens.lower[1]);
            self.table("bubbles-by-height.csv", &by_height)?;
            let path = self.folder.join("bubbles.png");
            let [first, last] = [times[even.rows.start], times[even.rows.end - 1]];
            let all: Vec<&BubbleRow> =
                bubbles.iter().filter(|one| (first..=last).contains(&one.time_s)).collect();
            draw::bubbles(&path, &rows, &all, &by_height, lens.lower[1])?;
            self.made.push(path);
        }
        Ok(())
    }

    fn means_of_frames(&mut self, rows: &[BedRow], seen: &[Seen], step: f64) {
        let columns: [(&str, Quantity); 5] = [
            ("bed_height_from_mean_m", |row| row.bed_height_from_mean_m),
            ("bed_height_95_m", |row| row.bed_height_95_m),
            ("bubbles", |row| row.bubbles),
            ("bubble_area_m2", |row| row.bubble_area_m2),
            ("lacey_index", |row| row.lacey_index),
        ];
        for (name, of) in columns {
            let values: Vec<f64> = rows.iter().map(of).collect();
            let found = estimate(&values);
            if found.verdict != Verdict::NoNumber {
                self.rows.push(Row::new("frames", name, &self.window, step, &found));
            }
        }
        // Each bubble counts the same, and not each frame.
        if seen.iter().any(|one| one.bubbles.is_some()) {
            let found = diameter(seen, |_| true);
            self.rows.push(Row::new("frames", "bubble_diameter_m", &self.window, step, &found));
        }
    }

    fn profiles(&mut self, lens: &Lens, seen: &[Seen]) -> Result<()> {
        let layers: Vec<&[profiles::Layer]> = seen.iter().filter_map(|one| one.layers.as_deref()).collect();
        let mean = |layer: usize, of: &dyn Fn(&profiles::Layer) -> f64| -> Estimate {
            estimate(&layers.iter().map(|all| of(&all[layer])).collect::<Vec<f64>>())
        };
        // Layers without a part of the domain have no share of it.
        let known = (0..lens.layers.area.len()).filter(|layer| lens.layers.area[*layer] > 0.0);
        let rows: Vec<ProfileRow> = known
            .map(|layer| {
                let solid = mean(layer, &|of| of.solid);
                let up = mean(layer, &|of| of.up);
                let down = mean(layer, &|of| of.down);
                let net = mean(layer, &|of| of.up - of.down);
                ProfileRow {
                    height_m: lens.layers.middle(layer) - lens.lower[1],
                    width_m: lens.layers.area[layer] / lens.layers.thickness,
                    solid_fraction: solid.mean,
                    solid_fraction_standard_error: solid.error,
                    solid_fraction_verdict: solid.verdict.name(),
                    upward_flux_m_per_s: up.mean,
                    upward_flux_standard_error_m_per_s: up.error,
                    upward_flux_verdict: up.verdict.name(),
                    downward_flux_m_per_s: down.mean,
                    downward_flux_standard_error_m_per_s: down.error,
                    downward_flux_verdict: down.verdict.name(),
                    net_flux_m_per_s: net.mean,
                    net_flux_standard_error_m_per_s: net.error,
                    net_flux_verdict: net.verdict.name(),
                }
            })
            .collect();
        self.table("profiles.csv", &rows)?;
        let path = self.folder.join("profiles.png");
        draw::profiles(&path, &rows, layers.len())?;
        self.made.push(path);
        Ok(())
    }

    /// The mean fields of the fluid.
    fn fields(&mut self, moments: &[Moment]) -> Result<()> {
        let with_fluid: Vec<&Moment> = moments.iter().filter(|moment| moment.fluid.is_some()).collect();
        if with_fluid.is_empty() {
            return Ok(());
        }
        let times: Vec<f64> = with_fluid.iter().map(|moment| moment.time).collect();
        let rows = self.window.rows(&times);
        let found = match Even::new(&times, rows) {
            Ok(even) => fields::means(&with_fluid[even.rows])?,
            Err(_) => Err("frames are not at even times".to_owned()),
        };
        match found {
            Err(why) => self.notes.push(format!("no mean fields: {why}")),
            Ok(means) => {
                let path = self.folder.join("mean-fields.vtu");
                means.write(&path)?;
                self.made.push(path);
                let path = self.folder.join("mean-fields.png");
                let title = format!("mean of {} frames", means.frames);
                plot::mean_fields(&path, &self.scene, means.frame(), &title)?;
                self.made.push(path);
                for field in &means.fields {
                    if let Some(why) = &field.unknown {
                        self.notes
                            .push(format!("errors of the mean field {} are not known: {why}", field.name));
                    }
                }
            }
        }
        Ok(())
    }

    /// Writes the table of all means, and prints what was found.
    fn finish(mut self) -> Result<()> {
        let rows = std::mem::take(&mut self.rows);
        self.table("analysis.csv", &rows)?;
        for (source, what) in [("series", "rows of series.csv"), ("frames", "frames")] {
            let part: Vec<Row> = rows.iter().filter(|row| row.source == source).cloned().collect();
            if !part.is_empty() {
                println!("means of {what} from {} s to {} s", self.window.from, self.window.to);
                report::print(&part);
                println!();
            }
        }
        self.notes.iter().for_each(|note| println!("{note}"));
        self.made.iter().for_each(|path| println!("{}", path.display()));
        Ok(())
    }
}
