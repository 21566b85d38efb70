//! The elements of a DICOM file that readers here want, and where its pixels lie. Values are read one by one and only where
//! they are short: nothing is allocated by a length that the file says before it is known that the file is that long.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};

use dicom_core::dictionary::DataDictionaryEntry;
use dicom_core::header::{Header, Length};
use dicom_core::{PrimitiveValue, Tag, VR};
use dicom_encoding::transfer_syntax::TransferSyntaxIndex;
use dicom_parser::StatefulDecode;
use dicom_parser::dataset::LazyDataToken;
use dicom_parser::dataset::lazy_read::LazyDataSetReader;
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;

use super::super::problem::Subject;
use super::super::stream::most_inflated_bytes;
use crate::volume::SourceError;

/// Where a file says that it is DICOM.
pub(super) const MAGIC_AT: usize = 128;
pub(super) const MAGIC: &[u8] = b"DICM";

/// Longer values are left out: of what is wanted none is.
const MOST_VALUE_BYTES: u32 = 64 << 10;
/// Longer texts are no tags to keep.
const MOST_TAG_BYTES: usize = 1024;
/// Elements that are looked at, in all: a frame has some dozens.
const MOST_ELEMENTS: u64 = 4 << 20;
/// Bytes of values that are kept.
const MOST_KEPT_BYTES: u64 = 256 << 20;
/// Sequences in sequences.
const MOST_DEPTH: usize = 32;
/// Bytes that a deflated data set is inflated to at most.
const MOST_INFLATED_BYTES: u64 = 1 << 30;

const EXPLICIT_LITTLE: &str = "1.2.840.10008.1.2.1";
pub(super) const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
pub(super) const EXPLICIT_BIG: &str = "1.2.840.10008.1.2.2";

pub(super) const PIXEL_DATA: Tag = Tag(0x7fe0, 0x0010);
pub(super) const FLOAT_PIXEL_DATA: Tag = Tag(0x7fe0, 0x0008);
pub(super) const DOUBLE_PIXEL_DATA: Tag = Tag(0x7fe0, 0x0009);

/// An item of a sequence, or the whole data set.
#[derive(Clone, Debug, Default)]
pub(super) struct Item {
    values: BTreeMap<Tag, PrimitiveValue>,
    sequences: BTreeMap<Tag, Vec<Item>>,
}

/// Where the pixels lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PixelPlace {
    /// Plain values: first byte and length.
    Native { at: u64, bytes: u64 },
    /// Items of compressed bytes: where the first one, the offset table, begins.
    Encapsulated { at: u64 },
}

/// A file's elements up to its pixels.
#[derive(Clone, Debug)]
pub(super) struct DataSet {
    pub(super) item: Item,
    /// UID of the transfer syntax.
    pub(super) syntax: String,
    /// Where the pixels lie, and which element they are; of a deflated data set in what it inflates to.
    pub(super) pixels: Option<(Tag, PixelPlace)>,
}

impl Item {
    /// The element's value, if it is there and not empty.
    fn value(&self, tag: Tag) -> Option<&PrimitiveValue> {
        self.values
            .get(&tag)
            .filter(|v| !matches!(v, PrimitiveValue::Empty))
    }

