//! Whether this machine has what the program needs.

use std::path::Path;
use voidage_coupling::Result;
use voidage_coupling::recorder::write_whole;

/// Prints one line per need; exit code 1 if one is not met.
pub fn doctor() -> Result<u8> {
    let threads = std::thread::available_parallelism().map_or(1, |count| count.get());
    println!("program             {} {}", env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"));
    println!(
        "build               {}",
        if cfg!(debug_assertions) { "debug: slow, use --release" } else { "release" }
    );
    println!("cores               {threads}");
    match memory() {
        Some(free) => println!("free memory         {:.1} GiB", free / 1024f64.powi(3)),
        None => println!("free memory         unknown"),
    }
    println!("fluid solver rust   available");
    println!("fluid solvers fenicsx, scikit-fem, python   not available in this version");
    let probe = Path::new(".voidage-doctor");
    let writable = write_whole(probe, |file| file.write_all(&[0; 4096]));
    // What cannot be removed was not written either; the line below says so.
    let _ = std::fs::remove_file(probe);
    match writable {
        Ok(()) => println!("this folder         can be written"),
        Err(error) => {
            println!("this folder         {error}");
            return Ok(1);
        }
    }
    Ok(0)
}

/// Bytes of memory that are free, where the system tells.
fn memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("MemAvailable:"))?;
    let kibibytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(1024.0 * kibibytes)
}
