//! Modes mip and minip leave out bricks that can't be better than what a ray has already met, on both renderers: far
//! fewer samples, the same picture (design.md §2, invariant 4; §6).
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/compare.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod compare;
#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use brickscope::camera::{Camera, Projection};
use brickscope::engine::{Engine, EngineOptions};
use brickscope::geom::Lod;
use brickscope::scene::{LodChoice, Mode, PictureSettings, Technique};
use brickscope::volume::VoxelType;
use compare::{assert_same_bits, coverage};
use glam::DVec3;
use memory_source::noise;
use scenes::{TestStore, cpu, field, settings, store_of};

/// Noise in which a slab of four voxels across +y is better than all of it: greater for mode mip, less for mode minip.
/// One voxel in a corner, where no ray passes, is still better, and one is the worst of all: neither the noise nor the
/// slab is an end of the volume's range.
fn slab_in_noise(mode: Mode, slab_from: usize) -> TestStore {
    let random: Vec<u32> = noise(64 * 192 * 64, 5).collect();
    let mut source = field([64, 192, 64], VoxelType::U8, |_| 0.0);
    for (i, byte) in source.bytes.iter_mut().enumerate() {
        let y = i / 64 % 192;
        let value = match (i, y) {
            (0, _) => 255,
            (1, _) => 0,
            _ if (slab_from..slab_from + 4).contains(&y) => 220,
            _ => 20 + (random[i] >> 8) as u8 % 100,
        };
        *byte = if mode == Mode::MinIp {
            255 - value
        } else {
            value
        };
    }
    store_of(&mut source)
}

/// Along +y through the middle of the volume, 40 mm of its 64.
fn through(store: &TestStore, mode: Mode) -> PictureSettings {
    let mut s = settings(&store.store, mode);
    s.size = [48, 48];
    s.step = 1.0;
    s.lod = LodChoice::Fixed(Lod(0));
    s.camera = Camera {
        eye: DVec3::new(31.5, -200.0, 31.5),
        target: DVec3::splat(31.5),
        up: DVec3::Z,
        fov_y_degrees: 2.0 * (20.0_f64 / 231.5).atan().to_degrees(),
        projection: Projection::Orthographic,
        near_mm: 0.0,
    };
    s
}

/// Samples taken with and without culling, by pictures that are equal to the bit.
fn samples(mut engine: Engine, s: &PictureSettings, what: &str) -> [u64; 2] {
    let [culled, all] = [Technique::Default, Technique::Basic].map(|technique| {
        let s = PictureSettings {
            technique,
            ..s.clone()
        };
        engine.render(&s).unwrap()
    });
    assert_eq!(coverage(&all.image), 1.0, "{what}: all rays meet something");
    assert_same_bits(&all.image, &culled.image, what);
    let [taken, of] = [&culled, &all].map(|p| p.stats.samples);
    assert_eq!(taken + culled.stats.samples_skipped, of, "{what}: samples");
    [taken, of]
}

fn what_lies_behind_is_culled(engine: impl Fn(&TestStore) -> Engine) {
    for mode in [Mode::Mip, Mode::MinIp] {
        // In the first brick of six, and in the last.
        let [front, behind] = [8, 180].map(|slab_from| {
            let store = slab_in_noise(mode, slab_from);
            let what = format!("{}, slab at {slab_from}", mode.name());
            samples(engine(&store), &through(&store, mode), &what)
        });
        assert_eq!(front[1], behind[1], "{}: all samples", mode.name());
        assert!(
            front[0] * 4 < front[1],
            "{}: {front:?} samples with the slab in front",
            mode.name()
        );
        assert!(
            behind[0] * 10 > behind[1] * 9,
            "{}: the control: {behind:?} samples with the slab behind",
            mode.name()
        );
    }
}

#[test]
fn the_cpu_culls_what_lies_behind() {
    what_lies_behind_is_culled(|store| cpu(store, EngineOptions::default()));
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_culls_what_lies_behind() {
    what_lies_behind_is_culled(|store| scenes::gpu(store, EngineOptions::default()));
}
