//! Tier 3: the fast CPU renderer against the reference, with every kind of vector that this processor has. Unshaded
//! pictures are equal to the bit (the same operations in the same order); lit ones within the twin bound, as powers are
//! computed in another way. With negative controls.
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/compare.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod compare;
#[path = "support/fast_cpu.rs"]
#[allow(dead_code, reason = "shared with the tests of its settings")]
mod fast_cpu;
#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use std::time::Duration;

use brickscope::camera::Projection;
use brickscope::engine::{EngineOptions, TickBudget, TickEvent};
use brickscope::geom::Lod;
use brickscope::scene::{Interpolation, LodChoice, Mode, PictureSettings};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, difference};
use fast_cpu::{check, lit, picture, speckle, unlit};
use glam::DVec3;
use scenes::{
    TestStore, cpu, field, inside, phantom, reference, settings, store_of, through_levels,
    tick_to_end, waves,
};

#[test]
fn every_voxel_type_and_mode() {
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        for mode in Mode::ALL {
            let s = picture(&store, mode);
            let what = format!("{voxel_type} {}", mode.name());
            check(&store, &s, &what);
            if !mode.projects() {
                check(&store, &lit(s), &format!("{what} lit"));
            }
        }
    }
}

#[test]
fn every_setting() {
    let store = waves(VoxelType::U16);
    let of = |mode| picture(&store, mode);
    let mut side_light = lit(of(Mode::Dvr));
    side_light.shading.light = Some(DVec3::new(1.0, 0.5, -0.3));
    check(&store, &side_light, "dvr lit from the side");
    for mode in Mode::ALL {
        let name = mode.name();
        let mut s = of(mode);
        s.camera.projection = Projection::Orthographic;
        check(&store, &s, &format!("orthographic {name}"));
        let mut s = of(mode);
        s.camera = inside(
            &store.store,
            DVec3::new(0.45, 0.55, 0.5),
            DVec3::new(0.3, 1.0, 0.2),
        );
        check(&store, &s, &format!("{name} from inside"));
        s.camera.near_mm = 7.5;
        check(&store, &s, &format!("{name} from inside with a near plane"));
        let mut s = of(mode);
        s.interpolation = Interpolation::Nearest;
        check(&store, &s, &format!("{name} nearest"));
        let mut s = of(mode);
        s.lod = LodChoice::Fixed(Lod(1));
        check(&store, &s, &format!("{name} at level 1"));
        // No multiple of a packet or a tile.
        let mut s = of(mode);
        s.size = [101, 37];
        check(&store, &s, &format!("{name} of an odd size"));
        let mut s = of(mode);
        (s.step, s.refine) = (5.0, false);
        check(&store, &s, &format!("{name} at step 5"));
        let mut s = of(mode);
        s.opacity_cutoff = 1.0;
        check(&store, &s, &format!("{name} to full opacity"));
    }
}

#[test]
fn several_levels_in_one_picture() {
    let store = waves(VoxelType::U16);
    for mode in Mode::ALL {
        let s = through_levels(&store, picture(&store, mode));
        check(&store, &s, &format!("{} at several levels", mode.name()));
    }
}

#[test]
fn speckle_from_all_sides() {
    for mode in Mode::ALL {
        let store = speckle(mode == Mode::MinIp);
        for (n, step) in [0.5, 1.0, 5.0].into_iter().enumerate() {
            for turn in 0..3 {
                let mut s = picture(&store, mode);
                let angle = f64::from(turn) * 2.1 + n as f64 * 0.4;
                let direction = DVec3::new(angle.cos(), angle.sin(), 0.3 - 0.2 * angle.sin());
                let from = if turn == 0 { 0.5 } else { -0.4 };
                s.camera = inside(
                    &store.store,
                    DVec3::splat(0.5) + direction * (from - 0.5),
                    direction,
                );
                s.size = [64, 64];
                s.step = step;
                check(
                    &store,
                    &s,
                    &format!("{} speckle, view {turn}, step {step}", mode.name()),
                );
            }
        }
    }
}

#[test]
fn sharp_edges() {
    let store = phantom("phantom:body:100,70,110:u8");
    for mode in Mode::ALL {
        let mut s = picture(&store, mode);
        s.classification.iso[0].value = 150.3;
        check(&store, &s, &format!("body {}", mode.name()));
    }
}

#[test]
fn one_voxel_thick() {
    let store = store_of(&mut field([40, 1, 33], VoxelType::U16, |p| p.x));
    // (Of the iso-surface a slice shows a line.)
    for mode in Mode::ALL.into_iter().filter(|&m| m != Mode::Iso) {
        let mut s = picture(&store, mode);
        s.camera = brickscope::camera::Camera::orbit(
            &brickscope::scene::volume_bounds(
                store.store.meta().dims,
                &store.store.meta().world_from_index,
            ),
            10.0,
            5.0,
            1.0,
            30.0,
        )
        .unwrap();
        check(&store, &s, &format!("a slice, {}", mode.name()));
    }
}