    /// Its first text, without padding; `None` where there is none.
    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        let text = self
            .value(tag)?
            .to_multi_str()
            .first()?
            .trim_matches(['\0', ' '])
            .to_owned();
        (!text.is_empty()).then_some(text)
    }

    /// All its texts.
    pub(super) fn texts(&self, tag: Tag) -> Vec<String> {
        self.value(tag).map_or_else(Vec::new, |v| {
            let texts = v.to_multi_str();
            texts
                .iter()
                .map(|t| t.trim_matches(['\0', ' ']).to_owned())
                .collect()
        })
    }

    /// Its first number; `None` where it is none.
    pub(super) fn number(&self, tag: Tag) -> Option<f64> {
        self.value(tag)?.to_float64().ok()
    }

    /// Exactly `N` numbers; `None` where these are not there.
    pub(super) fn numbers<const N: usize>(&self, tag: Tag) -> Option<[f64; N]> {
        self.value(tag)?.to_multi_float64().ok()?.try_into().ok()
    }

    /// Its first number as a whole one.
    pub(super) fn whole(&self, tag: Tag) -> Option<u64> {
        self.value(tag)?.to_int::<u64>().ok()
    }

    /// The items of a sequence.
    pub(super) fn items(&self, tag: Tag) -> &[Item] {
        self.sequences.get(&tag).map_or(&[], Vec::as_slice)
    }

    /// The only or first item of a sequence.
    pub(super) fn first(&self, tag: Tag) -> Option<&Item> {
        self.items(tag).first()
    }

    /// Short texts that are there, with the names of their elements: for who wants to keep them.
    pub(super) fn named_texts(&self) -> Vec<(String, String)> {
        use dicom_core::dictionary::DataDictionary;
        let names = dicom_dictionary_std::StandardDataDictionary;
        let named = self.values.keys().filter_map(|&tag| {
            let name = names.by_tag(tag)?.alias().to_owned();
            let text = self.texts(tag).join("\\");
            (1..=MOST_TAG_BYTES)
                .contains(&text.len())
                .then_some((name, text))
        });
        named.collect()
    }
}

impl DataSet {
    /// Reads a file's elements up to its pixels.
    ///
    /// # Errors
    /// It can't be read, is no DICOM file, or is damaged before the pixels.
    pub(super) fn read(subject: &Subject<'_>) -> Result<Self, SourceError> {
        let (file, length) = subject.open()?;
        let mut reader = BufReader::new(file);
        let mut magic = [0; MAGIC_AT + 4];
        let is_dicom = reader.read_exact(&mut magic).is_ok() && &magic[MAGIC_AT..] == MAGIC;
        if !is_dicom {
            return Err(subject.malformed("the first bytes", "DICM at byte 128", "something else"));
        }
        let (meta, begin) = file_meta(subject, reader, length)?;
        let syntax = meta.text(Tag(0x0002, 0x0010)).ok_or_else(|| {
            subject.malformed("element (0002,0010)", "the transfer syntax", "nothing")
        })?;
        if syntax == DEFLATED {
            let inflated = inflated(subject, begin, length)?;
            let length = inflated.len() as u64;
            return read_from(subject, Cursor::new(inflated), length, EXPLICIT_LITTLE)
                .map(|set| Self { syntax, ..set });
        }
        let (file, _) = subject.open()?;
        let mut reader = BufReader::new(file);
        reader
            .seek(SeekFrom::Start(begin))
            .map_err(|e| subject.io("read", e))?;
        read_from(subject, reader, length, &syntax)
    }
}

/// The byte at which the data set of a DICOM file begins.
pub(super) fn begin_of_data_set(subject: &Subject<'_>) -> Result<u64, SourceError> {
    let (file, length) = subject.open()?;
    let mut reader = BufReader::new(file);
    reader
        .seek(SeekFrom::Start(MAGIC_AT as u64 + 4))
        .map_err(|e| subject.io("read", e))?;
    file_meta(subject, reader, length).map(|(_, begin)| begin)
}

/// The file meta information, and the byte at which the data set begins.
fn file_meta(
    subject: &Subject<'_>,
    reader: BufReader<File>,
    length: u64,
) -> Result<(Item, u64), SourceError> {
    let mut walk = Walk::new(subject, reader, length, EXPLICIT_LITTLE)?;
    walk.only_group = Some(0x0002);
    walk.run()?;
    let end = walk.group_end;
    Ok((walk.finish().0, end))
}

fn read_from<R: Read + Seek>(
    subject: &Subject<'_>,
    reader: R,
    length: u64,
    syntax: &str,
) -> Result<DataSet, SourceError> {
    let mut walk = Walk::new(subject, reader, length, syntax)?;
    walk.run()?;
    let (item, pixels) = walk.finish();
    Ok(DataSet {
        item,
        syntax: syntax.to_owned(),
        pixels,
    })
}

