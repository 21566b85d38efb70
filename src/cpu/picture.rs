//! Whole pictures: parts of packets on all threads. A part is a tile, or pixels from a list, with all rays of its pixels.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use glam::Vec4;
use rayon::prelude::*;

use super::bricks::{BrickCache, CastLevel, LevelClassification, NearBricks, Purpose};
use super::cast::{Colors, Scene, Search, cast};
use super::field::{Field, VoxelKind, with_voxel_kind};
use super::intervals::Intervals;
use super::light::Light;
use super::rays::Packet;
use super::simd::{InstructionSet, Kernel, Lanes, PerLane};
use super::skip::Seen;
use super::surfaces::SurfaceTable;
use super::table::{SegmentTable, Table};
use crate::geom::Lod;
use crate::scene::{
    AntiAliasing, Classified, Extreme, Image, Mode, NO_DEPTHS, PictureSettings, RayCounts,
    RayFrame, RaySet, ShadingModel, Technique, add_ray,
};
use crate::store::{Store, StoreError};

/// Pixels along the edge of a tile: what a thread draws at once.
pub(super) const TILE: u32 = 32;
/// Pixels of a list that a thread draws at once.
const LISTED: usize = 1024;

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

/// A picture in work: settings made ready, and which parts are drawn.
#[derive(Debug)]
pub struct CpuPicture {
    frame: RayFrame,
    classified: Classified,
    settings: PictureSettings,
    image: Image,
    counts: RayCounts,
    rays: u64,
    /// The rays that are cast, and what tells those that follow; `None` once they are told.
    set: RaySet,
    anti_aliasing: Option<AntiAliasing>,
    /// One per level that is sampled, worked out when the first part is drawn.
    intervals: Option<Vec<Intervals>>,
    /// One per level that is sampled.
    tables: Vec<Table>,
    visible: u64,
    /// Of the set of rays.
    next_part: u32,
}

impl CpuPicture {
    /// Nothing is drawn yet.
    pub fn new(frame: RayFrame, classified: Classified, settings: PictureSettings) -> Self {
        Self {
            image: Image::for_settings(&settings),
            counts: RayCounts::default(),
            rays: 0,
            set: RaySet::first(settings.anti_aliasing),
            anti_aliasing: Some(settings.anti_aliasing),
            intervals: None,
            tables: classified
                .levels
                .iter()
                .map(|l| Table::new(&l.lut))
                .collect(),
            visible: 0,
            next_part: 0,
            frame,
            classified,
            settings,
        }
    }

    /// Are all parts drawn?
    pub fn is_done(&self) -> bool {
        self.anti_aliasing.is_none() && self.next_part >= self.parts()
    }

    /// Rays that each pixel of the next parts gets.
    pub fn rays_per_pixel(&self) -> usize {
        self.set.places.len()
    }

    /// Rays so far.
    pub fn rays(&self) -> u64 {
        self.rays
    }

    /// Samples so far.
    pub fn counts(&self) -> RayCounts {
        self.counts
    }

    /// Bricks of the levels in use that may be visible by the index; 0 before the first part is drawn.
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

    /// The picture, premultiplied, before the background; nothing where parts are missing.
    pub fn into_image(self) -> Image {
        self.image
    }

    /// How many parts its rays are cast in.
    fn parts(&self) -> u32 {
        match &self.set.pixels {
            Some(list) => list.len().div_ceil(LISTED) as u32,
            None => self.frame.size.map(|n| n.div_ceil(TILE)).iter().product(),
        }
    }

