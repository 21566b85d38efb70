//! From files to a volume: which series, in what order, at what distances.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec3, U64Vec3};
use rayon::prelude::*;

use super::super::affine;
use super::super::options::OpenOptions;
use super::super::problem::Subject;
use super::super::stack::{Slices, Stack};
use super::dataset::{MAGIC, MAGIC_AT};
use super::geometry::{self, Ordered, Spacing};
use super::image::{Image, Picture};
use super::pixels;
use super::series::{self, Group, Unchosen};
use super::volume::{EvenSlices, Slice, StoredSlices};
use crate::volume::{Rescale, SourceError, VolumeDesc};

/// Slices that lean by more from their normal are said to be tilted, degrees.
const TILTED_DEGREES: f64 = 0.1;
/// Series, files, and double slices that a message names at most.
const MOST_NAMED: usize = 20;

/// True when `bytes`, the first ones of a file, are DICOM's.
pub(in super::super) fn is_header(bytes: &[u8]) -> bool {
    bytes.get(MAGIC_AT..MAGIC_AT + MAGIC.len()) == Some(MAGIC)
}

/// Opens the series that `options` choose among `files`. `subject` is what they were named by.
///
/// # Errors
/// No file is a picture, there are several series and none was chosen, slices are missing, double or at uneven distances, or
/// a file is damaged or of a kind that is not built.
pub(in super::super) fn open(
    files: &[PathBuf],
    subject: &Subject<'_>,
    options: &OpenOptions,
) -> Result<Stack, SourceError> {
    let mut notes = Vec::new();
    let images = read_all(files, options, &mut notes)?;
    let groups = series::groups(&images);
    let group = series::choose(groups, options.series.as_deref(), &mut notes)
        .map_err(|why| unchosen(subject, why, options))?;
    let layout = Layout::of(&images, subject, &group, options, &mut notes)?;
    stack(images, &group, layout, subject, options, notes)
}