/// What a deflated data set inflates to.
pub(super) fn inflated(
    subject: &Subject<'_>,
    begin: u64,
    length: u64,
) -> Result<Vec<u8>, SourceError> {
    let (mut file, _) = subject.open()?;
    file.seek(SeekFrom::Start(begin))
        .map_err(|e| subject.io("read", e))?;
    let most = most_inflated_bytes(length).min(MOST_INFLATED_BYTES);
    let mut bytes = Vec::new();
    let decoder = flate2::read::DeflateDecoder::new(file);
    decoder
        .take(most + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| subject.malformed("the data set", "a sound deflate stream", e.to_string()))?;
    if bytes.len() as u64 > most {
        return Err(subject.unsupported(
            format!("a deflated data set of more than {most} bytes"),
            "save it uncompressed, or compressed picture by picture",
        ));
    }
    Ok(bytes)
}

/// A walk over the tokens of a data set.
struct Walk<'a, S> {
    subject: &'a Subject<'a>,
    reader: Option<LazyDataSetReader<S>>,
    length: u64,
    /// The items that are open, the data set first, each with the sequence it is of.
    open: Vec<(Option<Tag>, Item)>,
    /// The sequences that are open.
    sequences: Vec<Tag>,
    pixels: Option<(Tag, PixelPlace)>,
    /// Ends at the first element of another group.
    only_group: Option<u16>,
    /// Behind the last element of that group.
    group_end: u64,
    elements: u64,
    kept_bytes: u64,
}

impl<'a, R: Read + Seek> Walk<'a, dicom_parser::stateful::decode::DynStatefulDecoder<R>> {
    fn new(
        subject: &'a Subject<'a>,
        reader: R,
        length: u64,
        syntax: &str,
    ) -> Result<Self, SourceError> {
        let Some(ts) = TransferSyntaxRegistry.get(syntax) else {
            return Err(unknown_syntax(subject, syntax));
        };
        let reader = LazyDataSetReader::new_with_ts(reader, ts)
            .map_err(|e| subject.malformed("the data set", "a readable one", e.to_string()))?;
        Ok(Self {
            subject,
            reader: Some(reader),
            length,
            open: vec![(None, Item::default())],
            sequences: Vec::new(),
            pixels: None,
            only_group: None,
            group_end: 0,
            elements: 0,
            kept_bytes: 0,
        })
    }

