//! Reading and writing .msh files.

use crate::Vector;
use crate::mesh::{Hole, Mesh, Rectangle, Sides};
use proptest::prelude::*;

fn sample() -> Mesh<2> {
    let mut sides = Sides::all("walls");
    sides.top = crate::mesh::Side::named("open top");
    let hole = Hole { name: "droplet".into(), centre: [0.5, 0.5], radius: 0.1, size: 0.03, growth: 0.3 };
    Mesh::rectangle(&Rectangle {
        lower: [0.0, 0.0],
        upper: [1.0, 1.0],
        size: Some(0.2),
        sides,
        holes: vec![hole],
        refine: vec![],
        structured: None,
    })
    .unwrap()
}

#[test]
fn round_trip() {
    let mesh = sample();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sample.msh");
    mesh.write_msh(&path).unwrap();
    assert_eq!(Mesh::read_msh(&path).unwrap(), mesh);
    let missing = Mesh::<2>::read_msh(&folder.path().join("none.msh")).unwrap_err().to_string();
    assert!(missing.contains("none.msh: No such file"), "{missing}");

    let points =
        vec![Vector::<3>::zeros(), Vector::<3>::new(0.1, 1.0 / 3.0, 0.0), Vector::<3>::y(), Vector::<3>::z()];
    let tetrahedron =
        Mesh::<3>::with_boundaries(points, vec![0, 1, 2, 3], &["a".into(), "b".into()], |nodes| {
            Ok(usize::from(nodes.contains(&0)))
        })
        .unwrap();
    assert_eq!(Mesh::<3>::parse_msh(&tetrahedron.to_msh().unwrap(), "t.msh").unwrap(), tetrahedron);
}

/// Two triangles as Gmsh 4.12 writes them, with a point element, an unused node, a section to pass over and a cell of
/// negative orientation.
const TWO: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n3\n1 1 \"walls\"\n1 2 \"open\"\n2 3 \"fluid\"\n\
$EndPhysicalNames\n$Entities\n1 2 1 0\n1 0 0 0 0\n1 0 0 0 1 1 0 1 1 2 1 -2\n2 0 0 0 1 1 0 1 2 2 1 -2\n\
1 0 0 0 1 1 0 1 3 1 1\n$EndEntities\n$Comment\nanything $Nodes\n$EndComment\n$Nodes\n2 5 1 9\n0 1 0 1\n1\n0 0 0\n\
2 1 0 4\n2\n3\n4\n9\n1 0 0\n1 1 0\n0 1 0\n7 7 7\n$EndNodes\n$Elements\n4 7 1 7\n0 1 15 1\n1 1\n1 1 1 3\n2 1 2\n3 2 3\n\
4 3 4\n1 2 1 1\n5 4 1\n2 1 2 2\n6 1 2 3\n7 1 4 3\n$EndElements\n";

#[test]
fn a_file_of_gmsh() {
    let mesh = Mesh::<2>::parse_msh(TWO, "two.msh").unwrap();
    mesh.check().unwrap();
    assert_eq!((mesh.points.len(), mesh.cell_count()), (4, 2));
    assert_eq!(mesh.volume(), 1.0);
    assert_eq!(mesh.boundary("walls").unwrap().measure(&mesh), 3.0);
    assert_eq!(mesh.boundary("open").unwrap().facets, [3, 0]);
}

