//! The points of a campaign.

use crate::progress::Progress;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use voidage_coupling::Result;

/// How points are done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Concurrency {
    /// One after the other, each with all threads.
    OneByOne,
    /// As many at once as there are threads.
    Threads,
}

/// What the progress of a campaign is counted in.
pub enum Scale<P> {
    /// By the number of points, of which so many were done before; and what one is called.
    Count(usize, &'static str),
    /// By what points cost: the last one may take longer than all before it.
    Cost(fn(&P) -> f64),
}

impl<P> Scale<P> {
    fn progress(&self, left: &[P], quiet: bool) -> Progress {
        match self {
            Self::Count(known, noun) => Progress::of(noun, *known as u64, (known + left.len()) as u64, quiet),
            Self::Cost(_) => Progress::percent(quiet),
        }
    }

    /// What the progress stands at when these of the points that are left are done.
    fn at<'a>(&self, left: &'a [P], done: impl Iterator<Item = &'a P>) -> u64 {
        match self {
            Self::Count(known, _) => (known + done.count()) as u64,
            Self::Cost(cost) => {
                (1e2 * done.map(cost).sum::<f64>() / left.iter().map(cost).sum::<f64>()) as u64
            }
        }
    }
}

/// Points that are to be done, and what is said of them on the way.
pub struct Points<'a, P> {
    /// The points.
    pub left: &'a [P],
    /// What their progress is counted in.
    pub scale: Scale<P>,
    /// The name of a point, by its place among them.
    pub name: &'a (dyn Fn(usize, &P) -> String + Sync),
    /// No progress.
    pub quiet: bool,
}

/// Does the points; `keep` puts what came of one where it is safe, as soon as it is there, in the order in which points
/// end. A point without a result ends the campaign: whoever watches has asked for that.
///
/// # Errors
/// That of a point or of `keep`: no further point is begun.
pub fn run<P: Sync, S: Send>(
    points: &Points<P>,
    concurrency: Concurrency,
    one: impl Fn(&P) -> Result<Option<S>> + Sync,
    keep: impl FnMut(&P, S) -> Result<()> + Send,
) -> Result<()> {
    let Points { left, scale, name, quiet } = points;
    let next = AtomicUsize::new(0);
    let shared = Mutex::new((keep, vec![], scale.progress(left, *quiet)));
    let work = || {
        let lock = || shared.lock().unwrap_or_else(PoisonError::into_inner);
        let stop = || next.store(left.len(), Ordering::Relaxed);
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(point) = left.get(number) else { return Ok(()) };
            {
                let (_, done, progress) = &*lock();
                progress.tell(scale.at(left, done.iter().copied()), &name(number, point));
            }
            let sample = one(point).inspect_err(|_| stop())?;
            let Some(sample) = sample else {
                stop();
                return Ok(());
            };
            let (keep, done, _) = &mut *lock();
            done.push(point);
            keep(point, sample).inspect_err(|_| stop())?;
        }
    };
    let ends = match concurrency {
        Concurrency::OneByOne => vec![work()],
        // Not an iterator of rayon: a thread that waits for a part of its point would begin another point meanwhile.
        Concurrency::Threads => rayon::broadcast(|_| work()),
    };
    let (_, done, progress) = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
    if done.len() == left.len() {
        progress.tell(scale.at(left, done.into_iter()), "done");
    }
    ends.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use voidage_coupling::Error;

    #[test]
    fn what_is_done_is_kept_and_an_error_or_an_interrupt_begins_no_further_point() {
        let points = Points {
            left: &[1, 2, 3, 4],
            scale: Scale::Cost(|point: &i32| f64::from(*point)),
            name: &|number, point| format!("{number} {point}"),
            quiet: true,
        };
        let kept = |stop: Option<i32>, fail: Option<i32>, concurrency| {
            let mut kept = vec![];
            let one = |point: &i32| match (Some(*point) == stop, Some(*point) == fail) {
                (true, _) => Ok(None),
                (_, true) => Err(Error::run("wrong")),
                _ => Ok(Some(10 * point)),
            };
            let end = run(&points, concurrency, one, |point, sample| {
                assert_eq!(sample, 10 * point);
                kept.push(*point);
                Ok(())
            });
            kept.sort_unstable();
            (kept, end.is_ok())
        };
        assert_eq!(kept(None, None, Concurrency::Threads), (vec![1, 2, 3, 4], true));
        assert_eq!(kept(Some(3), None, Concurrency::OneByOne), (vec![1, 2], true));
        assert_eq!(kept(None, Some(2), Concurrency::OneByOne), (vec![1], false));
    }
}
