//! The values of one picture: found in its file, decompressed, and brought to little-endian voxels. Only the picture's own
//! bytes are read, however many frames the file has.

use std::borrow::Cow;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use dicom_encoding::adapters::{PixelDataObject, RawPixelData};
use dicom_encoding::transfer_syntax::{Codec, TransferSyntaxIndex};
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;

use super::super::problem::Subject;
use super::super::voxel_file::{read_exact_at, swap_bytes};
use super::dataset::{DEFLATED, EXPLICIT_BIG, PixelPlace, inflated, unknown_syntax};
use super::image::{Image, PixelForm};
use super::jpegls;
use crate::volume::SourceError;

/// Items that a file's pixels have at most.
const MOST_FRAGMENTS: usize = 1 << 22;
/// Compressed bytes of a picture, in terms of what it decompresses to: no picture of use is larger.
const MOST_COMPRESSED: u64 = 4;
const COMPRESSED_HEADERS: u64 = 1 << 20;

/// Where a picture's bytes lie in its file.
#[derive(Clone, Debug)]
pub(super) enum FramePlace {
    /// Plain values.
    Plain(u64),
    /// Plain values in a data set that is deflated as a whole, which begins at this byte.
    Deflated { at: u64 },
    /// Compressed bytes, in pieces: first byte and length.
    Pieces(Vec<(u64, u32)>),
}

/// Where the pictures of a file lie.
///
/// # Errors
/// The items of its pixels are damaged, or can't be told apart.
pub(super) fn places(image: &Image) -> Result<Vec<FramePlace>, SourceError> {
    let subject = Subject::new(&image.path);
    let frames = u64::from(image.frames);
    match image.place {
        PixelPlace::Native { at, .. } => {
            let bytes = image.form.picture_bytes();
            let of = |frame: u64| at + frame * bytes;
            Ok((0..frames)
                .map(|frame| match image.syntax == DEFLATED {
                    true => FramePlace::Deflated { at: of(frame) },
                    false => FramePlace::Plain(of(frame)),
                })
                .collect())
        }
        PixelPlace::Encapsulated { at } => encapsulated(&subject, at, frames),
    }
}

fn encapsulated(
    subject: &Subject<'_>,
    at: u64,
    frames: u64,
) -> Result<Vec<FramePlace>, SourceError> {
    let (file, length) = subject.open()?;
    let items = items(subject, &file, at, length)?;
    let Some((&table, fragments)) = items.split_first() else {
        return Err(subject.malformed("the pixels", "an offset table", "no item"));
    };
    if frames == 1 {
        return Ok(vec![FramePlace::Pieces(fragments.to_vec())]);
    }
    if fragments.len() as u64 == frames {
        return Ok(fragments
            .iter()
            .map(|&f| FramePlace::Pieces(vec![f]))
            .collect());
    }
    // Offsets count from the first byte of the first fragment's item.
    let wanted = frames * 4;
    if u64::from(table.1) != wanted {
        return Err(subject.malformed(
            "the pixels' offset table",
            format!(
                "{frames} offsets, for {frames} pictures in {} pieces",
                fragments.len()
            ),
            format!("{} bytes", table.1),
        ));
    }
    let mut bytes = vec![0; wanted as usize];
    read_exact_at(&file, &mut bytes, table.0)
        .map_err(|e| subject.io("read the offset table", e))?;
    let first = fragments.first().map_or(0, |f| f.0 - 8);
    let offsets: Vec<u64> = bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| first + u64::from(u32::from_le_bytes(*b)))
        .collect();
    let ends = offsets.iter().skip(1).copied().chain([u64::MAX]);
    Ok(offsets
        .iter()
        .zip(ends)
        .map(|(&from, to)| {
            let of_frame = |f: &&(u64, u32)| (from..to).contains(&(f.0 - 8));
            FramePlace::Pieces(fragments.iter().filter(of_frame).copied().collect())
        })
        .collect())
}

