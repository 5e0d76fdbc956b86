//! Broken input: each ends with exit code 2 and a message that names the file, the line, the value and the remedy.

use assert_cmd::Command;
use std::fs;
use std::path::Path;

const BED: &str = include_str!("bed.toml");

/// One mistake in the small bed.
struct Mistake {
    what: &'static str,
    /// A text of the good scene, and what it is replaced by.
    change: [&'static str; 2],
    /// The line at fault begins like this, and is the last that does.
    line: &'static str,
    /// All of this is in the message: key or value, and the remedy.
    says: &'static [&'static str],
}

const fn mistake(
    what: &'static str,
    change: [&'static str; 2],
    line: &'static str,
    says: &'static [&'static str],
) -> Mistake {
    Mistake { what, change, line, says }
}

const MISTAKES: &[Mistake] = &[
    mistake(
        "a temperature of a wall to which no heat passes",
        ["conduction = \"henry\"", ""],
        "temperature = 300.0",
        &["walls[2].temperature", "contacts.conduction"],
    ),
    mistake(
        "unknown key",
        ["radius =", "raduis ="],
        "raduis",
        &["grains[0].raduis", "did you mean `radius`?"],
    ),
    mistake(
        "a word of another program; the error pointed at its value",
        ["radius = { uniform = [5e-4, 6e-4] }", "diameter = 1e-3"],
        "diameter",
        &["grains[0].diameter", "here it is `radius`, half of it", ":1]"],
    ),
    mistake(
        "a key of an earlier version",
        ["[fluid.mesh", "[fluid.solver]\ndrag_in_stabilisation = true\n\n[fluid.mesh"],
        "drag_in_stabilisation",
        &["fluid.solver.drag_in_stabilisation", "delete the line"],
    ),
    mistake(
        "contacts that are never old",
        ["[contacts]", "[contacts]\ncohesion = { force = 1.0, sliding = 0.0 }"],
        "cohesion",
        &["contacts.cohesion.sliding", "0"],
    ),
    mistake(
        "cohesion that falls off round no droplet",
        ["[coupling]", "[coupling]\ncohesion_halo = 1.5"],
        "cohesion_halo",
        &["coupling.cohesion_halo", "[droplet]", "add a droplet"],
    ),
    mistake(
        "unknown table",
        ["[contacts]", "[kontakts]"],
        "[kontakts]",
        &["kontakts", "did you mean `contacts`?"],
    ),
    mistake(
        "wrong type",
        ["density = 1.204", "density = \"air\""],
        "density = \"air\"",
        &["fluid.density = \"air\"", "expected a number", "kg/m3"],
    ),
    mistake(
        "a list of the wrong length",
        ["[5e-4, 6e-4]", "[5e-4]"],
        "radius =",
        &["grains[0].radius.uniform", "length 2"],
    ),
    mistake(
        "a choice made twice",
        ["{ uniform = [5e-4, 6e-4] }", "{ uniform = [5e-4, 6e-4], constant = 5e-4 }"],
        "radius =",
        &["grains[0].radius", "2 keys (`constant`, `uniform`), where one is chosen"],
    ),
    mistake(
        "a choice beside a key that does not exist",
        ["{ uniform = [5e-4, 6e-4] }", "{ uniform = [5e-4, 6e-4], weibull = 5e-4 }"],
        "weibull",
        &["grains[0].radius.weibull", "unknown field `weibull`", "keys allowed here: constant, "],
    ),
    mistake(
        "a choice that does not exist",
        ["{ uniform = [5e-4, 6e-4] }", "{ unifrom = [5e-4, 6e-4] }"],
        "unifrom",
        &["grains[0].radius.unifrom", "unknown field `unifrom`", "did you mean `uniform`?"],
    ),
    mistake(
        "one table where a list of them belongs",
        ["[[grains]]", "[grains]"],
        "[grains]",
        &["grains", "expected a list", "`[[grains]]`"],
    ),
    mistake(
        "an unknown key that has a Rust word in it",
        ["radius =", "remap ="],
        "remap",
        &["grains[0].remap", "unknown field `remap`"],
    ),
    mistake("negative count", ["count = 40", "count = -40"], "amount =", &["grains[0].amount", "-40"]),
    mistake("missing key", ["viscosity = 2e-5\n", ""], "[fluid]", &["missing field `viscosity`", "Pa s"]),
    mistake(
        "missing table",
        ["[time]\nstep = 1e-3\nend = 0.04", ""],
        "",
        &["missing field `time`", "Step and end"],
    ),
    mistake("no TOML", ["[contacts]", "[contacts"], "[contacts", &["TOML"]),
    mistake("a key twice", ["end = 0.04", "end = 0.04\nend = 0.05"], "end = 0.05", &["duplicate key"]),
    mistake("not a number", ["end = 0.04", "end = nan"], "end = nan", &["time.end = nan", "finite"]),
    mistake(
        "infinite",
        ["temperature = 363.15", "temperature = inf"],
        "temperature = inf",
        &["grains[0].temperature = inf", "finite"],
    ),
    mistake(
        "grains colder than anything",
        ["temperature = 363.15", "temperature = -5.0"],
        "temperature = -5.0",
        &["grains[0].temperature = -5", "above 0"],
    ),
    mistake(
        "a fluid colder than anything",
        ["initial_temperature = 290.0", "initial_temperature = -1.0"],
        "initial_temperature",
        &["fluid.heat.initial_temperature = -1", "above 0"],
    ),
    mistake(
        "zero radius",
        ["{ uniform = [5e-4, 6e-4] }", "{ constant = 0 }"],
        "radius =",
        &["grains[0].radius.constant = 0", "above 0"],
    ),
    mistake(
        "radii upside down",
        ["[5e-4, 6e-4]", "[6e-4, 5e-4]"],
        "radius =",
        &["0.0006, 0.0005", "[smallest, largest]"],
    ),
    mistake(
        "negative density",
        ["density = 2500.0", "density = -2500.0"],
        "density = -2500.0",
        &["materials.glass.density = -2500", "above 0"],
    ),
    mistake("too much solid", ["solidity = 0.8165", "solidity = 1.2"], "solidity", &["1.2", "at most 1"]),
    mistake(
        "restitution above 1",
        ["friction = 0.3", "restitution = 1.5"],
        "restitution",
        &["1.5", "from 0 to 1"],
    ),
    mistake(
        "rolling above 1",
        ["friction = 0.3", "friction = 0.3\nrolling = 1.5"],
        "rolling",
        &["materials.glass.rolling = 1.5", "from 0 to 1"],
    ),
    mistake(
        "rolling below 0 at a wall",
        ["friction = 0.5", "friction = 0.5\nrolling = -0.1"],
        "rolling",
        &["walls[0].rolling = -0.1", "from 0 to 1"],
    ),
    mistake(
        "rolling of grains that do not spin",
        [
            "[contacts]",
            "[[walls]]\nname = \"lid\"\nfrom = [0.0, 0.03]\nto = [0.01, 0.03]\nrolling = 0.1\n\n[contacts]\nrotation = false",
        ],
        "rolling",
        &["walls[3].rolling", "contacts.rotation = false", "take the key away"],
    ),
    mistake(
        "rolling with the interior-point method",
        [
            "[contacts]",
            "[[walls]]\nname = \"lid\"\nfrom = [0.0, 0.03]\nto = [0.01, 0.03]\nrolling = 0.1\n\n[contacts]\ninterior = true",
        ],
        "rolling",
        &["walls[3].rolling", "contacts.interior = true", "take the key away"],
    ),
    mistake(
        "unknown material",
        ["material = \"glass\"\nradius", "material = \"gold\"\nradius"],
        "material = \"gold\"",
        &["gold", "there are: glass"],
    ),
    mistake(
        "heat without a heat capacity",
        ["heat_capacity = 840.0\n", ""],
        "[materials.glass]",
        &["heat_capacity", "add"],
    ),
    mistake(
        "conduction without temperature",
        ["temperature = 363.15\n", ""],
        "conduction",
        &["contacts.conduction", "give all `grains` a `temperature`"],
    ),
    mistake(
        "a box outside of the fluid",
        ["upper = [0.01, 0.02], arr", "upper = [0.01, 0.2], arr"],
        "placement",
        &["[0.01, 0.2]", "outside of the fluid", "stay within"],
    ),
    mistake(
        "a box upside down",
        ["lower = [0.0, 0.0], upper = [0.01, 0.02]", "lower = [0.0, 0.02], upper = [0.01, 0.0]"],
        "placement",
        &["[0.01, 0.0]", "above"],
    ),
    mistake(
        "neighbours that overlap",
        ["spacing = 1.05", "spacing = 0.9"],
        "placement",
        &["0.9", "1 or more"],
    ),
    mistake(
        "more grains than places",
        ["count = 40", "count = 4000"],
        "placement",
        &["full after 126 grains", "make it larger or ask for fewer"],
    ),
    mistake(
        "less than half a grain",
        ["amount = { count = 40 }", "amount = { mass = 1e-5 }"],
        "placement",
        &["1e-5 kg/m", "less than half of one grain: a grain of radius", "e-3 kg/m"],
    ),
    mistake(
        "far more grains poured than the box takes",
        [
            "amount = { count = 40 }\nplacement = { lattice = { lower = [0.0, 0.0], upper = [0.01, 0.02], arrangement = \"triangular\", spacing = 1.05 } }",
            "amount = { count = 20000 }\nplacement = { deposit = { lower = [0.0, 0.0], upper = [0.01, 0.02] } }",
        ],
        "placement",
        &["takes about 172 grains, and 20000 are asked for", "make it larger or ask for fewer"],
    ),
    mistake(
        "a few more grains poured than the box takes",
        [
            "amount = { count = 40 }\nplacement = { lattice = { lower = [0.0, 0.0], upper = [0.01, 0.02], arrangement = \"triangular\", spacing = 1.05 } }",
            "amount = { count = 180 }\nplacement = { deposit = { lower = [0.0, 0.0], upper = [0.01, 0.02] } }",
        ],
        "placement",
        &["full after 1", "make it larger or ask for fewer"],
    ),
    mistake(
        "far more grains at random than the box takes",
        [
            "amount = { count = 40 }\nplacement = { lattice = { lower = [0.0, 0.0], upper = [0.01, 0.02], arrangement = \"triangular\", spacing = 1.05 } }",
            "amount = { count = 20000 }\nplacement = { random = { lower = [0.0, 0.0], upper = [0.01, 0.02] } }",
        ],
        "placement",
        &["takes about 105 grains, and 20000 are asked for"],
    ),
    mistake(
        "a box narrower than a grain",
        [
            "lattice = { lower = [0.0, 0.0], upper = [0.01, 0.02], arrangement = \"triangular\", spacing = 1.05 }",
            "deposit = { lower = [0.0, 0.0], upper = [0.001, 0.02] }",
        ],
        "placement",
        &["1.0000e-3 m wide", "the largest grain needs 1.2000e-3 m"],
    ),
    mistake(
        "negative friction while settling",
        [
            "lattice = { lower = [0.0, 0.0], upper = [0.01, 0.02], arrangement = \"triangular\", spacing = 1.05 }",
            "deposit = { lower = [0.0, 0.0], upper = [0.01, 0.02], friction = -0.1 }",
        ],
        "placement",
        &["deposit.friction = -0.1", "0 or more"],
    ),
    mistake(
        "grains across a wall",
        ["from = [0.01, 0.0]", "from = [0.005, 0.0]"],
        "placement",
        &["overlaps the wall \"right\"", "off the walls"],
    ),
    mistake(
        "missing file of grains",
        [
            "{ lattice = { lower = [0.0, 0.0], upper = [0.01, 0.02], arrangement = \"triangular\", spacing = 1.05 } }",
            "{ csv = { file = \"none.csv\" } }",
        ],
        "radius",
        &["take it away"],
    ),
    mistake(
        "vector of the wrong length",
        ["velocity = [0.0, 0.0]", "velocity = [0.0, 0.0, 0.0]"],
        "velocity",
        &["has 3 numbers", "give 2 numbers"],
    ),
    mistake(
        "three dimensions",
        ["gravity = [0.0, -9.81]", "gravity = [0.0, 0.0, -9.81]"],
        "gravity",
        &["3 numbers", "3 dimensions are not available"],
    ),
    mistake(
        "a wall that is a point",
        ["to = [0.01, 0.0]", "to = [0.0, 0.0]"],
        "to = [0.0, 0.0]",
        &["two different points"],
    ),
    mistake(
        "boundary that the mesh lacks",
        ["name = \"outflow\"\n", "name = \"outlet\"\n"],
        "name = \"outlet\"",
        &["outlet", "there are: walls, inflow, nozzle, outflow"],
    ),
    mistake(
        "boundary without conditions",
        ["[[fluid.boundaries]]\nname = \"nozzle\"\nflow = \"no-slip\"\n", ""],
        "[fluid]",
        &["\"nozzle\" of the mesh has no conditions", "add `[[fluid.boundaries]]`"],
    ),
    mistake(
        "boundary twice",
        ["name = \"nozzle\"\n", "name = \"walls\"\n"],
        "name = \"walls\"",
        &["has conditions already", "one table"],
    ),
    mistake(
        "unknown condition",
        ["\"no-slip\"", "\"noslip\""],
        "flow = \"noslip\"",
        &["fluid.boundaries[2].flow", "no-slip"],
    ),
    mistake(
        "two conditions in one",
        [
            "flow = { superficial_velocity = [0.0, 0.8] }",
            "flow = { superficial_velocity = [0.0, 0.8], open = {} }",
        ],
        "flow = { superficial",
        &["fluid.boundaries[1].flow"],
    ),
    mistake(
        "heat at a boundary of a fluid without",
        ["[fluid.heat]\nheat_capacity = 1010.0\nconductivity = 0.025\ninitial_temperature = 290.0\n", ""],
        "heat = { open",
        &["has no temperature", "add `[fluid.heat]`"],
    ),
    mistake(
        "rectangle upside down",
        ["upper = [0.01, 0.03]\n", "upper = [0.01, -0.03]\n"],
        "upper = [0.01, -0.03]",
        &["-0.03", "above"],
    ),
    mistake(
        "cells larger than the domain",
        ["size = 2e-3", "size = 0.5"],
        "size = 0.5",
        &["fluid.mesh.rectangle.size = 0.5", "longer than the rectangle", "length of the edges"],
    ),
    mistake("size of zero", ["size = 2e-3", "size = 0.0"], "size = 0.0", &["size = 0", "positive"]),
    mistake("part beyond its side", ["to = 6e-3", "to = 6.0"], "bottom", &["to = 6", "between"]),
    mistake(
        "unknown scheme",
        ["scheme = \"iterated\"", "scheme = \"henri\""],
        "scheme",
        &["henri", "henry", "explicit"],
    ),
    mistake(
        "a kernel narrower than the grain",
        ["scheme = \"iterated\"", "kernel = 0.5"],
        "kernel",
        &["coupling.kernel = 0.5", "from 1 to 20"],
    ),
    mistake(
        "added mass below nothing",
        ["scheme = \"iterated\"", "added_mass = -0.5"],
        "added_mass",
        &["coupling.added_mass = -0.5", "from 0 to 100"],
    ),
    mistake(
        "added mass of grains without acceleration",
        ["scheme = \"iterated\"", "scheme = \"explicit\"\nadded_mass = 0.5"],
        "added_mass",
        &["coupling.added_mass", "explicit", "another scheme"],
    ),
    mistake(
        "added mass of grains with steps of their own",
        ["scheme = \"iterated\"", "scheme = \"strang\"\nadded_mass = 0.5"],
        "added_mass",
        &["coupling.added_mass", "strang", "another scheme"],
    ),
    mistake(
        "grains that never step",
        ["scheme = \"iterated\"", "sub_cycling = { steps = 0 }"],
        "sub_cycling",
        &["coupling.sub_cycling.steps = 0", "from 1 to 10000"],
    ),
    mistake(
        "unknown law of lift",
        ["scheme = \"iterated\"", "lift = \"magnus\""],
        "lift",
        &["magnus", "saffman-mei"],
    ),
    mistake(
        "relaxation of nothing",
        ["scheme = \"iterated\"", "iteration = { relaxation = { constant = 0.0 } }"],
        "iteration",
        &["relaxation", "above 0 and at most 1"],
    ),
    mistake(
        "heat that never agrees",
        ["scheme = \"iterated\"", "iteration = { heat_tolerance = 0.0 }"],
        "iteration",
        &["heat_tolerance", "above 0"],
    ),
    mistake(
        "parts of steps in which nothing moves",
        ["scheme = \"iterated\"", "cut = { travel = 0.0 }"],
        "cut",
        &["coupling.cut.travel", "above 0"],
    ),
    mistake(
        "remeshing after no step",
        [
            "[fluid.heat]",
            "[fluid.mesh_motion]\namplitude = [1e-4, 0.0]\nfrequency = 1.0\nremesh = { every = 0 }\n\n[fluid.heat]",
        ],
        "remesh",
        &["fluid.mesh_motion.remesh.every = 0", "above 0"],
    ),
    mistake(
        "no step fits",
        ["end = 0.04", "end = 1e-4"],
        "end = 1e-4",
        &["time.end = 0.0001", "at least one step of 0.001 s"],
    ),
    mistake(
        "contacts that count as solved whatever they are",
        ["conduction = \"henry\"", "conduction = \"henry\"\ntolerance = 1e300"],
        "tolerance",
        &["contacts.tolerance = 1e300", "at most 0.1"],
    ),
    mistake(
        "a fluid that counts as solved where it stands",
        ["[coupling]", "[fluid.solver]\ntolerance = 10.0\n\n[coupling]"],
        "tolerance",
        &["fluid.solver.tolerance = 10", "at most 0.01"],
    ),
    mistake(
        "grains that may pass through walls",
        ["conduction = \"henry\"", "conduction = \"henry\"\nmax_penetration = 2.0"],
        "max_penetration",
        &["contacts.max_penetration = 2", "from 0.05 to 1"],
    ),
    mistake("negative step", ["step = 1e-3", "step = -1e-3"], "step", &["time.step = -0.001", "above 0"]),
    mistake(
        "pressure between boundaries that are not there",
        ["to = \"outflow\"", "to = \"sky\""],
        "pressure_drop",
        &["sky", "there are: outflow, inflow, nozzle, walls"],
    ),
    mistake(
        "average that ends before it begins",
        ["from = 0.01, to = 0.04", "from = 0.04, to = 0.01"],
        "average",
        &["output.average.to = 0.01", "after `from`"],
    ),
];

