//! Round trips of the files.

use super::*;
use crate::Average;
use nalgebra::Vector2;
use std::fs;
use voidage_dem::Period;

#[test]
fn frames_read_back_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let points = [Vector2::new(0.0, 0.0), Vector2::new(1.0, 0.0), Vector2::new(0.0, 2.0)];
    let pressure = [1.5, -2.0, 1e300];
    let velocity = [Vector2::new(3.0, 4.0), Vector2::zeros(), Vector2::new(-1.0, 0.25)];
    let number = [7, 8, 9];
    let columns = [
        Column::scalars("pressure_Pa", &pressure),
        Column::vectors("velocity_m_per_s", &velocity),
        Column::integers("id", &number),
    ];
    for name in ["a.vtu", "a.vtp"] {
        let path = folder.path().join(name);
        if name == "a.vtu" {
            write_mesh(&path, &points, &[0, 1, 2], &columns).unwrap();
        } else {
            write_grains(&path, &points, &columns).unwrap();
        }
        let frame = read_frame(&path).unwrap();
        assert_eq!(frame.points[2], [0.0, 2.0, 0.0]);
        assert_eq!(frame.cells, [0, 1, 2]);
        assert_eq!(frame.column("pressure_Pa").unwrap(), pressure);
        assert_eq!(
            frame.column("velocity_m_per_s").unwrap(),
            [3.0, 4.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.25, 0.0]
        );
        assert_eq!(frame.column("id").unwrap(), [7.0, 8.0, 9.0]);
        let whole = fs::read(&path).unwrap();
        for length in [0, 10, whole.len() / 2] {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(read_frame(&path).is_err());
        }
    }
}

#[test]
fn a_series_goes_on_after_a_restart_without_later_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("series.csv");
    let columns = ["time_s".to_owned(), "mean_grain_temperature_K".to_owned()];
    let mut series = Series::create(&path, &columns).unwrap();
    for k in 1..=5 {
        series.row(&[k as f64 * 0.1, 300.0 + 1.0 / k as f64]).unwrap();
    }
    assert!(series.row(&[0.6]).is_err());
    let straight = fs::read_to_string(&path).unwrap();
    fs::write(&path, format!("{straight}0.6,3")).unwrap(); // a row that a crash cut off
    let mut series = Series::resume(&path, &columns, 3.0 * 0.1).unwrap();
    for k in 4..=5 {
        series.row(&[k as f64 * 0.1, 300.0 + 1.0 / k as f64]).unwrap();
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), straight);
    let other = ["time_s".to_owned(), "pressure_drop_Pa".to_owned()];
    assert!(Series::resume(&path, &other, 0.3).unwrap_err().is_input());
    for (from, to, says) in [
        ("0.2,300.5", "0.2", "series.csv:3: 1 values for 2 columns: `0.2`"),
        ("0.2,300.5", "0.2,3x0.5", "series.csv:3: `mean_grain_temperature_K` is `3x0.5`"),
        ("0.2,300.5", "O.2,300.5", "series.csv:3: `time_s` is `O.2`"),
        ("0.2,300.5", "NaN,300.5", "series.csv:3: `time_s` is NaN after 0.1"),
        ("0.2,300.5", "0.1,300.5", "series.csv:3: `time_s` is 0.1 after 0.1"),
    ] {
        let damaged = straight.replacen(from, to, 1);
        fs::write(&path, &damaged).unwrap();
        let error = Series::resume(&path, &columns, 0.3).unwrap_err();
        assert!(error.is_input() && error.to_string().contains(says), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), damaged, "what is refused is left alone");
    }
}

#[test]
fn a_collection_goes_on_after_a_restart_without_later_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grains.pvd");
    let mut frames = Collection::new(&path);
    for k in 0..4 {
        frames.push(k as f64 * 0.1, format!("frames/grains-{k}.vtp").into()).unwrap();
    }
    let frames = Collection::resume(&path, 0.15).unwrap();
    assert_eq!((frames.len(), frames.last_time()), (2, Some(0.1)));
    let listed = read_collection(&path).unwrap();
    assert_eq!(listed[3], (0.30000000000000004, folder.path().join("frames/grains-3.vtp")));
}

