//! What a DICOM file says of its pictures: their form, where each lies, what its values mean. One file has one picture or,
//! enhanced or not, many frames (PS3.3 C.7.6.2, C.7.6.3, C.7.6.16).

use std::path::{Path, PathBuf};

use dicom_core::Tag;
use glam::DVec3;

use super::super::problem::Subject;
use super::dataset::{DOUBLE_PIXEL_DATA, DataSet, FLOAT_PIXEL_DATA, Item, PixelPlace};
use crate::volume::{Rescale, SourceError, VoxelType};

const SOP_CLASS: Tag = Tag(0x0008, 0x0016);
const MODALITY: Tag = Tag(0x0008, 0x0060);
const SERIES_DESCRIPTION: Tag = Tag(0x0008, 0x103e);
const SLICE_THICKNESS: Tag = Tag(0x0018, 0x0050);
const SPACING_BETWEEN_SLICES: Tag = Tag(0x0018, 0x0088);
const ECHO_TIME: Tag = Tag(0x0018, 0x0081);
const TRIGGER_TIME: Tag = Tag(0x0018, 0x1060);
const SERIES_UID: Tag = Tag(0x0020, 0x000e);
const ACQUISITION_NUMBER: Tag = Tag(0x0020, 0x0012);
const INSTANCE_NUMBER: Tag = Tag(0x0020, 0x0013);
const POSITION: Tag = Tag(0x0020, 0x0032);
const ORIENTATION: Tag = Tag(0x0020, 0x0037);
const TEMPORAL_POSITION: Tag = Tag(0x0020, 0x0100);
const FRAME_CONTENT: Tag = Tag(0x0020, 0x9111);
const PLANE_POSITION: Tag = Tag(0x0020, 0x9113);
const PLANE_ORIENTATION: Tag = Tag(0x0020, 0x9116);
const TEMPORAL_INDEX: Tag = Tag(0x0020, 0x9128);
const SAMPLES_PER_PIXEL: Tag = Tag(0x0028, 0x0002);
const PHOTOMETRIC: Tag = Tag(0x0028, 0x0004);
const FRAMES: Tag = Tag(0x0028, 0x0008);
const ROWS: Tag = Tag(0x0028, 0x0010);
const COLUMNS: Tag = Tag(0x0028, 0x0011);
const PIXEL_SPACING: Tag = Tag(0x0028, 0x0030);
const BITS_ALLOCATED: Tag = Tag(0x0028, 0x0100);
const BITS_STORED: Tag = Tag(0x0028, 0x0101);
const HIGH_BIT: Tag = Tag(0x0028, 0x0102);
const REPRESENTATION: Tag = Tag(0x0028, 0x0103);
const INTERCEPT: Tag = Tag(0x0028, 0x1052);
const SLOPE: Tag = Tag(0x0028, 0x1053);
const RESCALE_TYPE: Tag = Tag(0x0028, 0x1054);
const PIXEL_MEASURES: Tag = Tag(0x0028, 0x9110);
const VALUE_TRANSFORMATION: Tag = Tag(0x0028, 0x9145);
const GRID_FRAME_OFFSETS: Tag = Tag(0x3004, 0x000c);
const UNITS: Tag = Tag(0x0054, 0x1001);
const SHARED_GROUPS: Tag = Tag(0x5200, 0x9229);
const FRAME_GROUPS: Tag = Tag(0x5200, 0x9230);

/// Frames of a file at most.
const MOST_FRAMES: u64 = 1 << 20;

