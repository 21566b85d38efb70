//! The slices of a chosen volume as a [`Stack`]: in their order, rescaled where each slice has its own rescale, and resampled
//! where that was asked for.

use std::sync::Arc;

use super::image::Image;
use super::pixels::{self, FramePlace, most_compressed};
use crate::input::stack::Slices;
use crate::volume::{Rescale, SourceError, VoxelType};

/// One slice: a picture of a file.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    pub(super) file: usize,
    pub(super) place: FramePlace,
    pub(super) rescale: Rescale,
}

/// The slices of a volume, as they are stored.
pub(super) struct StoredSlices {
    pub(super) images: Arc<Vec<Image>>,
    pub(super) slices: Vec<Slice>,
    /// Physical values come out, as f32: slices differ in their rescale.
    pub(super) are_physical: bool,
}

impl StoredSlices {
    /// Type of what comes out.
    pub(super) fn voxel_type(&self) -> VoxelType {
        match (self.are_physical, self.images.first()) {
            (false, Some(image)) => image.form.voxel_type,
            _ => VoxelType::F32,
        }
    }

    fn stored_bytes(&self) -> u64 {
        let form = self.images.first().map(|i| i.form);
        form.map_or(0, |f| f.picture_bytes())
    }
}

impl Slices for StoredSlices {
    fn read(&self, z: u64, out: &mut [u8]) -> Result<(), SourceError> {
        let slice = &self.slices[z as usize];
        let image = &self.images[slice.file];
        if !self.are_physical {
            return pixels::read(image, &slice.place, out);
        }
        let mut stored = vec![0; self.stored_bytes() as usize];
        pixels::read(image, &slice.place, &mut stored)?;
        let size = image.form.voxel_type.size();
        for (voxel, out) in stored.chunks_exact(size).zip(out.as_chunks_mut::<4>().0) {
            let value = slice.rescale.physical(image.form.voxel_type.value(voxel));
            *out = (value as f32).to_le_bytes();
        }
        Ok(())
    }

    fn working_bytes(&self) -> u64 {
        let form = self.images.first().map(|i| i.form);
        // A decoder has its values as f32 or u16 beside the compressed bytes.
        form.map_or(0, |f| most_compressed(&f)) + 3 * self.stored_bytes()
    }

    fn stamp(&self) -> String {
        let mut hash = xxhash_rust::xxh3::Xxh3::new();
        for slice in &self.slices {
            let image = &self.images[slice.file];
            let info = std::fs::metadata(&image.path).ok();
            let changed = info.as_ref().and_then(|i| i.modified().ok());
            let text = format!("{:?} {:?} {changed:?}", image.path, info.map(|i| i.len()));
            hash.update(text.as_bytes());
        }
        format!("{} slices, files {:016x}", self.slices.len(), hash.digest())
    }
}

/// Slices at even places, each between two of those that are there.
pub(super) struct EvenSlices {
    pub(super) of: StoredSlices,
    /// Per slice: the one before, and how far it lies towards the next one, 0 to 1.
    pub(super) between: Vec<(usize, f64)>,
}

impl EvenSlices {
    /// `of`, which lie at `along_mm`, at the places `even_mm`; both rise.
    pub(super) fn new(of: StoredSlices, along_mm: &[f64], even_mm: &[f64]) -> Self {
        let last = along_mm.len().saturating_sub(2);
        let between = even_mm
            .iter()
            .map(|&mm| {
                let before = along_mm
                    .partition_point(|&at| at <= mm)
                    .saturating_sub(1)
                    .min(last);
                let gap = along_mm[before + 1] - along_mm[before];
                (before, ((mm - along_mm[before]) / gap).clamp(0.0, 1.0))
            })
            .collect();
        Self { of, between }
    }
}

impl Slices for EvenSlices {
    fn read(&self, z: u64, out: &mut [u8]) -> Result<(), SourceError> {
        let (before, share) = self.between[z as usize];
        if share == 0.0 {
            return self.of.read(before as u64, out);
        }
        if share == 1.0 {
            return self.of.read(before as u64 + 1, out);
        }
        self.of.read(before as u64, out)?;
        let mut behind = vec![0; out.len()];
        self.of.read(before as u64 + 1, &mut behind)?;
        let voxel_type = self.of.voxel_type();
        let size = voxel_type.size();
        for (a, b) in out.chunks_exact_mut(size).zip(behind.chunks_exact(size)) {
            let mixed = voxel_type.value(a) * (1.0 - share) + voxel_type.value(b) * share;
            voxel_type.put(mixed, a);
        }
        Ok(())
    }

    fn working_bytes(&self) -> u64 {
        2 * self.of.working_bytes()
    }

    fn stamp(&self) -> String {
        format!("{}, resampled to {}", self.of.stamp(), self.between.len())
    }
}
