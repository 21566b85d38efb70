//! The numbers behind the header of a PLY.

use super::header::{Element, Kind, Property};
use crate::clip::MeshError;
use crate::clip::file::problem::Subject;
use crate::clip::file::text::Words;

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    Little,
    Big,
}

/// Reads numbers one after the other.
pub(super) struct Values<'a> {
    subject: Subject<'a>,
    encoding: Encoding,
    bytes: &'a [u8],
    /// Where the next binary number lies.
    at: usize,
    words: Words<'a>,
}

/// The number of these bytes, the least first.
fn decode(kind: Kind, bytes: [u8; 8]) -> f64 {
    let [a, b, c, d, ..] = bytes;
    match kind {
        Kind::I8 => f64::from(a as i8),
        Kind::U8 => f64::from(a),
        Kind::I16 => f64::from(i16::from_le_bytes([a, b])),
        Kind::U16 => f64::from(u16::from_le_bytes([a, b])),
        Kind::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        Kind::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
        Kind::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        Kind::F64 => f64::from_le_bytes(bytes),
    }
}

impl<'a> Values<'a> {
    /// The numbers that `words` stands before.
    pub(super) fn new(
        subject: Subject<'a>,
        encoding: Encoding,
        bytes: &'a [u8],
        words: Words<'a>,
    ) -> Self {
        Self {
            subject,
            encoding,
            bytes,
            at: words.at(),
            words,
        }
    }

    /// An error at the last number of text, or before the next of a binary file.
    pub(super) fn malformed(
        &self,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> MeshError {
        let place = if self.encoding == Encoding::Text {
            format!("line {}", self.words.line())
        } else {
            format!("byte {}", self.at)
        };
        self.subject.malformed(place, expected, found)
    }

    /// How much of the file is still to be read.
    pub(super) fn left_bytes(&self) -> usize {
        if self.encoding == Encoding::Text {
            self.bytes.len() - self.words.at()
        } else {
            self.bytes.len() - self.at
        }
    }

    /// How many bytes a number takes at least.
    fn least_of(&self, kind: Kind) -> usize {
        if self.encoding == Encoding::Text {
            1
        } else {
            kind.bytes()
        }
    }

    /// How many bytes a property takes at least.
    pub(super) fn least_bytes(&self, property: &Property) -> usize {
        match property {
            Property::Scalar { kind, .. } => self.least_of(*kind),
            Property::List { count, .. } => self.least_of(*count),
        }
    }

    /// The next number.
    pub(super) fn next(&mut self, kind: Kind) -> Result<f64, MeshError> {
        if self.encoding == Encoding::Text {
            let word = self.words.next();
            return self.words.number(word);
        }
        let length = kind.bytes();
        let Some(found) = self.bytes.get(self.at..self.at + length) else {
            let left = format!("{} until the end of the file", self.left_bytes());
            return Err(self.malformed(format!("a number of {length} bytes"), left));
        };
        let mut bytes = [0; 8];
        bytes[..length].copy_from_slice(found);
        if self.encoding == Encoding::Big {
            bytes[..length].reverse();
        }
        self.at += length;
        Ok(decode(kind, bytes))
    }

    /// The next list, number by number.
    pub(super) fn list(
        &mut self,
        count: Kind,
        item: Kind,
        mut see: impl FnMut(&Self, f64) -> Result<(), MeshError>,
    ) -> Result<(), MeshError> {
        let count = self.next(count)?;
        let most = self.left_bytes() / self.least_of(item);
        if !(count >= 0.0 && count <= most as f64 && count.fract() == 0.0) {
            let expected = format!("the count of a list, at most {most} numbers are left");
            return Err(self.malformed(expected, count.to_string()));
        }
        for _ in 0..count as usize {
            let number = self.next(item)?;
            see(self, number)?;
        }
        Ok(())
    }

    /// Passes over an element.
    pub(super) fn skip(&mut self, element: &Element) -> Result<(), MeshError> {
        if element.properties.is_empty() {
            // Its count is bounded by nothing.
            return Ok(());
        }
        for _ in 0..element.count {
            for property in &element.properties {
                match property {
                    Property::Scalar { kind, .. } => {
                        self.next(*kind)?;
                    }
                    Property::List { count, item, .. } => {
                        self.list(*count, *item, |_, _| Ok(()))?;
                    }
                }
            }
        }
        Ok(())
    }
}