/// The items from byte `at` on: where the bytes of each begin, and how many they are.
fn items(
    subject: &Subject<'_>,
    file: &File,
    mut at: u64,
    length: u64,
) -> Result<Vec<(u64, u32)>, SourceError> {
    const ITEM: [u8; 4] = [0xfe, 0xff, 0x00, 0xe0];
    const END: [u8; 4] = [0xfe, 0xff, 0xdd, 0xe0];
    let mut items = Vec::new();
    loop {
        let mut header = [0; 8];
        // Files that end without the last delimiter are common.
        if at + 8 > length {
            return Ok(items);
        }
        read_exact_at(file, &mut header, at)
            .map_err(|e| subject.io(format!("read at byte {at}"), e))?;
        let (tag, len) = header.split_at(4);
        let len = u32::from_le_bytes(len.try_into().expect("invariant: four bytes"));
        if tag == END {
            return Ok(items);
        }
        let is_whole = at + 8 + u64::from(len) <= length;
        if tag != ITEM || !is_whole || items.len() > MOST_FRAGMENTS {
            return Err(subject.malformed(
                format!("the pixels, byte {at}"),
                "an item that lies in the file",
                format!("tag {tag:02x?}, {len} bytes"),
            ));
        }
        items.push((at + 8, len));
        at += 8 + u64::from(len);
    }
}

/// Reads a picture into `out`: its voxels, little-endian.
///
/// # Errors
/// The file can't be read, the picture is damaged, or compressed in a way that is not built.
pub(super) fn read(image: &Image, place: &FramePlace, out: &mut [u8]) -> Result<(), SourceError> {
    let subject = Subject::new(&image.path);
    let form = &image.form;
    match place {
        FramePlace::Plain(at) => {
            let (file, _) = subject.open()?;
            read_exact_at(&file, out, *at)
                .map_err(|e| subject.io(format!("read at byte {at}"), e))?;
        }
        FramePlace::Deflated { at } => {
            let (_, length) = subject.open()?;
            let begin = super::dataset::begin_of_data_set(&subject)?;
            let bytes = inflated(&subject, begin, length)?;
            let at = *at as usize;
            let part = bytes.get(at..at.saturating_add(out.len())).ok_or_else(|| {
                subject.malformed("the pixels", "all of them", "a shorter data set")
            })?;
            out.copy_from_slice(part);
        }
        FramePlace::Pieces(pieces) => {
            let compressed = gathered(&subject, form, pieces)?;
            decompress(&subject, image, &compressed, out)?;
        }
    }
    if image.syntax == EXPLICIT_BIG {
        swap_bytes(out, form.voxel_type.size());
    }
    cut_to_stored_bits(form, out);
    Ok(())
}

/// The compressed bytes of a picture.
fn gathered(
    subject: &Subject<'_>,
    form: &PixelForm,
    pieces: &[(u64, u32)],
) -> Result<Vec<u8>, SourceError> {
    let bytes: u64 = pieces.iter().map(|p| u64::from(p.1)).sum();
    let most = most_compressed(form);
    if bytes > most {
        return Err(subject.malformed(
            "the compressed picture",
            format!(
                "at most {most} bytes for {} × {} pixels",
                form.columns, form.rows
            ),
            format!("{bytes} bytes"),
        ));
    }
    let (mut file, _) = subject.open()?;
    let mut all = Vec::with_capacity(bytes as usize);
    for &(at, len) in pieces {
        file.seek(SeekFrom::Start(at))
            .and_then(|_| file.by_ref().take(u64::from(len)).read_to_end(&mut all))
            .map_err(|e| subject.io(format!("read at byte {at}"), e))?;
    }
    Ok(all)
}

/// Most compressed bytes of a picture.
pub(super) fn most_compressed(form: &PixelForm) -> u64 {
    MOST_COMPRESSED * form.picture_bytes() + COMPRESSED_HEADERS
}

