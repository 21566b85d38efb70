//! The tags of a VTK XML file without the text between them, which may be gigabytes of numbers: what is left goes to an XML
//! parser, and where each text lies is remembered. Nothing is decoded here.

use std::io::{self, BufRead, BufReader, Read};
use std::ops::Range;

use super::super::problem::{Subject, quoted};
use crate::volume::SourceError;

/// The most bytes of tags that a file may have.
const MOST_BYTES: u64 = 4 << 20;

/// How far behind the tag of the appended data its mark `_` may stand.
const MOST_BEFORE_MARK: u64 = 4096;

/// A file's tags, and where its texts are.
pub(super) struct Markup {
    /// Well-formed if the file is: what the appended data hide is closed.
    pub(super) xml: String,
    /// Place in `xml` and bytes in the file of each text, in their order.
    texts: Vec<(usize, Range<u64>)>,
    /// Byte of the file behind the `_` where the appended data start.
    pub(super) appended: Option<u64>,
}

impl Markup {
    /// The texts that lie in a part of `xml`.
    pub(super) fn texts_in(&self, part: Range<usize>) -> impl Iterator<Item = (usize, Range<u64>)> {
        let first = self.texts.partition_point(|(at, _)| *at <= part.start);
        self.texts[first..]
            .iter()
            .take_while(move |(at, _)| *at < part.end)
            .cloned()
    }
}

/// Reads the tags of a file.
///
/// # Errors
/// The file can't be read, is no XML, or has more tags than any image needs.
pub(super) fn read(subject: &Subject<'_>, file: impl Read) -> Result<Markup, SourceError> {
    let mut scanner = Scanner {
        subject,
        reader: BufReader::with_capacity(256 << 10, file),
        at: 0,
    };
    let mut xml = Vec::new();
    let mut texts = Vec::new();
    let mut appended = None;
    loop {
        let text = scanner.skip_text()?;
        let Some(text) = text else { break };
        if !text.is_empty() {
            texts.push((xml.len(), text));
        }
        let left = MOST_BYTES.saturating_sub(xml.len() as u64);
        let tag = scanner.tag(left)?;
        // Comments and instructions say nothing of the image.
        if tag.starts_with(b"<!--") || tag.starts_with(b"<?") {
            continue;
        }
        if tag.starts_with(b"<!") {
            return Err(subject.malformed(
                "the XML",
                "elements, without DOCTYPE or CDATA",
                quoted(&String::from_utf8_lossy(&tag)),
            ));
        }
        xml.extend_from_slice(&tag);
        let name = &tag[1..];
        if name.starts_with(b"AppendedData") {
            if !tag.ends_with(b"/>") {
                appended = scanner.skip_mark()?;
                xml.extend_from_slice(b"</AppendedData>");
            }
            xml.extend_from_slice(b"</VTKFile>");
            break;
        }
    }
    let xml = String::from_utf8(xml).map_err(|e| {
        subject.malformed("the XML", "tags in UTF-8", format!("{}", e.utf8_error()))
    })?;
    Ok(Markup {
        xml,
        texts,
        appended,
    })
}

struct Scanner<'a, R: Read> {
    subject: &'a Subject<'a>,
    reader: BufReader<R>,
    /// Bytes read so far, those of a tag's `<` not counted.
    at: u64,
}

impl<R: Read> Scanner<'_, R> {
    fn failed(&self, error: io::Error) -> SourceError {
        self.subject.io(format!("read at byte {}", self.at), error)
    }

    /// Skips to the next `<`; `None` when there is none.
    fn skip_text(&mut self) -> Result<Option<Range<u64>>, SourceError> {
        let start = self.at;
        loop {
            let bytes = match self.reader.fill_buf() {
                Ok(bytes) => bytes,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                Err(e) => return Err(self.failed(e)),
            };
            if bytes.is_empty() {
                return Ok(None);
            }
            let n = bytes.iter().position(|&b| b == b'<');
            let skipped = n.unwrap_or(bytes.len());
            self.reader.consume(skipped);
            self.at += skipped as u64;
            if n.is_some() {
                return Ok(Some(start..self.at));
            }
        }
    }

    /// The tag, comment or instruction that begins here, with its brackets.
    fn tag(&mut self, most: u64) -> Result<Vec<u8>, SourceError> {
        let start = self.at;
        let mut tag = Vec::new();
        while !is_whole(&tag) {
            let left = most.saturating_sub(tag.len() as u64);
            let n = (&mut self.reader)
                .take(left)
                .read_until(b'>', &mut tag)
                .map_err(|e| self.subject.io(format!("read at byte {start}"), e))?;
            self.at += n as u64;
            if n == 0 && left == 0 {
                let expected = format!("at most {MOST_BYTES} bytes of tags");
                return Err(self.subject.malformed("the XML", expected, "more"));
            }
            if n == 0 {
                return Err(self.subject.malformed(
                    format!("the XML tag at byte {start}"),
                    "its end '>'",
                    "the end of the file",
                ));
            }
        }
        Ok(tag)
    }

    /// Skips the white space and the `_` before the appended data; `None` when the file ends there.
    fn skip_mark(&mut self) -> Result<Option<u64>, SourceError> {
        let mut before = Vec::new();
        let n = (&mut self.reader)
            .take(MOST_BEFORE_MARK)
            .read_until(b'_', &mut before)
            .map_err(|e| self.subject.io(format!("read at byte {}", self.at), e))?;
        self.at += n as u64;
        match before.split_last() {
            None => Ok(None),
            Some((b'_', space)) if space.trim_ascii().is_empty() => Ok(Some(self.at)),
            Some(_) => Err(self.subject.malformed(
                "AppendedData",
                "'_' before the data",
                quoted(&String::from_utf8_lossy(&before)),
            )),
        }
    }
}

/// True when `tag`, which ends in '>' or is empty, is not cut at a '>' inside it.
fn is_whole(tag: &[u8]) -> bool {
    if tag.starts_with(b"<!--") {
        return tag.len() >= 7 && tag.ends_with(b"-->");
    }
    if tag.starts_with(b"<?") {
        return tag.ends_with(b"?>");
    }
    if !tag.ends_with(b">") {
        return false;
    }
    let mut quote = None;
    for &b in tag {
        match quote {
            Some(q) if b == q => quote = None,
            None if matches!(b, b'"' | b'\'') => quote = Some(b),
            _ => {}
        }
    }
    quote.is_none()
}
