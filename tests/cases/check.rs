//! `voidage check`: it builds what a run builds, prints sizes, and says what is unusual; each mistake of units was once
//! passed over.

use assert_cmd::Command;
use std::fs;
use std::path::Path;
use voidage_fluid::Mesh;
use voidage_scene::{MeshSource, Scene};

const BED: &str = include_str!("bed.toml");

/// Exit code, what was printed and what was said.
fn check(folder: &Path, sets: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    command.current_dir(folder).args(["check", "scene.toml"]);
    sets.iter().for_each(|set| {
        command.args(["--set", set]);
    });
    let output = command.output().unwrap();
    let [printed, said] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    (output.status.code(), printed, said)
}

fn folder(scene: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    folder
}

/// A folder of the name of a shipped case does not hide it.
#[test]
fn a_case_is_found_beside_a_folder_of_its_name() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("settling-grain-still")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    command.current_dir(folder.path()).args(["check", "settling-grain-still"]).assert().success();
}

/// The water of a droplet expects one step of the grains in it: with ten it was carried along at twice its speed.
#[test]
fn schemes_in_which_grains_take_steps_of_their_own_are_refused_beside_a_droplet() {
    for scheme in ["strang", "sub-cycled", "sub-cycled-explicit"] {
        let set = format!("coupling.scheme={scheme}");
        let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
        let output = command.args(["check", "droplet-digging-quick", "--set", &set]).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(scheme) && said.contains("[droplet]"), "{said}");
    }
}

#[test]
fn a_good_scene_has_sizes_and_nothing_unusual() {
    let (code, printed, said) = check(folder(BED).path(), &[]);
    assert_eq!(code, Some(0), "{said}");
    for part in [
        "40, diameter 0.001 to 0.0012 m",
        "111 nodes, 180 triangles, 0.01 x 0.03 m",
        "0.0064 m2/s through inflow (0.008 m long)",
        "Courant number",
        "diameters wide",
        "relaxation time",
        "minimum fluidisation at",
    ] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
    assert!(!printed.contains("unusual"), "{printed}");
}

#[test]
fn what_is_unusual_is_said_with_key_and_reason() {
    for (set, says) in [
        ("gravity=[0.0, 9.81]", ["`gravity`", "points upwards"]),
        ("gravity=[0.0, -9810.0]", ["`gravity`", "on earth it is 9.81"]),
        ("materials.glass.density=2.5", ["`materials.glass.density`", "water has 1000"]),
        ("fluid.density=1.2e-3", ["`fluid.density`", "air has 1.2"]),
        ("fluid.viscosity=2e-8", ["`fluid.viscosity`", "air has 1.8e-5"]),
        ("time.step=0.02", ["`time.step`", "diameters in a step"]),
        (
            "fluid.boundaries.inflow.flow.superficial_velocity=[0.8, 0.0]",
            ["`fluid.boundaries[1].flow`", "along \"inflow\""],
        ),
        (
            "fluid.boundaries.inflow.flow.superficial_velocity=[0.0, -0.8]",
            ["`fluid.boundaries[1].flow`", "out of the mesh"],
        ),
        ("fluid.boundaries.inflow.flow.superficial_velocity=[0.0, 8.0]", ["`fluid.boundaries`", "blown out"]),
        ("grains[0].temperature=90.0", ["`grains[0].temperature`", "kelvin"]),
        ("grains[0].solidity=1.0", ["`grains[0].solidity`", "0.8165"]),
        ("fluid.mesh.rectangle.size=2.5e-4", ["`fluid.mesh`", "diameters of the largest grain"]),
    ] {
        let (code, printed, said) = check(folder(BED).path(), &[set]);
        assert_eq!(code, Some(0), "{set}: {said}");
        let (_, unusual) = printed.split_once("unusual: right, if you mean it").unwrap_or(("", ""));
        assert!(says.iter().all(|part| unusual.contains(part)), "{set}: {says:?} is not in\n{printed}");
    }
    let bare = BED.replace(
        "name = \"left\"\nfrom = [0.0, 0.0]\nto = [0.0, 0.03]",
        "name = \"left\"\nfrom = [0.0, 0.0]\nto = [0.0, 0.001]",
    );
    let bare = bare.replace(
        "name = \"right\"\nfrom = [0.01, 0.0]\nto = [0.01, 0.03]",
        "name = \"right\"\nfrom = [0.01, 0.0]\nto = [0.01, 0.001]",
    );
    assert_ne!(bare, BED);
    let (_, printed, _) = check(folder(&bare).path(), &[]);
    assert!(
        printed.contains("no wall of the grains stands along") && printed.contains("along = \"walls\""),
        "{printed}"
    );
}

