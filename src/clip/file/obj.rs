//! OBJ: vertices, normals and polygons as lines of text. Everything else in it (textures, materials, groups, curves) is
//! passed over.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::problem::Subject;
use super::text::Words;
use crate::clip::{MeshError, TriangleMesh};

/// Words that lines may begin with where a file of unknown name is an OBJ.
const KEYWORDS: &[&[u8]] = &[
    b"v", b"vn", b"vt", b"vp", b"f", b"l", b"p", b"o", b"g", b"s", b"mtllib", b"usemtl",
];

/// Does the first line that is no comment begin as one of an OBJ?
pub(super) fn is_obj(bytes: &[u8]) -> bool {
    bytes
        .split(|b| matches!(b, b'\n' | b'\r'))
        .filter_map(|line| line.split(u8::is_ascii_whitespace).find(|w| !w.is_empty()))
        .find(|word| !word.starts_with(b"#"))
        .is_some_and(|word| KEYWORDS.contains(&word))
}

/// A corner of a polygon: its vertex and its normal, from 0.
type Corner = (u32, Option<u32>);

/// The greatest index that was named, and where: what it names may come later.
#[derive(Default)]
struct Greatest {
    index: u32,
    line: usize,
}

impl Greatest {
    /// The index, from 0, that `word` names where `count` are there so far: from 1, or back from the last as −1.
    fn index(&mut self, words: &Words<'_>, word: &[u8], count: usize) -> Result<u32, MeshError> {
        let number: Option<i64> = str::from_utf8(word).ok().and_then(|w| w.parse().ok());
        let index = match number {
            Some(n) if n > 0 => u32::try_from(n - 1).ok(),
            Some(n) if n < 0 => usize::try_from(n.unsigned_abs())
                .ok()
                .and_then(|back| u32::try_from(count.checked_sub(back)?).ok()),
            _ => None,
        };
        let index = index.ok_or_else(|| {
            let expected = format!("an index from 1 up, or from −1 down to −{count}");
            words.malformed(expected, Some(word))
        })?;
        if self.line == 0 || index > self.index {
            *self = Self {
                index,
                line: words.line(),
            };
        }
        Ok(index)
    }

    /// Is what was named among the `count` that are there in the end?
    fn check(&self, subject: Subject<'_>, what: &str, count: usize) -> Result<(), MeshError> {
        if self.line == 0 || (self.index as usize) < count {
            return Ok(());
        }
        Err(subject.malformed(
            format!("line {}", self.line),
            format!("one of the {count} {what} of the file"),
            format!("number {}", u64::from(self.index) + 1),
        ))
    }
}

/// What of the file is kept.
#[derive(Default)]
struct Reader {
    places: Vec<DVec3>,
    normals: Vec<Vec3>,
    greatest_place: Greatest,
    greatest_normal: Greatest,
    /// Each pair of a vertex and a normal once: what becomes a vertex of the mesh.
    corners: Vec<Corner>,
    by_corner: HashMap<Corner, u32>,
    triangles: Vec<[u32; 3]>,
}

impl Reader {
    /// The corner that a word as `7`, `7/1`, `7//3` or `7/1/3` names; textures are passed over.
    fn corner(&mut self, words: &Words<'_>, word: &[u8]) -> Result<u32, MeshError> {
        let mut parts = word.split(|&b| b == b'/');
        let place = parts.next().unwrap_or_default();
        let place = self.greatest_place.index(words, place, self.places.len())?;
        let normal = match parts.nth(1) {
            None | Some([]) => None,
            Some(word) => Some(
                self.greatest_normal
                    .index(words, word, self.normals.len())?,
            ),
        };
        let corner = (place, normal);
        let Ok(next) = u32::try_from(self.corners.len()) else {
            return Err(MeshError::TooLarge {
                triangles: self.triangles.len(),
                most: TriangleMesh::MOST_TRIANGLES,
            });
        };
        let index = *self.by_corner.entry(corner).or_insert(next);
        if index == next {
            self.corners.push(corner);
        }
        Ok(index)
    }

    /// Divides a polygon into a fan of triangles.
    fn polygon(&mut self, words: &mut Words<'_>) -> Result<(), MeshError> {
        let (mut count, mut first, mut last) = (0, 0, 0);
        while let Some(word) = words.next_in_line() {
            if word.starts_with(b"#") {
                break;
            }
            let corner = self.corner(words, word)?;
            match count {
                0 => first = corner,
                1 => {}
                _ => self.triangles.push([first, last, corner]),
            }
            last = corner;
            count += 1;
        }
        if count < 3 {
            return Err(words.malformed_count("at least 3 corners", count));
        }
        Ok(())
    }
}

/// The mesh of an OBJ.
pub(super) fn read(subject: Subject<'_>, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let mut words = Words::new(subject, bytes, 0, 1);
    let mut reader = Reader::default();
    loop {
        match words.next_in_line() {
            Some(b"v") => {
                let mut place = [0.0; 3];
                for number in &mut place {
                    let word = words.next_in_line();
                    *number = words.coordinate(word)?;
                }
                reader.places.push(DVec3::from_array(place));
            }
            Some(b"vn") => {
                let mut normal = [0.0; 3];
                for number in &mut normal {
                    let word = words.next_in_line();
                    *number = words.number(word)? as f32;
                }
                reader.normals.push(Vec3::from_array(normal));
            }
            Some(b"f") => reader.polygon(&mut words)?,
            _ => {}
        }
        if !words.next_line() {
            break;
        }
    }
    let Reader {
        places, normals, ..
    } = &reader;
    reader
        .greatest_place
        .check(subject, "vertices", places.len())?;
    reader
        .greatest_normal
        .check(subject, "normals", normals.len())?;
    let vertices = reader
        .corners
        .iter()
        .map(|c| places[c.0 as usize])
        .collect();
    let of_corner = |c: &Corner| c.1.map_or(Vec3::ZERO, |n| normals[n as usize]);
    let has_normals = reader.corners.iter().any(|c| c.1.is_some());
    let normals = has_normals.then(|| reader.corners.iter().map(of_corner).collect());
    TriangleMesh::new(vertices, reader.triangles, normals)
}
