//! The fast CPU renderer held against the reference.

use brickscope::classify::{OpacityCurve, OpacityPoint};
use brickscope::engine::{EngineOptions, InstructionSet, Picture};
use brickscope::scene::{Mode, PictureSettings, Shading, ShadingModel, Technique, TransferMode};
use brickscope::volume::VoxelType;

use crate::compare::{assert_same_bits, assert_twins, coverage};
use crate::scenes::{TestStore, cpu, field, reference, settings, store_of};

/// Few small blobs: nearly every block is empty, and activity changes from block to block. `inverse`: few small holes.
pub fn speckle(inverse: bool) -> TestStore {
    store_of(&mut field([90, 75, 70], VoxelType::U8, |p| {
        let cell = (p * 23.0).floor();
        let hash = (cell.x * 12.9898 + cell.y * 78.233 + cell.z * 37.719).sin() * 43758.547;
        let is_blob = hash - hash.floor() > 0.97;
        if is_blob == inverse { 0.0 } else { 0.9 }
    }))
}

/// An unlit picture of `mode`; one of minima shows those, too, that most transfer functions leave transparent. Smaller than
/// others, as each is drawn with every kind of vector, but of several tiles.
pub fn picture(store: &TestStore, mode: Mode) -> PictureSettings {
    let mut s = unlit(settings(&store.store, mode));
    s.size = [96, 96];
    if matches!(mode, Mode::MinIp | Mode::Mean) {
        let meta = store.store.meta();
        let ends = [meta.value_min, meta.value_max].map(|v| meta.rescale.physical(v));
        s.classification.transfer.opacity = OpacityCurve::new(vec![
            OpacityPoint::linear(ends[0], 0.8),
            OpacityPoint::linear(ends[1], 0.3),
        ])
        .unwrap();
    }
    s
}

/// The same, pre-integrated.
pub fn preintegrated(mut s: PictureSettings) -> PictureSettings {
    s.classification.transfer_mode = TransferMode::Preintegrated;
    s
}

/// Draws with every kind of vector, compares with the reference, and demands that there is something to compare. The samples
/// that the default technique took, and the reference's picture.
pub fn check(store: &TestStore, settings: &PictureSettings, what: &str) -> (u64, Picture) {
    let mut taken = 0;
    let truth = reference(store, settings);
    assert!(
        coverage(&truth.image) > 0.02,
        "{what}: the picture is nearly empty"
    );
    for technique in [Technique::Default, Technique::Basic] {
        let settings = PictureSettings {
            technique,
            ..settings.clone()
        };
        for set in InstructionSet::available() {
            let options = EngineOptions {
                instructions: Some(set),
                ..EngineOptions::default()
            };
            let drawn = cpu(store, options).render(&settings).unwrap();
            let what = format!("{what}, {technique:?}, {}", set.name());
            if settings.shading.model == ShadingModel::None {
                assert_same_bits(&drawn.image, &truth.image, &what);
            } else {
                assert_twins(&drawn.image, &truth.image, 0, &what);
            }
            let (fast, slow) = (&drawn.stats, &truth.stats);
            assert_eq!(
                fast.samples + fast.samples_skipped,
                slow.samples,
                "{what}: every sample is either taken or skipped"
            );
            assert_eq!(
                fast.samples_contributing, slow.samples_contributing,
                "{what}: what contributes is taken"
            );
            if technique == Technique::Basic {
                assert_eq!(fast.samples_skipped, 0, "{what}: nothing is skipped");
            } else {
                taken = fast.samples;
            }
        }
    }
    (taken, truth)
}

pub fn unlit(mut s: PictureSettings) -> PictureSettings {
    s.shading.model = ShadingModel::None;
    s
}

pub fn lit(mut s: PictureSettings) -> PictureSettings {
    s.shading = Shading {
        model: ShadingModel::Phong,
        ..Shading::default()
    };
    s
}