    /// Walks up to the pixels, or the end.
    fn run(&mut self) -> Result<(), SourceError> {
        let Some(mut reader) = self.reader.take() else {
            return Ok(());
        };
        let mut header_tag = None;
        while let Some(token) = reader.advance() {
            let token = match token {
                Ok(token) => token,
                // The group before is whole; what follows is in another syntax.
                Err(_) if self.only_group.is_some() && self.group_end > 0 => return Ok(()),
                Err(e) => {
                    return Err(self.subject.malformed(
                        "the data set",
                        "sound elements up to the pixels",
                        describe(&e),
                    ));
                }
            };
            self.elements += 1;
            if self.elements > MOST_ELEMENTS {
                return Err(self.subject.malformed(
                    "the data set",
                    format!("at most {MOST_ELEMENTS} elements before the pixels"),
                    "more",
                ));
            }
            match token {
                LazyDataToken::ElementHeader(header) => {
                    if self.only_group.is_some_and(|g| header.tag.0 != g) {
                        return Ok(());
                    }
                    header_tag = Some(header.tag);
                }
                LazyDataToken::LazyValue { header, decoder } => {
                    let at = decoder.position();
                    let tag = header.tag();
                    let Length(len) = header.len;
                    if self.is_at_top() && is_pixels(tag) {
                        let bytes = u64::from(len);
                        self.pixels = Some((tag, PixelPlace::Native { at, bytes }));
                        return Ok(());
                    }
                    if at + u64::from(len) > self.length {
                        return Err(self.subject.malformed(
                            format!("element {tag}, byte {at}"),
                            format!("{len} bytes of its value"),
                            format!("a file that ends at byte {}", self.length),
                        ));
                    }
                    self.kept_bytes += u64::from(len);
                    let is_kept = len <= MOST_VALUE_BYTES
                        && self.kept_bytes <= MOST_KEPT_BYTES
                        && !matches!(header.vr(), VR::OB | VR::OW | VR::OF | VR::OD | VR::UN);
                    let done = if is_kept {
                        decoder.read_value(&header).map(Some)
                    } else {
                        decoder.skip_bytes(len).map(|()| None)
                    };
                    self.group_end = decoder.position();
                    // A value that can't be understood is left out: most are of no use here.
                    match done {
                        Ok(Some(value)) => {
                            if let Some((_, item)) = self.open.last_mut() {
                                item.values.insert(tag, value);
                            }
                        }
                        Ok(None) => {}
                        Err(e) => {
                            return Err(self.subject.malformed(
                                format!("element {tag}, byte {at}"),
                                format!("a value of {}", header.vr().to_string()),
                                describe(&e),
                            ));
                        }
                    }
                }
                LazyDataToken::SequenceStart { tag, .. } => {
                    self.sequences.push(tag);
                    self.check_depth()?;
                }
                LazyDataToken::ItemStart { .. } => {
                    let of = self.sequences.last().copied();
                    self.open.push((of, Item::default()));
                    self.check_depth()?;
                }
                LazyDataToken::ItemEnd => {
                    if self.open.len() > 1
                        && let Some((Some(tag), item)) = self.open.pop()
                        && let Some((_, around)) = self.open.last_mut()
                    {
                        around.sequences.entry(tag).or_default().push(item);
                    }
                }
                LazyDataToken::SequenceEnd => {
                    self.sequences.pop();
                }
                LazyDataToken::PixelSequenceStart => {
                    let at = reader.into_decoder().position();
                    let tag = header_tag.filter(|&t| is_pixels(t)).unwrap_or(PIXEL_DATA);
                    if self.is_at_top() {
                        self.pixels = Some((tag, PixelPlace::Encapsulated { at }));
                        return Ok(());
                    }
                    // Of an icon: what comes behind is not wanted so much that it is looked for.
                    return Ok(());
                }
                LazyDataToken::LazyItemValue { len, decoder } => {
                    decoder.skip_bytes(len).map_err(|e| {
                        self.subject
                            .malformed("the data set", "an item's bytes", describe(&e))
                    })?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn is_at_top(&self) -> bool {
        self.open.len() == 1 && self.sequences.is_empty()
    }

    fn check_depth(&self) -> Result<(), SourceError> {
        if self.open.len().max(self.sequences.len()) <= MOST_DEPTH {
            return Ok(());
        }
        Err(self.subject.malformed(
            "the data set",
            format!("at most {MOST_DEPTH} sequences in each other"),
            "more",
        ))
    }

    fn finish(mut self) -> (Item, Option<(Tag, PixelPlace)>) {
        // Items that were not closed are left out with what they are in.
        self.open.truncate(1);
        let item = self.open.pop().map_or_else(Item::default, |(_, item)| item);
        (item, self.pixels)
    }
}

fn is_pixels(tag: Tag) -> bool {
    [PIXEL_DATA, FLOAT_PIXEL_DATA, DOUBLE_PIXEL_DATA].contains(&tag)
}

/// The refusal of a transfer syntax that nothing here knows.
pub(super) fn unknown_syntax(subject: &Subject<'_>, syntax: &str) -> SourceError {
    subject.unsupported(
        format!("transfer syntax {syntax}"),
        "supported are uncompressed, deflated, RLE, JPEG (8 bit and lossless), JPEG-LS and JPEG 2000",
    )
}

/// An error with what it comes from.
fn describe(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text.push_str(": ");
        text.push_str(&error.to_string());
        source = error.source();
    }
    text
}
