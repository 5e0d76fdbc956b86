//! Time to make meshes, to find neighbours and to locate points.

use criterion::{Criterion, criterion_group, criterion_main};
use voidage_fluid::mesh::{Hole, Locator, Mesh, Rectangle, Sides};

fn bed(size: f64) -> Rectangle {
    Rectangle {
        lower: [0.0, 0.0],
        upper: [0.08, 0.25],
        size: Some(size),
        sides: Sides::all("walls"),
        holes: Vec::new(),
        refine: Vec::new(),
        structured: None,
    }
}

fn meshes(criterion: &mut Criterion) {
    let domain = bed(1.5e-3);
    criterion.bench_function("rectangle 8 x 25 cm, 1.5 mm", |b| b.iter(|| Mesh::rectangle(&domain)));
    // The digging case: what a remeshing costs.
    let hole =
        Hole { name: "droplet".into(), centre: [5e-3, 25.25e-3], radius: 1.25e-3, size: 5e-5, growth: 0.1 };
    let digging = Rectangle { upper: [0.01, 0.03], size: Some(3e-4), holes: vec![hole], ..domain.clone() };
    let nodes = Mesh::rectangle(&digging).map(|mesh| mesh.points.len());
    criterion.bench_function("droplet in 1 x 3 cm", |b| b.iter(|| Mesh::rectangle(&digging)));
    println!("droplet: {nodes:?} nodes");
    let mesh = Mesh::rectangle(&domain).expect("the description is valid");
    criterion.bench_function("neighbours", |b| b.iter(|| mesh.neighbours()));
    criterion.bench_function("locator", |b| b.iter(|| Locator::new(&mesh)));
    let mut locator = Locator::new(&mesh).expect("the mesh is whole");
    criterion.bench_function("locator after motion", |b| b.iter(|| locator.moved(&mesh)));
}

criterion_group!(benches, meshes);
criterion_main!(benches);
