//! The metadata: what the store says of its volume, as JSON.
//!
//! Values (`value_min`, histogram, percentiles) are in *stored* units; [`StoreMeta::rescale`] makes them physical.
//! Statistics are of level 0, each voxel once, borders not counted.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3, U64Vec3};
use serde::{Deserialize, Serialize};

use super::error::{Fault, Part};
use super::header::{Header, MAX_METADATA_LEN};
use crate::geom::BrickGrid;
use crate::volume::{Rescale, StoredType, VoxelType};

/// Bins of the histogram.
pub const HISTOGRAM_BINS: usize = 4096;

/// How source values became stored ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conversion {
    /// stored = source + `offset`: 128 for i8 kept as u8, 32768 for i16 kept as u16, else 0.
    pub offset: u32,
    /// Finite voxels whose stored value is not exactly the source's (rounded to f32).
    pub lossy_values: u64,
    /// NaN voxels, replaced by the least finite value of the volume.
    pub nan_values: u64,
    /// Infinite voxels, replaced by the nearest finite value of the volume.
    pub inf_values: u64,
}

impl Conversion {
    /// True when every source value can be had back.
    pub fn is_exact(&self) -> bool {
        self.lossy_values == 0 && self.nan_values == 0 && self.inf_values == 0
    }
}

/// How often values occur: bin i counts the voxels in [start + i·width, start + (i+1)·width); the last bin includes the
/// greatest value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Lower edge of the first bin: the least stored value.
    pub start: f64,
    /// Width of a bin; a whole number for u8 and u16, so that all bins hold equally many values.
    pub width: f64,
    /// [`HISTOGRAM_BINS`] counts. For f32 exact to the resolution of `bricking::stats`.
    pub counts: Vec<u64>,
}

/// Stored values below which a share of the voxels lies (nearest rank: exact for u8 and u16).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "p5 is the 5th percentile, p0_1 the 0.1th")]
pub struct Percentiles {
    pub p0_1: f64,
    pub p1: f64,
    pub p5: f64,
    pub p25: f64,
    pub p50: f64,
    pub p75: f64,
    pub p95: f64,
    pub p99: f64,
    pub p99_9: f64,
    /// 1st percentile of the voxels above the minimum (the minimum, when all voxels are equal).
    pub p1_above_min: f64,
    /// 99.9th percentile of the voxels above the minimum.
    pub p99_9_above_min: f64,
}

/// A level of detail.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelMeta {
    /// Voxels along each axis.
    pub dims: U64Vec3,
    /// Voxels of level 0 per voxel of this level, along each axis: powers of two.
    pub scale: DVec3,
}

/// What a store says of its volume.
#[derive(Clone, Debug, PartialEq)]
pub struct StoreMeta {
    /// Voxels of level 0 along each axis.
    pub dims: U64Vec3,
    /// Type of the source's voxels.
    pub source_type: VoxelType,
    /// Type of the stored voxels.
    pub stored_type: StoredType,
    /// How one became the other.
    pub conversion: Conversion,
    /// physical = slope · *stored* + intercept.
    pub rescale: Rescale,
    /// physical = slope · *source* + intercept, as it came in.
    pub source_rescale: Rescale,
    /// Voxel index (centres at the integers) to world millimetres, RAS+. Finite and invertible.
    pub world_from_index: DAffine3,
    /// Unit of the physical value, such as `HU`; empty when unknown.
    pub unit: String,
    /// Least stored value.
    pub value_min: f64,
    /// Greatest stored value.
    pub value_max: f64,
    /// How often values occur.
    pub histogram: Histogram,
    /// Percentiles of the values.
    pub percentiles: Percentiles,
    /// The levels, finest first.
    pub levels: Vec<LevelMeta>,
    /// What the source was called.
    pub source_name: String,
    /// Wrapping sum over the bricks of level 0 of the XXH3-64 of their own voxels (little-endian, x fastest, cut to the
    /// volume), seeded with the brick's linear index: the same whatever the order of writing.
    pub source_hash: u64,
    /// Program and version that wrote the store.
    pub writer: String,
    /// What else the source said and was asked to be kept: names and texts. Empty unless somebody asked.
    pub tags: BTreeMap<String, String>,
}

impl StoreMeta {
    /// Distance of neighbouring voxel centres along each index axis, in millimetres.
    pub fn spacing(&self) -> DVec3 {
        let m = self.world_from_index.matrix3;
        DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
    }

    /// World position of the centre of voxel (0, 0, 0), in millimetres.
    pub fn origin(&self) -> DVec3 {
        self.world_from_index.translation
    }

    /// Unit vectors of the index axes in the world, as columns.
    pub fn direction(&self) -> DMat3 {
        let m = self.world_from_index.matrix3;
        DMat3::from_cols(
            m.x_axis.normalize(),
            m.y_axis.normalize(),
            m.z_axis.normalize(),
        )
    }

    /// The JSON text.
    pub fn to_json(&self) -> Vec<u8> {
        let m = self.world_from_index.matrix3;
        let json = Json {
            writer: self.writer.clone(),
            dims: self.dims,
            source_type: self.source_type,
            stored_type: self.stored_type,
            conversion: self.conversion,
            rescale: self.rescale,
            source_rescale: self.source_rescale,
            world_from_index: [m.x_axis, m.y_axis, m.z_axis, self.origin()],
            spacing: Some(self.spacing()),
            origin: Some(self.origin()),
            direction: Some(self.direction().transpose().to_cols_array_2d()),
            unit: self.unit.clone(),
            value_min: self.value_min,
            value_max: self.value_max,
            percentiles: self.percentiles,
            levels: self.levels.clone(),
            source_name: self.source_name.clone(),
            source_hash: format!("{:016x}", self.source_hash),
            histogram: self.histogram.clone(),
            tags: self.tags.clone(),
        };
        serde_json::to_vec(&json).expect("invariant: plain numbers and strings become JSON")
    }