fn voidage() -> Command {
    Command::new(env!("CARGO_BIN_EXE_voidage"))
}

/// Runs the program in a folder; checks that it ends with code 2, and returns what it says.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = voidage().current_dir(folder).args(arguments).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?} says\n{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

#[test]
fn mistakes_of_a_mesh_that_follows_a_table_are_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), include_str!("../../cases/piston/scene.toml")).unwrap();
    let turns = "[[0.0,0.0,0.0,0.0],[1.0,0.0,0.0,1.0]]";
    let aside = "fluid.mesh_motion.table.rows=[[0.0,0.0,0.0,0.0],[1.0,1e-3,0.0,0.0]]";
    let cases: &[(&[&str], &[&str])] = &[
        (&[aside], &["fluid.mesh_motion", "leaves the part \"sides\""]),
        (&["fluid.boundaries[0].flow=no-slip"], &["fluid.mesh_motion.sliding[0]", "would go with them"]),
        (
            &["fluid.mesh_motion.frequency=1.0"],
            &["fluid.mesh_motion.table", "beside `amplitude` or `frequency`"],
        ),
        (
            &["fluid.mesh_motion.table.rows=[[0.0,1e-3,0.0,0.0]]"],
            &["does not begin where the mesh is", "[t, 0.0, 0.0, 0.0]"],
        ),
        (&[&format!("fluid.mesh_motion.table.rows={turns}")], &["has angles, but no `centre`"]),
        (
            &[&format!("fluid.mesh_motion.table.rows={turns}"), "fluid.boundaries[1].flow=slip"],
            &["has angles, but no boundary of the fluid is open"],
        ),
        (
            &["fluid.mesh_motion.sliding=[\"side\"]"],
            &["fluid.mesh_motion.sliding[0]", "sides, outlet, piston"],
        ),
    ];
    for (sets, says) in cases {
        let sets = sets.iter().flat_map(|set| ["--set", set]);
        let arguments: Vec<&str> = ["run", "scene.toml", "--out", "out"].into_iter().chain(sets).collect();
        let said = refused(folder.path(), &arguments);
        let missing: Vec<_> = says.iter().filter(|part| !said.contains(**part)).collect();
        assert!(missing.is_empty(), "{arguments:?}: {missing:?} is not in\n{said}");
    }
}

