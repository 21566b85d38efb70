//! Tier 3: what few pictures ask for (translucent surfaces, pre-integration, jitter, filtered gradients), drawn by the
//! fast CPU renderer with every kind of vector, against the reference: unlit to the bit, lit within the twin bound.
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/compare.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod compare;
#[path = "support/fast_cpu.rs"]
#[allow(dead_code, reason = "shared with the other tests of the CPU renderer")]
mod fast_cpu;
#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use brickscope::camera::Projection;
use brickscope::classify::{OpacityCurve, OpacityPoint};
use brickscope::engine::EngineOptions;
use brickscope::geom::Lod;
use brickscope::scene::{
    GradientFilter, Interpolation, IsoSurface, Jitter, LodChoice, Mode, PictureSettings,
};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, difference};
use fast_cpu::{check, lit, picture, preintegrated, speckle};
use glam::{DVec3, Vec3};
use scenes::{TestStore, cpu, field, inside, phantom, reference, store_of, through_levels, waves};

/// Surfaces at these places (0–1) of the volume's values, of these opacities.
fn surfaces(store: &TestStore, of: &[(f64, f32)]) -> Vec<IsoSurface> {
    let meta = store.store.meta();
    let at = |t: f64| meta.value_min + (meta.value_max - meta.value_min) * t;
    of.iter()
        .enumerate()
        .map(|(n, &(t, opacity))| IsoSurface {
            value: meta.rescale.physical(at(t)),
            color: Vec3::new(0.2 + 0.1 * n as f32, 0.9 - 0.1 * n as f32, 0.5),
            opacity,
        })
        .collect()
}

fn with_surfaces(store: &TestStore, of: &[(f64, f32)]) -> PictureSettings {
    let mut s = picture(store, Mode::Iso);
    s.classification.iso = surfaces(store, of);
    s
}

/// For what takes long: of many tiles and packets, not all of them whole, of every place of the jitter's pattern, and of the
/// same level.
fn of_few_pixels(s: PictureSettings) -> PictureSettings {
    PictureSettings {
        size: [72, 56],
        lod: LodChoice::Fixed(Lod(0)),
        ..s
    }
}

const FOUR: [(f64, f32); 4] = [(0.7, 1.0), (0.3, 0.25), (0.5, 0.4), (0.6, 0.15)];

#[test]
fn translucent_surfaces() {
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        let s = with_surfaces(&store, &FOUR);
        check(&store, &s, &format!("{voxel_type}, four surfaces"));
        check(&store, &lit(s.clone()), &format!("{voxel_type}, four, lit"));
        for (step, refine) in [(5.0, true), (1.0, false)] {
            let s = PictureSettings {
                step,
                refine,
                ..s.clone()
            };
            check(&store, &s, &format!("{voxel_type}, four, step {step}"));
        }
    }
    let store = waves(VoxelType::U16);
    let eight: Vec<(f64, f32)> = (0..8).map(|n| (0.15 + 0.09 * f64::from(n), 0.2)).collect();
    check(&store, &with_surfaces(&store, &eight), "eight surfaces");
    let twice = [(0.5, 0.3), (0.5, 0.6), (0.5, 0.2)];
    check(&store, &with_surfaces(&store, &twice), "three of one value");
    let mut nearest = with_surfaces(&store, &FOUR);
    nearest.interpolation = Interpolation::Nearest;
    check(&store, &nearest, "four, nearest");
    let mut whole = with_surfaces(&store, &FOUR);
    whole.opacity_cutoff = 1.0;
    check(&store, &whole, "four, to full opacity");
    let mut ortho = with_surfaces(&store, &FOUR);
    ortho.camera.projection = Projection::Orthographic;
    check(&store, &ortho, "four, orthographic");
    let levels = through_levels(&store, with_surfaces(&store, &FOUR));
    check(&store, &levels, "four, at several levels");
}

