//! The description of a domain: as text, its errors, its schema, and meshes of random ones.

use super::*;
use proptest::prelude::*;

const BED: &str = r#"
lower = [0.0, 0.0]
upper = [0.08, 0.25]
size = 1.5e-3
holes = [{ name = "droplet", centre = [0.04, 0.2], radius = 0.005, size = 5e-4 }]

[sides]
left = "walls"
right = "walls"
top = "outflow"
bottom = [{ name = "inflow", to = 0.034 }, { name = "nozzle", to = 0.046 }, { name = "inflow" }]

[[refine]]
around = { box = { lower = [0.0, 0.0], upper = [0.08, 0.01] } }
size = 1e-3
[[refine]]
around = { segment = { from = [0.04, 0.0], to = [0.04, 0.1] } }
size = 1e-3
within = 0.002
growth = 0.5
[[refine]]
around = { point = [0.01, 0.01] }
size = 1e-4
"#;

fn parse(text: &str) -> std::result::Result<Rectangle, String> {
    let deserializer = toml::Deserializer::parse(text).map_err(|error| error.to_string())?;
    serde_path_to_error::deserialize(deserializer)
        .map_err(|error| format!("{}: {}", error.path(), error.inner()))
}

#[test]
fn text_and_back() {
    let domain = parse(BED).unwrap();
    domain.validate().unwrap();
    assert_eq!(domain.sides.left, Side::named("walls"));
    assert_eq!(domain.sides.bottom.0[1], Part { name: "nozzle".into(), to: Some(0.046) });
    let text = toml::to_string(&domain).unwrap();
    assert!(text.contains("left = \"walls\""), "{text}");
    assert_eq!(parse(&text).unwrap(), domain);
    let schema = schemars::schema_for!(Rectangle).to_value().to_string();
    assert!(schema.contains("Mean length of the edges") && schema.contains("Side"), "{schema}");
}

#[test]
fn errors_of_form_name_the_place() {
    let fails = |from: &str, to: &str, texts: &[&str]| {
        assert!(BED.contains(from), "{from}");
        let error = parse(&BED.replacen(from, to, 1)).unwrap_err();
        texts.iter().for_each(|text| assert!(error.contains(text), "{error}"));
    };
    fails("radius", "raduis", &["holes[0]", "line 5", "unknown field `raduis`", "`radius`"]);
    fails("\"walls\"", "7", &["sides.left", "expected a name or an array of parts"]);
    fails(
        "to = 0.046",
        "till = 0.046",
        &["sides.bottom[1].till", "unknown field `till`, expected `name` or `to`"],
    );
    fails("to = 0.034", "to = \"x\"", &["sides.bottom[0].to", "expected f64"]);
    fails("top = \"outflow\"\n", "", &["sides", "missing field `top`"]);
    fails(
        "{ point",
        "{ pint",
        &["refine[2].around", "unknown variant `pint`, expected one of `point`, `segment`, `box`"],
    );
}

#[test]
fn errors_of_meaning_name_the_field() {
    let fails = |change: &dyn Fn(&mut Rectangle), text: &str| {
        let mut domain = parse(BED).unwrap();
        change(&mut domain);
        let error = Mesh::rectangle(&domain).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    };
    fails(&|d| d.upper[0] = -1.0, "upper = [-1.0, 0.25] must be right of");
    fails(&|d| d.lower[1] = f64::NAN, "all finite");
    fails(&|d| d.size = Some(0.0), "size = 0 must be positive and finite");
    fails(&|d| d.size = None, "size is missing");
    fails(&|d| d.size = Some(1e-12), "edges");
    fails(
        &|d| d.sides.bottom.0[1].to = Some(0.02),
        "sides.bottom[1].to = 0.02 must lie between 0.034 and 0.08",
    );
    fails(&|d| d.sides.bottom.0[0].to = None, "sides.bottom[0].to is missing");
    fails(&|d| d.sides.bottom.0[2].to = Some(0.07), "sides.bottom[2].to: the last part ends at the corner");
    fails(&|d| d.sides.top = Side(vec![]), "sides.top must have at least one part");
    fails(&|d| d.sides.top = Side::named(" "), "sides.top[0].name must not be empty");
    fails(&|d| d.holes[0].radius = 0.05, "holes[0] (\"droplet\"");
    fails(&|d| d.holes.push(d.holes[0].clone()), "overlaps holes[0]");
    fails(&|d| d.holes[0].growth = 2.0, "holes[0].growth = 2 must be from 0 to 1");
    fails(&|d| d.refine[1].size = -1.0, "refine[1].size = -1");
    fails(&|d| d.refine[1].within = -1.0, "refine[1].within = -1");
    let grid = Structured { squares: [4, 4], diagonals: Diagonals::Rising };
    fails(&|d| d.structured = Some(grid.clone()), "give either size or structured");
    fails(&|d| (d.size, d.structured) = (None, Some(grid.clone())), "structured excludes holes");
}