/// Classes that are no pictures of voxels, with what to call them.
const OTHER_CLASSES: [(&str, &str); 9] = [
    (
        "1.2.840.10008.5.1.4.1.1.66.4",
        "a DICOM segmentation (DICOM-SEG)",
    ),
    (
        "1.2.840.10008.5.1.4.1.1.66.5",
        "a DICOM surface segmentation",
    ),
    ("1.2.840.10008.5.1.4.1.1.66", "DICOM raw data"),
    (
        "1.2.840.10008.5.1.4.1.1.481.3",
        "a DICOM radiotherapy structure set",
    ),
    ("1.2.840.10008.5.1.4.1.1.481.5", "a DICOM radiotherapy plan"),
    ("1.2.840.10008.5.1.4.1.1.88", "a DICOM structured report"),
    ("1.2.840.10008.5.1.4.1.1.11", "a DICOM presentation state"),
    ("1.2.840.10008.5.1.4.1.1.104", "a document in DICOM"),
    ("1.2.840.10008.5.1.4.1.1.66.1", "a DICOM registration"),
];

pub(super) const SUPPORTED: &str =
    "supported are grey pictures of 8, 16 and 32 bits, one or many to a file, and float ones";

/// The form of a picture's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PixelForm {
    pub(super) columns: u32,
    pub(super) rows: u32,
    pub(super) bits_allocated: u32,
    pub(super) bits_stored: u32,
    pub(super) high_bit: u32,
    pub(super) voxel_type: VoxelType,
}

impl PixelForm {
    /// Bytes of a picture as it is stored uncompressed.
    pub(super) fn picture_bytes(&self) -> u64 {
        u64::from(self.columns) * u64::from(self.rows) * u64::from(self.bits_allocated / 8)
    }
}

/// A picture: a file's only one, or a frame.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    /// Number of the file, and of the frame in it.
    pub(super) file: usize,
    pub(super) frame: u32,
    /// Centre of the first pixel, LPS mm.
    pub(super) position: Option<DVec3>,
    /// Unit directions of a row (along columns) and of a column, LPS.
    pub(super) orientation: Option<[DVec3; 2]>,
    /// Distance of columns and of rows, mm.
    pub(super) spacing: Option<[f64; 2]>,
    /// Distance of slices, if the file says one; thickness else.
    pub(super) slice_mm: Option<f64>,
    pub(super) rescale: Rescale,
    /// What tells volumes taken one after another apart, and orders them.
    pub(super) when: [f64; 4],
    /// Its number in the series.
    pub(super) instance: f64,
}

/// A file of pictures of one form.
#[derive(Clone, Debug)]
pub(super) struct Image {
    pub(super) path: PathBuf,
    pub(super) series: String,
    pub(super) modality: String,
    pub(super) description: String,
    pub(super) unit: String,
    pub(super) is_inverted: bool,
    pub(super) form: PixelForm,
    pub(super) syntax: String,
    pub(super) place: PixelPlace,
    pub(super) frames: u32,
    pub(super) pictures: Vec<Picture>,
    /// Short texts of its header, where these are to be kept.
    pub(super) texts: Vec<(String, String)>,
}

