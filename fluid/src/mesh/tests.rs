//! Tests of generated meshes.

use super::*;
use approx::assert_relative_eq;

fn plain(upper: [f64; 2], size: f64) -> Rectangle {
    Rectangle {
        lower: [0.0, 0.0],
        upper,
        size: Some(size),
        sides: Sides::all("walls"),
        holes: Vec::new(),
        refine: Vec::new(),
        structured: None,
    }
}

fn hole(name: &str, centre: [f64; 2], radius: f64, size: f64) -> Hole {
    Hole { name: name.into(), centre, radius, size, growth: 0.2 }
}

fn report(label: &str, mesh: &Mesh<2>) -> Quality {
    let q = mesh.quality();
    println!("{label}: {} nodes, {} cells, {q:?}", mesh.points.len(), mesh.cell_count());
    q
}

#[test]
fn bubbling_bed() {
    let mut domain = plain([0.08, 0.25], 1.5e-3);
    let part = |name: &str, to| Part { name: name.into(), to };
    domain.sides.bottom =
        Side(vec![part("inflow", Some(0.034)), part("nozzle", Some(0.046)), part("inflow", None)]);
    domain.sides.top = Side::named("outflow");
    let mesh = Mesh::rectangle(&domain).unwrap();
    mesh.check().unwrap();
    let q = report("bed", &mesh);
    assert!(q.smallest_angle >= 25.0);
    assert!((10_000..13_000).contains(&mesh.points.len()));
    assert_relative_eq!(mesh.volume(), 0.02, max_relative = 1e-13);
    for (name, length) in [("inflow", 0.068), ("nozzle", 0.012), ("walls", 0.5), ("outflow", 0.08)] {
        assert_relative_eq!(mesh.boundary(name).unwrap().measure(&mesh), length, max_relative = 1e-13);
    }
    for end in [0.034, 0.046] {
        assert!(mesh.points.iter().any(|p| *p == Vector::<2>::new(end, 0.0)));
    }
    assert_eq!(mesh, Mesh::rectangle(&domain).unwrap());
}

#[test]
fn mean_edge_is_the_wanted_size() {
    for size in [0.2, 0.1, 0.05, 0.02] {
        let q = report(&format!("square {size}"), &Mesh::rectangle(&plain([1.0, 1.0], size)).unwrap());
        assert!(q.smallest_angle >= 25.0);
        if size < 0.1 {
            assert_relative_eq!(q.mean_edge, size, max_relative = 0.03);
        }
    }
}

#[test]
fn holes_and_refinement() {
    // The digging case: droplet of 2.5 mm in 10 x 30 mm.
    let mut domain = plain([0.01, 0.03], 1e-3);
    domain.holes = vec![hole("droplet", [0.005, 0.02525], 1.25e-3, 1e-4)];
    let mesh = Mesh::rectangle(&domain).unwrap();
    mesh.check().unwrap();
    assert!(report("droplet", &mesh).smallest_angle >= 25.0);
    let droplet = mesh.boundary("droplet").unwrap();
    for &node in &droplet.facets {
        let p = mesh.points[node as usize] - Vector::<2>::new(0.005, 0.02525);
        assert_relative_eq!(p.norm(), 1.25e-3, max_relative = 1e-12);
    }
    // The inscribed polygon of n equal chords: area n/2 r^2 sin(2 pi/n).
    let n = droplet.cells.len() as f64;
    let polygon = 0.5 * n * 1.25e-3_f64.powi(2) * (std::f64::consts::TAU / n).sin();
    assert_relative_eq!(mesh.volume(), 3e-4 - polygon, max_relative = 1e-6);
    // Narrow gaps to a side and between holes.
    domain.holes.push(hole("near", [0.0061, 0.0021], 1.9e-3, 3e-4));
    domain.holes.push(hole("wall", [0.0021, 0.0021], 2.0e-3, 3e-4));
    domain.refine = vec![Refinement {
        around: Place::Segment { from: [0.0, 0.01], to: [0.01, 0.012] },
        size: 1e-4,
        within: 2e-4,
        growth: 0.5,
    }];
    let mesh = Mesh::rectangle(&domain).unwrap();
    mesh.check().unwrap();
    assert!(report("narrow", &mesh).smallest_angle >= 25.0);
    assert_eq!(mesh, Mesh::rectangle(&domain).unwrap());
}