/// Blocks between surfaces lie in zones of their own, and are skipped: a ramp with large steps of nothing between them.
#[test]
fn zones_between_surfaces_are_skipped() {
    let store = store_of(&mut field([40, 120, 40], VoxelType::U8, |p| p.y));
    let eight: Vec<(f64, f32)> = (0..8).map(|n| (0.1 + 0.1 * f64::from(n), 0.2)).collect();
    for step in [0.5, 5.0] {
        let mut s = with_surfaces(&store, &eight);
        s.step = step;
        check(&store, &s, &format!("a ramp, step {step}"));
    }
    let mut s = with_surfaces(&store, &[(0.2, 0.3), (0.8, 0.3)]);
    s.step = 0.5;
    let (taken, truth) = check(&store, &s, "a ramp, two surfaces");
    let all = truth.stats.samples;
    assert!(taken < all / 4, "{taken} of {all} samples taken");
}

#[test]
fn segments() {
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        for step in [1.0, 4.0] {
            let mut s = preintegrated(picture(&store, Mode::Dvr));
            s.step = step;
            let what = format!("pre-integrated {voxel_type}, step {step}");
            check(&store, &s, &what);
            check(&store, &lit(s.clone()), &format!("{what}, lit"));
            s.interpolation = Interpolation::Nearest;
            check(&store, &s, &format!("{what}, nearest"));
        }
    }
    let store = waves(VoxelType::U16);
    let s = preintegrated(picture(&store, Mode::Dvr));
    let mut ortho = s.clone();
    ortho.camera.projection = Projection::Orthographic;
    check(&store, &ortho, "pre-integrated, orthographic");
    let mut coarse = s.clone();
    coarse.lod = LodChoice::Fixed(Lod(1));
    check(&store, &coarse, "pre-integrated at level 1");
    check(
        &store,
        &through_levels(&store, s.clone()),
        "pre-integrated at several levels",
    );
    let mut near = s;
    near.camera = inside(
        &store.store,
        DVec3::new(0.45, 0.55, 0.5),
        DVec3::new(0.3, 1.0, 0.2),
    );
    near.camera.near_mm = 7.5;
    check(&store, &near, "pre-integrated from inside");
}

/// A peak between the values of two blocks in which nothing can be seen shows in the segment from one to the other.
#[test]
fn segments_across_a_peak() {
    let thin = |store: &TestStore| {
        let mut s = preintegrated(picture(store, Mode::Dvr));
        let meta = store.store.meta();
        let at = |t: f64| {
            meta.rescale
                .physical(meta.value_min + (meta.value_max - meta.value_min) * t)
        };
        s.classification.transfer.opacity = OpacityCurve::new(vec![
            OpacityPoint::linear(at(0.48), 0.0),
            OpacityPoint::linear(at(0.5), 0.9),
            OpacityPoint::linear(at(0.52), 0.0),
        ])
        .unwrap();
        s
    };
    let store = speckle(false);
    for (turn, step) in [(0, 0.5), (1, 1.0), (2, 4.0), (3, 9.0)] {
        let mut s = thin(&store);
        let angle = f64::from(turn) * 1.7;
        let direction = DVec3::new(angle.cos(), angle.sin(), 0.2);
        s.camera = inside(&store.store, DVec3::splat(0.5) - direction, direction);
        s.step = step;
        s.size = [64, 64];
        let (taken, truth) = check(&store, &s, &format!("blobs across a peak, step {step}"));
        let all = truth.stats.samples;
        assert!(taken < all, "something is skipped at step {step}");
    }
    // Slabs of both sides, far apart: nothing but the step between them shows, in brick-sized steps.
    let slabs = store_of(&mut field([40, 200, 40], VoxelType::U8, |p| {
        f64::from((p.y * 3.125) as u32 % 2)
    }));
    for step in [1.0, 4.0, 40.0] {
        let mut s = thin(&slabs);
        s.step = step;
        s.size = [128, 128];
        let (taken, truth) = check(&slabs, &s, &format!("slabs, step {step}"));
        let all = truth.stats.samples;
        assert!(
            step > 1.0 || taken < all / 4,
            "{taken} of {all} samples taken"
        );
    }
}

