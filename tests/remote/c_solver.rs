//! Fluid solvers in C: the header is that of the protocol, the example computes what the same solver in Rust does, what
//! C reads is what was sent, and what is no frame is an error that says so.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use voidage_coupling::backend::{FluidBackend, FluidStep, Immersed, Model, Solution};
use voidage_coupling::closure::{Drag, HeatTransfer, Per, ThermalFluid, VoidageFunction};
use voidage_coupling::exchange::AtGrains;
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::unsteady::Unsteady;
use voidage_coupling::{Coupled, Fluid, Interaction, Laws, Mixture, Result, StepReport, System, TEMPERATURE};
use voidage_dem::{Dem, Material, Particles, Settings, Wall};
use voidage_fluid::conditions::{Condition, FlowCondition};
use voidage_fluid::flow::{Numerics, State};
use voidage_fluid::forms::Properties;
use voidage_fluid::mesh::{Diagonals, Rectangle, Side, Sides, Structured};
use voidage_fluid::points::{PointScalar, Points};
use voidage_fluid::transport::Scalar;
use voidage_fluid::{Mesh, MeshMotion, Vector};
use voidage_remote::protocol::{
    HEADER_BYTES, Header, Kind, MeshMessage, POINT_SCALAR, POINTS, Setup, StateMessage, StepMessage, Table,
    TableLayout, numbers_for_text, write_text,
};
use voidage_remote::remote::RemoteFluid;
use voidage_remote::token::Token;
use voidage_remote::transport::{self, Address};

type Vec2 = Vector<2>;

const PATIENCE: Duration = Duration::from_secs(60);

/// The root of the repository.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the folder above")
}

// ------------------------------------------------------------------------------------------ compilers

/// Warnings are errors. A sum of a product is not to be contracted, on machines that could: bits are compared.
const STRICT: [&str; 5] = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off"];

fn compile(compiler: &str, options: &[&str], source: &str, to: &Path) -> std::io::Result<Output> {
    let mut command = Command::new(compiler);
    command.args(options).args(STRICT).args(["-O1", "-o"]).arg(to).arg(root().join(source)).output()
}

/// A program in C, and the folder that goes with it.
fn program(source: &str, options: &[&str]) -> (PathBuf, TempDir) {
    let place = tempfile::tempdir().expect("a folder");
    let to = place.path().join("solver");
    let output = compile("cc", &[&["-std=c99"], options].concat(), source, &to).expect("a C compiler");
    assert!(output.status.success(), "{source}: {}", String::from_utf8_lossy(&output.stderr));
    (to, place)
}

#[test]
fn the_header_is_that_of_the_protocol() {
    let written = std::fs::read_to_string(root().join("coupling/remote/voidage.h")).unwrap_or_default();
    assert!(
        written == voidage_remote::c::header(),
        "coupling/remote/voidage.h is old: cargo run -p voidage-remote --example header"
    );
}

#[test]
fn the_header_and_the_example_are_c_plus_plus_too() {
    let place = tempfile::tempdir().expect("a folder");
    for standard in ["-std=c++11", "-std=c++20"] {
        let to = place.path().join("solver");
        match compile("c++", &["-x", "c++", standard], "coupling/remote/examples/uniform.c", &to) {
            Ok(output) => {
                let said = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "{standard}: {said}");
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                eprintln!("there is no c++ here: the header has not been compiled as C++");
                return;
            }
            Err(error) => panic!("{error}"),
        }
    }
}

/// In the root of the repository, as pages say.
#[test]
fn the_command_that_pages_show_compiles_the_example() {
    let place = tempfile::tempdir().expect("a folder");
    for page in ["coupling/README.md", "coupling/remote/examples/uniform.c"] {
        let text = std::fs::read_to_string(root().join(page)).expect("a page");
        let mut lines = text.lines().map(|line| line.trim_start_matches([' ', '*']));
        let command = lines.find(|line| line.starts_with("cc ")).expect("a command");
        let mut words = command.split(' ');
        let mut compiler = Command::new(words.next().expect("a compiler"));
        let to = place.path().join("uniform");
        let words = words.map(|word| if word == "uniform" { to.as_os_str() } else { OsStr::new(word) });
        let status = compiler.args(words).current_dir(root()).status().expect("a C compiler");
        assert!(status.success() && to.exists(), "{page}: {command}");
        std::fs::remove_file(&to).expect("the solver");
    }
}

