//! How far a run is: a bar on a terminal, plain lines elsewhere.

use indicatif::ProgressStyle;
use std::io::IsTerminal;
use std::time::{Duration, Instant};
use tracing::{Span, info, info_span};
use tracing_indicatif::{IndicatifLayer, span_ext::IndicatifSpanExt};
use tracing_subscriber::{filter::LevelFilter, fmt, layer::SubscriberExt, util::SubscriberInitExt};

/// Sends messages to stderr, above the bar where there is one; where `quiet`, warnings only.
pub fn start_logging(quiet: bool) {
    let bar = has_bar(quiet).then(IndicatifLayer::new);
    let lines = fmt::layer().without_time().with_target(false).with_level(false);
    let registry =
        tracing_subscriber::registry().with(if quiet { LevelFilter::WARN } else { LevelFilter::INFO });
    match bar {
        Some(bar) => registry.with(lines.with_writer(bar.get_stderr_writer())).with(bar).init(),
        None => registry.with(lines.with_ansi(false).with_writer(std::io::stderr)).init(),
    }
}

fn has_bar(quiet: bool) -> bool {
    !quiet && std::io::stderr().is_terminal()
}

/// The unit of shares.
const PERCENT: &str = "%";

/// What a line or the bar says beside the number of steps.
#[derive(Clone, Copy, Debug, Default)]
pub struct News {
    /// Time reached, s.
    pub time: f64,
    /// Number of grains.
    pub grains: usize,
    /// Contacts that carry a force.
    pub contacts: usize,
    /// Largest relative residual of the solvers.
    pub residual: f64,
}

/// Shows how far a run is.
pub struct Progress {
    bar: Option<Span>,
    unit: &'static str,
    first: u64,
    last: u64,
    started: Instant,
    shown: Option<Instant>,
    every: Duration,
    /// Whether the work may be over before the last.
    open: bool,
}

impl Progress {
    /// From the step where this process starts to the last one.
    pub fn new(first: u64, last: u64, quiet: bool) -> Self {
        Self::of("step", first, last, quiet)
    }

    /// The same for the share of all work.
    pub fn percent(quiet: bool) -> Self {
        Self::of(PERCENT, 0, 100, quiet)
    }

    /// The same for anything that is counted; the unit in the singular.
    pub fn of(unit: &'static str, first: u64, last: u64, quiet: bool) -> Self {
        let bar = has_bar(quiet).then(|| {
            let span = info_span!("run");
            let counted =
                if unit == PERCENT { "{pos} %".to_owned() } else { format!("{{pos}}/{{len}} {unit}s") };
            let style = format!("{{bar:30.cyan/blue}} {counted}  {{eta}} left  {{msg}}");
            span.pb_set_style(
                &ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
            span.pb_set_length(last);
            span.pb_set_position(first);
            span.pb_start();
            span
        });
        let every = if bar.is_some() { Duration::from_millis(100) } else { Duration::from_secs(2) };
        Progress { bar, unit, first, last, started: Instant::now(), shown: None, every, open: false }
    }

    /// Shows the news, not too often.
    pub fn show(&mut self, step: u64, news: impl FnOnce() -> News) {
        let due = self.shown.is_none_or(|shown| shown.elapsed() >= self.every);
        if !due && step != self.last {
            return;
        }
        self.shown = Some(Instant::now());
        let News { time, grains, contacts, residual } = news();
        let rate = (step - self.first) as f64 / self.started.elapsed().as_secs_f64().max(1e-9);
        let message = format!(
            "{rate:.1} steps/s  t {time:.4} s  {grains} grains  {contacts} contacts  residual {residual:.1e}"
        );
        self.tell(step, &message);
    }

    /// For work that may be over before `last`: no time left is shown, and nothing of work that is over soon.
    pub fn open(unit: &'static str, last: u64, quiet: bool) -> Self {
        let mut progress = Self::of(unit, 0, last, quiet);
        if let Some(bar) = &progress.bar {
            let style = format!("{{bar:30.cyan/blue}} {unit} {{pos}}/{{len}}  {{msg}}");
            bar.pb_set_style(
                &ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
        }
        progress.open = true;
        progress.shown = Some(Instant::now());
        progress
    }

    /// Shows how many are done and a message, not too often.
    pub fn tell_at_times(&mut self, done: u64, message: impl FnOnce() -> String) {
        if self.shown.is_none_or(|shown| shown.elapsed() >= self.every) {
            self.shown = Some(Instant::now());
            self.tell(done, &message());
        }
    }

    /// Shows how many are done and a message, at once.
    pub fn tell(&self, done: u64, message: &str) {
        match &self.bar {
            Some(bar) => {
                bar.pb_set_position(done);
                bar.pb_set_message(message);
            }
            None if self.open => info!("{} {done}/{}  {message}", self.unit, self.last),
            None => {
                let rate = (done - self.first) as f64 / self.started.elapsed().as_secs_f64().max(1e-9);
                let left = (self.last - done) as f64 / rate;
                let left = duration(left);
                match self.unit {
                    PERCENT => info!("{done} %  {left} left  {message}"),
                    unit => info!("{unit} {done}/{}  {left} left  {message}", self.last),
                }
            }
        }
    }
}

/// A duration for reading: `3 min 20 s`.
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "?".to_owned();
    }
    let whole = seconds.round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, 0, 0) if seconds > 0.0 && seconds < 0.1 => format!("{:.2} ms", 1e3 * seconds),
        (0, 0, _) => format!("{seconds:.1} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}