#[test]
fn checkpoints_read_back_and_refuse_damage_and_other_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.voidage");
    let hash = "a".repeat(64);
    let stamp = Stamp { scene_hash: hash.clone(), step: 42, time: 0.1 + 0.2 };
    let state = (vec![1.0, -0.0, f64::MIN_POSITIVE], Some(3_u64));
    Checkpoint::write(&path, &stamp, &state, &"recorder").unwrap();
    let read = Checkpoint::read(&path, &hash).unwrap();
    assert_eq!(read.stamp, stamp);
    assert_eq!(read.state::<(Vec<f64>, Option<u64>)>().unwrap(), state);
    assert_eq!(read.recorder::<String>().unwrap(), "recorder");

    let message = |path: &std::path::Path, hash: &str| {
        let error = Checkpoint::read(path, hash).unwrap_err();
        assert!(error.is_input());
        error.to_string()
    };
    // The checksum of what is not a state is as good as any.
    let forged = read.state::<Vec<f64>>().unwrap_err();
    assert!(forged.is_input() && forged.to_string().contains("left over"), "{forged}");

    assert!(message(&path, &"b".repeat(64)).contains("another scene"));
    let good = fs::read(&path).unwrap();
    for at in [12, 80, 90, 120, 150, good.len() - 1] {
        let mut bad = good.clone();
        bad[at] ^= 1;
        fs::write(&path, &bad).unwrap();
        assert!(message(&path, &hash).contains("checksum"), "byte {at}");
    }
    fs::write(&path, &good[..good.len() - 3]).unwrap();
    assert!(message(&path, &hash).contains("cut off"));
    fs::write(&path, b"time_s,x\n").unwrap();
    assert!(message(&path, &hash).contains("no checkpoint"));
    assert!(message(&folder.path().join("none"), &hash).contains("cannot read"));
}

#[test]
fn averages_keep_the_solid_area_and_the_velocity() {
    let sides = Period::new([Some([0.0, 1.0]), None]).unwrap();
    for (place, period) in [(0.47, Period::default()), (0.05, sides)] {
        let mut averages =
            Averages::new([0.0, 0.0], [1.0, 2.0], &Average { from: 0.0, to: 1.0, cell: 0.1, interval: None });
        let (position, velocity) = (Vector2::new(place, 1.01), Vector2::new(0.5, -2.0));
        for _ in 0..3 {
            averages.sample(&[position], &[velocity], &[0.2], &[0.1], &period);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("averages.csv");
        averages.write(&path).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let rows: Vec<Vec<f64>> =
            text.lines().skip(1).map(|row| row.split(',').map(|x| x.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), 200);
        let solid: f64 = rows.iter().map(|row| row[2] * 0.01).sum();
        approx::assert_relative_eq!(solid, 0.1, max_relative = 1e-12);
        for row in rows.iter().filter(|row| row[2] > 0.0) {
            approx::assert_relative_eq!(row[3], 0.5, max_relative = 1e-12);
            approx::assert_relative_eq!(row[4], -2.0, max_relative = 1e-12);
        }
    }
}

#[test]
fn a_file_that_cannot_be_written_is_named_and_the_old_one_stays() {
    let error = write_whole("/proc/no-such-place/x.vtu".as_ref(), |_| Ok(())).unwrap_err();
    assert!(error.to_string().contains("/proc/no-such-place/x.vtu") && !error.is_input());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("summary.json");
    Summary { steps: 3, ..Summary::default() }.write(&path).unwrap();
    let full = |_: &mut dyn std::io::Write| Err(std::io::ErrorKind::StorageFull.into());
    assert!(write_whole(&path, full).is_err());
    assert_eq!(Summary::read(&path).unwrap().steps, 3);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left behind");
}
