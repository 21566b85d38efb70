//! Whole pictures: tiles of packets on all threads.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use glam::Vec4;
use rayon::prelude::*;

use super::bricks::{BrickCache, CastLevel, LevelClassification, NearBricks, Purpose};
use super::cast::{Colors, Scene, Search, cast};
use super::extreme::Extreme;
use super::field::{Field, VoxelKind, with_voxel_kind};
use super::intervals::Intervals;
use super::light::Light;
use super::simd::{InstructionSet, Kernel, Lanes};
use super::skip::Seen;
use super::surfaces::SurfaceTable;
use super::table::{SegmentTable, Table};
use crate::geom::Lod;
use crate::scene::{
    Classified, Image, Mode, PictureSettings, RayCounts, RayFrame, ShadingModel, Technique,
};
use crate::store::{Store, StoreError};
use crate::volume::StoredType;

/// Pixels along the edge of a tile: what a thread draws at once.
pub(super) const TILE: u32 = 32;

/// A store and what of it is decoded, kept from picture to picture.
#[derive(Debug)]
pub struct CpuRenderer {
    cache: BrickCache,
    instructions: InstructionSet,
    /// What the blocks of each level have been classified by, and the number of that.
    classified: Vec<Option<Arc<LevelClassification>>>,
    generations: u64,
}

/// What has been read of the store, since the renderer was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CpuTraffic {
    /// Bricks read and decoded.
    pub bricks_read: u64,
    /// Bytes of their records.
    pub bytes_read: u64,
    /// Bytes of their voxels.
    pub bytes_decompressed: u64,
}

/// A picture in work: settings made ready, and which tiles are drawn.
#[derive(Debug)]
pub struct CpuPicture {
    frame: RayFrame,
    classified: Classified,
    settings: PictureSettings,
    image: Image,
    counts: RayCounts,
    /// One per level that is sampled, worked out when the first tile is drawn.
    intervals: Option<Vec<Intervals>>,
    /// One per level that is sampled.
    tables: Vec<Table>,
    visible: u64,
    next_tile: u32,
}

impl CpuPicture {
    /// Nothing is drawn yet.
    pub fn new(frame: RayFrame, classified: Classified, settings: PictureSettings) -> Self {
        Self {
            image: Image::clear(frame.size),
            counts: RayCounts::default(),
            intervals: None,
            tables: classified
                .levels
                .iter()
                .map(|l| Table::new(&l.lut))
                .collect(),
            visible: 0,
            next_tile: 0,
            frame,
            classified,
            settings,
        }
    }

    /// Are all tiles drawn?
    pub fn is_done(&self) -> bool {
        self.next_tile >= self.tiles()
    }

    /// Samples so far.
    pub fn counts(&self) -> RayCounts {
        self.counts
    }

    /// Bricks of the levels in use that may be visible by the index; 0 before the first tile is drawn.
    pub fn visible(&self) -> u64 {
        self.visible
    }

    /// The look-up tables of the levels that are sampled.
    pub(super) fn tables(&self) -> &[Table] {
        &self.tables
    }

    /// The sample grid.
    pub fn frame(&self) -> &RayFrame {
        &self.frame
    }

    /// The picture, premultiplied, before the background; nothing where tiles are missing.
    pub fn into_image(self) -> Image {
        self.image
    }

    fn tiles_across(&self) -> u32 {
        self.frame.size[0].div_ceil(TILE)
    }

    fn tiles(&self) -> u32 {
        self.tiles_across() * self.frame.size[1].div_ceil(TILE)
    }
}

impl CpuRenderer {
    /// Most bricks of a level that is drawn: lanes count them in 32 bits.
    pub const MAX_BRICKS: u64 = i32::MAX as u64;

    /// A renderer of `store` that keeps at most `ram_bytes` of decoded bricks (a few at least).
    pub fn new(store: &Arc<Store>, ram_bytes: u64, instructions: InstructionSet) -> Self {
        Self {
            cache: BrickCache::new(store, ram_bytes),
            instructions,
            classified: std::iter::repeat_with(|| None)
                .take(store.levels())
                .collect(),
            generations: 0,
        }
    }