    /// Takes over what the next parts have become.
    fn take(&mut self, parts: Vec<Drawn>) {
        let size = self.frame.size;
        for drawn in parts {
            let part = Part::new(&self.set, size, self.next_part);
            for (n, color) in drawn.colors.iter().enumerate() {
                let [x, y] = part.pixel(n);
                let at = y as usize * size[0] as usize + x as usize;
                self.image.pixels[at] = *color;
                if let Some(&depths) = drawn.depths.get(n) {
                    self.image.note_depths(at, depths);
                }
            }
            self.counts += drawn.counts;
            self.rays += (drawn.colors.len() * self.set.places.len()) as u64;
            self.next_part += 1;
        }
        if self.next_part == self.parts()
            && let Some(how) = self.anti_aliasing.take()
            && let Some(set) = RaySet::second(how, &self.image)
        {
            (self.set, self.next_part) = (set, 0);
        }
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

    /// Draws up to `parts` more parts of `picture` on all threads of the current rayon pool.
    ///
    /// # Errors
    /// A brick, or the index of a level, can't be read; the parts are not drawn then.
    pub fn draw(&mut self, picture: &mut CpuPicture, parts: u32) -> Result<(), StoreError> {
        let last = picture.next_part.saturating_add(parts).min(picture.parts());
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
        let scene = scene_of(picture);
        let threads = rayon::current_num_threads();
        let drawn: Result<Vec<Drawn>, StoreError> = (picture.next_part..last)
            .into_par_iter()
            .map_init(
                || {
                    let near = levels.iter().map(|level| level.near(threads));
                    near.collect::<Vec<_>>()
                },
                |near, number| {
                    let drawn = with_voxel_kind!(stored_type, K => instructions.run_large(DrawPart {
                        scene: &scene,
                        near,
                        part: Part::new(&picture.set, picture.frame.size, number),
                        places: &picture.set.places,
                        kind: std::marker::PhantomData::<K>,
                    }));
                    match near.iter_mut().find_map(|n| n.error.take()) {
                        Some(error) => Err(error),
                        None => Ok(drawn),
                    }
                },
            )
            .collect();
        picture.take(drawn?);
        Ok(())
    }

    /// The levels of `picture`, under its classification.
    fn levels(&mut self, picture: &CpuPicture) -> Result<Vec<CastLevel<'_>>, StoreError> {
        let mut levels = Vec::with_capacity(picture.frame.used_levels);
        for (level, classified) in picture.frame.used().iter().zip(&picture.classified.levels) {
            self.cache.store().check_level(level.lod)?;
            let purpose = match (picture.settings.technique, picture.settings.mode) {
                (Technique::Basic, _) | (_, Mode::Mean) => Purpose::Everything,
                (_, mode @ (Mode::Mip | Mode::MinIp)) => Purpose::Extreme(Extreme::of_mode(mode)),
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

fn scene_of(picture: &CpuPicture) -> Scene<'_> {
    let (settings, classified) = (&picture.settings, &picture.classified);
    let levels = classified.levels.iter();
    let (extreme, range) = (Extreme::of_mode(settings.mode), classified.value_range);
    Scene {
        frame: &picture.frame,
        mode: settings.mode,
        tables: &picture.tables,
        segments: levels
            .filter_map(|l| l.preintegrated.as_deref().map(SegmentTable::new))
            .collect(),
        intervals: picture.intervals.as_deref().unwrap_or_default(),
        skips: settings.technique != Technique::Basic,
        depths: settings.depths,
        geometry: &settings.geometry,
        shading: &settings.shading,
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
            end: classified.extreme_end,
        },
    }
}

/// Pixels that are drawn together.
#[derive(Clone, Copy)]
enum Part<'s> {
    Tile { origin: [u32; 2], size: [u32; 2] },
    List(&'s [[u32; 2]]),
}

impl<'s> Part<'s> {
    /// Part number `number` of a set of rays in a picture of `size` pixels.
    fn new(set: &'s RaySet, [width, height]: [u32; 2], number: u32) -> Self {
        if let Some(list) = &set.pixels {
            let from = number as usize * LISTED;
            return Self::List(&list[from..list.len().min(from + LISTED)]);
        }
        let across = width.div_ceil(TILE);
        let [x, y] = [number % across * TILE, number / across * TILE];
        Self::Tile {
            origin: [x, y],
            size: [TILE.min(width - x), TILE.min(height - y)],
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Tile { size: [w, h], .. } => (w * h) as usize,
            Self::List(list) => list.len(),
        }
    }

    /// Its `n`-th pixel, in the picture.
    fn pixel(&self, n: usize) -> [u32; 2] {
        match self {
            Self::Tile { origin, size } => {
                let n = n as u32;
                [origin[0] + n % size[0], origin[1] + n / size[0]]
            }
            Self::List(list) => list[n],
        }
    }

    fn packets<L: Lanes>(&self) -> usize {
        let [across, down] = L::SHAPE;
        match self {
            Self::Tile { size: [w, h], .. } => (w.div_ceil(across) * h.div_ceil(down)) as usize,
            Self::List(list) => list.len().div_ceil(L::WIDTH),
        }
    }

    /// Packet number `packet`, with rays through `place` of their pixels.
    #[inline(always)]
    fn packet<L: Lanes>(
        &self,
        l: L,
        frame: &RayFrame,
        packet: usize,
        place: [f32; 2],
    ) -> Packet<L> {
        match self {
            Self::Tile { origin, size } => {
                let [x, y] = first_of_packet::<L>(size[0], packet);
                Packet::block(l, frame, [origin[0] + x, origin[1] + y], place)
            }
            Self::List(list) => {
                let from = packet * L::WIDTH;
                let to = list.len().min(from + L::WIDTH);
                Packet::listed(l, frame, &list[from..to], place)
            }
        }
    }

    /// Which of its pixels a lane of a packet is; `None` outside.
    #[inline(always)]
    fn number<L: Lanes>(&self, packet: usize, lane: usize) -> Option<usize> {
        match self {
            Self::Tile { size: [w, h], .. } => {
                let [x, y] = first_of_packet::<L>(*w, packet);
                let (x, y) = (x + lane as u32 % L::SHAPE[0], y + lane as u32 / L::SHAPE[0]);
                (x < *w && y < *h).then_some((y * w + x) as usize)
            }
            Self::List(list) => {
                let number = packet * L::WIDTH + lane;
                (number < list.len()).then_some(number)
            }
        }
    }
}

/// The first pixel of a packet of a tile `width` pixels wide.
#[inline(always)]
fn first_of_packet<L: Lanes>(width: u32, packet: usize) -> [u32; 2] {
    let [across, down] = L::SHAPE;
    let in_row = width.div_ceil(across);
    let packet = packet as u32;
    [packet % in_row * across, packet / in_row * down]
}

/// What a part has become.
struct Drawn {
    /// In the order of its pixels.
    colors: Vec<Vec4>,
    /// The same, where they are told; else empty.
    depths: Vec<[f32; 2]>,
    counts: RayCounts,
}

/// Draws a part, packet by packet, ray by ray of its pixels.
struct DrawPart<'t, 's, 'a, K> {
    scene: &'t Scene<'s>,
    near: &'t mut [NearBricks<'a>],
    part: Part<'t>,
    places: &'t [[f32; 2]],
    kind: std::marker::PhantomData<K>,
}