#[test]
fn structured_grids() {
    for diagonals in [Diagonals::Rising, Diagonals::Falling, Diagonals::Alternating] {
        let mut domain = plain([2.0, 1.0], 1.0);
        domain.size = None;
        domain.structured = Some(Structured { squares: [8, 4], diagonals });
        let mesh = Mesh::rectangle(&domain).unwrap();
        mesh.check().unwrap();
        assert_eq!((mesh.points.len(), mesh.cell_count()), (45, 64));
        assert_relative_eq!(mesh.volume(), 2.0, max_relative = 1e-14);
        assert_relative_eq!(mesh.quality().smallest_angle, 45.0, max_relative = 1e-12);
        assert_relative_eq!(mesh.boundary("walls").unwrap().measure(&mesh), 6.0, max_relative = 1e-13);
        assert_relative_eq!(mesh.nodal_volume().iter().sum::<f64>(), 2.0, max_relative = 1e-13);
    }
}

#[test]
fn locating() {
    let mut domain = plain([1.0, 0.5], 0.05);
    domain.holes = vec![hole("hole", [0.3, 0.25], 0.1, 0.02)];
    let mesh = Mesh::rectangle(&domain).unwrap();
    let locator = Locator::new(&mesh).unwrap();
    for cell in 0..mesh.cell_count() {
        let p = mesh.centroid(cell);
        for hint in [None, Some(0), Some(cell as u32), Some(mesh.cell_count() as u32 - 1), Some(u32::MAX)] {
            assert_eq!(locator.locate(&mesh, &p, hint), Some(cell as u32));
        }
        for (k, &across) in locator.neighbours().of(cell).iter().enumerate() {
            if across != Neighbours::<2>::NONE {
                assert!(locator.neighbours().of(across as usize).contains(&(cell as u32)));
                assert!(!mesh.cell(across as usize).contains(&mesh.cell(cell)[k]));
            }
        }
    }
    for (node, p) in mesh.points.iter().enumerate() {
        let cell = locator.locate(&mesh, p, None).unwrap();
        assert!(mesh.cell(cell as usize).contains(&(node as u32)));
    }
    for p in [[-1e-6, 0.2], [1.5, 0.2], [0.3, 0.25], [0.5, -7.0], [f64::NAN, 0.1], [1e300, 1e300]] {
        for hint in [None, Some(0), Some(40)] {
            assert_eq!(locator.locate(&mesh, &Vector::<2>::from(p), hint), None);
        }
    }
}

#[test]
fn a_tetrahedral_mesh() {
    // The cube in six tetrahedra around its diagonal.
    let points: Vec<Vector<3>> =
        (0..8).map(|i| Vector::<3>::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64)).collect();
    let cells = vec![0, 1, 3, 7, 0, 3, 2, 7, 0, 2, 6, 7, 0, 6, 4, 7, 0, 4, 5, 7, 0, 5, 1, 7];
    let mesh = Mesh::<3>::with_boundaries(points, cells, &["walls".into()], |_| Ok(0)).unwrap();
    mesh.check().unwrap();
    assert_relative_eq!(mesh.volume(), 1.0, max_relative = 1e-15);
    assert_relative_eq!(mesh.boundary("walls").unwrap().measure(&mesh), 6.0, max_relative = 1e-15);
    let locator = Locator::new(&mesh).unwrap();
    for cell in 0..6 {
        assert_eq!(locator.locate(&mesh, &mesh.centroid(cell), Some(0)), Some(cell as u32));
    }
    assert_eq!(locator.locate(&mesh, &Vector::<3>::new(0.5, 0.5, 1.1), Some(0)), None);
}

