//! The fluid solver in another process: the same result, and every way in which a process can fail.

use std::fs;
use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use voidage_coupling::HEAT;
use voidage_coupling::backend::{FluidStep, Immersed, Solution};
use voidage_coupling::exchange::{OnMesh, Rigid};
use voidage_coupling::load::{GrainLoad, HeatLoad};
use voidage_coupling::overlap::{self, Overlap};
use voidage_fluid::Vector;
use voidage_fluid::points::Points;
use voidage_remote::launch::Host;
use voidage_remote::protocol::{Header, Kind};
use voidage_remote::transport::{self, Address};
use voidage_scene::{Scene, build};

const BED: &str = include_str!("bed.toml");
/// A run that only ends by force.
const ENDLESS: [&str; 2] = ["--set", "time.end=1000"];
/// How soon the survivor of a dead process must end.
const SOON: Duration = Duration::from_secs(2);

fn voidage(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    command.current_dir(folder).stdout(Stdio::null()).stderr(Stdio::piped()).stdin(Stdio::null());
    command
}

/// A folder with the small bed in it.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), BED).unwrap();
    folder
}

fn start(folder: &Path, out: &str, options: &[&str]) -> Child {
    let arguments = ["run", "scene.toml", "--quiet", "--threads", "1", "--out", out];
    voidage(folder).args(arguments).args(options).spawn().unwrap()
}

/// Runs to the end; it must be a good one.
fn run(folder: &Path, out: &str, options: &[&str]) -> PathBuf {
    let (code, said) = end(start(folder, out, options));
    assert_eq!(code, Some(0), "{said}");
    folder.join(out)
}

/// Exit code and what was said.
fn end(child: Child) -> (Option<i32>, String) {
    let Output { status, stderr, .. } = child.wait_with_output().unwrap();
    (status.code(), String::from_utf8(stderr).unwrap())
}

/// Waits for something to be so.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until a run is so many steps on its way.
fn until_step(out: &Path, steps: usize) {
    let rows = || fs::read_to_string(out.join("series.csv")).map_or(0, |text| text.lines().count());
    until("the run does not get on", || rows() > steps + 1);
}

fn signal(signal: &str, process: u32) {
    assert!(Command::new("kill").args([signal, &process.to_string()]).status().unwrap().success());
}

/// The only child of a process.
fn child_of(process: u32) -> u32 {
    let children = format!("/proc/{process}/task/{process}/children");
    let text = fs::read_to_string(children).unwrap();
    text.split_whitespace().next().expect("a fluid solver").parse().unwrap()
}

fn is_running(process: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    // A process that has ended and that nobody has asked about is a zombie.
    stat.rsplit_once(") ").is_some_and(|(_, state)| !state.starts_with(['Z', 'X']))
}

fn assert_same(a: &Path, b: &Path) {
    for name in ["checkpoint.voidage", "series.csv", "averages.csv"] {
        assert!(fs::read(a.join(name)).unwrap() == fs::read(b.join(name)).unwrap(), "{name} differs");
    }
}

#[test]
fn serve_is_the_solver_of_this_process_bit_for_bit() {
    let folder = folder();
    let short = ["--set", "time.end=0.02"];
    let here = run(folder.path(), "here", &short);
    for (out, transport) in [("shm", "shm"), ("tcp", "tcp")] {
        let options = [&["--fluid", "serve", "--transport", transport], &short[..]].concat();
        assert_same(&here, &run(folder.path(), out, &options));
    }
    // The scene as resolved says the same, and the fluid alone and the ramp go the same way.
    let scene = fs::read_to_string(folder.path().join("tcp/scene.toml")).unwrap();
    assert!(scene.contains("solver = \"serve\"") && scene.contains("transport = \"tcp\""), "{scene}");
    let ramped = [&["--set", "fluid.ramp=0.01"], &short[..]].concat();
    let here = run(folder.path(), "ramped", &ramped);
    assert_same(&here, &run(folder.path(), "ramped-serve", &[&["--fluid", "serve"], &ramped[..]].concat()));
}

