//! Every format written and read back; what is cut off or changed is an error or a mesh, never a panic.

use std::fmt::Write as _;
use std::path::Path;

use glam::{DVec3, Vec3};
use proptest::prelude::*;

use super::read::parse;
use crate::clip::{MeshError, TriangleMesh};

fn read(name: &str, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    parse(Path::new(name), bytes)
}

/// A mesh whose coordinates f32 holds, and so every format.
fn ball() -> TriangleMesh {
    let ball = TriangleMesh::sphere(DVec3::new(10.0, -4.0, 2.5), 30.0, 1).unwrap();
    let vertices = ball.vertices().iter().map(|v| v.as_vec3().as_dvec3());
    TriangleMesh::new(vertices.collect(), ball.triangles().to_vec(), None).unwrap()
}

/// The same mesh with a normal at each vertex that no triangle has.
fn with_normals(mesh: &TriangleMesh) -> (Vec<Vec3>, TriangleMesh) {
    let normals: Vec<Vec3> = (0..mesh.vertices().len())
        .map(|i| Vec3::new(1.0, i as f32, -2.0).normalize())
        .collect();
    let (vertices, triangles) = (mesh.vertices().to_vec(), mesh.triangles().to_vec());
    let mesh = TriangleMesh::new(vertices, triangles, Some(normals.clone())).unwrap();
    (normals, mesh)
}

fn binary_stl(mesh: &TriangleMesh, header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((mesh.triangle_count() as u32).to_le_bytes());
    for t in 0..mesh.triangle_count() as u32 {
        bytes.extend([0; 12]);
        for corner in mesh.corners(t) {
            for x in corner.to_array() {
                bytes.extend((x as f32).to_le_bytes());
            }
        }
        bytes.extend([0xff; 2]);
    }
    bytes
}

fn text_stl(mesh: &TriangleMesh, end: &str) -> Vec<u8> {
    let mut text = format!("solid a facet of nothing{end}");
    for t in 0..mesh.triangle_count() as u32 {
        let _ = write!(text, "  facet normal nan 0 0{end}    outer loop{end}");
        for c in mesh.corners(t) {
            let _ = write!(text, "      vertex {} {:e} {}{end}", c.x, c.y, c.z);
        }
        let _ = write!(text, "    endloop{end}  ENDFACET{end}");
    }
    let _ = write!(text, "endsolid a facet{end}");
    text.into_bytes()
}