fn decompress(
    subject: &Subject<'_>,
    image: &Image,
    bytes: &[u8],
    out: &mut [u8],
) -> Result<(), SourceError> {
    let failed = |reason: String| {
        let expected = format!("a sound picture in transfer syntax {}", image.syntax);
        subject.malformed("the compressed picture", expected, reason)
    };
    match image.syntax.as_str() {
        "1.2.840.10008.1.2.4.90" | "1.2.840.10008.1.2.4.91" => {
            jpeg2000(&image.form, bytes, out).map_err(failed)
        }
        "1.2.840.10008.1.2.4.80" | "1.2.840.10008.1.2.4.81" => {
            jpeg_ls(&image.form, bytes, out).map_err(failed)
        }
        "1.2.840.10008.1.2.4.50"
        | "1.2.840.10008.1.2.4.51"
        | "1.2.840.10008.1.2.4.57"
        | "1.2.840.10008.1.2.4.70" => jpeg(&image.form, bytes, out).map_err(failed),
        "1.2.840.10008.1.2.5" => rle(image, bytes, out).map_err(failed),
        other => Err(unknown_syntax(subject, other)),
    }
}

/// JPEG baseline, extended of 8 bits, and lossless.
fn jpeg(form: &PixelForm, bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut decoder = jpeg_decoder::Decoder::new(bytes);
    decoder.read_info().map_err(|e| e.to_string())?;
    let info = decoder.info().ok_or("no header")?;
    check_size(form, [info.width.into(), info.height.into()])?;
    let pixel_bytes = info.pixel_format.pixel_bytes();
    if ![1, 2].contains(&pixel_bytes) {
        return Err("colour".into());
    }
    decoder.set_max_decoding_buffer_size(out.len().max(1 << 16) * 2);
    let pixels = decoder.decode().map_err(|e| e.to_string())?;
    // Two bytes come in the order of the machine.
    let values: Vec<u16> = match pixel_bytes {
        1 => pixels.iter().map(|&v| v.into()).collect(),
        _ => pixels
            .as_chunks::<2>()
            .0
            .iter()
            .map(|b| u16::from_ne_bytes(*b))
            .collect(),
    };
    store(form, values.into_iter().map(u32::from), out)
}

fn jpeg_ls(form: &PixelForm, bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
    let samples = jpegls::decode(bytes, [form.columns, form.rows])?;
    store(form, samples.into_iter().map(u32::from), out)
}

fn jpeg2000(form: &PixelForm, bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
    use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image as Jpeg2000};
    let settings = DecodeSettings {
        resolve_palette_indices: false,
        strict: false,
        target_resolution: None,
    };
    let picture = Jpeg2000::new(bytes, &settings).map_err(|e| e.to_string())?;
    check_size(form, [picture.width(), picture.height()])?;
    let bits = u32::from(picture.original_bit_depth());
    let mut context = DecoderContext::default();
    let decoded = picture.decode(&mut context).map_err(|e| e.to_string())?;
    let [component] = decoded.components() else {
        return Err("colour".into());
    };
    // The decoder lifts signed values by half their range, too.
    let lift = match is_signed_codestream(bytes) {
        true => 1_i64 << (bits.clamp(1, 32) - 1),
        false => 0,
    };
    let values = component.samples().iter();
    store(form, values.map(|v| (v.round() as i64 - lift) as u32), out)
}

/// Does a codestream say that its first component is signed (SIZ, ISO 15444-1 A.5.1)?
fn is_signed_codestream(bytes: &[u8]) -> bool {
    const SIZ: [u8; 4] = [0xff, 0x4f, 0xff, 0x51];
    let begin = bytes.windows(4).take(4096).position(|w| w == SIZ);
    begin
        .and_then(|at| bytes.get(at + 42))
        .is_some_and(|ssiz| ssiz & 0x80 != 0)
}

fn check_size(form: &PixelForm, [width, height]: [u32; 2]) -> Result<(), String> {
    match [width, height] == [form.columns, form.rows] {
        true => Ok(()),
        false => Err(format!(
            "{width} × {height} pixels, where the header says {} × {}",
            form.columns, form.rows
        )),
    }
}