#[test]
fn jitter() {
    let store = waves(VoxelType::U16);
    let mut all: Vec<(String, PictureSettings)> = Mode::ALL
        .map(|mode| (mode.name().to_owned(), picture(&store, mode)))
        .into();
    all.push(("four surfaces".into(), with_surfaces(&store, &FOUR)));
    all.push((
        "pre-integrated".into(),
        preintegrated(picture(&store, Mode::Dvr)),
    ));
    for (what, s) in all {
        let mut s = of_few_pixels(s);
        s.jitter = Jitter::Interleaved;
        s.step = 2.0;
        check(&store, &s, &format!("{what}, jitter"));
        let levels = through_levels(&store, s.clone());
        check(&store, &levels, &format!("{what}, jitter, levels"));
        s.camera.projection = Projection::Orthographic;
        check(&store, &s, &format!("{what}, jitter, orthographic"));
    }
    let store = speckle(false);
    for mode in [Mode::Dvr, Mode::Iso] {
        for step in [0.5, 5.0] {
            let mut s = picture(&store, mode);
            (s.jitter, s.step) = (Jitter::Interleaved, step);
            check(
                &store,
                &s,
                &format!("{} speckle, jitter, step {step}", mode.name()),
            );
        }
    }
}

fn filtered(s: PictureSettings) -> PictureSettings {
    let mut s = lit(s);
    s.shading.gradient = GradientFilter::Filtered;
    s
}

/// Gradients without light, which are compared to the bit.
fn filtered_gradient(store: &TestStore) -> PictureSettings {
    let mut s = of_few_pixels(picture(store, Mode::Gradient));
    s.shading.gradient = GradientFilter::Filtered;
    s
}

#[test]
fn filtered_gradients() {
    let few = |s: PictureSettings| of_few_pixels(filtered(s));
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        for mode in [Mode::Dvr, Mode::Iso, Mode::Gradient] {
            let what = format!("{} {voxel_type}, filtered", mode.name());
            check(&store, &few(picture(&store, mode)), &what);
        }
        let mut s = filtered_gradient(&store);
        let what = format!("gradient {voxel_type}, filtered");
        check(&store, &s, &format!("{what}, unlit"));
        s.interpolation = Interpolation::Nearest;
        check(&store, &s, &format!("{what}, nearest"));
    }
    let store = waves(VoxelType::U16);
    let mut s = filtered_gradient(&store);
    let levels = through_levels(&store, s.clone());
    check(&store, &levels, "filtered, at several levels");
    s.step = 3.0;
    check(&store, &s, "filtered, step 3");
    let segments = few(preintegrated(picture(&store, Mode::Dvr)));
    check(&store, &segments, "filtered, pre-integrated");
    let four = few(with_surfaces(&store, &FOUR));
    check(&store, &four, "filtered, four surfaces");
}

/// Levels whose last voxel is the last of a brick, or the first of one, or the only one.
#[test]
fn filtered_gradients_at_the_edges() {
    for dims in [[64, 64, 64], [65, 33, 40], [40, 1, 33]] {
        let store = store_of(&mut field(dims, VoxelType::U16, |p| {
            0.5 + 0.5 * (p.x * 37.0).sin() * (p.z * 29.0 + p.y * 13.0).cos()
        }));
        let mut s = filtered_gradient(&store);
        s.classification.transfer.opacity =
            OpacityCurve::new(vec![OpacityPoint::linear(0.0, 0.05)]).unwrap();
        s.step = 0.3;
        check(&store, &s, &format!("filtered, {dims:?}"));
    }
}

