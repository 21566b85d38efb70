//! What is compared: per system the pictures, and for each picture the configurations that draw it.
//!
//! All configurations of a comparison classify alike, so that drawing them in turns costs none of them a new classification.

use super::theirs::{self, Reported};
use super::{SeedPictures, SeedTable};
use crate::camera::Camera;
use crate::scene::{
    AntiAliasing, GradientFilter, IsoSurface, Mode, PictureSettings, SamplePattern, Shading,
    ShadingModel, SlabShape, Technique,
};

/// Step of the pictures, voxels.
const STEP: f64 = 1.0;
/// Step that refined surfaces bear (techniques.md T1.3), voxels.
const REFINED_STEP: f64 = 5.0;
/// Thresholds of selective super-sampling.
const THRESHOLDS: [f32; 4] = [0.02, 0.05, 0.1, AntiAliasing::THRESHOLD];
/// An opacity that no ray has: none ends early.
const NO_CUTOFF: f32 = 2.0;
/// Work-groups, and samples at once, beside the default slab.
const SHAPES: [[u32; 3]; 6] = [
    [8, 8, 4],
    [8, 8, 8],
    [8, 8, 16],
    [16, 8, 8],
    [16, 16, 4],
    [32, 8, 4],
];

/// One picture, drawn in several ways.
#[derive(Clone, Debug)]
pub(super) struct Comparison {
    pub(super) table: SeedTable,
    /// In words.
    pub(super) picture: String,
    pub(super) columns: Vec<Column>,
}

/// One way.
#[derive(Clone, Debug)]
pub(super) struct Column {
    /// In words.
    pub(super) name: String,
    pub(super) settings: PictureSettings,
    /// With technique slab.
    pub(super) slab: SlabShape,
    pub(super) drawing: Drawing,
    /// The column whose time is divided by this one's, and what they found there.
    pub(super) against: Option<(usize, &'static [Reported])>,
    /// The column whose pictures this one's should be.
    pub(super) exact: Option<usize>,
    /// Count what is active in the volume?
    pub(super) counts_active: bool,
}

/// How a frame is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Drawing {
    /// To its end.
    Whole,
    /// At once, as while the camera moves.
    Moving,
}

impl Column {
    fn new(name: impl Into<String>, settings: PictureSettings) -> Self {
        Self {
            name: name.into(),
            settings,
            slab: SlabShape::default(),
            drawing: Drawing::Whole,
            against: None,
            exact: None,
            counts_active: false,
        }
    }

    fn against(mut self, column: usize, theirs: &'static [Reported]) -> Self {
        self.against = Some((column, theirs));
        self
    }

    fn exact(mut self, column: usize) -> Self {
        self.exact = Some(column);
        self
    }

    fn in_slabs(mut self, slab: SlabShape) -> Self {
        self.slab = slab;
        self
    }

    fn moving(mut self) -> Self {
        self.drawing = Drawing::Moving;
        self
    }

    fn counting_active(mut self) -> Self {
        self.counts_active = true;
        self
    }
}

/// The comparisons of a system. The cameras of the pictures are of no account.
pub(super) fn comparisons(table: SeedTable, pictures: &SeedPictures) -> Vec<Comparison> {
    let plan = Plan { table, pictures };
    match table {
        SeedTable::T1 => plan.mesh(),
        SeedTable::T2 => plan.leaping().into_iter().chain([plan.rays()]).collect(),
        SeedTable::T3 => plan.layers(),
        SeedTable::T4 => plan.streams(),
        SeedTable::T5 => plan.slabs(),
    }
}

struct Plan<'a> {
    table: SeedTable,
    pictures: &'a SeedPictures,
}

