//! What grains cost: bytes per grain, allocations per step.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicIsize, AtomicUsize, Ordering::Relaxed};
use voidage_dem::packing::{Amount, Fill, Radii, Region, loose};
use voidage_dem::{Dem, Load, Material, Settings, Vector, Wall};

/// The system's allocator, counting calls and live bytes.
struct Counting;
static CALLS: AtomicUsize = AtomicUsize::new(0);
static LIVE: AtomicIsize = AtomicIsize::new(0);

// SAFETY: every call is passed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Relaxed);
        LIVE.fetch_add(layout.size() as isize, Relaxed);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, p: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size() as isize, Relaxed);
        unsafe { System.dealloc(p, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_plain_scene_is_small_and_allocates_nothing() {
    let materials = [Material { friction: 0.3, ..Material::default() }];
    let region = Region { low: Vector::zeros(), high: Vector::<2>::new(0.08, 0.1) };
    let radii = Radii::Uniform { min: 0.4e-3, max: 0.5e-3 };
    let fill = Fill { radii, amount: Amount::Count(3800), material: 0, materials: &materials, seed: 1 };
    let corner = |x: f64, y: f64| Vector::<2>::new(x, y);
    let walls = vec![
        Wall::new("floor", corner(0.0, 0.0), corner(0.08, 0.0)),
        Wall::new("left", corner(0.0, 0.0), corner(0.0, 0.2)),
        Wall::new("right", corner(0.08, 0.0), corner(0.08, 0.2)),
    ];
    // Grains that have fallen from a loose lattice lie at rest.
    let fallen = loose(&region, &fill).unwrap();
    let mut falling = Dem::new(fallen, walls.clone(), materials.to_vec(), Settings::default()).unwrap();
    for _ in 0..400 {
        falling.step(1.4e-3, &Load::default());
    }
    let mut particles = falling.particles.clone();
    particles.velocity.fill(Vector::zeros());
    drop(falling);

    let before = LIVE.load(Relaxed);
    let n = particles.len();
    let particles = particles.clone();
    let mut dem = Dem::new(particles, walls, materials.to_vec(), Settings::default()).unwrap();
    // Room for corrections of the cold start is given back after a hundred steps without one.
    for _ in 0..200 {
        dem.step(1e-3, &Load::default());
    }
    let bytes = (LIVE.load(Relaxed) - before) as f64 / n as f64;
    println!("{bytes:.0} bytes per grain");
    // Some 220 of them are what sweeps keep of the contacts of tiles that were ever swept.
    assert!(bytes <= 800.0, "{bytes} bytes per grain");

    let calls = CALLS.load(Relaxed);
    let report = dem.step(1e-3, &Load::default());
    for _ in 0..9 {
        dem.step(1e-3, &Load::default());
    }
    assert_eq!(CALLS.load(Relaxed) - calls, 0);
    assert!(report.contacts > n, "{report:?}");
}