/// Where the first sample of a ray already is the volume's own extreme, it is the only one.
#[test]
fn rays_end_at_the_volumes_own_extreme() {
    for (mode, inverse) in [(Mode::Mip, false), (Mode::MinIp, true)] {
        let store = store_of(&mut field([60, 60, 60], VoxelType::U16, |p| {
            let edge = (p - 0.5).abs().max_element();
            let v: f64 = if edge > 0.4 { 1.0 } else { 0.5 * p.x };
            if inverse { 1.0 - v } else { v }
        }));
        let s = picture(&store, mode);
        let (taken, truth) = check(&store, &s, mode.name());
        let rays = truth.image.pixels.iter().filter(|p| p.w > 0.0).count() as u64;
        assert_eq!(taken, rays, "{}: a sample a ray", mode.name());
    }
}

#[test]
fn few_bricks_are_as_good_as_all() {
    let store = phantom("phantom:body:150,140,160:u16");
    let four = with_surfaces(&store, &FOUR);
    let gradient = filtered_gradient(&store);
    for (what, s) in [
        ("four surfaces", four),
        ("pre-integrated", preintegrated(picture(&store, Mode::Dvr))),
        ("filtered gradients", gradient),
    ] {
        let s = PictureSettings {
            lod: LodChoice::Fixed(Lod(0)),
            ..s
        };
        let truth = reference(&store, &s).image;
        for ram_bytes in [0, 200_000, 1 << 30] {
            let options = EngineOptions {
                ram_bytes,
                ..EngineOptions::default()
            };
            let drawn = cpu(&store, options).render(&s).unwrap();
            assert_same_bits(&drawn.image, &truth, &format!("{what}, {ram_bytes} bytes"));
        }
    }
}

#[test]
fn negative_controls_fail() {
    let store = waves(VoxelType::U16);
    let beyond = |a: &PictureSettings, b: &PictureSettings| {
        let drawn = cpu(&store, EngineOptions::default()).render(a).unwrap();
        difference(&drawn.image, &reference(&store, b).image, TWIN_BOUND).beyond
    };
    let differs = |a: &PictureSettings, b: &PictureSettings, what: &str| {
        assert_eq!(beyond(a, a), 0, "{what}: the control's own control");
        let count = beyond(a, b);
        assert!(count > 300, "{what}: {count} pixels");
    };
    let dvr = picture(&store, Mode::Dvr);
    differs(&dvr, &preintegrated(dvr.clone()), "pre-integrated or not");
    let jittered = PictureSettings {
        jitter: Jitter::Interleaved,
        ..dvr.clone()
    };
    differs(&jittered, &dvr, "jitter or none");
    differs(&filtered(dvr.clone()), &lit(dvr), "filtered or not");
    let four = with_surfaces(&store, &FOUR);
    let mut denser = FOUR;
    denser[1].1 *= 1.03;
    differs(&four, &with_surfaces(&store, &denser), "3 % more opacity");
    let mut moved = FOUR;
    moved[2].0 += 0.002;
    differs(
        &lit(four.clone()),
        &lit(with_surfaces(&store, &moved)),
        "a moved surface",
    );
    let mut one_less = FOUR;
    one_less[3].1 = 1e-6;
    differs(&four, &with_surfaces(&store, &one_less), "one surface less");
    for [a, b] in [
        [Mode::Mip, Mode::MinIp],
        [Mode::Mean, Mode::Mip],
        [Mode::Gradient, Mode::Dvr],
        [Mode::Xray, Mode::Dvr],
    ] {
        let name = format!("{}, not {}", a.name(), b.name());
        differs(&picture(&store, a), &picture(&store, b), &name);
    }
    for mode in [Mode::Mean, Mode::MinIp, Mode::Gradient] {
        let s = picture(&store, mode);
        let coarser = PictureSettings {
            lod: LodChoice::Fixed(Lod(1)),
            ..s.clone()
        };
        differs(&s, &coarser, &format!("{} of another level", mode.name()));
    }
}