// --------------------------------------------------------------------------------------- a small scene

fn mesh() -> Mesh<2> {
    let [left, right, bottom, top] = ["left", "right", "bottom", "top"].map(Side::named);
    Mesh::rectangle(&Rectangle {
        lower: [0.0; 2],
        upper: [0.04, 0.08],
        size: None,
        sides: Sides { left, right, bottom, top },
        holes: vec![],
        refine: vec![],
        structured: Some(Structured { squares: [4, 8], diagonals: Diagonals::Alternating }),
    })
    .expect("a mesh")
}

fn model() -> Model<2> {
    let properties = Properties {
        density: 1.2,
        viscosity: 1.8e-5,
        gravity: Vec2::new(0.1, -9.81),
        body_force: Vec2::zeros(),
        thin_cell_drag: 0.0,
    };
    let condition = |side: &str| Condition {
        boundary: side.into(),
        flow: if side == "left" { FlowCondition::Slip } else { FlowCondition::Open { pressure: 0.1 } },
        scalars: vec![],
    };
    Model {
        properties,
        scalars: vec![Scalar::new(TEMPERATURE, 1200.0, 0.03), Scalar::new("tracer", 1.0, 1e-5)],
        numerics: Numerics::default(),
        conditions: ["left", "right", "bottom", "top"].map(condition).to_vec(),
    }
}

fn number(i: usize) -> f64 {
    (i as f64 * 0.7).sin() / 3.0
}

fn fields(mesh: &Mesh<2>) -> State<2> {
    let nodes = 0..mesh.points.len();
    State {
        velocity: nodes.clone().map(|i| Vec2::new(number(i), number(i + 7))).collect(),
        pressure: nodes.clone().map(|i| 1e2 * number(i + 3)).collect(),
        scalars: [300.0, 0.5].map(|base| nodes.clone().map(|i| base + number(i)).collect()).to_vec(),
    }
}

/// What `examples/uniform.c` does, in this process.
struct Uniform {
    properties: Properties<2>,
    pressure: Vec<f64>,
    accepted: State<2>,
    next: State<2>,
    calls: Arc<Mutex<[usize; 2]>>,
}

impl FluidBackend<2> for Uniform {
    fn set_mesh(&mut self, mesh: &Mesh<2>, _: u32, fields: &State<2>) -> Result<()> {
        let Properties { density, gravity, .. } = &self.properties;
        self.pressure = mesh.points.iter().map(|x| density * (gravity.x * x.x + gravity.y * x.y)).collect();
        self.accepted = fields.clone();
        Ok(())
    }

    fn solve(&mut self, step: &FluidStep<'_, 2>, out: &mut Solution<2>) -> Result<()> {
        self.calls.lock().expect("no panic")[0] += 1;
        let share = step.dt / 0.05;
        let stream = |node: usize| step.immersed.map_or(0.1, |immersed| 0.1 / immersed.voidage[node]);
        let velocity =
            self.accepted.velocity.iter().enumerate().map(|(node, u)| {
                Vec2::new(u.x / (1.0 + share), (u.y + share * stream(node)) / (1.0 + share))
            });
        self.next = State {
            velocity: velocity.collect(),
            pressure: self.pressure.clone(),
            scalars: self.accepted.scalars.clone(),
        };
        *out = Solution { fields: self.next.clone(), ..Solution::default() };
        Ok(())
    }

    fn accept(&mut self) {
        self.calls.lock().expect("no panic")[1] += 1;
        self.accepted = self.next.clone();
    }
}

