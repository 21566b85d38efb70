//! How much of a volume may be visible in a picture: what bounding mesh and bricks leave out.

use rayon::prelude::*;

use super::{Engine, EngineError, prepare};
use crate::classify::{Occupancy, SegmentTables};
use crate::geom::{BLOCK_EDGE, BrickId};
use crate::pager::scan;
use crate::proxy::ActiveBlocks;
use crate::scene::PictureSettings;
use crate::store::{BrickReader, Store, StoreError};

/// Bricks and blocks of 4³ voxels of a level, and how many of them are active: something in their range of values is
/// visible, the voxels around them included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActiveShare {
    /// Bricks of the level.
    pub bricks: u64,
    /// Those with an active block.
    pub bricks_active: u64,
    /// Blocks of the level.
    pub blocks: u64,
    /// Those that are active.
    pub blocks_active: u64,
}

impl Engine {
    /// Counts what is active at the finest level that a picture samples. Reads every brick of it that may be visible.
    ///
    /// # Errors
    /// The settings make no picture, or a brick can't be read.
    pub fn active_share(&self, settings: &PictureSettings) -> Result<ActiveShare, EngineError> {
        let store = &*self.store;
        let (rays, classified) = prepare(store, &SegmentTables::default(), settings)?;
        let (lod, visibility) = (rays.levels[0].lod, &classified.levels[0].visibility);
        store.check_level(lod)?;
        let visible: Vec<BrickId> = scan(store, lod, visibility)
            .filter_map(|brick| brick.visible.then_some(brick.id))
            .collect();
        let occupancies = visible
            .into_par_iter()
            .map_init(BrickReader::new, |reader, id| {
                let reader = reader.as_mut().map_err(|_| no_memory(store))?;
                let data = store.read_brick(id, reader)?;
                let ranges = data.block_ranges.first_chunk();
                let ranges = ranges.expect("invariant: a brick has a range for each block");
                Ok((id.xyz, Occupancy::from_ranges(ranges, visibility)))
            })
            .collect::<Result<Vec<_>, EngineError>>()?;
        let grid = store.level(lod).grid;
        let active = ActiveBlocks::new(grid, occupancies)?;
        let blocks = grid
            .voxels
            .to_array()
            .map(|n| n.div_ceil(u64::from(BLOCK_EDGE)));
        Ok(ActiveShare {
            bricks: grid.len(),
            bricks_active: active.len() as u64,
            blocks: blocks.iter().product(),
            blocks_active: active.iter().map(|(_, o)| u64::from(o.count())).sum(),
        })
    }
}

/// A decoder could not be made.
fn no_memory(store: &Store) -> EngineError {
    EngineError::Store(StoreError::Io {
        path: store.path().to_owned(),
        doing: "make a decoder of bricks",
        error: std::io::ErrorKind::OutOfMemory.into(),
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::bricking::{BrickOptions, NoProgress, brick};
    use crate::camera::Camera;
    use crate::classify::grey_ramp;
    use crate::engine::{DeviceChoice, EngineOptions};
    use crate::geom::Lod;
    use crate::input;
    use crate::scene::{IsoSurface, LodChoice, Mode};

    #[test]
    fn all_some_or_none_is_active() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.bsk");
        let mut source = input::open("phantom:body:40,40,40", &Default::default()).unwrap();
        brick(&mut *source, &path, &BrickOptions::default(), &NoProgress).unwrap();
        let options = EngineOptions {
            device: DeviceChoice::Cpu,
            ..EngineOptions::default()
        };
        let store = Arc::new(Store::open(&path).unwrap());
        let engine = Engine::with_store(store, options).unwrap();
        let share = |mode: Mode, iso: f64| {
            let camera = Camera::turntable(0, 1, DVec3::splat(19.5), 150.0);
            let mut settings =
                PictureSettings::new(mode, grey_ramp(0.0, 255.0, 0.5).unwrap(), camera);
            settings.lod = LodChoice::Fixed(Lod(0));
            settings.classification.iso = vec![IsoSurface::opaque(iso)];
            engine.active_share(&settings).unwrap()
        };
        // 2 × 2 × 2 bricks, 10 × 10 × 10 blocks; a mean is of all values.
        let all = share(Mode::Mean, 0.0);
        assert_eq!((all.bricks, all.bricks_active), (8, 8));
        assert_eq!((all.blocks, all.blocks_active), (1000, 1000));
        let none = share(Mode::Iso, 1000.0);
        assert_eq!((none.bricks_active, none.blocks_active), (0, 0));
        let some = share(Mode::Iso, 129.0);
        assert!(
            some.bricks_active > 0 && 0 < some.blocks_active && some.blocks_active < 1000,
            "bone is in few places: {some:?}"
        );
    }
}