/// The same mesh in format 2.2, with a byte order mark before it, was refused.
#[test]
fn a_file_of_format_2_2() {
    let old = "\u{feff}$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n3\n1 1 \"walls\"\n1 2 \"open\"\n\
               2 3 \"fluid\"\n$EndPhysicalNames\n$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n9 7 7 7\n$EndNodes\n\
               $Elements\n7\n1 15 2 0 1 1\n2 1 2 1 1 1 2\n3 1 2 1 1 2 3\n4 1 2 1 1 3 4\n5 1 2 2 2 4 1\n\
               6 2 2 3 1 1 2 3\n7 2 2 3 1 1 4 3\n$EndElements\n";
    let mesh = Mesh::<2>::parse_msh(old, "old.msh").unwrap();
    assert_eq!(mesh, Mesh::<2>::parse_msh(TWO, "two.msh").unwrap());
    let fails = |from: &str, to: &str, text: &str| {
        let error = Mesh::<2>::parse_msh(&old.replacen(from, to, 1), "old.msh").unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    };
    fails("2 2 3 1 1 2 3", "3 2 3 1 1 2 3 4", "elements of type 3; allowed here are triangles");
    fails("5 1 2 2 2 4 1", "5 1 2 0 2 4 1", "is in no physical group");
    fails("2.2 0 8", "2.2 1 8", "a binary file");
}

/// Written by Gmsh 4.15: a square as text, and as binary files, which were refused.
const SQUARE: &str = include_str!("square.msh");
const BINARY: [&[u8]; 2] = [include_bytes!("square-binary.msh"), include_bytes!("square-binary-2.2.msh")];

fn read_bytes(bytes: &[u8]) -> crate::Result<Mesh<2>> {
    Mesh::parse_msh(&super::binary::as_text(bytes, "binary.msh")?, "binary.msh")
}

#[test]
fn binary_files_are_read_as_text_is() {
    let text = Mesh::<2>::parse_msh(SQUARE, "square.msh").unwrap();
    assert_eq!((text.points.len(), text.cell_count()), (9, 8));
    for bytes in BINARY {
        assert_eq!(read_bytes(bytes).unwrap(), text);
        // All that is cut off, and a number that is none.
        for end in 0..bytes.len() - 2 {
            let error = read_bytes(&bytes[..end]).map(|_| end);
            assert!(error.is_err() || end + 12 > bytes.len(), "{error:?} of {}", bytes.len());
        }
        let error = read_bytes(&[&bytes[..40], &[7; 60][..]].concat()).unwrap_err().to_string();
        assert!(error.contains("binary.msh"), "{error}");
    }
    assert_eq!(super::binary::as_text(SQUARE.as_bytes(), "square.msh").unwrap(), SQUARE);
}

/// A file of a machine that writes the highest byte first.
#[test]
fn the_order_of_bytes_is_the_files() {
    let mut bytes = b"$MeshFormat\n2.2 1 8\n".to_vec();
    bytes.extend(1_i32.to_be_bytes());
    bytes.extend(b"\n$EndMeshFormat\n$Nodes\n3\n");
    for (tag, [x, y]) in [(1_i32, [0.0_f64, 0.0]), (2, [1.0, 0.0]), (3, [0.0, 1.0])] {
        bytes.extend(tag.to_be_bytes());
        [x, y, 0.0].iter().for_each(|x| bytes.extend(x.to_be_bytes()));
    }
    bytes.extend(b"\n$EndNodes\n$Elements\n4\n");
    let lines = [1_i32, 3, 1, 1, 5, 1, 2, 2, 5, 2, 3, 3, 5, 3, 1];
    let triangle = [2_i32, 1, 2, 4, 6, 6, 1, 2, 3];
    lines.iter().chain(&triangle).for_each(|number| bytes.extend(number.to_be_bytes()));
    bytes.extend(b"\n$EndElements\n");
    let mesh = read_bytes(&bytes).unwrap();
    assert_eq!((mesh.volume(), mesh.boundary("5").unwrap().cells.len()), (0.5, 3));
}