#[test]
fn a_solver_started_by_hand_is_attached() {
    let folder = folder();
    let short = ["--set", "time.end=0.02"];
    let here = run(folder.path(), "here", &short);
    for address in [Address::unique(), Address::Tcp("127.0.0.1:47311".into())] {
        let address = address.to_string();
        // In either order.
        let solver = voidage(folder.path()).args(["serve", "--connect", &address]).spawn().unwrap();
        let attach = format!("attach:{address}");
        let out =
            run(folder.path(), &address.replace(':', "-"), &[&["--fluid", &attach], &short[..]].concat());
        assert_same(&here, &out);
        let (code, said) = end(solver);
        assert_eq!(code, Some(0), "{said}");
    }
}

#[test]
fn two_runs_at_once_do_not_meet() {
    let folder = folder();
    let options = ["--fluid", "serve", "--set", "time.end=0.02"];
    let both = ["a", "b"].map(|out| start(folder.path(), out, &options));
    for child in both {
        let (code, said) = end(child);
        assert_eq!(code, Some(0), "{said}");
    }
    assert_same(&folder.path().join("a"), &folder.path().join("b"));
}

#[test]
fn a_killed_solver_ends_the_run_which_can_be_restarted() {
    for transport in ["shm", "tcp"] {
        let folder = folder();
        let serve = ["--fluid", "serve", "--transport", transport];
        let run_process = start(folder.path(), "out", &[&serve, &ENDLESS[..]].concat());
        let out = folder.path().join("out");
        until_step(&out, 15);
        let killed = Instant::now();
        signal("-KILL", child_of(run_process.id()));
        let (code, said) = end(run_process);
        assert!(killed.elapsed() < SOON, "{:?}", killed.elapsed());
        assert_eq!(code, Some(1), "{said}");
        for part in ["step ", "fluid solver serve", "it is gone (signal: 9", "the last checkpoint is"] {
            assert!(said.contains(part), "{part} is not in\n{said}");
        }
        let steps = fs::read_to_string(out.join("series.csv")).unwrap().lines().count() - 2;
        let last = format!("time.end={}", 1e-3 * (steps + 5) as f64);
        let restart = ["--restart", "out/checkpoint.voidage", "--set", &last];
        run(folder.path(), "out", &[&serve, &restart[..]].concat());
        let straight = run(folder.path(), "straight", &["--set", &last]);
        assert_same(&straight, &out);
    }
}

#[test]
fn a_hung_solver_ends_the_run_at_the_time_out() {
    for transport in ["shm", "tcp"] {
        let folder = folder();
        let serve = ["--fluid", "serve", "--transport", transport, "--timeout", "1"];
        let run_process = start(folder.path(), "out", &[&serve, &ENDLESS[..]].concat());
        until_step(&folder.path().join("out"), 5);
        let stopped = Instant::now();
        signal("-STOP", child_of(run_process.id()));
        let (code, said) = end(run_process);
        assert!(stopped.elapsed() < Duration::from_secs(1) + SOON, "{:?}", stopped.elapsed());
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("step ") && said.contains("silent for 1 s"), "{said}");
        assert!(said.contains("--timeout"), "{said}");
    }
}

#[test]
fn the_error_of_a_solver_is_that_of_the_run() {
    let folder = folder();
    let closed = ["--set", "fluid.boundaries.outflow.flow=no-slip"];
    let options = [&["--fluid", "serve"], &closed[..]].concat();
    let (code, said) = end(start(folder.path(), "out", &options));
    assert_eq!(code, Some(1), "{said}");
    for part in ["step 1,", "fluid solver serve", "it reports:", "no boundary is open"] {
        assert!(said.contains(part), "{part} is not in\n{said}");
    }
}

#[test]
fn a_solver_that_does_not_start_shows_its_log() {
    let folder = folder();
    let options = ["--fluid", "python:no_such_module"];
    let (code, said) = end(start(folder.path(), "out", &options));
    assert_eq!(code, Some(1), "{said}");
    let log = fs::read_to_string(folder.path().join("out/solver.log")).unwrap();
    let last = log.lines().last().unwrap();
    assert!(said.contains("solver.log") && said.contains(last), "{said}");
}

/// What voidage has in shared memory, but for the one file of 16 bytes that all runs share for good.
fn in_shared_memory() -> Vec<String> {
    let entries = fs::read_dir("/dev/shm").into_iter().flatten();
    let names = entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with("voidage_") && !name.ends_with(".global_mgmt")).collect()
}