    /// The processor's instructions that it uses.
    pub fn instructions(&self) -> InstructionSet {
        self.instructions
    }

    /// Drops what is decoded.
    pub fn forget(&self) {
        self.cache.clear();
    }

    /// What has been read since it was made.
    pub fn traffic(&self) -> CpuTraffic {
        let of = |n: &std::sync::atomic::AtomicU64| n.load(Ordering::Relaxed);
        let traffic = &self.cache.traffic;
        CpuTraffic {
            bricks_read: of(&traffic.bricks_read),
            bytes_read: of(&traffic.bytes_read),
            bytes_decompressed: of(&traffic.bytes_decompressed),
        }
    }

    /// Draws up to `tiles` more tiles of `picture` on all threads of the current rayon pool.
    ///
    /// # Errors
    /// A brick, or the index of a level, can't be read; the tiles are not drawn then.
    pub fn draw(&mut self, picture: &mut CpuPicture, tiles: u32) -> Result<(), StoreError> {
        let last = picture.next_tile.saturating_add(tiles).min(picture.tiles());
        let (instructions, stored_type) = (self.instructions, self.cache.store().stored_type());
        let levels = self.levels(picture)?;
        if picture.intervals.is_none() {
            let used = picture.frame.used().iter().zip(&levels);
            picture.visible = levels.iter().map(|l| l.of.visible.len() as u64).sum();
            picture.intervals = Some(
                used.map(|(level, cast)| cast.intervals(&picture.frame, level))
                    .collect(),
            );
        }
        let scene = scene_of(picture, stored_type);
        let [width, height] = picture.frame.size;
        let across = picture.tiles_across();
        let threads = rayon::current_num_threads();
        let drawn: Result<Vec<Tile>, StoreError> = (picture.next_tile..last)
            .into_par_iter()
            .map_init(
                || {
                    let near = levels.iter().map(|level| level.near(threads));
                    near.collect::<Vec<_>>()
                },
                |near, tile| {
                    let [x, y] = [tile % across * TILE, tile / across * TILE];
                    let mut tile = Tile {
                        origin: [x, y],
                        size: [TILE.min(width - x), TILE.min(height - y)],
                        pixels: Vec::new(),
                        counts: RayCounts::default(),
                    };
                    with_voxel_kind!(stored_type, K => instructions.run(DrawTile {
                        scene: &scene,
                        near,
                        tile: &mut tile,
                        kind: std::marker::PhantomData::<K>,
                    }));
                    match near.iter_mut().find_map(|n| n.error.take()) {
                        Some(error) => Err(error),
                        None => Ok(tile),
                    }
                },
            )
            .collect();
        for tile in drawn? {
            picture.counts += tile.counts;
            let [w, h] = tile.size.map(|n| n as usize);
            let [x, y] = tile.origin.map(|n| n as usize);
            for (row, pixels) in tile.pixels.chunks_exact(w).take(h).enumerate() {
                let at = (y + row) * width as usize + x;
                picture.image.pixels[at..at + w].copy_from_slice(pixels);
            }
        }
        picture.next_tile = last;
        Ok(())
    }