/// The headers of all files that are pictures.
fn read_all(
    files: &[PathBuf],
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<Image>, SourceError> {
    let read: Vec<(usize, Option<Result<Image, SourceError>>)> = files
        .par_iter()
        .enumerate()
        .map(|(n, path)| {
            let is_dicom = super::super::files::first_bytes(path).is_ok_and(|b| is_header(&b));
            (n, is_dicom.then(|| Image::read(path, n, options.keep_tags)))
        })
        .collect();
    let (mut images, mut refused, mut others) = (Vec::new(), Vec::new(), 0);
    for (_, found) in read {
        match found {
            None => others += 1,
            Some(Ok(image)) => images.push(image),
            // Beside pictures lie reports and plans.
            Some(Err(error @ SourceError::Unsupported { .. })) => refused.push(error),
            Some(Err(error)) => return Err(error),
        }
    }
    if images.is_empty()
        && let Some(error) = refused.pop()
    {
        return Err(error);
    }
    if others > 0 {
        notes.push(format!("{others} files are no DICOM and are left out"));
    }
    if let Some(first) = refused.first() {
        let more = match refused.len() {
            1 => String::new(),
            n => format!(", and {} more", n - 1),
        };
        notes.push(format!("left out: {first}{more}"));
    }
    // From here on files are told by their place among the pictures.
    for (n, image) in images.iter_mut().enumerate() {
        for picture in &mut image.pictures {
            picture.file = n;
        }
    }
    Ok(images)
}

fn unchosen(subject: &Subject<'_>, why: Unchosen, options: &OpenOptions) -> SourceError {
    let list = |lines: &[String]| {
        let more = lines.len().saturating_sub(MOST_NAMED);
        let shown = lines[..lines.len().min(MOST_NAMED)].join("\n  ");
        match more {
            0 => format!("\n  {shown}\n"),
            _ => format!("\n  {shown}\n  and {more} more\n"),
        }
    };
    let with = |remedy| Subject { remedy, ..*subject };
    match why {
        Unchosen::Several(lines) => with("choose one with --series UID").malformed(
            "the series",
            "one",
            format!("{}:{}", lines.len(), list(&lines)),
        ),
        Unchosen::NoSuch(lines) => with("name one of these").malformed(
            "--series",
            "the UID of a series, or its last numbers",
            format!(
                "{:?}; there are:{}",
                options.series.as_deref().unwrap_or_default(),
                list(&lines)
            ),
        ),
        Unchosen::Mixed(lines) => with("put those that belong together into a folder of their own")
            .malformed(
                "the series",
                "pictures of one size and orientation",
                format!("several kinds:{}", list(&lines)),
            ),
    }
}

/// The slices of a volume in their order, and where they lie.
struct Layout {
    slices: Vec<Picture>,
    /// Along the normal, mm; empty where no place is known.
    along_mm: Vec<f64>,
    /// Uneven distances, to be made even.
    are_uneven: bool,
}

impl Layout {
    fn of(
        images: &[Image],
        subject: &Subject<'_>,
        group: &Group,
        options: &OpenOptions,
        notes: &mut Vec<String>,
    ) -> Result<Self, SourceError> {
        let Some(ordered) = geometry::ordered(group.pictures.clone()) else {
            let mut slices = group.pictures.clone();
            slices.sort_by(|a, b| a.instance.total_cmp(&b.instance));
            notes.push("pictures without a place: ordered by their numbers".into());
            return Ok(Self {
                slices,
                along_mm: Vec::new(),
                are_uneven: false,
            });
        };
        let along_mm = ordered.along_mm.clone();
        let slices = one_at_each_place(ordered, images, subject, options, notes)?;
        let positions: Vec<DVec3> = slices.iter().filter_map(|s| s.position).collect();
        let pixel_mm = slices[0].spacing.map_or(1.0, |[x, y]| x.min(y));
        if !geometry::are_on_a_line(&positions, pixel_mm) {
            return Err(subject.unsupported(
                "a series whose slices do not lie on a line",
                "supported are slices one behind the other, straight or tilted",
            ));
        }
        let mut are_uneven = false;
        if let Spacing::Uneven(gaps) = geometry::spacing(&along_mm) {
            let words = geometry::gaps_in_words(&gaps);
            if !options.resample_gaps {
                let subject = Subject {
                    remedy: "give --resample-gaps to have slices interpolated at even distances",
                    ..*subject
                };
                return Err(subject.malformed("the distances of the slices", "even ones", words));
            }
            are_uneven = true;
            notes.push(format!("uneven distances of slices ({words})"));
        }
        if let (Some(&first), Some(&last), Some(axes)) =
            (positions.first(), positions.last(), group.orientation)
        {
            let tilt = geometry::tilt_degrees(axes, first, last);
            if tilt > TILTED_DEGREES {
                notes.push(format!(
                    "slices lean by {tilt:.2} degrees (gantry tilt): the affine is sheared"
                ));
            }
        }
        Ok(Self {
            slices,
            along_mm,
            are_uneven,
        })
    }
}

/// One picture for each place: of several volumes the one that was chosen.
fn one_at_each_place(
    ordered: Ordered,
    images: &[Image],
    subject: &Subject<'_>,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<Picture>, SourceError> {
    let counts = || ordered.places.iter().map(Vec::len);
    let (least, most) = (counts().min().unwrap_or(0), counts().max().unwrap_or(0));
    if most > 1 && least != most {
        let file = |p: &Picture| match images[p.file].path.file_name() {
            Some(name) if images[p.file].frames == 1 => name.to_string_lossy().into_owned(),
            _ => format!("frame {}", p.frame),
        };
        let double: Vec<String> = ordered
            .places
            .iter()
            .zip(&ordered.along_mm)
            .filter(|(p, _)| p.len() > least)
            .take(MOST_NAMED)
            .map(|(p, mm)| {
                let files: Vec<String> = p.iter().take(MOST_NAMED).map(file).collect();
                format!("{} at {mm:.3} mm ({})", p.len(), files.join(", "))
            })
            .collect();
        let subject = Subject {
            remedy: "take out the files that are double",
            ..*subject
        };
        return Err(subject.malformed(
            "the slices",
            "the same number at each place",
            format!("{least} at most places, but {}", double.join(", ")),
        ));
    }
    let time = match (options.time, most as u64) {
        (None, 0 | 1) => 0,
        (Some(time), n) if time < n.max(1) => time,
        (asked, n) => {
            let what = match asked {
                None => format!("{n} volumes, one after another or of several contrasts"),
                Some(asked) => format!("no volume {asked}: there are {n}"),
            };
            return Err(subject.unsupported(
                what,
                format!(
                    "choose one with --time N, from 0 to {}",
                    n.saturating_sub(1)
                ),
            ));
        }
    };
    if most > 1 {
        notes.push(format!("volume {time} of {most} at the same places"));
    }
    let chosen = ordered
        .places
        .into_iter()
        .map(|mut p| p.swap_remove(time as usize));
    Ok(chosen.collect())
}

fn stack(
    images: Vec<Image>,
    group: &Group,
    layout: Layout,
    subject: &Subject<'_>,
    options: &OpenOptions,
    mut notes: Vec<String>,
) -> Result<Stack, SourceError> {
    let Layout {
        slices: pictures,
        along_mm,
        are_uneven,
    } = layout;
    let image = &images[pictures[0].file];
    let rescales: Vec<Rescale> = pictures.iter().map(|p| p.rescale).collect();
    let is_one_rescale = rescales.windows(2).all(|w| w[0] == w[1]);
    if !is_one_rescale {
        notes.push("every slice has its own rescale: physical values are stored, as f32".into());
    }
    if image.is_inverted {
        notes.push(
            "MONOCHROME1: low values are meant to be bright; the values are kept as they are"
                .into(),
        );
    }
    let even_mm = match are_uneven {
        true => geometry::even_places(&along_mm),
        false => Vec::new(),
    };
    let count = match are_uneven {
        true => even_mm.len(),
        false => pictures.len(),
    } as u64;
    let world_from_index = world_from_index(&pictures, group, count, options, &mut notes);
    let unit = image.unit.clone();
    let tags = image.texts.clone();
    let form = group.form;
    let mut slices = Vec::with_capacity(pictures.len());
    let mut places: Vec<Option<Vec<pixels::FramePlace>>> = vec![None; images.len()];
    for picture in &pictures {
        let of_file = match &mut places[picture.file] {
            Some(known) => known,
            unknown => unknown.insert(pixels::places(&images[picture.file])?),
        };
        let place = of_file
            .get(picture.frame as usize)
            .ok_or_else(|| subject.malformed("the pixels", "all frames", "fewer"))?;
        slices.push(Slice {
            file: picture.file,
            place: place.clone(),
            rescale: picture.rescale,
        });
    }
    let stored = StoredSlices {
        images: Arc::new(images),
        slices,
        are_physical: !is_one_rescale,
    };
    let desc = VolumeDesc {
        dims: U64Vec3::new(form.columns.into(), form.rows.into(), count),
        voxel_type: stored.voxel_type(),
        world_from_index: affine::checked(
            subject,
            "orientation, position and spacing",
            world_from_index,
        )?,
        rescale: if is_one_rescale {
            rescales[0]
        } else {
            Rescale::IDENTITY
        },
        unit,
        // Names of files and series may be a patient's.
        name: format!(
            "{} series",
            match group.modality.as_str() {
                "" => "DICOM",
                modality => modality,
            }
        ),
    };
    let slices: Box<dyn Slices> = if are_uneven {
        notes.push(format!(
            "resampled to {count} slices, {:.3} mm apart",
            even_mm.get(1).map_or(0.0, |b| b - even_mm[0])
        ));
        Box::new(EvenSlices::new(stored, &along_mm, &even_mm))
    } else {
        Box::new(stored)
    };
    Ok(Stack::new(desc, slices).with_notes(notes).with_tags(tags))
}

/// Place and spacing of the volume.
fn world_from_index(
    pictures: &[Picture],
    group: &Group,
    count: u64,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> glam::DAffine3 {
    let first = &pictures[0];
    let slice_mm = first.slice_mm.unwrap_or(1.0);
    let spacing = first.spacing.unwrap_or([1.0; 2]);
    let ends = (first.position, pictures[pictures.len() - 1].position);
    if let (Some(axes), (Some(begin), Some(end))) = (group.orientation, ends) {
        return geometry::affine(axes, spacing, (begin, end), count, slice_mm);
    }
    if let Some(spacing) = options.spacing {
        return affine::from_spacing(spacing);
    }
    notes.push(format!(
        "no place in the patient is said: spacing {} × {} × {slice_mm} mm, no orientation",
        spacing[0], spacing[1]
    ));
    affine::from_spacing(DVec3::new(spacing[0], spacing[1], slice_mm))
}
