//! The same bits for any number of threads.

use std::path::Path;
use voidage_scene::{Scene, Simulation};

/// Everything that the quick bed holds after some steps, as bits.
fn bits(threads: usize, scheme: &str) -> Vec<u64> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/bubbling-bed/scene-quick.toml");
        let placement = "grains[0].placement={lattice={lower=[0.0,0.0],upper=[0.04,0.12],spacing=1.01}}";
        let sets = [placement.to_string(), format!("coupling.scheme={scheme:?}")];
        let scene = Scene::read(&path, &sets).unwrap_or_else(|error| panic!("{error}"));
        let mut simulation = Simulation::new(&scene).expect("a valid scene");
        for _ in 0..25 {
            simulation.step().expect("a step");
        }
        voidage_tests::bits(&mut simulation)
    })
}

#[test]
fn a_bed_is_the_same_for_one_two_and_four_threads() {
    for scheme in ["henry", "iterated"] {
        let one = bits(1, scheme);
        assert!(one.len() > 5_000, "{} numbers", one.len());
        for threads in [2, 4] {
            assert!(one == bits(threads, scheme), "{scheme}: {threads} threads give other bits");
        }
    }
}
