//! What the pages say: generated parts are up to date, what they show runs, and `voidage new` writes what they promise.

use assert_cmd::Command;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use voidage_coupling::scheme::SchemeName;
use voidage_scene::recorder::{column_name, readings};
use voidage_scene::{Coordinates, MeshSource, Placement, Probe, ProbeBox, Scene, Simulation};

fn voidage() -> Command {
    Command::new(env!("CARGO_BIN_EXE_voidage"))
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn page(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn said(arguments: &[&str]) -> String {
    let output = voidage().args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// The scenes of the cases.
fn shipped() -> Vec<PathBuf> {
    let folders = fs::read_dir(root().join("cases")).unwrap().map(|entry| entry.unwrap().path());
    let files = folders.filter(|path| path.is_dir()).flat_map(|folder| fs::read_dir(folder).unwrap());
    let scene = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("scene") && name.ends_with(".toml")
    };
    let mut found: Vec<PathBuf> = files.map(|entry| entry.unwrap().path()).filter(scene).collect();
    found.sort();
    assert!(found.len() >= 12, "{found:?}");
    found
}

#[test]
fn the_pages_of_keys_are_those_of_the_program() {
    for (name, options) in [("cases/keys.md", vec![]), ("cases/studies/keys.md", vec!["--study"])] {
        let arguments = [vec!["schema", "--markdown"], options].concat();
        let written = said(&arguments);
        assert!(page(name) == written, "{name} is old: voidage {} > {name}", arguments.join(" "));
        assert!(written.contains("(needed)") && written.lines().count() > 60);
        for link in written.split("](#").skip(1).filter_map(|rest| rest.split(')').next()) {
            let headings = written.lines().filter_map(|line| line.strip_prefix("## "));
            let anchor = |heading: &str| {
                heading
                    .chars()
                    .filter(|c| c.is_alphanumeric() || "_-".contains(*c))
                    .collect::<String>()
                    .to_lowercase()
            };
            assert!(headings.map(anchor).any(|heading| heading == link), "{name}: no section for #{link}");
        }
    }
}

/// The columns that a page lists in its tables.
fn listed(text: &str) -> Vec<String> {
    let rows = text.lines().filter_map(|line| line.strip_prefix("| `"));
    rows.filter_map(|row| row.split_once("` |").map(|(column, _)| column.to_owned())).collect()
}

/// A column of the page with the names of a scene.
fn named(column: &str, names_of: &[(&str, Vec<String>)]) -> Vec<String> {
    let mut names = vec![column.to_owned()];
    for (placeholder, of) in names_of {
        let put = |name: &String| -> Vec<String> {
            if name.contains(placeholder) {
                of.iter().map(|word| name.replace(placeholder, &column_name(word))).collect()
            } else {
                vec![name.clone()]
            }
        };
        names = names.iter().flat_map(put).collect();
    }
    names
}

#[test]
fn the_page_of_columns_has_every_column_of_a_run_and_no_other() {
    let text = page("cases/columns.md");
    let rows = listed(&text);
    assert!(rows.len() > 50, "{rows:?}");
    let mut met = BTreeSet::new();
    for case in [
        "bubbling-bed/scene-quick",
        "droplet-digging/scene-quick",
        "tracer/scene",
        "hopper/scene",
        "stirred-bed/scene",
        "drum/scene",
        "fed-hopper/scene",
        "stirrer/scene",
    ] {
        let mut scene = Scene::read(&root().join("cases").join(format!("{case}.toml")), &[]).unwrap();
        if let Some(motion) = scene.fluid.as_mut().and_then(|fluid| fluid.mesh_motion.as_mut())
            && let Some(table) = &mut motion.table
        {
            table.centre = Coordinates(vec![0.02, 0.0124]);
        }
        for group in &mut scene.grains {
            if let Placement::Deposit(deposit) = &mut group.placement {
                deposit.settle = false;
            }
        }
        (scene.output.stress, scene.output.energy) = (!scene.grains.is_empty(), !scene.grains.is_empty());
        if let Some(mesh) = scene.fluid.as_ref().and_then(|fluid| match &fluid.mesh {
            MeshSource::Rectangle(rectangle) => Some(rectangle),
            MeshSource::File(_) => None,
        }) {
            let corner = |x: [f64; 2]| Coordinates(x.to_vec());
            let within = Some(ProbeBox { lower: corner(mesh.lower), upper: corner(mesh.upper) });
            scene.output.probes = vec![Probe { name: "all".into(), within, ..Probe::default() }];
        }
        let walls: Vec<String> = scene.walls.iter().map(|wall| wall.body().to_owned()).collect();
        let fluid = scene.fluid.as_ref();
        let boundaries = fluid.iter().flat_map(|fluid| &fluid.boundaries).map(|part| part.name.clone());
        let parts: Vec<String> =
            boundaries.chain(scene.droplet.iter().map(|droplet| droplet.boundary.clone())).collect();
        let scalars: Vec<String> =
            fluid.iter().flat_map(|fluid| &fluid.scalars).map(|scalar| scalar.name.clone()).collect();
        let sources = scene.grains.iter().filter_map(|group| match &group.placement {
            Placement::Source(source) => Some(source.name.clone()),
            _ => None,
        });
        let sinks = scene.sinks.iter().map(|sink| sink.name.clone()).collect();
        let names_of = [
            ("WALL", walls),
            ("PART", parts),
            ("SCALAR", scalars),
            ("SOURCE", sources.collect()),
            ("SINK", sinks),
            ("PROBE", scene.output.probes.iter().map(|probe| probe.name.clone()).collect()),
        ];
        let mut simulation = Simulation::new(&scene).unwrap_or_else(|error| panic!("{case}: {error}"));
        simulation.refresh().unwrap();
        let written = readings(&scene.output, 0.0, &simulation.view(), &simulation.readings());
        let written: BTreeSet<String> = written.into_iter().map(|(name, _)| name.into_owned()).collect();
        let mut explained = BTreeSet::new();
        for row in &rows {
            let columns = named(row, &names_of);
            if columns.iter().any(|column| written.contains(column)) {
                met.insert(row.clone());
            }
            explained.extend(columns);
        }
        let unknown: Vec<&String> = written.difference(&explained).collect();
        assert!(unknown.is_empty(), "{case}: cases/columns.md has no {unknown:?}");
    }
    let never: Vec<&String> = rows.iter().filter(|row| !met.contains(*row)).collect();
    assert!(never.is_empty(), "cases/columns.md has {never:?}, which no run writes");
}

/// The first block of a page in a language.
fn block(text: &str, language: &str) -> String {
    let (_, rest) = text.split_once(&format!("\n```{language}\n")).expect("a block");
    rest.split_once("\n```").expect("its end").0.to_owned()
}

#[test]
fn the_scene_of_the_first_page_runs() {
    let folder = tempfile::tempdir().unwrap();
    let text = page("README.md");
    assert!(text.lines().count() <= 150, "the first page is to be read in one go");
    fs::write(folder.path().join("bed.toml"), block(&text, "toml")).unwrap();
    let arguments =
        ["run", "bed.toml", "--quiet", "--set", "time.end=0.02", "--set", "output.snapshots=[0.02]"];
    voidage().current_dir(&folder).args(arguments).assert().success();
    let series = fs::read_to_string(folder.path().join("out/bed/series.csv")).unwrap();
    assert_eq!(series.lines().count(), 22);
    assert!(folder.path().join("out/bed/snapshot-0.020s.png").exists());
}

#[test]
fn a_new_scene_runs_and_touches_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let new = |arguments: &[&str]| {
        let mut command = voidage();
        command.current_dir(&folder).arg("new").args(arguments);
        command.output().unwrap()
    };
    let first = new(&["bed"]);
    assert!(
        first.status.success() && String::from_utf8_lossy(&first.stdout).contains("voidage run bed.toml")
    );
    let written = fs::read_to_string(folder.path().join("bed.toml")).unwrap();
    // Every key has a comment with its meaning or unit, beside it or above in its line.
    let bare = |line: &&str| line.contains(" = ") && !line.contains('#') && !line.starts_with('#');
    let bare: Vec<&str> = written.lines().filter(bare).collect();
    assert!(bare.len() <= 12 && written.matches('#').count() > 40, "{bare:?}");
    let options = ["run", "bed.toml", "--quiet", "--set", "time.end=0.02", "--set", "output.snapshots=[]"];
    voidage().current_dir(&folder).args(options).assert().success();
    assert!(folder.path().join("out/bed/summary.json").exists());
    for again in [vec!["bed"], vec!["bed.toml"], vec!["bed", "--like", "hopper"]] {
        let refused = new(&again);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(
            refused.status.code() == Some(2) && said.contains("bed.toml: there is such a file"),
            "{said}"
        );
        assert_eq!(fs::read_to_string(folder.path().join("bed.toml")).unwrap(), written);
    }
    let lost = new(&["no/such"]);
    assert!(
        lost.status.code() == Some(2) && String::from_utf8_lossy(&lost.stderr).contains("no such folder")
    );
}

#[test]
fn every_shipped_scene_can_be_copied_and_is_good() {
    let folder = tempfile::tempdir().unwrap();
    let mut names = BTreeSet::new();
    for path in shipped() {
        let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
        let case = path.parent().and_then(Path::file_name).unwrap().to_string_lossy().into_owned();
        let name = format!("{case}{}", stem.strip_prefix("scene").unwrap());
        voidage().current_dir(&folder).args(["new", &name, "--like", &name]).assert().success();
        let copied = folder.path().join(format!("{name}.toml"));
        assert_eq!(fs::read(&copied).unwrap(), fs::read(&path).unwrap(), "{name}");
        voidage().arg("check").arg(&copied).assert().success();
        names.insert(name);
    }
    let wrong = voidage().args(["new", "x", "--like", "hoper"]).current_dir(&folder).output().unwrap();
    let said = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert_eq!(wrong.status.code(), Some(2));
    let (_, values) = said.split_once("[possible values: ").expect("the cases that there are");
    let offered: BTreeSet<String> =
        values.split(']').next().unwrap_or_default().split(", ").map(String::from).collect();
    assert_eq!(offered, names);
    assert!(!folder.path().join("x.toml").exists());
}

#[test]
fn shipped_scenes_use_the_default_scheme_or_their_page_says_why_not() {
    let (mut others, mut sections) = (0, 0);
    for path in shipped() {
        let scene = Scene::read(&path, &[]).unwrap();
        let scheme = scene.coupling.map(|coupling| coupling.scheme).unwrap_or_default();
        if scheme != SchemeName::default() {
            others += 1;
            let text = fs::read_to_string(path.with_file_name("README.md")).unwrap();
            sections += usize::from(text.contains(&format!("## Why the scheme is `{scheme}`")));
        }
    }
    assert!(others > 0 && others == sections, "{others} scenes, {sections} reasons");
}