    /// Parses the metadata of a store with this `header`, and checks it against it.
    ///
    /// # Errors
    /// It is not the JSON of a store, or it contradicts itself or the header.
    pub fn from_json(bytes: &[u8], header: &Header) -> Result<Self, Fault> {
        let bad = |expected: &str, found: String| {
            Fault::new(Part::Metadata, header.metadata_offset, expected, found)
        };
        if bytes.len() as u64 > MAX_METADATA_LEN {
            return Err(bad("at most 16 MiB", format!("{} bytes", bytes.len())));
        }
        let json: Json =
            serde_json::from_slice(bytes).map_err(|e| bad("the JSON of a store", e.to_string()))?;
        let [x, y, z, origin] = json.world_from_index;
        let meta = Self {
            dims: json.dims,
            source_type: json.source_type,
            stored_type: json.stored_type,
            conversion: json.conversion,
            rescale: json.rescale,
            source_rescale: json.source_rescale,
            world_from_index: DAffine3 {
                matrix3: DMat3::from_cols(x, y, z),
                translation: origin,
            },
            unit: json.unit,
            value_min: json.value_min,
            value_max: json.value_max,
            histogram: json.histogram,
            percentiles: json.percentiles,
            levels: json.levels,
            source_name: json.source_name,
            source_hash: u64::from_str_radix(&json.source_hash, 16)
                .map_err(|_| bad("a source hash of 16 hex digits", json.source_hash))?,
            writer: json.writer,
            tags: json.tags,
        };
        meta.check(header)
            .map_err(|(expected, found)| bad(expected, found))?;
        Ok(meta)
    }

    fn check(&self, header: &Header) -> Result<(), (&'static str, String)> {
        if self.stored_type != header.stored_type {
            return Err((
                "the header's voxel type",
                format!("{}, not {}", self.stored_type, header.stored_type),
            ));
        }
        let affine = &self.world_from_index;
        let det = affine.matrix3.determinant();
        if !affine.is_finite() || !det.is_finite() || det == 0.0 {
            return Err((
                "a finite, invertible world_from_index",
                format!("determinant {det}"),
            ));
        }
        for r in [self.rescale, self.source_rescale] {
            if !(r.slope.is_finite() && r.intercept.is_finite() && r.slope != 0.0) {
                return Err((
                    "a finite rescale with a slope other than 0",
                    format!("{r:?}"),
                ));
            }
        }
        if !(self.value_min.is_finite()
            && self.value_max.is_finite()
            && self.value_min <= self.value_max)
        {
            return Err((
                "a finite value range",
                format!("{} to {}", self.value_min, self.value_max),
            ));
        }
        let h = &self.histogram;
        if h.counts.len() != HISTOGRAM_BINS
            || !(h.start.is_finite() && h.width.is_finite() && h.width > 0.0)
        {
            return Err((
                "a histogram of 4096 bins",
                format!(
                    "{} bins of width {} from {}",
                    h.counts.len(),
                    h.width,
                    h.start
                ),
            ));
        }
        self.check_levels(header)
    }

    fn check_levels(&self, header: &Header) -> Result<(), (&'static str, String)> {
        if self.levels.len() != header.levels.len() {
            return Err((
                "the header's number of levels",
                self.levels.len().to_string(),
            ));
        }
        let mut below = LevelMeta {
            dims: self.dims,
            scale: DVec3::ONE,
        };
        for (i, (level, place)) in self.levels.iter().zip(&header.levels).enumerate() {
            if BrickGrid::for_voxels(level.dims).map(|g| g.bricks) != Some(place.bricks) {
                return Err((
                    "levels as large as the header's grids",
                    format!("level {i} of {} voxels", level.dims),
                ));
            }
            let ratio = level.scale / below.scale;
            let holds = (0..3).all(|a| {
                if i > 0 && ratio[a] == 2.0 {
                    level.dims[a] == below.dims[a].div_ceil(2)
                } else {
                    ratio[a] == 1.0 && level.dims[a] == below.dims[a]
                }
            });
            if !holds {
                return Err((
                    "each level to halve axes of the one below",
                    format!(
                        "level {i} of {} voxels at scale {}",
                        level.dims, level.scale
                    ),
                ));
            }
            below = *level;
        }
        Ok(())
    }
}

/// The metadata as it lies in the file. `spacing`, `origin` and `direction` (rows) restate `world_from_index` (columns)
/// for other readers; this one uses the exact matrix alone.
#[derive(Serialize, Deserialize)]
struct Json {
    writer: String,
    dims: U64Vec3,
    source_type: VoxelType,
    stored_type: StoredType,
    conversion: Conversion,
    rescale: Rescale,
    source_rescale: Rescale,
    world_from_index: [DVec3; 4],
    #[serde(default)]
    spacing: Option<DVec3>,
    #[serde(default)]
    origin: Option<DVec3>,
    #[serde(default)]
    direction: Option<[[f64; 3]; 3]>,
    unit: String,
    value_min: f64,
    value_max: f64,
    percentiles: Percentiles,
    levels: Vec<LevelMeta>,
    source_name: String,
    source_hash: String,
    histogram: Histogram,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    tags: BTreeMap<String, String>,
}