/// With normals or without; every other triangle counts back from the last vertex.
fn obj(mesh: &TriangleMesh, normals: Option<&[Vec3]>) -> Vec<u8> {
    let mut text = "# \u{e9} comment\nmtllib a.mtl\no thing\n\n".to_owned();
    for v in mesh.vertices() {
        let _ = writeln!(text, "v {} {} {} 1.0", v.x, v.y, v.z);
    }
    for n in normals.unwrap_or_default() {
        let _ = writeln!(text, "vn {} {} {}", n.x, n.y, n.z);
    }
    let count = mesh.vertices().len() as i64;
    for (i, t) in mesh.triangles().iter().enumerate() {
        text.push_str("usemtl red\nf");
        for &v in t {
            let index = if i % 2 == 0 {
                i64::from(v) + 1
            } else {
                i64::from(v) - count
            };
            match (normals, i % 3) {
                (Some(_), 0) => write!(text, " {index}/1/{index}"),
                (Some(_), _) => write!(text, " {index}//{index}"),
                (None, 0) => write!(text, " {index}/3"),
                (None, 1) => write!(text, " \\\r\n {index}"),
                (None, _) => write!(text, " {index}"),
            }
            .unwrap();
        }
        text.push_str(" # end\r\n");
    }
    // Comments need not be UTF-8.
    let mut bytes = b"#\xff\xfe\n".to_vec();
    bytes.extend(text.bytes());
    bytes
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Ply {
    Text,
    Little,
    Big,
}

/// With every kind of property, elements that are passed over before and between, and polygons.
fn ply(mesh: &TriangleMesh, normals: Option<&[Vec3]>, encoding: Ply) -> Vec<u8> {
    let name = match encoding {
        Ply::Text => "ascii",
        Ply::Little => "binary_little_endian",
        Ply::Big => "binary_big_endian",
    };
    let mut header = format!(
        "ply\r\nformat {name} 1.0\r\ncomment by hand\\\r\nobj_info none\r\n\
         element nothing 99999999999\r\n\
         element extra 2\r\nproperty list ushort double weights\r\nproperty short tag\r\n\
         element vertex {}\r\nproperty uchar red\r\nproperty double x\r\nproperty float32 y\r\n\
         property float z\r\nproperty list int8 int16 ids\r\n",
        mesh.vertices().len()
    );
    if normals.is_some() {
        header += "property float nx\r\nproperty float ny\r\nproperty float nz\r\n";
    }
    let faces = mesh.triangle_count() + 1;
    let _ = write!(
        header,
        "element face {faces}\r\nproperty list uint8 float uv\r\n\
         property list uint32 int vertex_indices\r\nproperty char flag\r\nend_header\r\n"
    );
    let mut bytes = header.into_bytes();
    let mut put = |number: f64, stored: &[u8]| match encoding {
        Ply::Text => bytes.extend(format!("{number} ").bytes()),
        Ply::Little => bytes.extend(stored),
        Ply::Big => bytes.extend(stored.iter().rev()),
    };
    for tag in [-7_i16, 300] {
        put(2.0, &2_u16.to_le_bytes());
        put(0.5, &0.5_f64.to_le_bytes());
        put(-1.0, &(-1.0_f64).to_le_bytes());
        put(f64::from(tag), &tag.to_le_bytes());
    }
    for (i, v) in mesh.vertices().iter().enumerate() {
        put(200.0, &[200]);
        put(v.x, &v.x.to_le_bytes());
        put(v.y, &(v.y as f32).to_le_bytes());
        put(v.z, &(v.z as f32).to_le_bytes());
        put(1.0, &[1]);
        put(-2.0, &(-2_i16).to_le_bytes());
        if let Some(n) = normals.map(|n| n[i]) {
            for x in n.to_array() {
                put(f64::from(x), &x.to_le_bytes());
            }
        }
    }
    // A polygon of two corners first: passed over.
    let polygons = [vec![0, 1]].into_iter();
    for polygon in polygons.chain(mesh.triangles().iter().map(|t| t.to_vec())) {
        put(1.0, &[1]);
        put(0.25, &0.25_f32.to_le_bytes());
        put(polygon.len() as f64, &(polygon.len() as u32).to_le_bytes());
        for v in polygon {
            put(f64::from(v), &v.to_le_bytes());
        }
        put(-3.0, &[0xfd]);
    }
    bytes
}

/// Every format of the same mesh, by a name that does not tell which.
fn all_formats() -> Vec<(&'static str, Vec<u8>, TriangleMesh)> {
    let plain = ball();
    let (normals, lit) = with_normals(&plain);
    let mut all = vec![
        (
            "binary STL",
            binary_stl(&plain, b"made by hand"),
            plain.clone(),
        ),
        (
            "binary STL, solid",
            binary_stl(&plain, b"solid facet"),
            plain.clone(),
        ),
        ("text STL", text_stl(&plain, "\n"), plain.clone()),
        ("text STL, CR", text_stl(&plain, "\r"), plain.clone()),
        ("OBJ", obj(&plain, None), plain.clone()),
        ("OBJ with normals", obj(&plain, Some(&normals)), lit.clone()),
    ];
    for encoding in [Ply::Text, Ply::Little, Ply::Big] {
        all.push(("PLY", ply(&plain, None, encoding), plain.clone()));
        all.push((
            "PLY with normals",
            ply(&plain, Some(&normals), encoding),
            lit.clone(),
        ));
    }
    all
}

#[test]
fn what_is_written_is_read_whatever_the_file_is_called() {
    for (format, bytes, expected) in all_formats() {
        let mesh = read("mesh.dat", &bytes).unwrap_or_else(|e| panic!("{format}: {e}"));
        assert!(mesh == expected, "{format}: {mesh:?}, not {expected:?}");
        mesh.check_closed().unwrap();
    }
}

#[test]
fn polygons_become_fans() {
    let text = "v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 2 0\nf 1 2 3 4 5\n";
    let mesh = read("a.obj", text.as_bytes()).unwrap();
    assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty int x\nproperty int y\n\
                property int z\nelement face 1\nproperty list uchar int vertex_index\n\
                end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    let mesh = read("a.ply", text.as_bytes()).unwrap();
    assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
}

/// A normal that only some corners have: the others are made from the triangles.
#[test]
fn corners_of_an_obj_without_normals_get_their_triangles() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 3 0\nf 1//1 2 3\n";
    let mesh = read("a.obj", text.as_bytes()).unwrap();
    assert_eq!(mesh.corner_normals(), [[Vec3::Y, Vec3::Z, Vec3::Z]]);
}