#[test]
fn a_killed_run_takes_its_solver_with_it_and_nothing_stays_after_the_next_start() {
    let folder = folder();
    for transport in ["shm", "tcp"] {
        let options = [&["--fluid", "serve", "--transport", transport], &ENDLESS[..]].concat();
        let before = in_shared_memory();
        let run_process = start(folder.path(), transport, &options);
        until_step(&folder.path().join(transport), 5);
        let solver = child_of(run_process.id());
        let left: Vec<_> = in_shared_memory().into_iter().filter(|name| !before.contains(name)).collect();
        signal("-KILL", run_process.id());
        let killed = Instant::now();
        end(run_process);
        until("the solver goes on", || !is_running(solver));
        assert!(killed.elapsed() < SOON, "{:?}", killed.elapsed());
        // Both killed: here the solver had time to tidy up, so do it again.
        let again = format!("{transport}-again");
        let run_process = start(folder.path(), &again, &options);
        until_step(&folder.path().join(&again), 5);
        let solver = child_of(run_process.id());
        signal("-STOP", solver);
        signal("-KILL", run_process.id());
        signal("-KILL", solver);
        end(run_process);
        run(folder.path(), &format!("{transport}-next"), &["--fluid", "serve", "--set", "time.end=0.001"]);
        // Some of this may be of tests beside this one, which end as well.
        until("something stays in shared memory", || {
            let now = in_shared_memory();
            !left.iter().any(|name| now.contains(name))
        });
    }
}

/// Tells the test below that it is the process to die.
const DIES: &str = "VOIDAGE_TEST_DIES_AT";

#[test]
fn a_solver_that_dies_before_its_hello_ends_the_run() {
    if let Ok(address) = std::env::var(DIES) {
        let _channel = transport::connect(&address.parse().unwrap(), Duration::from_secs(60)).unwrap();
        // Time to be seen, or not.
        std::thread::sleep(Duration::from_millis(300));
        std::process::abort();
    }
    let this = "a_solver_that_dies_before_its_hello_ends_the_run";
    let dies = |address: &Address| {
        let mut solver = Command::new(std::env::current_exe().unwrap());
        solver.args(["--exact", this]).env(DIES, address.to_string());
        assert!(!solver.stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap().success());
    };
    let folder = folder();
    let address = Address::unique();
    let run_process = start(folder.path(), "out", &["--fluid", &format!("attach:{address}")]);
    dies(&address);
    let died = Instant::now();
    let (code, said) = end(run_process);
    assert!(died.elapsed() < SOON, "{:?}", died.elapsed());
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("it is gone"), "{said}");
    // Anybody can come to a port and go: that is no solver, and the run waits for one.
    let address = Address::Tcp("127.0.0.1:47313".into());
    let options = ["--fluid", &format!("attach:{address}"), "--set", "time.end=0.005"];
    let run_process = start(folder.path(), "tcp", &options);
    dies(&address);
    let solver = voidage(folder.path()).args(["serve", "--connect", &address.to_string()]).spawn().unwrap();
    for process in [run_process, solver] {
        let (code, said) = end(process);
        assert_eq!(code, Some(0), "{said}");
    }
}

#[test]
fn a_run_that_all_the_world_could_reach_took_the_first_to_come() {
    let folder = folder();
    let options = ["--fluid", "attach:tcp:0.0.0.0:47317", "--set", "time.end=0.005"];
    let (code, said) = end(start(folder.path(), "out", &options));
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("whoever reaches this port") && said.contains("--token"), "{said}");
    let with_token = [&options[..], &["--token", "secret"]].concat();
    let run_process = start(folder.path(), "out", &with_token);
    let solver = |token: &str| {
        let mut command = voidage(folder.path());
        command.args(["serve", "--connect", "tcp:127.0.0.1:47317"]).env("VOIDAGE_TOKEN", token);
        end(command.spawn().unwrap())
    };
    for wrong in ["", "guess"] {
        let (code, said) = solver(wrong);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("takes no solver that greets with") && said.contains("--token"), "{said}");
        assert!(!said.contains("guess") && !said.contains("secret"), "{said}");
    }
    let (code, said) = solver("secret");
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = end(run_process);
    assert_eq!(code, Some(0), "{said}");
}

