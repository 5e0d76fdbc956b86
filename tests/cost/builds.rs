//! What builds cost: the program, the Python package and the tests share all crates that they compile.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// The features of each package of a build, which are several where programs that run in the build have others.
fn features(build: &[&str]) -> BTreeMap<String, BTreeSet<String>> {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    command.args(["tree", "--locked", "--prefix", "none", "--format", "{p}|{f}"]);
    let output = command.args(build).output().expect("cargo");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut found = BTreeMap::<String, BTreeSet<String>>::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let Some((package, features)) = line.split_once('|') else { continue };
        found.entry(package.into()).or_default().insert(features.trim_end_matches(" (*)").into());
    }
    found
}

/// A crate whose features differ is compiled once more, and so are all that use it: the Python package and the tests
/// compiled the whole workspace twice.
#[test]
fn the_package_the_program_and_the_tests_compile_crates_once() {
    let tests = features(&["--edges", "normal,build,dev"]);
    for package in ["voidage-python", "voidage"] {
        let built = features(&["--package", package, "--edges", "normal,build"]);
        assert!(built.len() > 100 && built.keys().any(|of| of.starts_with("voidage-dem ")), "{built:?}");
        let shared = built.iter().filter_map(|(of, features)| Some((of, features, tests.get(of)?)));
        let others: Vec<String> = shared
            .filter(|(_, features, tested)| !features.is_subset(tested))
            .map(|(of, features, tested)| format!("{of} in {package}: {features:?}, in tests {tested:?}"))
            .collect();
        assert!(others.is_empty(), "[workspace.dependencies] in Cargo.toml: {}", others.join("\n"));
    }
}
