//! Whether this machine has what the program needs.

use std::path::Path;
use std::process::Stdio;
use voidage_coupling::Result;
use voidage_remote::launch::{fenicsx_interpreter, interpreter, mpirun, python};
use voidage_remote::transport::shared::free_bytes;
use voidage_scene::recorder::write_whole;

const MEBIBYTE: f64 = (1 << 20) as f64;
/// Shared memory for some hundred thousand grains, bytes.
const ENOUGH: u64 = 512 << 20;

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
    println!("solver rust, serve  available");
    match free_bytes() {
        Some(free) if free < ENOUGH => println!(
            "shared memory       {:.0} MiB free, little: mount -o remount,size=1G /dev/shm (in a container \
             --shm-size=1g), or run with --transport tcp",
            free as f64 / MEBIBYTE
        ),
        Some(free) => println!("shared memory       {:.0} MiB free", free as f64 / MEBIBYTE),
        None => println!("shared memory       there is no /dev/shm: run with --transport tcp"),
    }
    let dolfinx = "apt-get install --no-install-recommends python3-dolfinx".to_owned();
    let scipy = "apt-get install --no-install-recommends python3-scipy".to_owned();
    python_solver("fenicsx", &fenicsx_interpreter(), &[("dolfinx", dolfinx), ("scipy", scipy), package()]);
    match mpirun(&fenicsx_interpreter()) {
        Ok(file) => println!("ranks of fenicsx    available, {}", file.display()),
        Err(notice) => println!("ranks of fenicsx    one: {}: {}", notice.what, notice.help),
    }
    let other = interpreter();
    let scikit = format!("{} -m pip install scikit-fem", other.display());
    python_solver("scikit-fem", &other, &[("skfem", scikit), package()]);
    python_solver("python", &other, &[package()]);
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

/// Prints whether an interpreter has the modules that a solver needs, and what installs those that it has not.
fn python_solver(name: &str, interpreter: &Path, modules: &[(&str, String)]) {
    let missing: Vec<_> = modules.iter().filter(|(module, _)| !has_module(interpreter, module)).collect();
    let python = interpreter.display();
    if missing.is_empty() {
        println!("{:<20}available, {python}", format!("solver {name}"));
    }
    for (module, command) in missing {
        println!("{:<20}needs the module {module} in {python}: {command}", format!("solver {name}"));
    }
}

fn has_module(interpreter: &Path, module: &str) -> bool {
    // Wheels of dolfinx find the MPI that mpi4py has loaded.
    let before = if module == "dolfinx" { "import mpi4py.MPI; " } else { "" };
    let mut probe = python(interpreter, &format!("{before}import {module}"));
    probe.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    probe.status().is_ok_and(|status| status.success())
}

/// The package of this project, and what installs it.
fn package() -> (&'static str, String) {
    ("voidage", "`pip install ./coupling/python` in a clone".to_owned())
}

/// Bytes of memory that are free, where the system tells.
fn memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("MemAvailable:"))?;
    let kibibytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(1024.0 * kibibytes)
}