/// Errors say where, what was expected and what is there.
#[test]
fn errors_name_their_place() {
    let ply =
        |header: &str, body: &str| format!("ply\nformat ascii 1.0\n{header}end_header\n{body}");
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let list = "element face 1\nproperty list uchar int vertex_index\n";
    let mut nan = binary_stl(&ball(), b"");
    nan[84 + 50 + 24..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut short = binary_stl(&ball(), b"");
    short.truncate(1000);
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        (
            "a.obj",
            b"v 0 0 0\nv 1 x 0\n".into(),
            &["a.obj", "line 2", "a number", "\"x\""],
        ),
        ("a.obj", b"v 0 0\n".into(), &["line 1", "nothing more"]),
        ("a.obj", b"v 0 inf 0\n".into(), &["line 1", "finite"]),
        (
            "a.obj",
            b"v 0 0 0\nf 1 2 3\nv 1 0 0\n".into(),
            &["line 2", "2 vertices", "number 3"],
        ),
        (
            "a.obj",
            b"v 0 0 0\nf -1 -2 -1\n".into(),
            &["line 2", "\"-2\""],
        ),
        ("a.obj", b"v 0 0 0\nf 0 1 1\n".into(), &["line 2", "\"0\""]),
        (
            "a.obj",
            b"v 0 0 0\nf 1//4 1 1\n".into(),
            &["line 2", "0 normals", "number 4"],
        ),
        (
            "a.obj",
            b"v 0 0 0\nf 1 1\n".into(),
            &["line 2", "3 corners", "found 2"],
        ),
        ("a.obj", b"v 0 0 0\n".into(), &["a.obj", "no triangles"]),
        (
            "a.stl",
            b"solid\nfacet normal 0 0 1\nouter\nvertex".into(),
            &["line 4", "\"loop\"", "\"vertex\""],
        ),
        (
            "a.stl",
            short,
            &["byte 80", "4084 bytes for 80 triangles", "1000 bytes"],
        ),
        ("a.stl", nan, &["byte 158", "finite"]),
        ("a.stl", b"junk".into(), &["84 bytes", "4 bytes"]),
        ("a.dat", b"junk".into(), &["STL, OBJ or PLY", "junk"]),
        ("a.dat", b"".into(), &["STL, OBJ or PLY"]),
        (
            "a.ply",
            b"ply\nformat binary_middle 1.0\n".into(),
            &["line 2", "binary_middle"],
        ),
        ("a.ply", b"ply\nformat ascii 1.0\n".into(), &["end_header"]),
        (
            "a.ply",
            ply(
                &format!("element vertex 4000000000\n{xyz}{list}"),
                "0 0 0\n",
            )
            .into(),
            &["4000000000", "\"vertex\"", "6 bytes"],
        ),
        (
            "a.ply",
            ply(
                &format!("element vertex 1\n{xyz}{list}"),
                "0 0 0\n3 0 0 1\n",
            )
            .into(),
            &["line 11", "below 1", "found 1"],
        ),
        (
            "a.ply",
            ply(
                &format!("element vertex 1\n{xyz}{list}"),
                "0 0 0\n4000000000 0\n",
            )
            .into(),
            &["line 11", "list", "4000000000"],
        ),
        (
            "a.ply",
            ply(&format!("element vertex 1\n{xyz}"), "0 0 0\n").into(),
            &["\"face\""],
        ),
    ];
    for (name, bytes, expected) in cases {
        let message = match read(name, &bytes).map_err(|e| e.of_file(Path::new(name))) {
            Ok(mesh) => panic!("{:?} is read as {mesh:?}", String::from_utf8_lossy(&bytes)),
            Err(e) => e.to_string(),
        };
        for part in expected {
            assert!(message.contains(part), "{part:?} is not in: {message}");
        }
    }
}

#[test]
fn files_cut_off_anywhere_are_errors_or_meshes() {
    let small = TriangleMesh::cuboid(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)).unwrap();
    let (normals, _) = with_normals(&small);
    let files = [
        binary_stl(&small, b""),
        text_stl(&small, "\n"),
        obj(&small, Some(&normals)),
        ply(&small, Some(&normals), Ply::Text),
        ply(&small, None, Ply::Little),
        ply(&small, None, Ply::Big),
    ];
    let mut meshes = 0;
    for bytes in &files {
        for name in ["a.stl", "a.obj", "a.ply"] {
            assert_eq!(read(name, bytes).unwrap(), read("a", bytes).unwrap());
        }
        for length in 0..bytes.len() {
            meshes += usize::from(read("a.stl", &bytes[..length]).is_ok());
        }
    }
    assert!(meshes > 0, "a text cut off behind a triangle is a mesh");
}

#[test]
fn files_are_read_from_disk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.PLY");
    std::fs::write(&path, ply(&ball(), None, Ply::Big)).unwrap();
    assert_eq!(TriangleMesh::read(&path).unwrap(), ball());
    let error = TriangleMesh::read(folder.path()).unwrap_err();
    assert!(error.to_string().contains("expected a file"), "{error}");
    let error = TriangleMesh::read(&folder.path().join("none.stl")).unwrap_err();
    assert!(error.to_string().contains("none.stl"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn changed_bytes_are_an_error_or_a_mesh(
        which in 0..12_usize,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        in_head in any::<bool>(),
    ) {
        thread_local! {
            static FILES: Vec<Vec<u8>> = all_formats().into_iter().map(|f| f.1).collect();
        }
        FILES.with(|files| {
            let mut bytes = files[which].clone();
            for (place, byte) in changes {
                let length = if in_head { 600.min(bytes.len()) } else { bytes.len() };
                bytes[place.index(length)] = byte;
            }
            for name in ["a.stl", "a.obj"] {
                if let Ok(mesh) = read(name, &bytes) {
                    prop_assert!(mesh.vertices().iter().all(|v| v.is_finite()));
                    let most = mesh.vertices().len() as u32;
                    prop_assert!(mesh.triangles().as_flattened().iter().all(|&v| v < most));
                }
            }
            Ok(())
        })?;
    }
}