impl Image {
    /// Reads the header of file number `file`.
    ///
    /// # Errors
    /// The file can't be read, is no DICOM or damaged, or holds something that is not built.
    pub(super) fn read(path: &Path, file: usize, keep_texts: bool) -> Result<Self, SourceError> {
        let subject = Subject::new(path);
        let set = DataSet::read(&subject)?;
        let top = &set.item;
        let class = top.text(SOP_CLASS).unwrap_or_default();
        let of_class = |root: &str| class == root || class.starts_with(&format!("{root}."));
        if let Some((_, what)) = OTHER_CLASSES.iter().find(|(root, _)| of_class(root)) {
            return Err(subject.unsupported(*what, SUPPORTED));
        }
        let Some((pixels, place)) = set.pixels else {
            return Err(subject.unsupported(
                format!("a DICOM file without pixels (class {class})"),
                SUPPORTED,
            ));
        };
        let form = form(&subject, top, pixels)?;
        let frames = top.whole(FRAMES).unwrap_or(1).max(1);
        if frames > MOST_FRAMES {
            return Err(subject.malformed(
                "NumberOfFrames",
                format!("at most {MOST_FRAMES}"),
                frames.to_string(),
            ));
        }
        let frames = frames as u32;
        if let PixelPlace::Native { bytes, .. } = place {
            let wanted = u64::from(frames) * form.picture_bytes();
            if bytes < wanted {
                return Err(subject.malformed(
                    "the pixels",
                    format!(
                        "{wanted} bytes for {frames} pictures of {} × {}",
                        form.columns, form.rows
                    ),
                    format!("{bytes} bytes"),
                ));
            }
        }
        let modality = top.text(MODALITY).unwrap_or_default();
        let pictures = pictures(top, file, frames);
        Ok(Self {
            path: path.to_owned(),
            series: top.text(SERIES_UID).unwrap_or_default(),
            unit: unit(top, &modality),
            description: top.text(SERIES_DESCRIPTION).unwrap_or_default(),
            is_inverted: top.text(PHOTOMETRIC).as_deref() == Some("MONOCHROME1"),
            modality,
            form,
            syntax: set.syntax.clone(),
            place,
            frames,
            pictures,
            texts: if keep_texts {
                top.named_texts()
            } else {
                Vec::new()
            },
        })
    }
}

/// The form of the pixels, if it is one that is built.
fn form(subject: &Subject<'_>, top: &Item, pixels: Tag) -> Result<PixelForm, SourceError> {
    let need = |tag: Tag, name: &str, most: u64| {
        let found = top.whole(tag).filter(|&v| v <= most);
        found.map(|v| v as u32).ok_or_else(|| {
            let there = top.text(tag).unwrap_or_else(|| "nothing".into());
            subject.malformed(name, format!("a whole number up to {most}"), there)
        })
    };
    let (rows, columns) = (need(ROWS, "Rows", 65535)?, need(COLUMNS, "Columns", 65535)?);
    if rows == 0 || columns == 0 {
        return Err(subject.malformed("Rows and Columns", "at least 1", "0"));
    }
    let samples = top.whole(SAMPLES_PER_PIXEL).unwrap_or(1);
    let photometric = top
        .text(PHOTOMETRIC)
        .unwrap_or_else(|| "MONOCHROME2".into());
    if samples != 1 || !photometric.starts_with("MONOCHROME") {
        let what = format!("a colour picture ({samples} samples, {photometric})");
        return Err(subject.unsupported(what, SUPPORTED));
    }
    let of_bits = |bits_allocated: u32, voxel_type| PixelForm {
        columns,
        rows,
        bits_allocated,
        bits_stored: bits_allocated,
        high_bit: bits_allocated - 1,
        voxel_type,
    };
    if pixels == FLOAT_PIXEL_DATA {
        return Ok(of_bits(32, VoxelType::F32));
    }
    if pixels == DOUBLE_PIXEL_DATA {
        return Ok(of_bits(64, VoxelType::F64));
    }
    let bits = need(BITS_ALLOCATED, "BitsAllocated", 64)?;
    let stored = top.whole(BITS_STORED).unwrap_or(u64::from(bits)) as u32;
    let high = top
        .whole(HIGH_BIT)
        .map_or(stored.wrapping_sub(1), |h| h as u32);
    let is_signed = top.whole(REPRESENTATION).unwrap_or(0) == 1;
    let voxel_type = match (bits, is_signed) {
        (8, false) => VoxelType::U8,
        (8, true) => VoxelType::I8,
        (16, false) => VoxelType::U16,
        (16, true) => VoxelType::I16,
        (32, false) => VoxelType::U32,
        (32, true) => VoxelType::I32,
        _ => return Err(subject.unsupported(format!("pixels of {bits} bits"), SUPPORTED)),
    };
    if stored == 0 || stored > bits || high >= bits || high + 1 < stored {
        return Err(subject.malformed(
            "BitsStored and HighBit",
            format!("a part of {bits} bits"),
            format!("{stored} bits up to bit {high}"),
        ));
    }
    Ok(PixelForm {
        bits_stored: stored,
        high_bit: high,
        ..of_bits(bits, voxel_type)
    })
}