    /// The levels of `picture`, under its classification.
    fn levels(&mut self, picture: &CpuPicture) -> Result<Vec<CastLevel<'_>>, StoreError> {
        let mut levels = Vec::with_capacity(picture.frame.used_levels);
        for (level, classified) in picture.frame.used().iter().zip(&picture.classified.levels) {
            self.cache.store().check_level(level.lod)?;
            let purpose = match (picture.settings.technique, picture.settings.mode) {
                (Technique::Basic, _) | (_, Mode::Mean) => Purpose::Everything,
                (_, mode @ (Mode::Mip | Mode::MinIp)) => Purpose::Extreme(extreme_of(mode)),
                (_, Mode::Dvr | Mode::Iso | Mode::Xray | Mode::Gradient) => Purpose::Skip(Seen {
                    visibility: classified.visibility.clone(),
                    surfaces: picture
                        .classified
                        .surfaces
                        .iter()
                        .map(|s| s.value)
                        .collect(),
                }),
            };
            levels.push(self.classified(level.lod, purpose));
        }
        Ok(levels
            .iter()
            .map(|of| CastLevel::new(&self.cache, of))
            .collect())
    }

    /// The level with its blocks told so: as it was, or anew.
    fn classified(&mut self, lod: Lod, purpose: Purpose) -> Arc<LevelClassification> {
        let last = &mut self.classified[usize::from(lod.0)];
        if let Some(of) = last
            && of.purpose == purpose
        {
            return Arc::clone(of);
        }
        self.generations += 1;
        let store = self.cache.store();
        let of = LevelClassification::new(store, lod, purpose, self.generations);
        Arc::clone(last.insert(Arc::new(of)))
    }
}

/// What mode mip or minip looks for; of the others it doesn't matter.
fn extreme_of(mode: Mode) -> Extreme {
    if mode == Mode::MinIp {
        Extreme::Least
    } else {
        Extreme::Greatest
    }
}

fn scene_of(picture: &CpuPicture, stored_type: StoredType) -> Scene<'_> {
    let (settings, classified) = (&picture.settings, &picture.classified);
    let levels = classified.levels.iter();
    let (extreme, range) = (extreme_of(settings.mode), classified.value_range);
    Scene {
        frame: &picture.frame,
        mode: settings.mode,
        tables: &picture.tables,
        segments: levels
            .filter_map(|l| l.preintegrated.as_ref().map(SegmentTable::new))
            .collect(),
        intervals: picture.intervals.as_deref().unwrap_or_default(),
        skips: settings.technique != Technique::Basic,
        light: match settings.shading.model {
            ShadingModel::None => None,
            ShadingModel::Phong => Some(Light::new(&settings.shading)),
        },
        gradient_filter: settings.shading.gradient,
        gradient_scale: (settings.mode == Mode::Gradient).then_some(classified.gradient_scale),
        interpolation: settings.interpolation,
        surfaces: SurfaceTable::new(&classified.surfaces),
        refine: settings.refine,
        opacity_cutoff: settings.opacity_cutoff,
        search: Search {
            sign: extreme.sign(),
            begin: extreme.begin(range),
            end: extreme.bound(stored_type, range),
        },
    }
}

/// Pixels of a part of the picture.
struct Tile {
    origin: [u32; 2],
    size: [u32; 2],
    pixels: Vec<Vec4>,
    counts: RayCounts,
}

/// Draws a tile, packet by packet.
struct DrawTile<'t, 's, 'a, K> {
    scene: &'t Scene<'s>,
    near: &'t mut [NearBricks<'a>],
    tile: &'t mut Tile,
    kind: std::marker::PhantomData<K>,
}

impl<K: VoxelKind> Kernel for DrawTile<'_, '_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let [across, down] = L::SHAPE;
        let [width, height] = self.tile.size;
        let mut pixels = vec![Vec4::ZERO; (width * height) as usize];
        let mut fields = Vec::with_capacity(self.near.len());
        for (near, level) in self.near.iter_mut().zip(self.scene.frame.used()) {
            fields.push(Field::new(l, near, level, self.scene.interpolation));
        }
        for y in (0..height).step_by(down as usize) {
            for x in (0..width).step_by(across as usize) {
                let at = [self.tile.origin[0] + x, self.tile.origin[1] + y];
                let colors: Colors =
                    cast::<L, K>(l, self.scene, &mut fields, at, &mut self.tile.counts);
                for lane in 0..L::WIDTH as u32 {
                    let (px, py) = (x + lane % across, y + lane / across);
                    if px < width && py < height {
                        pixels[(py * width + px) as usize] =
                            Vec4::from_array(colors.map(|c| c[lane as usize]));
                    }
                }
            }
        }
        self.tile.pixels = pixels;
    }
}
