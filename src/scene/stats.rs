//! The numbers of a picture, as `--stats` prints them (cli.md).

use std::collections::BTreeMap;

use serde::Serialize;

/// What rays did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// Samples taken along rays (not those of gradients or refinement).
    pub samples: u64,
    /// Samples inside the volume that skipping saved; those behind a terminated ray don't count.
    pub skipped: u64,
    /// Samples that changed the picture: with opacity (`dvr`, `xray`, `gradient`; pre-integrated: that end a
    /// segment with opacity), a new extreme of their ray (`mip`, `minip`), surfaces met (`iso`), every one (`mean`).
    pub contributing: u64,
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.samples += other.samples;
        self.skipped += other.skipped;
        self.contributing += other.contributing;
    }
}

/// What technique `layers` did with a picture (techniques.md T3).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LayerStats {
    /// Nodes of the quadtrees, each time that one was made.
    pub nodes: u64,
    /// Passes over the nodes, each of several layers.
    pub passes: u64,
    /// Cell by cell and, where a pixel has several rays, ray by ray.
    pub cells: Vec<CellSamples>,
}

/// The samples of a cell of 16×16 pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellSamples {
    /// Its first pixel.
    pub origin: [u32; 2],
    /// The most samples that one of its rays has in the interval of the bounding mesh.
    pub layers: u32,
    /// The most samples that one of them took.
    pub most: u32,
    /// Samples that all of them took.
    pub samples: u64,
}

/// The keys of `--stats`, in cli.md's meaning; `None` where not applicable.
#[derive(Clone, Debug, Default, Serialize)]
#[expect(missing_docs, reason = "the names are the contract of cli.md")]
pub struct PictureStats {
    pub device: String,
    pub adapter: Option<String>,
    pub driver: Option<String>,
    pub version: String,
    pub wall_ms: f64,
    pub first_complete_ms: Option<f64>,
    pub converged_ms: Option<f64>,
    pub converged: bool,
    pub passes_ms: Option<BTreeMap<String, f64>>,
    pub rays: u64,
    pub samples: u64,
    pub samples_skipped: u64,
    pub bricks_visible: Option<u64>,
    pub bricks_requested: Option<u64>,
    pub bricks_read: Option<u64>,
    pub bricks_uploaded: Option<u64>,
    pub bricks_evicted: Option<u64>,
    pub bricks_touched: Option<u64>,
    pub bytes_read: Option<u64>,
    pub bytes_decompressed: Option<u64>,
    pub bytes_uploaded: Option<u64>,
    pub atlas_slots: Option<u64>,
    pub atlas_bytes: Option<u64>,
    pub gpu_bytes: Option<u64>,
    pub mesh_triangles: Option<u64>,
    /// The level that was drawn. Not a key of `--stats`: cli.md lists those.
    #[serde(skip)]
    pub lod: u8,
    /// [`RayCounts::contributing`]; `None` from a renderer that doesn't count them. Not a key of `--stats` either.
    #[serde(skip)]
    pub samples_contributing: Option<u64>,
    /// Did rays start where those of the frame before allowed it (techniques.md T2.2)? Not a key of `--stats` either.
    #[serde(skip)]
    pub leapt: bool,
    /// Of technique `layers`; no key either.
    #[serde(skip)]
    pub layers: Option<LayerStats>,
}