/// Puts whole values into `out`, in the width of the voxels.
fn store(
    form: &PixelForm,
    values: impl ExactSizeIterator<Item = u32>,
    out: &mut [u8],
) -> Result<(), String> {
    let size = form.voxel_type.size();
    if values.len() * size != out.len() {
        return Err(format!("{} pixels", values.len()));
    }
    for (value, out) in values.zip(out.chunks_exact_mut(size)) {
        out.copy_from_slice(&value.to_le_bytes()[..size]);
    }
    Ok(())
}

fn rle(image: &Image, bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
    let codec = TransferSyntaxRegistry
        .get(&image.syntax)
        .map(|ts| ts.codec());
    let Some(Codec::EncapsulatedPixelData(Some(reader), _)) = codec else {
        return Err("no decoder".into());
    };
    let mut pixels = Vec::new();
    let picture = OnePicture { image, bytes };
    reader
        .decode_frame(&picture, 0, &mut pixels)
        .map_err(|e| e.to_string())?;
    if pixels.len() != out.len() {
        return Err(format!("{} bytes", pixels.len()));
    }
    out.copy_from_slice(&pixels);
    Ok(())
}

/// One compressed picture, as decoders want to see it.
struct OnePicture<'a> {
    image: &'a Image,
    bytes: &'a [u8],
}

impl PixelDataObject for OnePicture<'_> {
    fn transfer_syntax_uid(&self) -> &str {
        &self.image.syntax
    }

    fn rows(&self) -> Option<u16> {
        u16::try_from(self.image.form.rows).ok()
    }

    fn cols(&self) -> Option<u16> {
        u16::try_from(self.image.form.columns).ok()
    }

    fn samples_per_pixel(&self) -> Option<u16> {
        Some(1)
    }

    fn bits_allocated(&self) -> Option<u16> {
        u16::try_from(self.image.form.bits_allocated).ok()
    }

    fn bits_stored(&self) -> Option<u16> {
        u16::try_from(self.image.form.bits_stored).ok()
    }

    fn photometric_interpretation(&self) -> Option<&str> {
        Some("MONOCHROME2")
    }

    fn number_of_frames(&self) -> Option<u32> {
        Some(1)
    }

    fn number_of_fragments(&self) -> Option<u32> {
        Some(1)
    }

    fn fragment(&self, fragment: usize) -> Option<Cow<'_, [u8]>> {
        (fragment == 0).then_some(Cow::Borrowed(self.bytes))
    }

    fn offset_table(&self) -> Option<Cow<'_, [u32]>> {
        Some(Cow::Borrowed(&[0]))
    }

    fn raw_pixel_data(&self) -> Option<RawPixelData> {
        Some(RawPixelData {
            fragments: [self.bytes.to_vec()].into_iter().collect(),
            offset_table: [0].into_iter().collect(),
        })
    }
}

/// Values of fewer bits than there is room for: what lies above them (overlays of old) goes, the sign is carried on.
fn cut_to_stored_bits(form: &PixelForm, out: &mut [u8]) {
    let (stored, high) = (form.bits_stored, form.high_bit);
    if form.voxel_type.is_real() || (stored == form.bits_allocated && high + 1 == stored) {
        return;
    }
    let size = form.voxel_type.size();
    let is_signed = form.voxel_type.is_signed_integer();
    let (up, down) = (31 - high, 32 - stored);
    for voxel in out.chunks_exact_mut(size) {
        let mut bytes = [0; 4];
        bytes[..size].copy_from_slice(voxel);
        let lifted = u32::from_le_bytes(bytes) << up;
        let value = match is_signed {
            true => (lifted.cast_signed() >> down).cast_unsigned(),
            false => lifted >> down,
        };
        voxel.copy_from_slice(&value.to_le_bytes()[..size]);
    }
}