#[test]
fn any_memory_gives_the_same_bits() {
    let store = phantom("phantom:body:150,140,160:u16");
    for mode in Mode::ALL {
        let mut s = picture(&store, mode);
        s.lod = LodChoice::Fixed(Lod(0));
        let truth = reference(&store, &s).image;
        let mut plenty = cpu(&store, EngineOptions::default());
        let first = plenty.render(&s).unwrap();
        assert_same_bits(&first.image, &truth, mode.name());
        let again = plenty.render(&s).unwrap();
        assert_same_bits(&again.image, &truth, "the second time");
        assert_eq!(again.stats.bricks_read, Some(0), "bricks are kept");
        let mut little = cpu(
            &store,
            EngineOptions {
                ram_bytes: 1 << 20,
                ..EngineOptions::default()
            },
        );
        let picture = little.render(&s).unwrap();
        assert_same_bits(&picture.image, &truth, "with 1 MiB");
        let again = little.render(&s).unwrap();
        // (Rays that look for a minimum end in the air before the body.)
        assert!(
            mode == Mode::MinIp || again.stats.bricks_read > Some(0),
            "{}: a dozen bricks are kept, not all",
            mode.name()
        );
    }
}

#[test]
fn edits_reclassify_what_is_kept() {
    let store = phantom("phantom:body:100,70,110:u16");
    let mut engine = cpu(&store, EngineOptions::default());
    for (mode, value) in [
        (Mode::Iso, 1200.0),
        (Mode::Iso, 2700.0),
        (Mode::Dvr, 0.0),
        (Mode::Mip, 0.0),
        (Mode::MinIp, 0.0),
        (Mode::Gradient, 0.0),
        (Mode::Iso, 1200.0),
    ] {
        let mut s = picture(&store, mode);
        s.classification.iso[0].value = value;
        assert_same_bits(
            &engine.render(&s).unwrap().image,
            &reference(&store, &s).image,
            &format!("{} {value}", mode.name()),
        );
    }
}

#[test]
fn ticks_are_whole_first_and_exact_in_the_end() {
    let store = phantom("phantom:body:150,140,160:u16");
    let mut s = unlit(settings(&store.store, Mode::Dvr));
    s.size = [96, 96];
    let mut engine = cpu(&store, EngineOptions::default());
    engine.set_picture(s.clone());
    assert!(engine.image().is_none(), "nothing yet");
    let budget = TickBudget {
        time: Duration::ZERO,
        ..TickBudget::default()
    };
    assert_eq!(
        engine.tick(&budget).unwrap().event,
        None,
        "no time, no picture"
    );
    let mut events = Vec::new();
    for _ in 0..100 {
        events.extend(engine.tick(&TickBudget::default()).unwrap().event);
        if engine.is_converged() {
            break;
        }
    }
    assert_eq!(
        events,
        [TickEvent::Whole, TickEvent::Converged],
        "coarse, then exact"
    );
    assert_same_bits(
        engine.image().unwrap(),
        &reference(&store, &s).image,
        "by ticks",
    );
    let stats = engine.statistics().unwrap().unwrap();
    assert!(
        stats.converged && stats.first_complete_ms <= stats.converged_ms,
        "both are told"
    );
    assert_eq!(
        engine.tick(&TickBudget::default()).unwrap().event,
        None,
        "nothing is left to do"
    );
}

#[test]
fn negative_controls_fail() {
    let value =
        |p: DVec3| 0.5 + 0.5 * ((p - 0.5).length() * 19.0).cos() * (1.0 - (p - 0.5).length());
    let dims = [70_u64, 45, 52];
    let plain = store_of(&mut field(dims, VoxelType::U16, value));
    let s = unlit(settings(&plain.store, Mode::Dvr));
    let truth = reference(&plain, &s).image;
    let beyond = |store: &TestStore, s: &PictureSettings| {
        let drawn = cpu(store, EngineOptions::default()).render(s).unwrap();
        difference(&drawn.image, &truth, TWIN_BOUND).beyond
    };
    assert_eq!(beyond(&plain, &s), 0, "the control's own control");
    let shifted = store_of(&mut field(dims, VoxelType::U16, |p| {
        value(p + DVec3::new(1.0 / 70.0, 0.0, 0.0))
    }));
    assert!(beyond(&shifted, &s) > 500, "a voxel's shift is seen");
    let mut denser = s.clone();
    denser.classification.opacity_unit_mm = Some(1.0 / 1.03);
    assert!(beyond(&plain, &denser) > 500, "3 % more opacity is seen");
    let mut coarser = s.clone();
    coarser.lod = LodChoice::Fixed(Lod(1));
    assert!(beyond(&plain, &coarser) > 500, "the wrong level is seen");
}

#[test]
fn budgets_may_change_while_a_picture_is_drawn() {
    let store = phantom("phantom:body:100,70,110:u16");
    let s = unlit(settings(&store.store, Mode::Mip));
    let mut engine = cpu(&store, EngineOptions::default());
    engine.render(&s).unwrap();
    let step = PictureSettings {
        step: 1.0,
        ..s.clone()
    };
    // Counted from a renderer that has read bricks to one that has read none.
    engine.set_picture(step.clone());
    engine.set_budgets(None, 1 << 20);
    tick_to_end(&mut engine, &TickBudget::default());
    assert_same_bits(
        engine.image().unwrap(),
        &reference(&store, &step).image,
        "after another budget",
    );
    let read = engine.statistics().unwrap().unwrap().bricks_read.unwrap();
    assert!((1..1000).contains(&read), "{read} bricks read");
}
