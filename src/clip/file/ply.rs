//! PLY: a header that says what follows, then vertices, polygons and whatever else, as text or as binary numbers of either
//! byte order.

mod header;
mod values;

use glam::{DVec3, Vec3};

use super::problem::Subject;
use crate::clip::{MeshError, TriangleMesh};
use header::{Element, Header, Property};
use values::Values;

/// Does the file begin as a PLY?
pub(super) fn is_ply(bytes: &[u8]) -> bool {
    matches!(bytes, [b'p', b'l', b'y', b'\n' | b'\r' | b' ' | b'\t', ..])
}

/// What of the file is kept.
#[derive(Default)]
struct Reader {
    places: Vec<DVec3>,
    normals: Option<Vec<Vec3>>,
    triangles: Vec<[u32; 3]>,
}

impl Reader {
    fn vertices(&mut self, element: &Element, values: &mut Values<'_>) -> Result<(), MeshError> {
        let column = |name: &str| element.properties.iter().position(|p| p.is_scalar(name));
        let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(column) else {
            return Err(values.malformed("vertices with properties x, y and z", "others"));
        };
        let normal = match ["nx", "ny", "nz"].map(column) {
            [Some(x), Some(y), Some(z)] => Some([x, y, z]),
            _ => None,
        };
        let mut row = vec![0.0; element.properties.len()];
        let mut normals = Vec::new();
        for _ in 0..element.count {
            for (property, value) in element.properties.iter().zip(&mut row) {
                *value = match property {
                    Property::Scalar { kind, .. } => values.next(*kind)?,
                    Property::List { count, item, .. } => {
                        values.list(*count, *item, |_, _| Ok(()))?;
                        0.0
                    }
                };
            }
            let place = DVec3::new(row[x], row[y], row[z]);
            if !place.is_finite() {
                return Err(values.malformed("finite coordinates", place.to_string()));
            }
            self.places.push(place);
            normals.extend(normal.map(|n| Vec3::from_array(n.map(|n| row[n] as f32))));
        }
        self.normals = normal.map(|_| normals);
        Ok(())
    }

    /// Polygons, divided into fans; those of fewer than three corners are passed over.
    fn faces(
        &mut self,
        element: &Element,
        vertex_count: usize,
        values: &mut Values<'_>,
    ) -> Result<(), MeshError> {
        let column = element.properties.iter().position(Property::is_corners);
        let mut polygon: Vec<u32> = Vec::new();
        for _ in 0..element.count {
            for (index, property) in element.properties.iter().enumerate() {
                match property {
                    Property::Scalar { kind, .. } => {
                        values.next(*kind)?;
                    }
                    Property::List { count, item, .. } if Some(index) == column => {
                        polygon.clear();
                        values.list(*count, *item, |values, number| {
                            let is_vertex = number >= 0.0
                                && number < vertex_count as f64
                                && number <= f64::from(u32::MAX)
                                && number.fract() == 0.0;
                            if !is_vertex {
                                let expected = format!("an index below {vertex_count}");
                                return Err(values.malformed(expected, number.to_string()));
                            }
                            polygon.push(number as u32);
                            Ok(())
                        })?;
                        if let [first, ref rest @ ..] = polygon[..] {
                            let fan = rest.windows(2).map(|pair| [first, pair[0], pair[1]]);
                            self.triangles.extend(fan);
                        }
                    }
                    Property::List { count, item, .. } => {
                        values.list(*count, *item, |_, _| Ok(()))?;
                    }
                }
            }
        }
        Ok(())
    }
}

/// The mesh of a PLY.
pub(super) fn read(subject: Subject<'_>, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let (header, mut values) = Header::read(subject, bytes)?;
    let vertex_count = header.check(&values)?;
    let mut reader = Reader::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => reader.vertices(element, &mut values)?,
            "face" => reader.faces(element, vertex_count, &mut values)?,
            _ => values.skip(element)?,
        }
    }
    TriangleMesh::new(reader.places, reader.triangles, reader.normals)
}