#[test]
fn the_bed_with_everything() {
    let mesh = Mesh::rectangle(&parse(BED).unwrap()).unwrap();
    mesh.check().unwrap();
    assert!(mesh.quality().smallest_angle >= 25.0);
}

/// Description of a small domain with up to three holes that do not overlap and one refinement.
fn domains() -> impl Strategy<Value = Rectangle> {
    let hole = (0.02..0.98f64, 0.02..0.98f64, 0.01..0.3f64, 0.02..0.2f64);
    let holes = prop::collection::vec(hole, 0..4);
    let refine = (0.0..1.0f64, 0.0..1.0f64, 0.005..0.1f64, 0.1..0.5f64);
    (0.5..2.0f64, 0.03..0.3f64, holes, refine).prop_map(|(height, size, holes, (x, y, fine, growth))| {
        let mut domain = Rectangle {
            lower: [-1.0, 2.0],
            upper: [0.0, 2.0 + height],
            size: Some(size),
            sides: Sides::all("walls"),
            holes: Vec::new(),
            refine: vec![Refinement {
                around: Place::Point([x - 1.0, y * height + 2.0]),
                size: fine,
                within: fine,
                growth,
            }],
            structured: None,
        };
        for (x, y, radius, size) in holes {
            let centre = [x - 1.0, 2.0 + y * height];
            let hole =
                Hole { name: format!("hole {}", domain.holes.len()), centre, radius, size, growth: 0.3 };
            let mut with = domain.clone();
            with.holes.push(hole);
            // Gaps below a hundredth of the size are no reasonable request.
            let wide = |a: [f64; 2], b: [f64; 2], r: f64| (a[0] - b[0]).hypot(a[1] - b[1]) > r + 2e-3;
            let apart = domain.holes.iter().all(|other| wide(other.centre, centre, other.radius + radius));
            let margin = radius + 2e-3;
            let inside =
                (0..2).all(|k| centre[k] - margin > with.lower[k] && centre[k] + margin < with.upper[k]);
            if apart && inside {
                domain = with;
            }
        }
        domain
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// Any description that makes sense has a mesh of good angles, with all holes open.
    #[test]
    fn random_domains(domain in domains()) {
        let mesh = Mesh::rectangle(&domain).unwrap();
        mesh.check().unwrap();
        prop_assert!(mesh.quality().smallest_angle >= 25.0);
        let height = domain.upper[1] - domain.lower[1];
        let walls = mesh.boundary("walls").unwrap().measure(&mesh);
        prop_assert!((walls - 2.0 - 2.0 * height).abs() < 1e-12);
        let mut area = height;
        for hole in &domain.holes {
            let part = mesh.boundary(&hole.name).unwrap();
            // Shoelace over the polygon, negative as the outward normal points into the hole.
            area += part.facets.chunks_exact(2).map(|edge| {
                let [a, b] = [0, 1].map(|k| mesh.points[edge[k] as usize] - Vector::<2>::from(hole.centre));
                0.5 * (a[0] * b[1] - a[1] * b[0])
            }).sum::<f64>();
        }
        prop_assert!((mesh.volume() - area).abs() < 1e-12);
    }
}