#[test]
fn mistakes_of_a_droplet_are_named() {
    const DROPLET: &str = include_str!("../../cases/droplet-digging/scene-quick.toml");
    let boundary = "[[fluid.boundaries]]\nname = \"droplet\"\nflow = \"no-slip\"\n\n[droplet]";
    for (change, says) in [
        (["boundary = \"droplet\"", "boundary = \"drop\""], ["drop", "there are: droplet"]),
        (["latent_heat = 2.257e6", "latent_heat = 0.0"], ["droplet.latent_heat = 0", "above 0"]),
        (["scalars = { vapour = 1.0 }", "scalars = { steam = 1.0 }"], ["steam", "there are: vapour"]),
        (["flow = \"open\"", "flow = \"slip\""], ["no way out", "flow = \"open\""]),
        (["[coupling]", "[coupling]\nadded_mass = 0.5"], ["coupling.added_mass", "beside `[droplet]`"]),
        (["[droplet]", boundary], ["has a table in `[[fluid.boundaries]]`", "take that away"]),
        (
            ["boundary = \"droplet\"", "boundary = \"droplet\"\nheld = 1"],
            ["droplet.held", "expected a boolean"],
        ),
        (
            ["boundary = \"droplet\"", "boundary = \"droplet\"\ngrain_share = \"round\""],
            ["grain_share", "disc"],
        ),
        (
            ["boundary = \"droplet\"", "boundary = \"droplet\"\nblowing = \"mean\""],
            ["blowing", "interstitial"],
        ),
        (
            ["boundary = \"droplet\"", "boundary = \"droplet\"\nheat_flux = \"both\""],
            ["heat_flux", "gradient"],
        ),
        (
            ["boundary = \"droplet\"", "boundary = \"droplet\"\nbuoyancy = \"all\""],
            ["buoyancy", "hydrostatic"],
        ),
        (
            ["boundary = \"droplet\"", "boundary = \"droplet\"\ninside = { voidage = \"two\" }"],
            ["voidage", "one"],
        ),
        (
            ["boundary = \"droplet\"", "boundary = \"droplet\"\ninside = { drag = \"henry\" }"],
            ["droplet.inside.drag", "voidage"],
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        assert!(DROPLET.contains(change[0]), "{}", change[0]);
        fs::write(folder.path().join("scene.toml"), DROPLET.replacen(change[0], change[1], 1)).unwrap();
        let said = refused(folder.path(), &["check", "scene.toml"]);
        for text in says {
            assert!(said.contains(text), "{} says\n{said}", change[1]);
        }
    }
}

#[test]
fn choices_of_a_droplet_that_change_nothing_are_refused() {
    const DROPLET: &str = include_str!("../python/scenes/boils-away.toml");
    let [before, after] = ["[[grains]]", "[fluid]"].map(|table| DROPLET.find(table).unwrap());
    let bare = format!("{}{}", &DROPLET[..before], &DROPLET[after..]);
    for (key, value) in [
        ("grain_share", "\"disc\""),
        ("blowing", "\"interstitial\""),
        ("buoyancy", "\"none\""),
        ("inside", "{ voidage = \"one\" }"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scene.toml"), format!("{bare}{key} = {value}\n")).unwrap();
        let said = refused(folder.path(), &["check", "scene.toml"]);
        for text in [&format!("droplet.{key}"), "no grains"] {
            assert!(said.contains(text), "{key} says\n{said}");
        }
    }
    let cold = DROPLET.replacen("heat = { open = { temperature = 673.15 } }\n", "", 1);
    let [before, after] = ["[fluid.heat]", "[[fluid.boundaries]]"].map(|table| cold.find(table).unwrap());
    let cold = format!("{}{}heat_flux = \"gradient\"\n", &cold[..before], &cold[after..]);
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), &cold).unwrap();
    let said = refused(folder.path(), &["check", "scene.toml"]);
    assert!(said.contains("droplet.heat_flux") && said.contains("no temperature"), "{said}");
    // Grains at no temperature of theirs condensed gas onto it.
    fs::write(folder.path().join("scene.toml"), cold.replace("heat_flux = \"gradient\"\n", "")).unwrap();
    let said = refused(folder.path(), &["check", "scene.toml"]);
    assert!(said.contains("grains have a temperature") && said.contains("[fluid.heat]"), "{said}");
}

