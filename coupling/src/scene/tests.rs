//! Tests of reading scenes.

use super::*;
use std::path::{Path, PathBuf};

fn cases() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases")
}

#[test]
fn every_case_is_a_valid_scene() {
    let scenes = [
        "bubbling-bed/scene.toml",
        "bubbling-bed/scene-quick.toml",
        "bubbling-bed/scene-migflow.toml",
        "settling-grain/scene.toml",
        "packed-bed/scene.toml",
        "hopper/scene.toml",
        "cavity/scene.toml",
    ];
    for name in scenes {
        let scene = Scene::read(&cases().join(name), &[]).unwrap_or_else(|error| panic!("{error}"));
        let text = scene.to_toml().unwrap();
        let again =
            Scene::parse(Path::new("resolved.toml"), &text, &[]).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(text, again.to_toml().unwrap(), "{name} changes when written and read");
        assert_eq!(scene.hash().unwrap(), again.hash().unwrap());
    }
}
