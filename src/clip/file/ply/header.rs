//! The header of a PLY: which elements there are, and what each is made of.

use super::values::{Encoding, Values};
use crate::clip::MeshError;
use crate::clip::file::problem::Subject;
use crate::clip::file::text::Words;

/// What a number is stored as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    /// By its names, the old and the new.
    fn named(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// In binary files.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// What each of an element has.
#[derive(Debug)]
pub(super) enum Property {
    /// One number.
    Scalar { name: String, kind: Kind },
    /// A count, and as many numbers.
    List {
        name: String,
        count: Kind,
        item: Kind,
    },
}

impl Property {
    /// Is it one number of this name?
    pub(super) fn is_scalar(&self, wanted: &str) -> bool {
        matches!(self, Self::Scalar { name, .. } if name == wanted)
    }

    /// Is it the list of the corners of polygons? Writers have two names for it.
    pub(super) fn is_corners(&self) -> bool {
        matches!(self, Self::List { name, .. } if name == "vertex_indices" || name == "vertex_index")
    }
}

/// A table of a PLY.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

/// The header of a PLY.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) elements: Vec<Element>,
}

impl Header {
    /// The header, and the values behind it.
    pub(super) fn read<'a>(
        subject: Subject<'a>,
        bytes: &'a [u8],
    ) -> Result<(Self, Values<'a>), MeshError> {
        let mut words = Words::new(subject, bytes, 0, 1);
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let text =
            |word: Option<&[u8]>| String::from_utf8_lossy(word.unwrap_or_default()).into_owned();
        while words.next_line() {
            match words.next_in_line() {
                Some(b"format") => {
                    let word = words.next_in_line();
                    encoding = Some(match word {
                        Some(b"ascii") => Encoding::Text,
                        Some(b"binary_little_endian") => Encoding::Little,
                        Some(b"binary_big_endian") => Encoding::Big,
                        _ => {
                            let expected = "ascii, binary_little_endian or binary_big_endian";
                            return Err(words.malformed(expected, word));
                        }
                    });
                }
                Some(b"element") => {
                    let name = text(words.next_in_line());
                    let word = words.next_in_line();
                    let count = word.and_then(|w| str::from_utf8(w).ok()?.parse().ok());
                    let count = count.ok_or_else(|| words.malformed("a count", word))?;
                    if elements.iter().any(|e| e.name == name) {
                        return Err(words.malformed("each element once", Some(name.as_bytes())));
                    }
                    elements.push(Element {
                        name,
                        count,
                        properties: Vec::new(),
                    });
                }
                Some(b"property") => {
                    let kind = |word: Option<&[u8]>, words: &Words<'_>| {
                        word.and_then(Kind::named)
                            .ok_or_else(|| words.malformed("a type such as float or uchar", word))
                    };
                    let word = words.next_in_line();
                    let property = if word == Some(b"list") {
                        let word = words.next_in_line();
                        let count = kind(word, &words)?;
                        if matches!(count, Kind::F32 | Kind::F64) {
                            return Err(words.malformed("an integer type", word));
                        }
                        let word = words.next_in_line();
                        let item = kind(word, &words)?;
                        let name = text(words.next_in_line());
                        Property::List { name, count, item }
                    } else {
                        let kind = kind(word, &words)?;
                        let name = text(words.next_in_line());
                        Property::Scalar { name, kind }
                    };
                    let Some(element) = elements.last_mut() else {
                        return Err(words.malformed("an element before its properties", word));
                    };
                    element.properties.push(property);
                }
                Some(b"end_header") => {
                    let Some(encoding) = encoding else {
                        let expected = "a line with the format before";
                        return Err(words.malformed(expected, Some(b"end_header")));
                    };
                    words.next_line();
                    return Ok((
                        Self { elements },
                        Values::new(subject, encoding, bytes, words),
                    ));
                }
                None | Some(b"comment" | b"obj_info") => {}
                word => return Err(words.malformed("a line of a header", word)),
            }
        }
        Err(words.malformed("end_header", None))
    }

    /// Can the bytes that are there hold what the header counts, and is there a mesh in it? How many vertices it has.
    pub(super) fn check(&self, values: &Values<'_>) -> Result<usize, MeshError> {
        let mut left = values.left_bytes();
        for element in &self.elements {
            let each: usize = element
                .properties
                .iter()
                .map(|p| values.least_bytes(p))
                .sum();
            let needed = each.checked_mul(element.count);
            left = needed
                .and_then(|needed| left.checked_sub(needed))
                .ok_or_else(|| {
                    let (count, name) = (element.count, &element.name);
                    let expected = format!("{count} of element {name:?}, of {each} bytes at least");
                    values.malformed(expected, format!("{left} bytes"))
                })?;
        }
        let named = |name: &str| self.elements.iter().find(|e| e.name == name);
        if !named("face").is_some_and(|e| e.properties.iter().any(Property::is_corners)) {
            let expected = "an element \"face\" with a list \"vertex_indices\"";
            return Err(values.malformed(expected, "none"));
        }
        named("vertex")
            .map(|e| e.count)
            .ok_or_else(|| values.malformed("an element \"vertex\"", "none"))
    }
}