#[test]
fn every_mistake_is_named_with_its_place_and_its_remedy() {
    let mut wrong = Vec::new();
    for Mistake { what, change: [from, to], line, says } in MISTAKES {
        assert!(BED.contains(from), "{what}: the scene has no {from:?}");
        let text = BED.replacen(from, to, 1);
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scene.toml"), &text).unwrap();
        let said = refused(folder.path(), &["run", "scene.toml", "--out", "out"]);
        let place = text.lines().collect::<Vec<_>>();
        let place = place.iter().rposition(|other| !line.is_empty() && other.starts_with(line));
        let place = place.map_or("scene.toml:".to_owned(), |index| format!("scene.toml:{}:", index + 1));
        let missing = says.iter().copied().chain([place.as_str()]).filter(|part| !said.contains(part));
        let missing: Vec<&str> = missing.collect();
        if !missing.is_empty() {
            wrong.push(format!("{what}: {missing:?} is not in\n{said}"));
        }
        assert!(!folder.path().join("out/scene.toml").exists(), "{what}: results of a broken scene");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(MISTAKES.len() >= 25);
}

#[test]
fn files_that_are_missing_or_wrong_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let in_folder = |name: &str| folder.path().join(name);
    let said = refused(folder.path(), &["run", "none.toml"]);
    assert!(said.contains("none.toml") && said.contains("give the path"), "{said}");

    let grains = BED
        .replace("{ lattice = { lower = [0.0, 0.0], upper = [0.01, 0.02], arrangement = \"triangular\", spacing = 1.05 } }", "{ csv = { file = \"grains.csv\" } }")
        .replace("radius = { uniform = [5e-4, 6e-4] }\n", "")
        .replace("amount = { count = 40 }\n", "");
    fs::write(in_folder("scene.toml"), &grains).unwrap();
    let said = refused(folder.path(), &["check", "scene.toml"]);
    assert!(said.contains("grains.csv") && said.contains("there is no file"), "{said}");
    for (table, says) in [
        ("x,y,r\n0.005,0.005,0.0005\n0.005,abc,0.0005\n", ["line 3", "abc"]),
        ("x,y,r\n0.005,0.005,0\n", ["line 2", "positive"]),
        ("x,y,raduis\n", ["raduis", "allowed"]),
        ("x,y,r\n0.005,0.005,0.0005\n0.0053,0.005,0.0005\n", ["line 3", "overlaps that of line 2"]),
        ("x,y,r\n0.005,0.5,0.0005\n", ["line 2", "outside of the fluid"]),
        ("x,y,r\n0.0001,0.005,0.0005\n", ["line 2", "outside of the fluid"]),
        ("x,y,r,vx,vy\n0.005,0.005,0.0005,1e308,0\n", ["line 2", "velocity (1e308, 0e0) is out of range"]),
        ("x,y,r\n0.005,1e300,0.0005\n", ["line 2", "place (5e-3, 1e300) is out of range"]),
        ("x,y,r,T\n0.005,0.005,0.0005,-5\n", ["line 2", "T is -5: a temperature must be 0 K or more"]),
    ] {
        fs::write(in_folder("grains.csv"), table).unwrap();
        let said = refused(folder.path(), &["check", "scene.toml"]);
        assert!(says.iter().all(|part| said.contains(part)) && said.contains("scene.toml:"), "{table}{said}");
    }

    let mesh = BED.replace(
        "[fluid.mesh.rectangle]\nlower = [0.0, 0.0]\nupper = [0.01, 0.03]\nsize = 2e-3\n",
        "[fluid.mesh]\nfile = \"bed.msh\"\n",
    );
    let sides = mesh.find("[fluid.mesh.rectangle.sides]").unwrap();
    let end = mesh.find("[fluid.heat]").unwrap();
    fs::write(in_folder("scene.toml"), format!("{}{}", &mesh[..sides], &mesh[end..])).unwrap();
    let said = refused(folder.path(), &["run", "scene.toml"]);
    assert!(said.contains("bed.msh") && said.contains("there is no file"), "{said}");
    fs::write(in_folder("bed.msh"), "no mesh").unwrap();
    let said = refused(folder.path(), &["run", "scene.toml"]);
    assert!(said.contains("bed.msh") && said.contains("scene.toml:"), "{said}");
}