/// So many grains all over a mesh, as a step has them.
fn crowd(mesh: &voidage_fluid::Mesh<2>, count: usize) -> (Points<2>, Vec<f64>) {
    let (lower, upper) = mesh.bounds();
    // Multiples of irrational numbers lie evenly.
    let place = |i: usize, k: usize| 0.05 + 0.9 * (i as f64 * [0.754_877_666, 0.569_840_290][k]).fract();
    let position: Vec<_> = (0..count)
        .map(|i| Vector::<2>::from_fn(|k, _| lower[k] + (upper[k] - lower[k]) * place(i, k)))
        .collect();
    let area = (upper - lower).product();
    let column = |most: f64| (0..count).map(|i| most * (0.5 + 0.5 * place(i, 0))).collect::<Vec<_>>();
    let each = 1.0 / count as f64;
    let heat = HeatLoad {
        coefficient: column(10.0 * each),
        mobility: vec![0.0; count],
        temperature: vec![350.0; count],
    };
    let mut load = GrainLoad {
        volume: column(0.4 * area * each),
        drag: column(0.1 * each),
        mobility: vec![0.0; count],
        velocity: vec![Vector::zeros(); count],
        heat: Some(heat),
        ..GrainLoad::default()
    };
    let radius = vec![0.3 * (area * each).sqrt(); count];
    Overlap::new(mesh).unwrap().cut(mesh, &position, &radius, &mut load.pieces, &mut vec![]).unwrap();
    overlap::voidage(mesh, &load.pieces, &load.volume, &mesh.nodal_volume(), &mut load.voidage);
    let rigid = Rigid { fluid: OnMesh { mesh, fields: &at_rest(mesh) }, density: 1.2, dt: 1e-3 };
    let mut points = Points::default();
    load.fill_points(&rigid, (HEAT, 1), &mut points);
    (points, load.voidage)
}

#[test]
fn grains_may_grow_in_number_by_a_hundred_times_during_a_run() {
    let folder = folder();
    let path = folder.path().join("scene.toml");
    let scene = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| set.to_string()).collect();
        Scene::read(&path, &sets).unwrap()
    };
    let host = Host {
        program: Some(env!("CARGO_BIN_EXE_voidage").into()),
        log: folder.path().join("solver.log"),
        ..Host::default()
    };
    let coupled = build::coupled(&scene(&[]), &host).unwrap();
    let fluid = coupled.fluid().unwrap();
    // Tests without Python go without the third; `tests/python-setup` makes its environment.
    let python = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/venv/bin/python");
    let solvers = [("shm", "serve"), ("tcp", "serve"), ("shm", "scikit-fem")];
    for (transport, solver) in &solvers[..if python.exists() { 3 } else { 2 }] {
        let choice = [
            format!("fluid.backend.solver={solver:?}"),
            format!("fluid.backend.transport={transport:?}"),
            "fluid.solver.tolerance=1e-13".into(),
        ];
        let remote = scene(&choice.each_ref().map(String::as_str));
        let here = scene(&["fluid.solver.tolerance=1e-13"]);
        let mut backends = [&here, &remote].map(|scene| build::backend(scene, &host).unwrap());
        let start = at_rest(&fluid.mesh);
        backends.iter_mut().for_each(|backend| backend.set_mesh(&fluid.mesh, 1, &start).unwrap());
        for (number, count) in (1..).zip([50, 5_000, 70, 5_000]) {
            let (points, voidage) = crowd(&fluid.mesh, count);
            // In every second step solid volume comes in and goes.
            let coming: Vec<f64> =
                (0..fluid.mesh.points.len()).map(|node| (0.3 * node as f64).sin()).collect();
            let source = (number % 2 == 0).then_some(&coming[..]);
            let immersed = Some(Immersed { points: &points, voidage: &voidage, source });
            let (time, conditions) = (1e-3 * (number - 1) as f64, &fluid.conditions[..]);
            let step = FluidStep { number, time, dt: 1e-3, immersed, conditions, motion: None };
            let [ours, theirs] = backends.each_mut().map(|backend| {
                let mut solution = Solution::default();
                backend.solve(&step, &mut solution).unwrap();
                backend.accept();
                (solution.fields, solution.balances)
            });
            if *solver == "serve" {
                assert_eq!(theirs, ours);
            }
            let (ours, theirs) = (ours.0, theirs.0);
            let largest = ours.velocity.iter().fold(0.0, |most: f64, u| most.max(u.norm()));
            for (a, b) in ours.velocity.iter().zip(&theirs.velocity) {
                assert!((a - b).norm() <= 1e-9 * largest, "{solver}: {a} {b}");
            }
        }
    }
}