/// Hot grains that fall on a floor, in a fluid of this solver.
fn bed(backend: Box<dyn FluidBackend<2>>) -> Result<Coupled<2>> {
    let (mesh, model) = (mesh(), model());
    let start = fields(&mesh);
    let names = model.scalars.iter().map(|scalar| scalar.name.clone()).collect();
    let fluid = Fluid::new(backend, mesh, start, names, model.conditions)?;
    let material = Material { density: 200.0, heat_capacity: 800.0, ..Material::default() };
    let materials = [material.clone()];
    let places = (0..40).map(|k| {
        let (column, row) = ((k % 5) as f64, (k / 5) as f64);
        Vec2::new(0.004 + 0.008 * column + 1e-3 * number(k), 0.0025 + 0.0045 * row)
    });
    let particles = Particles::new(places.collect(), vec![2e-3; 40], vec![0; 40], &materials)?;
    let particles = particles.heated(350.0, &materials)?;
    let [a, b, c, d] = [[0.0, 0.0], [0.04, 0.0], [0.0, 0.08], [0.04, 0.08]].map(Vec2::from);
    let walls = vec![Wall::new("floor", a, b), Wall::new("left", a, c), Wall::new("right", b, d)];
    let settings = Settings { gravity: model.properties.gravity, ..Settings::default() };
    let grains = Dem::new(particles, walls, vec![material], settings)?;
    let at = AtGrains {
        velocity: vec![Vec2::zeros(); 40],
        pressure_gradient: vec![Vec2::zeros(); 40],
        temperature: vec![300.0; 40],
    };
    let laws = Laws {
        drag: Drag::Dallavalle,
        voidage_function: VoidageFunction::None,
        heat: HeatTransfer::RanzMarshall,
        per: Per::Solid,
        unsteady: Unsteady::default(),
        kernel: 1.0,
        density: model.properties.density,
        viscosity: model.properties.viscosity,
        thermal: Some(ThermalFluid { conductivity: 0.03, prandtl: 0.7 }),
    };
    let interaction = Interaction::new(laws, &fluid.mesh, &grains, at)?;
    let system = System::Mixture(Box::new(Mixture::new(grains, fluid, interaction)));
    Ok(Coupled::new(system, SchemeName::Iterated.build(&Options::default())?))
}

/// Grains and accepted fields, as bits.
fn bits(system: &Coupled<2>) -> Vec<u64> {
    let (particles, fluid) =
        (&system.grains().expect("grains").particles, &system.fluid().expect("a fluid").accepted);
    let vectors = particles.position.iter().chain(&particles.velocity).chain(&fluid.velocity);
    let heat = &particles.heat.as_ref().expect("heat").temperature;
    let scalars = heat.iter().chain(&fluid.pressure).chain(fluid.scalars.iter().flatten());
    vectors.flat_map(|v| [v.x, v.y]).chain(scalars.copied()).map(f64::to_bits).collect()
}

/// Twenty steps, other accepted fields, and twenty more. Before each the fluid is solved over another time, without
/// grains, and this solution is rejected.
fn run(mut system: Coupled<2>) -> Result<Vec<u64>> {
    for step in 0..40 {
        if step == 20 {
            let fluid = system.fluid_mut().expect("a fluid");
            fluid.accepted.velocity.iter_mut().for_each(|u| u.y *= 0.5);
            fluid.start()?;
        }
        system.fluid_mut().expect("a fluid").solve(3e-3, None, &mut StepReport::default())?;
        system.step(1e-3)?;
    }
    Ok(bits(&system))
}

/// A solver in C. What it says goes to files: nobody reads a pipe while it runs.
struct Running {
    process: Child,
    said: File,
    errors: File,
}

/// A solver that connects to an address.
fn start(program: &Path, address: &str, token: &str) -> Running {
    let [said, errors] = [(); 2].map(|()| tempfile::tempfile().expect("a file"));
    let written = |file: &File| Stdio::from(file.try_clone().expect("a file"));
    let mut command = Command::new(program);
    command.arg(address).env("VOIDAGE_TOKEN", token).stdin(Stdio::null());
    // Memory that is not there is to be an error of the solver, and no end of it.
    command.env("ASAN_OPTIONS", "allocator_may_return_null=1:detect_leaks=0");
    let process = command.stdout(written(&said)).stderr(written(&errors)).spawn().expect("a process");
    Running { process, said, errors }
}