#[test]
fn wrong_options_are_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), BED).unwrap();
    let cases: &[(&[&str], &[&str])] = &[
        (&["--set", "fluid.densty=1"], &["--set fluid.densty=1", "did you mean `density`?"]),
        (&["--set", "fluid.density"], &["has no `=`", "key.of.the.scene=value"]),
        (&["--set", "grains[3].solidity=1"], &["no entry `[3]`", "from 0 to 0"]),
        (&["--set", "fluid.boundaries.inlet.flow=slip"], &["inlet", "names: outflow, inflow, nozzle, walls"]),
        (
            &["--set", "fluid.boundaries.inflow.flow.velocity=[0]"],
            &["--set", "has 1 numbers", "give 2 numbers"],
        ),
        (&["--set", "time.end=nan"], &["--set time.end=nan", "finite"]),
        (&["--scheme", "henri"], &["henri", "explicit"]),
        (&["--fluid", "magic"], &["magic", "no such fluid solver", "fenicsx"]),
        (&["--ranks", "2"], &["fluid.backend.ranks", "the solver rust", "choose the solver fenicsx"]),
        (&["--ranks", "2", "--fluid", "scikit-fem"], &["fluid.backend.ranks", "the solver scikit-fem"]),
        (&["--ranks", "0", "--fluid", "fenicsx"], &["fluid.backend.ranks = 0", "give 1 or more"]),
        (&["--ranks", "two"], &["--ranks", "two"]),
        (&["--threads", "0"], &["--threads 0", "1 to 1024"]),
        (&["--restart", "none"], &["none", "cannot read the checkpoint"]),
        (&["--restart", "scene.toml"], &["scene.toml", "is no checkpoint"]),
        (&["--no-such-option"], &["--no-such-option"]),
    ];
    for (options, says) in cases {
        let arguments = [&["run", "scene.toml", "--out", "out"], *options].concat();
        let said = refused(folder.path(), &arguments);
        let missing: Vec<_> = says.iter().filter(|part| !said.contains(**part)).collect();
        assert!(missing.is_empty(), "{options:?}: {missing:?} is not in\n{said}");
    }
    let said = refused(folder.path(), &["plot", "."]);
    assert!(said.contains("folder of a run") || said.contains("series"), "{said}");
}