/// The unit of physical values.
fn unit(top: &Item, modality: &str) -> String {
    match (top.text(RESCALE_TYPE), top.text(UNITS), modality) {
        (Some(unit), _, _) if unit != "US" => unit,
        (_, Some(unit), _) => unit,
        (_, _, "CT") => "HU".into(),
        _ => String::new(),
    }
}

/// The pictures of a file.
fn pictures(top: &Item, file: usize, frames: u32) -> Vec<Picture> {
    let shared = top.first(SHARED_GROUPS);
    let per_frame = top.items(FRAME_GROUPS);
    let offsets = top.texts(GRID_FRAME_OFFSETS);
    let mut pictures = Vec::with_capacity(frames as usize);
    for frame in 0..frames {
        let own = per_frame.get(frame as usize);
        // A group of an enhanced file is the frame's own, or that of all; else elements of the data set.
        let group = |tag: Tag| {
            let own = own.and_then(|i| i.first(tag));
            own.or_else(|| shared.and_then(|i| i.first(tag)))
                .unwrap_or(top)
        };
        let measures = group(PIXEL_MEASURES);
        let values = group(VALUE_TRANSFORMATION);
        let content = group(FRAME_CONTENT);
        let orientation = group(PLANE_ORIENTATION)
            .numbers::<6>(ORIENTATION)
            .and_then(directions);
        let mut position = group(PLANE_POSITION)
            .numbers::<3>(POSITION)
            .map(DVec3::from_array)
            .filter(|p| p.is_finite());
        // Frames of a dose grid: one position, and how far along the normal each lies.
        if frames > 1 && own.is_none() {
            let offset = offsets
                .get(frame as usize)
                .and_then(|o| o.parse::<f64>().ok());
            position = match (position, orientation, offset) {
                (Some(p), Some([row, column]), Some(mm)) => Some(p + row.cross(column) * mm),
                _ => None,
            };
        }
        let positive = |v: &f64| v.is_finite() && *v > 0.0;
        let slice_mm = measures
            .number(SPACING_BETWEEN_SLICES)
            .map(f64::abs)
            .filter(positive);
        let number = |item: &Item, tag| item.number(tag).filter(|v| v.is_finite());
        let slope = number(values, SLOPE).filter(|&s| s != 0.0).unwrap_or(1.0);
        pictures.push(Picture {
            file,
            frame,
            position,
            orientation,
            spacing: measures
                .numbers::<2>(PIXEL_SPACING)
                .filter(|s| s.iter().all(positive))
                // The first is the distance of rows.
                .map(|[of_rows, of_columns]| [of_columns, of_rows]),
            slice_mm: slice_mm.or_else(|| measures.number(SLICE_THICKNESS).filter(positive)),
            rescale: Rescale {
                slope,
                intercept: number(values, INTERCEPT).unwrap_or(0.0),
            },
            when: [
                number(content, TEMPORAL_INDEX).or_else(|| number(top, TEMPORAL_POSITION)),
                number(top, ACQUISITION_NUMBER),
                number(top, TRIGGER_TIME),
                number(top, ECHO_TIME),
            ]
            .map(|v| v.unwrap_or(0.0)),
            instance: number(top, INSTANCE_NUMBER).unwrap_or(0.0) + f64::from(frame),
        });
    }
    pictures
}

/// Two directions as unit vectors, if they are across each other.
fn directions([a, b, c, d, e, f]: [f64; 6]) -> Option<[DVec3; 2]> {
    let row = DVec3::new(a, b, c).try_normalize()?;
    let column = DVec3::new(d, e, f).try_normalize()?;
    (row.dot(column).abs() < 1e-3).then_some([row, column])
}