#[test]
fn broken_meshes() {
    let mesh = Mesh::rectangle(&plain([1.0, 1.0], 0.3)).unwrap();
    let fails = |change: &dyn Fn(&mut Mesh<2>), text: &str| {
        let mut broken = mesh.clone();
        change(&mut broken);
        let error = broken.check().unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    };
    fails(&|m| m.cells.swap(0, 1), "must be positive");
    fails(&|m| m.points[3][0] = f64::NAN, "node 3 is not finite");
    fails(&|m| m.points.push(Vector::<2>::zeros()), "belongs to no cell");
    fails(&|m| m.cells[5] = 10_000, "names node 10000");
    fails(&|m| m.boundaries[0].facets.swap(0, 1), "no outward facet");
    fails(&|m| m.boundaries.clear(), "the boundary parts hold 0 facets");
    fails(&|m| m.boundaries.push(m.boundaries[0].clone()), "occurs twice");
    assert!(mesh.boundary("wals").unwrap_err().to_string().contains("it has \"walls\""));
}

#[test]
fn a_remeshed_domain_keeps_its_boundary_and_linear_fields() {
    let mut domain = plain([2.0, 1.0], 0.1);
    domain.sides.left = Side::named("inflow");
    domain.holes = vec![hole("rod", [0.6, 0.5], 0.15, 0.05)];
    let mut mesh = Mesh::rectangle(&domain).unwrap();
    let spacing = mesh.spacing();
    // The rod moves to the right, and the nodes around it with it, less and less.
    let pull =
        |x: &Vector<2>| (1.0 - ((x - Vector::<2>::new(0.6, 0.5)).norm() - 0.15) / 0.35).clamp(0.0, 1.0);
    mesh.points.iter_mut().for_each(|x| x[0] += 0.2 * pull(x));
    let remeshed = mesh.remesh(&spacing).unwrap();
    let (new, old) = (&remeshed.mesh, &mesh);
    new.check().unwrap();
    assert_relative_eq!(new.volume(), old.volume(), max_relative = 1e-13);
    for part in &old.boundaries {
        let same = new.boundary(&part.name).unwrap();
        assert_eq!(same.facets.len(), part.facets.len(), "{}", part.name);
        assert_relative_eq!(same.measure(new), part.measure(old), max_relative = 1e-13);
    }
    let (before, after) = (report("moved", old), report("anew", new));
    assert!(before.smallest_angle < 20.0 && after.smallest_angle > 25.0, "{before:?} {after:?}");
    assert_relative_eq!(after.mean_edge, before.mean_edge, max_relative = 0.05);
    let linear = |x: &Vector<2>| 3.0 + 2.0 * x[0] - 5.0 * x[1];
    let carried = remeshed.carry(&old.points.iter().map(linear).collect::<Vec<f64>>());
    for (value, point) in carried.iter().zip(&new.points) {
        assert_relative_eq!(*value, linear(point), epsilon = 1e-12);
    }
    let again = mesh.remesh(&spacing).unwrap();
    assert_eq!(again.mesh, *new);
}

#[test]
fn meshes_made_one_from_the_other_keep_their_sizes() {
    let domain = Rectangle { holes: vec![hole("rod", [0.6, 0.5], 0.15, 0.03)], ..plain([2.0, 1.0], 0.1) };
    let first = Mesh::rectangle(&domain).unwrap();
    let (mut mesh, mut spacing) = (first.clone(), first.spacing());
    for _ in 0..10 {
        let remeshed = mesh.remesh(&spacing).unwrap();
        spacing = remeshed.carry(&spacing);
        mesh = remeshed.mesh;
    }
    let (before, after) = (report("first", &first), report("tenth", &mesh));
    assert_relative_eq!(after.mean_edge, before.mean_edge, max_relative = 0.05);
    assert_relative_eq!(mesh.points.len() as f64, first.points.len() as f64, max_relative = 0.1);
    assert!(after.smallest_angle > 25.0, "{after:?}");
}
