//! STL: triangles one after the other, as records of 50 bytes or as text. Their normals are not read: the corners' order says
//! it all, and writers often leave them 0.

use glam::DVec3;

use super::problem::Subject;
use super::text::Words;
use crate::clip::{MeshError, TriangleMesh};

/// 80 bytes of anything, and how many triangles follow.
const HEADER_BYTES: usize = 84;
/// Normal and three corners as f32, little-endian, and two bytes of anything.
const RECORD_BYTES: usize = 50;

/// The count in the header of a binary STL.
fn count(bytes: &[u8]) -> Option<usize> {
    let word = bytes.get(HEADER_BYTES - 4..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*word) as usize)
}

/// Is it as long as its count says? Text is not: its bytes 80 to 83 would say thousands of millions.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    count(bytes).is_some_and(|n| n > 0 && bytes.len() == HEADER_BYTES + RECORD_BYTES * n)
}

/// Does it begin as text does? Binary files may begin so, too, but have bytes of 0 soon.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(512)];
    head.trim_ascii_start()
        .get(..5)
        .is_some_and(|w| w.eq_ignore_ascii_case(b"solid"))
        && !head.contains(&0)
}

/// The mesh of triangles in a row.
fn mesh(corners: Vec<DVec3>) -> Result<TriangleMesh, MeshError> {
    let triangles = corners.len() / 3;
    let Ok(last) = u32::try_from(corners.len()) else {
        return Err(MeshError::TooLarge {
            triangles,
            most: u32::MAX as usize / 3,
        });
    };
    let triangles = (0..last / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    TriangleMesh::new(corners, triangles.collect(), None)
}

/// A binary STL; bytes behind the last triangle are passed over.
pub(super) fn binary(subject: Subject<'_>, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let there = format!("{} bytes", bytes.len());
    let Some(count) = count(bytes) else {
        let expected = format!("a binary STL of at least {HEADER_BYTES} bytes");
        return Err(subject.malformed("the file", expected, there));
    };
    let records = &bytes[HEADER_BYTES..];
    if records.len() / RECORD_BYTES < count {
        let needed = HEADER_BYTES + RECORD_BYTES * count;
        let expected = format!("{needed} bytes for {count} triangles");
        return Err(subject.malformed("byte 80", expected, there));
    }
    let mut corners = Vec::with_capacity(3 * count);
    let (records, _) = records.as_chunks::<RECORD_BYTES>();
    for (index, record) in records[..count].iter().enumerate() {
        let (numbers, _) = record.as_chunks::<4>();
        for corner in 1..4 {
            let at = 3 * corner;
            let [x, y, z] = [0, 1, 2].map(|k| f64::from(f32::from_le_bytes(numbers[at + k])));
            let place = DVec3::new(x, y, z);
            if !place.is_finite() {
                let byte = HEADER_BYTES + RECORD_BYTES * index + 4 * at;
                let found = place.to_string();
                return Err(subject.malformed(format!("byte {byte}"), "finite coordinates", found));
            }
            corners.push(place);
        }
    }
    mesh(corners)
}

/// A text STL of one or more solids.
pub(super) fn text(subject: Subject<'_>, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let mut words = Words::new(subject, bytes, 0, 1);
    let mut corners = Vec::new();
    while let Some(word) = words.next() {
        if word.eq_ignore_ascii_case(b"solid") || word.eq_ignore_ascii_case(b"endsolid") {
            // Names may have any words.
            words.next_line();
        } else if word.eq_ignore_ascii_case(b"facet") {
            words.expect("normal")?;
            for _ in 0..3 {
                let word = words.next();
                words.number(word)?;
            }
            words.expect("outer")?;
            words.expect("loop")?;
            for _ in 0..3 {
                words.expect("vertex")?;
                let mut place = [0.0; 3];
                for number in &mut place {
                    let word = words.next();
                    *number = words.coordinate(word)?;
                }
                corners.push(DVec3::from_array(place));
            }
            words.expect("endloop")?;
            words.expect("endfacet")?;
        } else {
            return Err(words.malformed("\"facet\" or \"endsolid\"", Some(word)));
        }
    }
    mesh(corners)
}