impl Running {
    /// How it ended and what it said, if it ends in time.
    fn end(mut self) -> (Option<i32>, String, String) {
        let limit = Instant::now() + PATIENCE;
        while self.process.try_wait().expect("a process").is_none() {
            if Instant::now() > limit {
                self.process.kill().expect("a process");
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let code = self.process.wait().expect("a process").code();
        let [said, errors] = [self.said, self.errors].map(|mut file| {
            let mut text = String::new();
            file.rewind().and_then(|()| file.read_to_string(&mut text)).expect("UTF-8");
            text
        });
        (code, said, errors)
    }
}

/// A solver in C as the grains see it, and the process that it is.
fn attach(program: &Path, token: &str) -> (RemoteFluid<2>, Running) {
    let token = Token::new(Some(token.into()));
    let (channel, address) = transport::listen(&Address::any_port(), PATIENCE, &token).expect("a port");
    let solver = start(program, &address.to_string(), token.word().unwrap_or_default());
    let name = program.display().to_string();
    let fluid = RemoteFluid::new(channel, None, name, (PATIENCE, token), &Setup::new(model()));
    (fluid.expect("a solver in C"), solver)
}

#[test]
fn a_bed_with_the_solver_in_c_is_that_with_the_same_solver_in_rust_bit_for_bit() {
    let (program, _folder) = program("coupling/remote/examples/uniform.c", &[]);
    let (fluid, solver) = attach(&program, "a word");
    let in_c = run(bed(Box::new(fluid)).expect("a bed")).expect("a run");
    assert_eq!(solver.end(), (Some(0), String::new(), String::new()));
    let calls = Arc::new(Mutex::new([0; 2]));
    let uniform = Uniform {
        properties: model().properties,
        pressure: vec![],
        accepted: State::default(),
        next: State::default(),
        calls: calls.clone(),
    };
    let in_rust = run(bed(Box::new(uniform)).expect("a bed")).expect("a run");
    assert_eq!(in_c, in_rust);
    let [solved, accepted] = *calls.lock().expect("no panic");
    assert!(accepted == 40 && solved >= 80, "{solved} solutions of {accepted} steps reject too few");
}

// ----------------------------------------------------------------------------------- what C has read

fn line(name: &str, numbers: impl IntoIterator<Item = f64>) -> String {
    let numbers = numbers.into_iter().map(|number| format!(" {:x}", number.to_bits()));
    format!("{name}{}\n", numbers.collect::<String>())
}

fn flat(vectors: &[Vec2]) -> Vec<f64> {
    vectors.iter().flat_map(|v| [v.x, v.y]).collect()
}

fn whole(numbers: &[u32]) -> Vec<f64> {
    numbers.iter().map(|number| f64::from(*number)).collect()
}

fn lines_of_fields(fields: &State<2>) -> String {
    let scalars: String = fields.scalars.iter().map(|values| line("value", values.clone())).collect();
    line("velocity", flat(&fields.velocity)) + &line("pressure", fields.pressure.clone()) + &scalars
}

fn lines_of_mesh(mesh: &Mesh<2>, fields: &State<2>) -> String {
    let parts = &mesh.boundaries;
    let sides: Vec<f64> = parts.iter().flat_map(|part| whole(&part.facets)).collect();
    let behind: Vec<f64> = parts.iter().flat_map(|part| whole(&part.cells)).collect();
    let mut lines = line("points", flat(&mesh.points)) + &line("corners", whole(&mesh.cells));
    lines += &(line("sides", sides) + &line("behind", behind));
    if !mesh.periodic.is_none() {
        let masters = (0..mesh.points.len() as u32).map(|node| f64::from(mesh.periodic.master(node)));
        lines += &(line("period", mesh.periodic.period().iter().copied()) + &line("masters", masters));
    }
    let named: Vec<String> =
        parts.iter().map(|part| format!("[\"{}\",{}]", part.name, part.cells.len())).collect();
    let first = |k: usize, name: &str| i32::from(parts.get(k).is_some_and(|part| part.name == name));
    let known = format!("left: {}, right: {}\n", first(0, "left"), first(1, "right"));
    lines + &lines_of_fields(fields) + &format!("[{}]\n", named.join(",")) + &known
}

fn points(count: usize, exchanged: bool) -> Points<2> {
    let column = |shift: f64| (0..count).map(|i| shift + i as f64 / 3.0).collect::<Vec<_>>();
    let vectors = |shift| column(shift).into_iter().map(|x| Vec2::new(x, -x)).collect::<Vec<_>>();
    let scalar = PointScalar { coefficient: column(7.0), mobility: column(8.0), value: column(9.0) };
    Points {
        cell: (0..count as u32).map(|i| i % 3).collect(),
        coordinate: vectors(0.25),
        volume: column(1.0),
        drag: column(2.0),
        mobility: column(3.0),
        velocity: vectors(4.0),
        flux_mobility: column(5.0),
        flux_velocity: vectors(6.0),
        scalars: vec![None, exchanged.then_some(scalar)],
    }
}

/// The columns of points in the order of the table, read from a payload as Rust has written it.
fn lines_of_points(points: &Points<2>) -> String {
    let place = TableLayout::of(points, 0);
    let mut payload = vec![0.0; place.length];
    place.write(points, &mut payload);
    let ranges = place.ranges((&POINTS, &POINT_SCALAR), points.scalars(), 2);
    ranges.into_iter().map(|(column, range)| line(column.name, payload[range].to_vec())).collect()
}

fn lines_of_step(step: &FluidStep<'_, 2>, (iteration, accept): (u32, bool), new: bool) -> String {
    let mut lines = format!("step {}.{iteration} accept {}\n", step.number, i32::from(accept));
    lines += &(line("time", [step.time]) + &line("dt", [step.dt]));
    if let Some(immersed) = step.immersed {
        lines += &(lines_of_points(immersed.points) + &line("voidage", immersed.voidage.to_vec()));
        lines += &immersed.source.map_or_else(String::new, |source| line("source", source.to_vec()));
    }
    if let Some(motion) = step.motion {
        lines += &(line("places", flat(motion.points)) + &line("motion", flat(motion.velocity)));
    }
    if new {
        lines += &format!("{}\n", serde_json::json!(step.conditions));
    }
    lines
}

#[test]
fn c_reads_what_was_sent_and_its_answer_arrives() {
    let (program, _folder) = program("tests/remote/probe.c", &[]);
    let (mut fluid, solver) = attach(&program, "a \\ \"word\"\t");
    let plain = mesh();
    let mut joined = plain.clone();
    joined.join_sides([true, false]).expect("sides that fit");
    let mut expected = "4 parts, density 1.2, slip\n".to_owned();
    let mut other = model().conditions;
    other[1].flow = FlowCondition::NoSlip;
    let old = model().conditions;
    for (generation, mesh) in [(1, &plain), (2, &joined)] {
        let (nodes, fields) = (mesh.points.len(), fields(mesh));
        fluid.set_mesh(mesh, generation, &fields).expect("a mesh");
        expected += &lines_of_mesh(mesh, &fields);
        let (voidage, source): (Vec<f64>, Vec<f64>) =
            (0..nodes).map(|i| (0.5 + number(i), number(i + 1))).unzip();
        let velocity: Vec<_> = mesh.points.iter().map(|x| x * 3.0).collect();
        let motion = Some(MeshMotion { points: &mesh.points, velocity: &velocity });
        let (with_heat, without) = (points(5, true), points(16, false));
        let of = |points, source| Some(Immersed { points, voidage: &voidage, source });
        // The second mesh comes with the conditions that the first one ends with: no step has accepted the last.
        let steps = [
            (1, None, None, &old, generation == 2),
            (2, of(&with_heat, None), None, &other, true),
            (2, of(&with_heat, Some(&source[..])), None, &other, false),
            (3, of(&without, Some(&source[..])), motion, &old, true),
            (4, None, motion, &other, true),
        ];
        for (k, (step, immersed, motion, conditions, new)) in steps.into_iter().enumerate() {
            let step = FluidStep { number: step, time: 0.1, dt: 1.0 / 3.0, immersed, conditions, motion };
            let mut solution = Solution::default();
            fluid.solve(&step, &mut solution).expect("a solution");
            assert_eq!(solution.fields, fields);
            assert_eq!(solution.balances.len(), 4);
            let balance = &solution.balances[1];
            // Numbers 9 to 16: flux, force, torque, two scalars, and what was convected of them.
            assert_eq!((balance.flux, &balance.torque[..]), (9.0, &[12.0][..]));
            assert_eq!((balance.force, &balance.scalars[..]), (Vec2::new(10.0, 11.0), &[13.0, 14.0][..]));
            assert_eq!(balance.convected, [15.0, 16.0]);
            assert_eq!((solution.bodies[0].velocity, solution.bodies[0].vapour), (Vec2::new(1.0, 2.0), 3.0));
            let report = solution.report;
            assert_eq!((report.flow_iterations, report.scalar_iterations), (1, 2));
            assert_eq!((report.residual, report.factored), (3.0, true));
            assert_eq!((report.scalars_s, report.flow_s), (5.0, 6.0));
            // The second solution of step 2 follows one that was rejected.
            let (iteration, accept) = (u32::from(k == 2), matches!(k, 1 | 3 | 4));
            expected += &lines_of_step(&step, (iteration, accept), new);
            if k != 1 {
                fluid.accept();
            }
        }
        let state = State { pressure: vec![1.5; nodes], ..fields };
        fluid.set_mesh(mesh, generation, &state).expect("a state");
        expected += &lines_of_fields(&state);
    }
    drop(fluid);
    let (code, said, errors) = solver.end();
    assert_eq!((code, errors.as_str()), (Some(0), ""));
    for (said, expected) in said.lines().zip(expected.lines()) {
        assert_eq!(said, expected);
    }
    assert_eq!(said.lines().count(), expected.lines().count());
}

// --------------------------------------------------------------------------------- what is no frame

/// A frame as it goes over TCP.
fn frame(header: Header, payload: &[f64]) -> Vec<u8> {
    // SAFETY: the fields fill a header without padding.
    let header: [u8; HEADER_BYTES] = unsafe { std::mem::transmute(header) };
    header.iter().copied().chain(payload.iter().flat_map(|number| number.to_ne_bytes())).collect()
}

const RUN: u64 = 7;

/// The answer to a hello.
fn hello() -> Vec<u8> {
    let text = serde_json::to_string(&Setup::new(model())).expect("JSON");
    let mut payload = vec![0.0; numbers_for_text(&text)];
    write_text(&text, &mut payload);
    let (text, length) = (text.len() as u64, payload.len() as u64);
    frame(Header { run: RUN, text, length, ..Header::new(Kind::Hello) }, &payload)
}

/// A mesh, a state and a step, as header and payload.
fn requests() -> [(Header, Vec<f64>); 3] {
    let mesh = mesh();
    let fields = fields(&mesh);
    let written = |header: Header, write: &dyn Fn(&mut [f64])| {
        let mut payload = vec![0.0; header.length as usize];
        write(&mut payload);
        (Header { run: RUN, generation: 1, ..header }, payload)
    };
    let message = MeshMessage::new(&mesh, &fields);
    let first = written(message.header(), &|payload| message.write(payload));
    let message = StateMessage::new(&fields);
    let second = written(message.header(), &|payload| message.write(payload));
    let (points, voidage) = (points(5, true), vec![0.5; mesh.points.len()]);
    let (immersed, conditions) = (Immersed { points: &points, voidage: &voidage, source: None }, vec![]);
    let step = FluidStep {
        number: 1,
        time: 0.0,
        dt: 1e-3,
        immersed: Some(immersed),
        conditions: &conditions,
        motion: None,
    };
    let message = StepMessage::new(&step, "[]".into());
    [first, second, written(message.header(false, 0), &|payload| message.write(payload))]
}

/// What a solver says, and its exit code, when a run sends it these bytes and closes the connection.
fn told(program: &Path, bytes: &[u8]) -> (Option<i32>, String) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    let solver = start(program, &format!("tcp:{address}"), "");
    let (mut stream, _) = listener.accept().expect("a solver");
    stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
    read_frame(&mut stream);
    // A solver that has read enough does not wait for the rest.
    let _ = stream.write_all(bytes).and_then(|()| stream.shutdown(Shutdown::Write));
    let _ = stream.read_to_end(&mut vec![]);
    let (code, _, errors) = solver.end();
    (code, errors)
}

fn read_frame(stream: &mut TcpStream) {
    let mut header = [0; HEADER_BYTES];
    stream.read_exact(&mut header).expect("a header");
    let length = u64::from_ne_bytes(header[HEADER_BYTES - 8..].try_into().expect("eight bytes"));
    stream.read_exact(&mut vec![0; length as usize * 8]).expect("a payload");
}

#[test]
fn a_solver_in_c_says_what_is_wrong_with_what_it_is_sent() {
    let (program, _folder) = program("coupling/remote/examples/uniform.c", &[]);
    let hello = hello();
    let [mesh, state, step] = requests();
    let whole = frame(mesh.0, &mesh.1);
    let after = |last: Vec<u8>| [hello.clone(), last].concat();
    let on_mesh = |last: Vec<u8>| [hello.clone(), whole.clone(), last].concat();
    let changed = |(header, payload): &(Header, Vec<f64>), change: &dyn Fn(&mut Header, &mut Vec<f64>)| {
        let (mut header, mut payload) = (*header, payload.clone());
        change(&mut header, &mut payload);
        frame(header, &payload)
    };
    let cases: Vec<(Vec<u8>, &str)> = vec![
        (vec![], "takes no solver with this token and of this version of the protocol"),
        (
            frame(Header { version: 5, ..Header::new(Kind::Hello) }, &[]),
            "protocol version 5, this is version",
        ),
        (
            frame(Header { magic: 5, ..Header::new(Kind::Hello) }, &[]),
            "starts with 0x0000000000000005 and not",
        ),
        (frame(Header::default(), &[]), "the unknown kind 0"),
        (frame(Header::new(Kind::Step), &[]), "step instead of a hello"),
        (frame(Header::new(Kind::Hello), &[]), "a setup of 0 dimensions"),
        (frame(Header { length: 1 << 40, ..Header::new(Kind::Hello) }, &[]), "says it has 1099511627776"),
        (hello[..100].to_vec(), "within a frame, after 100 of the 128 bytes of its header"),
        (hello[..hello.len() - 1].to_vec(), "bytes of its payload"),
        (hello.clone(), "the run is gone"),
        (after(whole[..whole.len() - 8].to_vec()), "within a frame"),
        (after(frame(Header { run: 8, ..mesh.0 }, &mesh.1)), "a frame of the run 8"),
        (after(frame(Header { run: RUN, ..Header::new(Kind::Solution) }, &[])), "solution is no request"),
        (after(frame(state.0, &state.1)), "fields of 45 nodes, the mesh has 0"),
        (after(frame(step.0, &step.1)), "a step before the mesh"),
        (after(changed(&mesh, &|h, _| h.cells += 1)), "among behind, there are 65"),
        (after(changed(&mesh, &|h, _| h.facets = u64::MAX / 8)), "the sides of a mesh: "),
        (after(changed(&mesh, &|h, _| h.text = 8 * h.length + 1)), "a text of "),
        (after(changed(&mesh, &|h, _| h.scalars = 1)), "fields with the scalars 0x1, there are 2"),
        (after(changed(&mesh, &|h, _| h.stride += 8)), "45 rows, 56 apart"),
        (after(changed(&mesh, &|_, p| p[90] = 45.0)), "the number 45 among corners, there are 45"),
        (after(changed(&mesh, &|_, p| p[91] = 0.5)), "the number 0.5 among corners"),
        (after(changed(&mesh, &|_, p| p[91] = f64::NAN)), "among corners"),
        (
            on_mesh(changed(&state, &|h, p| {
                h.length += 1;
                p.push(0.0)
            })),
            "1 numbers too many in a state",
        ),
        (on_mesh(changed(&step, &|_, p| p[0] = 64.0)), "the number 64 among cell, there are 64"),
        (on_mesh(changed(&step, &|h, _| h.nodes = 44)), "a step for 44 nodes, the mesh has 45"),
        (on_mesh(changed(&step, &|h, _| h.scalars = 4)), "points with the scalars 0x4"),
        (
            on_mesh(changed(&step, &|h, p| {
                h.length -= 9;
                p.drain(p.len() - 10..p.len() - 1);
            })),
            "the voidage of a step: ",
        ),
    ];
    for (bytes, expected) in cases {
        let (code, said) = told(&program, &bytes);
        assert!(code == Some(1) && said.contains(expected), "{expected:?}: {code:?} {said}");
        assert!(said.starts_with("uniform: ") && said.lines().count() == 1, "{said}");
    }
}

/// Bytes of the headers that are others than they should be, under the checks of the compiler where it has them.
#[test]
fn a_header_of_nonsense_is_an_error_and_no_crash() {
    let place = tempfile::tempdir().expect("a folder");
    let checked = place.path().join("checked");
    let checks = ["-std=c99", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    let compiled = compile("cc", &checks, "tests/remote/probe.c", &checked).expect("a C compiler");
    let (plain, _folder) = program("tests/remote/probe.c", &[]);
    let program = if compiled.status.success() { checked } else { plain };
    let [mesh, _, step] = requests();
    for (request, before) in [(&mesh, hello()), (&step, [hello(), frame(mesh.0, &mesh.1)].concat())] {
        for field in Header::FIELDS {
            for value in [0, 7, 1 << 40, u64::MAX] {
                let mut bytes = frame(request.0, &request.1);
                let number = value.to_ne_bytes();
                let size = if field.number == "u32" { 4 } else { 8 };
                bytes[field.offset..field.offset + size].copy_from_slice(&number[..size]);
                let (code, said) = told(&program, &[before.clone(), bytes].concat());
                // Memory that cannot be had is no fault of the program.
                let faults =
                    said.lines().filter(|line| !line.contains("WARNING: AddressSanitizer failed to"));
                let said = faults.collect::<Vec<_>>().join("\n");
                let shown = (field.name, value, &said);
                assert!(code == Some(1) && said.starts_with("probe: "), "{shown:?} {code:?}");
                assert!(said.lines().count() == 1, "{shown:?}");
            }
        }
    }
}

#[test]
fn a_solver_in_c_with_another_token_is_turned_away_and_both_say_why() {
    let (program, _folder) = program("coupling/remote/examples/uniform.c", &[]);
    let token = Token::new(Some("ours".into()));
    let (mut channel, address) = transport::listen(&Address::any_port(), PATIENCE, &token).expect("a port");
    let solver = start(&program, &address.to_string(), "theirs");
    let limit = Instant::now() + PATIENCE;
    while channel.turned_away().is_none() && Instant::now() < limit {
        channel.poll(Duration::from_millis(10)).expect("nobody");
    }
    assert_eq!(channel.turned_away(), Some("\"uniform\" has not the token of this run"));
    let (code, _, said) = solver.end();
    assert!(code == Some(1) && said.contains("with this token"), "{said}");
    assert!(said.contains("VOIDAGE_TOKEN"), "{said}");
}

#[test]
fn a_run_reads_why_a_solver_in_c_cannot_go_on() {
    let (program, _folder) = program("coupling/remote/examples/uniform.c", &[]);
    let (mut fluid, solver) = attach(&program, "");
    let mut joined = mesh();
    joined.join_sides([true, false]).expect("sides that fit");
    let error = fluid.set_mesh(&joined, 1, &fields(&joined)).expect_err("a mesh that it does not know");
    let said = error.to_string();
    assert!(
        said.contains("uniform") && said.contains("it reports: this solver knows no periodic sides"),
        "{said}"
    );
    assert_eq!(solver.end().0, Some(1));
}
