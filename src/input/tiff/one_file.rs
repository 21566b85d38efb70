//! A volume in one TIFF file: its pages are checked, and slices read from them.

use std::path::{Path, PathBuf};

use glam::U64Vec3;

use super::directory::Tiff;
use super::layout::{Chain, Layout, Planes};
use super::page::{self, Format, Page};
use crate::input::options::OpenOptions;
use crate::input::problem::Subject;
use crate::input::raw::Endian;
use crate::input::stack::{Slices, Stack};
use crate::input::voxel_file::{swap_bytes, voxel_bytes};
use crate::input::{spacing, stamp};
use crate::volume::{SourceError, VolumeDesc};

/// How often the bytes of a file may be read to find its pages: each once, were it not for those that pages share.
const MOST_READS: u64 = 4;

/// Opens a file that is a volume. `named` is what the user typed for it.
///
/// # Errors
/// As [`super::open`].
pub(super) fn open(
    path: &Path,
    named: &Subject<'_>,
    options: &OpenOptions,
) -> Result<Stack, SourceError> {
    let tiff = Tiff::open(path)?;
    let subject = tiff.subject();
    let chain = Chain::walk(&tiff)?;
    let mut notes = Vec::new();
    let layout = Layout::read(&tiff, &chain, options, &mut notes)?;
    let side_pages = chain.pages.iter().filter(|p| p.is_side).count();
    if side_pages > 0 {
        notes.push(format!(
            "{side_pages} pages of reduced resolution or of masks are left out."
        ));
    }
    let pages = check_pages(&tiff, &chain, &layout.planes)?;
    pages.remarks.tell(&mut notes);
    if let Some((width, height)) = layout.stated_size
        && (width, height) != (pages.format.width, pages.format.height)
    {
        return Err(subject.malformed(
            "the OME-XML description, SizeX and SizeY",
            format!(
                "those of the pages, {} × {}",
                pages.format.width, pages.format.height
            ),
            format!("{width} × {height}"),
        ));
    }
    let dims = U64Vec3::new(
        pages.format.width,
        pages.format.height,
        layout.planes.count(),
    );
    let desc = VolumeDesc {
        dims,
        voxel_type: pages.format.voxel_type,
        world_from_index: spacing::world(&subject, layout.spacing, dims, options, &mut notes)?,
        rescale: layout.rescale,
        unit: layout.unit,
        name: named.name(),
    };
    voxel_bytes(&subject, &desc)?;
    let slices = OneFile {
        working_bytes: pages.working_bytes,
        format: pages.format,
        planes: layout.planes,
        choice: layout.choice,
        path: path.to_owned(),
        tiff,
    };
    Ok(Stack::new(desc, Box::new(slices)).with_notes(notes))
}

/// What is the same in all pages, and the most that one asks for.
struct Checked {
    format: Format,
    working_bytes: u64,
    remarks: Remarks,
}

/// Checks every page that holds a slice.
fn check_pages(tiff: &Tiff, chain: &Chain, planes: &Planes) -> Result<Checked, SourceError> {
    let only;
    let pages = match planes {
        Planes::Pages(pages) => pages.as_slice(),
        Planes::Behind { .. } => {
            only = chain.main_pages();
            &only
        }
    };
    let mut checked: Option<Checked> = None;
    let mut read_bytes: u64 = 0;
    for place in pages {
        let directory = tiff.directory(place.number, place.at)?;
        read_bytes = read_bytes.saturating_add(page::parse_bytes(&directory));
        if read_bytes / MOST_READS > tiff.len() {
            return Err(tiff.subject().malformed(
                format!("page {}", place.number),
                "tables of strips and tiles beside each other",
                "tables that pages share, longer than the file",
            ));
        }
        let page = Page::parse(tiff, &directory)?;
        let checked = checked.get_or_insert(Checked {
            format: page.format,
            working_bytes: 0,
            remarks: Remarks::default(),
        });
        check_same(tiff, &page, checked.format)?;
        checked.working_bytes = checked.working_bytes.max(page.working_bytes());
        checked.remarks.add(&Remarks::of(&page));
    }
    checked.ok_or_else(|| {
        tiff.subject()
            .malformed("the pages", "at least one", "none")
    })
}

/// Refuses a page that is not like the others.
///
/// # Errors
/// It is not.
pub(super) fn check_same(tiff: &Tiff, page: &Page, format: Format) -> Result<(), SourceError> {
    if page.format == format {
        return Ok(());
    }
    Err(tiff.subject().malformed(
        format!("page {}", page.number),
        format!("{}, as on the first page", format.name()),
        page.format.name(),
    ))
}

/// What a user should know of pages.
#[derive(Default)]
pub(super) struct Remarks {
    is_inverted: bool,
    orientation: Option<u64>,
    has_pyramid: bool,
}

impl Remarks {
    pub(super) fn of(page: &Page) -> Self {
        Self {
            is_inverted: page.is_inverted,
            orientation: (page.orientation != 1).then_some(page.orientation),
            has_pyramid: page.has_pyramid,
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.is_inverted |= other.is_inverted;
        self.orientation = self.orientation.or(other.orientation);
        self.has_pyramid |= other.has_pyramid;
    }

    pub(super) fn tell(&self, notes: &mut Vec<String>) {
        if self.is_inverted {
            notes.push(
                "0 is white in this file (WhiteIsZero); values are kept as they are stored."
                    .to_owned(),
            );
        }
        if let Some(orientation) = self.orientation {
            notes.push(format!(
                "Rows and columns are kept as they are stored; the orientation tag ({orientation}) is not followed."
            ));
        }
        if self.has_pyramid {
            notes.push("Reduced copies of the pages (SubIFDs) are left out.".to_owned());
        }
    }
}

/// The slices of one file.
struct OneFile {
    tiff: Tiff,
    path: PathBuf,
    format: Format,
    planes: Planes,
    choice: String,
    working_bytes: u64,
}

impl Slices for OneFile {
    fn read(&self, z: u64, out: &mut [u8]) -> Result<(), SourceError> {
        match &self.planes {
            Planes::Pages(pages) => {
                let place = pages[z as usize];
                let directory = self.tiff.directory(place.number, place.at)?;
                let page = Page::parse(&self.tiff, &directory)?;
                check_same(&self.tiff, &page, self.format)?;
                page.read(&self.tiff, out)
            }
            Planes::Behind { start, stride, .. } => {
                // All planes lie in the file, which was checked when it was opened.
                self.tiff
                    .read_at(&format!("slice {z}"), start + z * stride, out)?;
                if self.tiff.endian() == Endian::Big {
                    swap_bytes(out, self.format.voxel_type.size());
                }
                Ok(())
            }
        }
    }

    fn working_bytes(&self) -> u64 {
        self.working_bytes
    }

    fn stamp(&self) -> String {
        format!("{}{}", stamp::of_file(&self.path), self.choice)
    }
}