impl<K: VoxelKind> Kernel for DrawPart<'_, '_, '_, K> {
    type Output = Drawn;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Drawn {
        let (part, frame) = (self.part, self.scene.frame);
        let mut drawn = Drawn {
            colors: vec![Vec4::ZERO; part.len()],
            depths: if self.scene.depths {
                vec![NO_DEPTHS; part.len()]
            } else {
                Vec::new()
            },
            counts: RayCounts::default(),
        };
        let mut fields = Vec::with_capacity(self.near.len());
        for (near, level) in self.near.iter_mut().zip(frame.used()) {
            fields.push(Field::new(l, near, level, self.scene.interpolation));
        }
        for packet in 0..part.packets::<L>() {
            for (number, &place) in self.places.iter().enumerate() {
                let rays = part.packet(l, frame, packet, place);
                let (colors, depths): (Colors, [PerLane<f32>; 2]) =
                    cast::<L, K>(l, self.scene, &mut fields, rays, &mut drawn.counts);
                for lane in 0..L::WIDTH {
                    if let Some(n) = part.number::<L>(packet, lane) {
                        let color = Vec4::from_array(colors.map(|c| c[lane]));
                        add_ray(&mut drawn.colors[n], color, number, self.places.len());
                        if let Some(known) = drawn.depths.get_mut(n) {
                            *known = [0, 1].map(|k| known[k].min(depths[k][lane]));
                        }
                    }
                }
            }
        }
        drawn
    }
}
