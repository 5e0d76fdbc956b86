//! Time to make meshes, to find neighbours and to locate points.

use criterion::{Criterion, criterion_group, criterion_main};
use voidage_fluid::mesh::{Mesh, Rectangle, Sides};

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
    let mesh = Mesh::rectangle(&domain).expect("the description is valid");
    criterion.bench_function("neighbours", |b| b.iter(|| mesh.neighbours()));
}

criterion_group!(benches, meshes);
criterion_main!(benches);