/// Periodic sides, and what does not fit them: refused before anything is run.
#[test]
fn what_does_not_fit_periodic_sides_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let scene = include_str!("../python/scenes/periodic.toml");
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let cases: &[(&str, &[&str])] = &[
        ("periodic={}", &["neither `x` nor `y`"]),
        ("periodic.x=[0.016,0.0]", &["periodic.x = [0.016, 0]", "upside down"]),
        ("periodic.x=[0.0,0.02]", &["the mesh ends at 0 and 0.016", "give `x = [0.0, 0.016]`"]),
        ("grains[0].radius=3e-3", &["the period along axis 0", "needs 0.018 m"]),
        ("walls.floor.to=[0.015,0.0]", &["walls[0]", "neither leads from side to side"]),
        ("walls.floor.to=[0.016,0.001]", &["walls[0]", "ends at another height"]),
        ("walls.floor.motion={rotate={centre=[0.0,0.0],rate=1.0}}", &["walls[0]", "turns"]),
        ("walls.lid.to=[0.0,0.0]", &["walls[1]", "stands on a periodic side"]),
        (
            "grains[0].placement={deposit={lower=[0.0,0.0],upper=[0.015,0.008]}}",
            &["grains[0].placement.deposit", "from x = 0 to 0.015", "[0.0, 0.016]"],
        ),
        (
            "fluid.mesh_motion={amplitude=[0.0,1e-4],frequency=1.0}",
            &["fluid.mesh_motion", "not available together"],
        ),
        (
            "fluid.mesh.rectangle.sides.right=lid",
            &["\"lid\" lies there and elsewhere", "names that no other part has"],
        ),
        ("fluid.mesh.rectangle.structured.squares=[2,2]", &["three cells at least"]),
        ("fluid.boundaries[0].name=left", &["fluid.boundaries[0].name = \"left\"", "floor, lid"]),
        ("fluid.body_force=[1.0]", &["fluid.body_force", "give 2 numbers"]),
        ("fluid.body_force=[1e9,0.0]", &["fluid.body_force", "out of range"]),
    ];
    for (set, says) in cases {
        let said = refused(folder.path(), &["run", "scene.toml", "--out", "out", "--set", set]);
        let missing: Vec<_> = says.iter().filter(|part| !said.contains(**part)).collect();
        assert!(missing.is_empty(), "{set}: {missing:?} is not in\n{said}");
    }
}
