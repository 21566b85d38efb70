//! What `--quality` stands for: the distances of samples at rest, and of the picture that is shown while the camera moves.
//! That the command line takes them is in `tests/cli/pictures.rs`.
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

use std::time::Duration;

use brickscope::engine::{Engine, EngineOptions, TickBudget, TickEvent};
use brickscope::geom::Lod;
use brickscope::scene::{AntiAliasing, LodChoice, Mode, PictureSettings, Quality, SamplePattern};
use compare::{TWIN_BOUND, assert_same_bits, difference};
use scenes::{TestStore, cpu, phantom, settings};

#[test]
fn steps_grow_with_speed_and_while_the_camera_moves() {
    let [fine, balanced, fast] =
        [Quality::Fine, Quality::Balanced, Quality::Fast].map(|q| q.steps(Mode::Dvr));
    assert_eq!(
        [fine, balanced, fast],
        [[0.25, 1.0], [0.5, 2.0], [1.0, 3.0]]
    );
    for mode in Mode::ALL {
        for (quality, dvr) in [
            (Quality::Fine, fine),
            (Quality::Balanced, balanced),
            (Quality::Fast, fast),
        ] {
            let [rest, moving] = quality.steps(mode);
            assert_eq!(rest, dvr[0], "{mode:?}, {quality:?}, at rest");
            // Only surfaces are refined.
            assert_eq!(
                moving > dvr[1],
                mode == Mode::Iso,
                "{mode:?}, {quality:?}, moving: {moving}"
            );
        }
    }
}

#[test]
fn the_first_whole_picture_is_as_of_a_moving_camera() {
    let store = phantom("phantom:sponge:32,32,32");
    let mut s = settings(&store.store, Mode::Iso);
    (s.step, s.moving_step, s.lod_error) = (0.5, 4.0, 0.25);
    s.anti_aliasing = AntiAliasing::Full(SamplePattern::Two);
    let first = s.first_whole().unwrap();
    assert_eq!(
        first,
        PictureSettings {
            step: 4.0,
            lod_error: PictureSettings::FIRST_WHOLE_PIXELS,
            anti_aliasing: AntiAliasing::Off,
            ..s.clone()
        }
    );
    assert_eq!(first.first_whole(), None, "all of that is so already");
    // What is coarser already stays so; a level that was chosen is kept.
    (s.step, s.lod_error, s.lod) = (6.0, 9.0, LodChoice::Fixed(Lod(0)));
    let first = s.first_whole().unwrap();
    assert_eq!(
        (first.step, first.lod_error, first.lod),
        (6.0, 9.0, LodChoice::Fixed(Lod(0)))
    );
}

/// The picture that ticks show first has the moving step, and the one they end with the step at rest.
fn ticks_take_the_moving_step(engine: impl Fn(&TestStore) -> Engine) {
    let store = phantom("phantom:body:120,100,130:u16");
    // Pieces as small as can be: no tick goes on after the picture became whole.
    let budget = TickBudget {
        time: Duration::from_millis(1),
        ..TickBudget::default()
    };
    for mode in [Mode::Dvr, Mode::Iso] {
        let [step, moving_step] = Quality::Fast.steps(mode);
        let s = PictureSettings {
            size: [72, 56],
            step,
            moving_step,
            lod_error: 0.25,
            ..settings(&store.store, mode)
        };
        let coarse = |step| PictureSettings {
            step,
            lod_error: PictureSettings::FIRST_WHOLE_PIXELS,
            ..s.clone()
        };
        let mut oracle = engine(&store);
        let [moving, resting, exact] = [coarse(moving_step), coarse(step), s.clone()]
            .map(|s| oracle.render(&s).unwrap().image);
        let mut live = engine(&store);
        live.set_picture(s.clone());
        let event = (0..20_000)
            .find_map(|_| live.tick(&budget).unwrap().event)
            .unwrap();
        assert_eq!(event, TickEvent::Whole, "{mode:?}: what comes first");
        let first = live.image().unwrap();
        assert_same_bits(&moving, first, &format!("{mode:?}, moving"));
        let other = difference(&resting, first, TWIN_BOUND).beyond;
        assert!(
            other > 20,
            "{mode:?}: the control: {other} pixels are others"
        );
        let ended = (0..20_000).any(|_| live.tick(&budget).unwrap().converged);
        assert!(ended, "{mode:?}: 20 000 ticks and no end");
        assert_same_bits(&exact, live.image().unwrap(), &format!("{mode:?}, at rest"));
    }
}

#[test]
fn the_cpu_takes_the_moving_step() {
    ticks_take_the_moving_step(|store| cpu(store, EngineOptions::default()));
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_takes_the_moving_step() {
    ticks_take_the_moving_step(|store| scenes::gpu(store, EngineOptions::default()));
}
