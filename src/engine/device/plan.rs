//! A picture's settings made ready: sample grid, tables, what can be seen of the bricks, bounding mesh. Pure, so that a
//! thread beside the renderer can do it.

use crate::classify::{SegmentTables, Visibility};
use crate::proxy::Mesh;
use crate::render::{ExtremeCodes, FrameInputs};
use crate::scene::{Classified, PictureSettings, RayFrame, SlabShape, Technique};
use crate::store::Store;

use super::super::{EngineError, prepare};
use super::bounds::{active_blocks, mesh};
use super::classification::{ClassifiedBricks, KnownRanges, LevelVisibility, SeenLevels};

/// What a picture is drawn from, but for the volume.
#[derive(Clone, Debug)]
pub(super) struct PicturePlan {
    pub(super) settings: PictureSettings,
    pub(super) rays: RayFrame,
    pub(super) classified: Classified,
    pub(super) levels: SeenLevels,
    /// Mesh interval, brick and block skipping?
    pub(super) skip: bool,
    /// With technique slab, once the memory is known: the slabs.
    pub(super) slab: Option<SlabShape>,
}

impl PicturePlan {
    pub(super) fn new(
        store: &Store,
        tables: &SegmentTables,
        settings: &PictureSettings,
    ) -> Result<Self, EngineError> {
        let (rays, classified) = prepare(store, tables, settings)?;
        let skip = settings.technique != Technique::Basic;
        let iso = classified.surfaces.first().map(|s| s.value);
        let codes = ExtremeCodes::new(classified.value_range);
        let levels = rays
            .used()
            .iter()
            .zip(&classified.levels)
            .map(|(level, table)| {
                let visibility = if skip {
                    table.visibility.clone()
                } else {
                    Visibility::All
                };
                let seen = LevelVisibility {
                    visibility,
                    iso,
                    codes,
                };
                (level.lod, seen)
            })
            .collect();
        for level in &rays.levels {
            store.check_level(level.lod)?;
        }
        Ok(Self {
            settings: settings.clone(),
            rays,
            classified,
            levels,
            skip,
            slab: None,
        })
    }

    /// The same picture from coarser levels, soon there; `None` where it would be from the same ones.
    pub(super) fn first_whole(
        &self,
        store: &Store,
        tables: &SegmentTables,
    ) -> Result<Option<Self>, EngineError> {
        let Some(settings) = self.settings.first_whole() else {
            return Ok(None);
        };
        let coarse = Self::new(store, tables, &settings)?;
        Ok((coarse.rays.used() != self.rays.used()).then_some(coarse))
    }

    pub(super) fn inputs(&self) -> FrameInputs<'_> {
        FrameInputs {
            rays: &self.rays,
            classified: &self.classified,
            settings: &self.settings,
            skip: self.skip,
            slab: self.slab,
        }
    }

    /// The mesh of what may be visible, of blocks where they are known.
    fn mesh(
        &self,
        store: &Store,
        known: &KnownRanges,
        budget_bytes: u64,
    ) -> Result<Mesh, EngineError> {
        if !self.skip {
            return Ok(Mesh::default());
        }
        let blocks = active_blocks(store, &self.rays, &self.levels, known)?;
        Ok(mesh(&blocks, &self.rays, budget_bytes)?)
    }
}

/// One or more pictures of one classification, ready to be drawn.
#[derive(Debug)]
pub(super) struct ReadyPictures {
    /// In the order in which they are drawn, each with its mesh.
    pub(super) pictures: Vec<(PicturePlan, Mesh)>,
    /// The levels of all of them.
    pub(super) levels: SeenLevels,
    pub(super) bricks: ClassifiedBricks,
}

impl ReadyPictures {
    /// Works out what drawing `plans` needs of a volume of which `known` is known and whose tables are right for `seen`.
    pub(super) fn new(
        store: &Store,
        plans: Vec<PicturePlan>,
        (known, seen): (&KnownRanges, &SeenLevels),
        mesh_bytes: u64,
    ) -> Result<Self, EngineError> {
        let levels: SeenLevels = plans
            .iter()
            .flat_map(|p| p.levels.iter().map(|(&lod, seen)| (lod, seen.clone())))
            .collect();
        let bricks = ClassifiedBricks::new(store, &levels, seen, known);
        let mut pictures = Vec::with_capacity(plans.len());
        for plan in plans {
            let mesh = plan.mesh(store, known, mesh_bytes)?;
            pictures.push((plan, mesh));
        }
        Ok(Self {
            pictures,
            levels,
            bricks,
        })
    }

    /// Those that are drawn in slabs.
    pub(super) fn slab_plans(&self) -> impl Iterator<Item = &PicturePlan> {
        let plans = self.pictures.iter().map(|(plan, _)| plan);
        plans.filter(|p| p.settings.technique == Technique::Slab)
    }

    /// The same.
    pub(super) fn slab_plans_mut(&mut self) -> impl Iterator<Item = &mut PicturePlan> {
        let plans = self.pictures.iter_mut().map(|(plan, _)| plan);
        plans.filter(|p| p.settings.technique == Technique::Slab)
    }

    /// The picture that counts: the last.
    pub(super) fn final_plan(&self) -> &PicturePlan {
        let (plan, _) = self
            .pictures
            .last()
            .expect("invariant: there is a picture to draw");
        plan
    }
}