impl Plan<'_> {
    fn comparison(&self, picture: impl Into<String>, columns: Vec<Column>) -> Comparison {
        Comparison {
            table: self.table,
            picture: picture.into(),
            columns,
        }
    }

    /// A picture at step 1, its surfaces not refined, by technique basic.
    fn picture(&self, mode: Mode) -> PictureSettings {
        let pictures = self.pictures;
        let transfer = if mode.classifies_whole_range() {
            &pictures.projected
        } else {
            &pictures.composited
        };
        let camera = Camera::turntable(0, 1, glam::DVec3::ZERO, 1.0);
        let mut settings = PictureSettings::new(mode, transfer.clone(), camera);
        settings.size = [pictures.size; 2];
        settings.lod = pictures.lod;
        settings.step = STEP;
        settings.moving_step = STEP;
        settings.refine = false;
        settings.technique = Technique::Basic;
        settings.classification.opacity_unit_mm = pictures.opacity_unit_mm;
        if mode == Mode::Iso {
            settings.classification.iso = vec![IsoSurface::opaque(pictures.iso)];
        }
        settings
    }

    fn lit(&self, gradient: GradientFilter) -> PictureSettings {
        PictureSettings {
            shading: Shading {
                model: ShadingModel::Phong,
                gradient,
                ..Shading::of_mode(Mode::Dvr)
            },
            ..self.picture(Mode::Dvr)
        }
    }

    /// T1: mesh and refinement.
    fn mesh(&self) -> Vec<Comparison> {
        let iso = self.picture(Mode::Iso);
        let refined = PictureSettings {
            refine: true,
            step: REFINED_STEP,
            ..by(&iso, Technique::Default)
        };
        let (dvr, lit) = (self.picture(Mode::Dvr), self.lit(GradientFilter::Central));
        let surfaces = vec![
            Column::new("basic", iso.clone()),
            Column::new("mesh", by(&iso, Technique::Default))
                .against(0, theirs::T1_MESH)
                .counting_active(),
            Column::new(format!("mesh, refined, step {REFINED_STEP}"), refined)
                .against(0, theirs::T1_REFINED),
        ];
        let colors = vec![
            Column::new("basic", dvr.clone()),
            Column::new("mesh", by(&dvr, Technique::Default))
                .against(0, &[])
                .counting_active(),
            Column::new("lit, basic", lit.clone()),
            Column::new("lit, mesh", by(&lit, Technique::Default)).against(2, &[]),
        ];
        // Their figures of light are of the caster with the mesh.
        let light = vec![
            Column::new("mesh", by(&dvr, Technique::Default)),
            Column::new("mesh, lit", by(&lit, Technique::Default)).against(0, theirs::T1_LIT),
        ];
        vec![
            self.comparison("iso", surfaces),
            self.comparison("dvr", colors),
            self.comparison("dvr, light", light),
        ]
    }

    /// T2: leaping.
    fn leaping(&self) -> Vec<Comparison> {
        [
            (Mode::Iso, theirs::T2_LEAP_ISO),
            (Mode::Dvr, theirs::T2_LEAP_DVR),
        ]
        .into_iter()
        .map(|(mode, theirs)| {
            let mut columns = Vec::new();
            for technique in [Technique::Basic, Technique::Default] {
                let without = by(&self.picture(mode), technique);
                let with = PictureSettings {
                    leap: true,
                    ..without.clone()
                };
                let first = columns.len();
                let name = technique.name();
                columns.push(Column::new(name, without).moving());
                columns.push(
                    Column::new(format!("{name}, leaping"), with)
                        .moving()
                        .against(first, theirs)
                        .exact(first),
                );
            }
            self.comparison(mode.name(), columns)
        })
        .collect()
    }

    /// T2: super-sampling.
    fn rays(&self) -> Comparison {
        use SamplePattern::{Eight, Four, FourRotated, Sixteen, Two};
        /// The column that has all rays of what the selective ones have some of.
        const FULL: usize = 3;
        let one = PictureSettings {
            refine: true,
            ..by(&self.picture(Mode::Iso), Technique::Default)
        };
        let with = |anti_aliasing| PictureSettings {
            anti_aliasing,
            ..one.clone()
        };
        let full = |pattern: SamplePattern, theirs| {
            let name = format!("{}×", pattern.name());
            Column::new(name, with(AntiAliasing::Full(pattern))).against(0, theirs)
        };
        let mut columns = vec![
            Column::new("1×", one.clone()),
            full(Two, theirs::T2_TWO),
            full(Four, theirs::T2_FOUR),
            full(FourRotated, theirs::T2_FOUR),
            full(Eight, &[]),
        ];
        columns.extend(THRESHOLDS.map(|threshold| {
            let selective = AntiAliasing::Selective {
                pattern: FourRotated,
                threshold,
            };
            Column::new(format!("4r× from {threshold} on"), with(selective)).against(FULL, &[])
        }));
        let exact = columns.len();
        for column in &mut columns {
            column.exact = Some(exact);
        }
        columns.push(full(Sixteen, &[]));
        self.comparison("iso, rays of a pixel", columns)
    }

    /// T3: layers against the plain caster for each filter, then by size and by rate. The default caster beside them has the
    /// same skipping without passes.
    fn layers(&self) -> Vec<Comparison> {
        let interval = PictureSettings {
            classification: crate::scene::Classification {
                iso: self.pictures.interval().map(IsoSurface::opaque).to_vec(),
                ..self.picture(Mode::Iso).classification
            },
            ..self.picture(Mode::Iso)
        };
        let filters = [
            ("iso interval", interval),
            ("look-up table (dvr)", self.picture(Mode::Dvr)),
            ("maximum", self.picture(Mode::Mip)),
            ("minimum", self.picture(Mode::MinIp)),
            ("mean", self.picture(Mode::Mean)),
            ("semi-transparent (xray)", self.picture(Mode::Xray)),
            ("gradient", self.picture(Mode::Gradient)),
        ];
        let mut comparisons: Vec<Comparison> = filters
            .into_iter()
            .map(|(name, picture)| {
                let columns = vec![
                    Column::new("basic", picture.clone()),
                    Column::new("layers", by(&picture, Technique::Layers))
                        .against(0, theirs::T3_ENHANCED),
                    Column::new("default", by(&picture, Technique::Default)).against(0, &[]),
                ];
                self.comparison(name, columns)
            })
            .collect();
        // A maximum ends no ray early, and classifies at any step alike.
        let maximum = self.picture(Mode::Mip);
        let (mut sizes, mut rates) = (Vec::new(), Vec::new());
        for technique in [Technique::Basic, Technique::Layers] {
            let picture = by(&maximum, technique);
            let name = technique.name();
            let theirs = [&[], theirs::T3_PIXELS_4, theirs::T3_PIXELS_9];
            let edges = [1, 2, 3].map(|halves| half(self.pictures.size, halves));
            scale(
                &mut sizes,
                theirs,
                edges.map(|edge| {
                    let size = PictureSettings {
                        size: [edge; 2],
                        ..picture.clone()
                    };
                    Column::new(format!("{name} {edge}²"), size)
                }),
            );
            let theirs = [&[], theirs::T3_RATE_2, theirs::T3_RATE_4];
            scale(
                &mut rates,
                theirs,
                [2.0, 1.0, 0.5].map(|step| {
                    let rate = PictureSettings {
                        step,
                        ..picture.clone()
                    };
                    Column::new(format!("{name}, step {step}"), rate)
                }),
            );
        }
        comparisons.push(self.comparison("maximum, by size", sizes));
        comparisons.push(self.comparison("maximum, by rate", rates));
        comparisons
    }

    /// T4: early termination and skipping.
    fn streams(&self) -> Vec<Comparison> {
        let plain = |mode| PictureSettings {
            opacity_cutoff: NO_CUTOFF,
            ..self.picture(mode)
        };
        let dvr = self.picture(Mode::Dvr);
        let opaque = vec![
            Column::new("plain", plain(Mode::Dvr)),
            Column::new("+ERT (basic)", dvr.clone()).against(0, theirs::T4_ERT),
            Column::new("+ERT+ESS (multipass)", by(&dvr, Technique::Multipass))
                .against(0, theirs::T4_ESS),
            Column::new("+ERT+ESS (default)", by(&dvr, Technique::Default))
                .against(0, theirs::T4_ESS),
        ];
        let xray = self.picture(Mode::Xray);
        let clear = vec![
            Column::new("plain", plain(Mode::Xray)),
            Column::new("+ERT+ESS (default)", by(&xray, Technique::Default)).against(0, &[]),
            // What they lost is the cost of passes: against the same skipping without them.
            Column::new("+ERT+ESS (multipass)", by(&xray, Technique::Multipass))
                .against(1, theirs::T4_SEMI_TRANSPARENT),
        ];
        vec![
            self.comparison("dvr", opaque),
            self.comparison("semi-transparent (xray)", clear),
        ]
    }

    /// T5: slabs, by work per sample and size, then by the shape of the slabs.
    fn slabs(&self) -> Vec<Comparison> {
        let levels = [
            ("RC", self.picture(Mode::Mip), [theirs::T5_UNLIT; 3]),
            ("TF", self.picture(Mode::Dvr), [theirs::T5_UNLIT; 3]),
            ("PH", self.lit(GradientFilter::Central), theirs::T5_LIT),
            // They measured none.
            ("GF", self.lit(GradientFilter::Filtered), [&[][..]; 3]),
        ];
        let mut comparisons = Vec::new();
        for (name, picture, theirs) in levels {
            for (halves, theirs) in [2, 3, 4].into_iter().zip(theirs) {
                let edge = half(self.pictures.size, halves);
                let sized = PictureSettings {
                    size: [edge; 2],
                    ..picture.clone()
                };
                let columns = vec![
                    Column::new("default", by(&sized, Technique::Default)),
                    Column::new("slab", by(&sized, Technique::Slab)).against(0, theirs),
                ];
                comparisons.push(self.comparison(format!("{name} {edge}²"), columns));
            }
        }
        for (name, gradient) in [
            ("PH", GradientFilter::Central),
            ("GF", GradientFilter::Filtered),
        ] {
            let picture = by(&self.lit(gradient), Technique::Slab);
            let mut columns = vec![Column::new("default slab", picture.clone())];
            columns.extend(SHAPES.map(|[width, height, depth]| {
                let shape = SlabShape {
                    width,
                    height,
                    depth,
                };
                let column = Column::new(shape.to_string(), picture.clone()).in_slabs(shape);
                column.against(0, &[])
            }));
            comparisons.push(self.comparison(format!("{name}, by shape"), columns));
        }
        comparisons
    }
}