#[test]
fn lengths_in_millimetres_are_unusual() {
    let scene = "gravity = [0.0, -9.81]\ntime = { step = 1e-3, end = 0.1 }\nmaterials.glass.density = 2500.0\n\n[[grains]]\nmaterial = \"glass\"\n\
                 radius = 0.5\namount = { count = 9 }\nplacement.lattice = { lower = [0.0, 0.0], upper = [10.0, 10.0] }\n";
    let (code, printed, said) = check(folder(scene).path(), &[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(printed.contains("`grains[0].radius`: diameters of 1 m: lengths are in metres"), "{printed}");
}

#[test]
fn what_a_run_would_refuse_is_refused() {
    for (set, says) in [
        ("fluid.boundaries.outflow.flow=no-slip", ["no boundary is open", "0.0064 m2/s flow into the box"]),
        ("materials.glas.density=1.0", ["nothing is made of `materials.glas`", "[\"glass\"]"]),
        ("walls.left.name=right", ["another wall has this name", "walls["]),
        ("output.average.cell=1e-9", ["output.average.cell", "squares"]),
        ("output.probes=[{ name = 'far', at = [1.0, 1.0] }]", ["\"far\" lies outside", "where fluid is"]),
        (
            "output.probes=[{ name = 'a b', at = [1e-2, 1e-2] }, { name = 'a_b', at = [1e-2, 1e-2] }]",
            ["probe_a_b_pressure_Pa, which another probe makes", "name of its own"],
        ),
        // The velocity of the fluid at one, and that of the grains in the other.
        (
            "output.probes=[{ name = 'a_grain', at = [1e-2, 1e-2] }, { name = 'a', box = { lower = [0.0, 0.0], \
             upper = [1e-2, 1e-2] } }]",
            ["probe_a_grain_velocity_x_m_per_s", "which another probe makes"],
        ),
        ("output.probes=[{ name = '', at = [1e-2, 1e-2] }]", ["output.probes[0].name", "is empty"]),
        ("output.probes=[{ name = 'a' }]", ["output.probes[0]", "a point, a line or a box"]),
        (
            "output.probes=[{ name = 'a', line = { from = [1e-2, 1e-2], to = [1e-2, 1e-2] } }]",
            ["output.probes[0].line", "no length"],
        ),
        ("fluid.mesh.rectangle.size=2.5e-6", ["triangles", "larger size"]),
        (
            "fluid.mesh.rectangle.refine=[{ around = { point = [5e-3, 1e-2] }, size = 1e-8, within = 1e-3 }]",
            ["refine[0].size", "triangles"],
        ),
        ("grains[0].amount={ mass = 1e9 }", ["grains[0].amount.mass", "at most"]),
        ("grains[0].amount.count=4294967296", ["4294967296 grains", "at most"]),
        ("materials.glass.friction=1e30", ["materials.glass.friction", "out of range"]),
        ("materials.glass.density=1e-300", ["materials.glass.density", "out of range"]),
        ("grains[0].velocity=[0.0, 1e20]", ["grains[0].velocity", "out of range"]),
        ("gravity=[0.0, -1e300]", ["gravity", "out of range"]),
        ("stop.value={ column = \"x\", above = 1.0 }", ["no such column", "time_s"]),
    ] {
        let (code, _, said) = check(folder(BED).path(), &[set]);
        assert_eq!(code, Some(2), "{set}: {said}");
        assert!(says.iter().all(|part| said.contains(part)), "{set}: {says:?} is not in\n{said}");
    }
}

/// The small bed on a mesh from the file `bed.msh`.
fn on_a_file() -> tempfile::TempDir {
    let before = BED.find("[fluid.mesh.rectangle]").unwrap();
    let after = BED.find("[fluid.heat]").unwrap();
    folder(&format!("{}[fluid.mesh]\nfile = \"bed.msh\"\n\n{}", &BED[..before], &BED[after..]))
}

#[test]
fn memory_was_taken_for_what_no_machine_has() {
    let fine = ["grains[0].radius={ constant = 5e-9 }", "grains[0].amount=fill"];
    let (code, _, said) = check(folder(BED).path(), &fine);
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("grains[0].radius") && said.contains("grains") && said.contains("at most"),
        "{said}"
    );
    // Only the mesh of the file says how large the domain is.
    let folder = on_a_file();
    fs::write(folder.path().join("bed.msh"), mesh().to_msh().unwrap()).unwrap();
    let (code, _, said) = check(folder.path(), &["output.average.cell=1e-9"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("output.average.cell") && said.contains("squares"), "{said}");
    let (code, _, said) = check(folder.path(), &[]);
    assert_eq!(code, Some(0), "{said}");
}

/// The mesh of the small bed.
fn mesh() -> Mesh<2> {
    let scene = Scene::parse(Path::new("bed.toml"), BED, &[]).unwrap();
    match &scene.fluid.unwrap().mesh {
        MeshSource::Rectangle(rectangle) => Mesh::rectangle(rectangle).unwrap(),
        MeshSource::File(_) => panic!("the small bed has a rectangle"),
    }
}

#[test]
fn a_folded_mesh_was_good() {
    let mut mesh = mesh();
    let on_boundary = |node: u32| mesh.boundaries.iter().any(|part| part.facets.contains(&node));
    let inner = (0..mesh.points.len() as u32).find(|node| !on_boundary(*node)).unwrap();
    mesh.points[inner as usize] = [0.009, 0.05].into();
    let folder = on_a_file();
    fs::write(folder.path().join("bed.msh"), mesh.to_msh().unwrap()).unwrap();
    let (code, _, said) = check(folder.path(), &[]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("bed.msh: the mesh is folded"), "{said}");
}

#[test]
fn a_gmsh_mesh_is_read() {
    let folder = on_a_file();
    for text in ["no mesh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"] {
        fs::write(folder.path().join("bed.msh"), text).unwrap();
        let (code, _, said) = check(folder.path(), &[]);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("bed.msh"), "{said}");
    }
}

/// Elements smaller than a grain see it apart from its gap, also where they are much smaller.
#[test]
fn elements_smaller_than_grains_ask_for_a_kernel() {
    let folder = folder(BED);
    for size in ["8e-4", "4e-4"] {
        let fine = format!("fluid.mesh.rectangle.size={size}");
        let (_, printed, said) = check(folder.path(), &[&fine]);
        assert!(printed.contains("`coupling.kernel`"), "{printed}{said}");
        let (_, printed, said) = check(folder.path(), &[&fine, "coupling.kernel=2"]);
        assert!(!printed.contains("`coupling.kernel`"), "{printed}{said}");
    }
}

/// Spread over more than half of a period, a grain would meet its own image, and a part of it would be lost.
#[test]
fn a_grain_is_not_spread_over_its_own_image() {
    let folder = folder(include_str!("../python/scenes/periodic-box.toml"));
    let (code, _, said) = check(folder.path(), &["coupling.kernel=20"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("coupling.kernel = 20") && said.contains("at most"), "{said}");
}