#[test]
fn errors_name_the_place() {
    let fails = |from: &str, to: &str, text: &str| {
        assert!(TWO.contains(from), "{from}");
        let error = Mesh::<2>::parse_msh(&TWO.replacen(from, to, 1), "two.msh").unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    };
    fails("4.1 0 8", "4.0 0 8", "two.msh:2: format 4.0, allowed are 4.1 and 2.2");
    fails("$Comment", "$PartitionedEntities", "two.msh:17: the mesh is partitioned");
    fails("$Comment", "$ParametricNodes", "two.msh:17: the nodes are parametric");
    fails("$MeshFormat", "$NOD", "two.msh:1: a file of format 1, allowed are");
    fails("4.1 0 8", "4.1 1 8", "two.msh:2: a binary file where text should be");
    fails("1 1 0\n0 1 0\n", "1 1x 0\n0 1 0\n", "two.msh:31: \"1x\" where a number of coordinates should be");
    fails("1 1 0\n0 1 0\n", "1 1\n0 1 0\n", "two.msh:31: the end of the line where a number");
    fails("1 1 0\n0 1 0\n", "1 NaN 0\n0 1 0\n", "two.msh:31: [1.0, NaN, 0.0] where finite");
    fails("1 1 0\n0 1 0\n", "1 1 0.5\n0 1 0\n", "two.msh: z goes from 0 to 0.5");
    fails("6 1 2 3", "6 1 2 5", "there is no node 5");
    fails("2 1 2 2", "2 1 3 2", "elements of type 3 and dimension 2; allowed here are triangles of type 2");
    fails("5 4 1\n", "5 1 3\n", "is in no physical group");
    fails("1 2 \"open\"", "1 2 open", "\"1 2 open\" where dimension, number and \"name\"");
    fails("$EndNodes", "$EndNodse", "where $EndNodes should be");
    fails("$EndElements\n", "", "two.msh:48: the file ends where");
    fails("1 1 2 1 -2", "2 1 2 2 1 -2", "is in the physical groups walls, open");
    assert!(Mesh::<2>::parse_msh("", "x").unwrap_err().to_string().contains("no section $MeshFormat"));
    assert!(Mesh::<3>::parse_msh(TWO, "x").unwrap_err().to_string().contains("there are no tetrahedra"));
    // Without names a group is called by its number.
    let nameless = TWO.replace("3\n1 1 \"walls\"\n1 2 \"open\"\n", "1\n");
    assert!(Mesh::<2>::parse_msh(&nameless, "x").unwrap().boundary("2").is_ok());
}

proptest! {
    /// Whatever the damage, an error and no panic.
    #[test]
    fn damaged_files(at in 0..TWO.len(), with in "[0-9a-z$ \\n.-]{0,3}", cut in 0..4usize) {
        let end = (at + cut).min(TWO.len());
        let _ = Mesh::<2>::parse_msh(&format!("{}{with}{}", &TWO[..at], &TWO[end..]), "damaged.msh");
    }

    #[test]
    fn damaged_binary_files(which in 0..2usize, at in 0..600usize, with: [u8; 8], cut in 0..9usize) {
        let mut bytes = BINARY[which].to_vec();
        let at = at % (bytes.len() - 8);
        bytes[at..at + cut.min(8)].copy_from_slice(&with[..cut.min(8)]);
        let _ = read_bytes(&bytes);
    }
}

#[test]
fn a_mesh_whose_node_was_moved_over_its_neighbours_was_taken() {
    let text = sample().to_msh().unwrap();
    let mesh = Mesh::<2>::parse_msh(&text, "good.msh").unwrap();
    let inner = (0..mesh.points.len())
        .find(|&node| !mesh.boundaries.iter().any(|part| part.facets.contains(&(node as u32))));
    let place = mesh.points[inner.unwrap()];
    let line = format!("{} {} 0", place.x, place.y);
    assert_eq!(text.matches(&line).count(), 1, "{line}");
    let error =
        Mesh::<2>::parse_msh(&text.replace(&line, "1.3 1.2 0"), "folded.msh").unwrap_err().to_string();
    assert!(error.starts_with("folded.msh: the mesh is folded"), "{error}");
}

#[test]
fn a_mesh_that_reached_out_of_all_bounds_ended_in_a_panic() {
    let mut mesh = sample();
    let corner = mesh.points.iter().position(|point| point.x == 0.0 && point.y == 1.0).unwrap();
    mesh.points[corner].x = -1e300;
    let error = mesh.check().unwrap_err().to_string();
    assert!(error.contains("lies at [-1e300, 1.0]"), "{error}");
}