/// The same by another technique.
fn by(settings: &PictureSettings, technique: Technique) -> PictureSettings {
    PictureSettings {
        technique,
        ..settings.clone()
    }
}

/// So many halves of an edge, at least a pixel.
fn half(edge: u32, halves: u32) -> u32 {
    (edge * halves / 2).max(1)
}

/// Adds columns that are held against the first of them.
fn scale(columns: &mut Vec<Column>, theirs: [&'static [Reported]; 3], own: [Column; 3]) {
    let first = columns.len();
    for (number, (column, theirs)) in own.into_iter().zip(theirs).enumerate() {
        columns.push(match number {
            0 => column,
            _ => column.against(first, theirs),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::seeds::tests::pictures;

    /// Whatever is held against another column is held against one that is measured itself, of one classification.
    #[test]
    fn every_comparison_is_between_its_own_columns() {
        for table in SeedTable::ALL {
            let all = comparisons(table, &pictures());
            assert!(!all.is_empty(), "{table:?}");
            for comparison in all {
                let columns = &comparison.columns;
                assert!(columns[0].against.is_none(), "{comparison:?}");
                for (own, column) in columns.iter().enumerate() {
                    let others = [column.against.map(|(c, _)| c), column.exact];
                    for other in others.into_iter().flatten() {
                        assert!(other < columns.len(), "{column:?}");
                    }
                    assert_ne!(column.against.map(|(c, _)| c), Some(own), "{column:?}");
                    let first = &columns[0].settings;
                    assert_eq!(first.mode, column.settings.mode, "{column:?}");
                    assert_eq!(first.classification, column.settings.classification);
                    assert_eq!(columns[0].drawing, column.drawing, "{column:?}");
                }
                let mut names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
                names.sort_unstable();
                names.dedup();
                assert_eq!(names.len(), columns.len(), "each has its name");
            }
        }
    }

    /// What techniques.md asks of each table, by number of pictures.
    #[test]
    fn tables_have_what_the_systems_compared() {
        let count = |table| comparisons(table, &pictures()).len();
        // Six filters, gradient, by size, by rate; four levels of work in three sizes, two by shape.
        assert_eq!(SeedTable::ALL.map(count), [3, 3, 9, 2, 14]);
        let interval = &comparisons(SeedTable::T3, &pictures())[0].columns[0];
        assert_eq!(interval.settings.classification.iso.len(), 2);
        let rays = &comparisons(SeedTable::T2, &pictures())[2].columns;
        assert_eq!(rays.len(), 1 + 4 + 4 + 1, "none, full, selective, 16");
        assert!(
            rays.last().is_some_and(
                |c| c.settings.anti_aliasing == AntiAliasing::Full(SamplePattern::Sixteen)
            ),
            "what the others are measured against"
        );
        assert_eq!((half(512, 1), half(512, 3), half(1, 1)), (256, 768, 1));
    }
}