/// Gas at rest.
fn at_rest(mesh: &voidage_fluid::Mesh<2>) -> voidage_fluid::flow::State<2> {
    let nodes = mesh.points.len();
    voidage_fluid::flow::State {
        velocity: vec![Vector::zeros(); nodes],
        pressure: vec![0.0; nodes],
        scalars: vec![vec![290.0; nodes]],
    }
}

#[test]
fn another_protocol_version_is_named() {
    let folder = folder();
    // A solver of another version.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    drop(listener);
    let attach = format!("attach:tcp:127.0.0.1:{port}");
    let run_process = start(folder.path(), "out", &["--fluid", &attach]);
    let mut stream = None;
    until("the run does not listen", || {
        stream = TcpStream::connect(("127.0.0.1", port)).ok();
        stream.is_some()
    });
    stream.unwrap().write_all(&hello_of_version(99)).unwrap();
    let (code, said) = end(run_process);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("protocol version 99") && said.contains("install the same version"), "{said}");
    // A run of another version.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp:{}", listener.local_addr().unwrap());
    let solver = voidage(folder.path()).args(["serve", "--connect", &address]).spawn().unwrap();
    let mut stream = listener.accept().unwrap().0;
    stream.write_all(&hello_of_version(0)).unwrap();
    let (code, said) = end(solver);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("protocol version 0"), "{said}");
}

/// The first bytes of a header: magic, version, kind.
fn hello_of_version(version: u32) -> Vec<u8> {
    let header = Header::new(Kind::Hello);
    let mut bytes = header.magic.to_le_bytes().to_vec();
    bytes.extend(version.to_le_bytes());
    bytes.extend(header.kind.to_le_bytes());
    bytes.resize(size_of::<Header>(), 0);
    bytes
}

#[test]
fn a_full_shared_memory_is_an_error_with_a_remedy() {
    let folder = folder();
    let script = "mount -t tmpfs -o size=1m tmpfs /dev/shm && exec \"$0\" \"$@\"";
    let mut command = Command::new("unshare");
    command.current_dir(folder.path()).args(["-m", "sh", "-c", script, env!("CARGO_BIN_EXE_voidage")]);
    let output = command.args(["run", "scene.toml", "--quiet", "--fluid", "serve"]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    if said.contains("unshare") || said.contains("mount:") {
        eprintln!(
            "no right to mount here, `a_small_shared_memory_is_an_error_before_it_is_full` has to do: {said}"
        );
        return;
    }
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("1.0 MiB free") && said.contains("--transport tcp"), "{said}");
}

#[test]
fn options_of_processes_are_checked() {
    let folder = folder();
    let wrong = [
        (&["--fluid", "magic"][..], "there is no such fluid solver"),
        (&["--fluid", "attach:nowhere"][..], "is no address"),
        (&["--transport", "tcp"][..], "is not started here"),
        (&["--timeout", "3"][..], "is in this process"),
        (&["--fluid", "serve", "--timeout", "0"][..], "is not above 0"),
    ];
    for (options, what) in wrong {
        let (code, said) = end(start(folder.path(), "out", options));
        assert_eq!(code, Some(2), "{options:?}: {said}");
        assert!(said.contains(what), "{options:?}: {said}");
    }
}

/// The options were given to the reference in this process too, which has neither, so that every comparison with them
/// was refused.
#[test]
fn solvers_are_compared_with_options_that_only_some_of_them_have() {
    let folder = folder();
    let arguments =
        ["compare", "scene.toml", "--fluids", "rust,serve", "--timeout", "60", "--transport", "shm"];
    let short = ["--set", "time.end=0.002", "--steps", "0", "--out", "out"];
    let (code, said) = end(voidage(folder.path()).args(arguments).args(short).spawn().unwrap());
    assert_eq!(code, Some(0), "{said}");
}
