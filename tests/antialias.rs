//! Super-sampling (techniques.md T2.3) on every device: the mean of the rays of a pixel, which pixels get them, what it is
//! good for; to the bit under any memory, tile and technique. With negative controls.
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

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use brickscope::engine::{Engine, EngineOptions, InstructionSet, Picture, TickBudget};
use brickscope::geom::Lod;
use brickscope::scene::{
    AntiAliasing, Image, LodChoice, Mode, PictureSettings, SamplePattern, ShadingModel, Technique,
};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, assert_twins, by_comparison, coverage, difference};
use glam::{DVec3, Vec4};
use scenes::{
    TestStore, cpu, gpu, inside, many_levels, oblique, phantom, reference, settings, speckle,
    tick_to_end, waves,
};

const PATTERNS: [SamplePattern; 5] = [
    SamplePattern::One,
    SamplePattern::Two,
    SamplePattern::Four,
    SamplePattern::FourRotated,
    SamplePattern::Eight,
];

fn with(settings: &PictureSettings, anti_aliasing: AntiAliasing) -> PictureSettings {
    PictureSettings {
        anti_aliasing,
        ..settings.clone()
    }
}

fn pixels(settings: &PictureSettings) -> u64 {
    settings.size.map(u64::from).iter().product()
}

/// All places of a pattern are the centres of the pixels of a picture so many times as large.
fn finer(pattern: SamplePattern) -> u32 {
    match pattern {
        SamplePattern::One => 1,
        SamplePattern::Two | SamplePattern::Four => 2,
        SamplePattern::FourRotated | SamplePattern::Sixteen => 4,
        SamplePattern::Eight => 8,
    }
}

/// The reference's picture without super-sampling, `finer` times as large.
fn large_picture(store: &TestStore, settings: &PictureSettings, finer: u32) -> Image {
    let large = PictureSettings {
        size: settings.size.map(|n| n * finer),
        ..with(settings, AntiAliasing::Off)
    };
    reference(store, &large).image
}

/// The mean of a pattern's rays, each of them a pixel of a large picture.
fn mean_of_pixels(large: &Image, pattern: SamplePattern) -> Image {
    let (places, finer) = (pattern.places(), finer(pattern));
    let mut image = Image::clear([large.width, large.height].map(|n| n / finer));
    let width = image.width;
    for (n, pixel) in image.pixels.iter_mut().enumerate() {
        let [x, y] = [n as u32 % width, n as u32 / width];
        let mut sum = Vec4::ZERO;
        for place in &places {
            let [i, j] = place.map(|p| {
                let at = p * finer as f32 - 0.5;
                assert_eq!(at.fract(), 0.0, "a centre of the larger picture's");
                at as u32
            });
            sum += large.pixels[((y * finer + j) * large.width + x * finer + i) as usize];
        }
        *pixel = sum * (1.0 / places.len() as f32);
    }
    image
}

/// Settings whose levels don't depend on the picture's size.
fn of_level_0(store: &TestStore, mode: Mode) -> PictureSettings {
    let mut s = settings(&store.store, mode);
    s.size = [61, 47];
    s.lod = LodChoice::Fixed(Lod(0));
    s
}

#[test]
fn full_is_the_mean_of_the_pictures_of_its_rays() {
    let store = waves(VoxelType::U16);
    for mode in Mode::ALL {
        let mut large = BTreeMap::new();
        for pattern in PATTERNS {
            let what = format!("{} {}", mode.name(), pattern.name());
            let mut s = of_level_0(&store, mode);
            // Of eight rays of a pixel the large picture has 64: a quarter of the pixels will do.
            if pattern == SamplePattern::Eight {
                s.size = [31, 23];
            }
            let finer = finer(pattern);
            let large = large
                .entry(finer)
                .or_insert_with(|| large_picture(&store, &s, finer));
            let truth = mean_of_pixels(large, pattern);
            assert!(coverage(&truth) > 0.05, "{what}: something is seen");
            let full = with(&s, AntiAliasing::Full(pattern));
            let oracle = reference(&store, &full);
            assert_same_bits(&oracle.image, &truth, &format!("{what}, reference"));
            for set in InstructionSet::available() {
                let options = EngineOptions {
                    instructions: Some(set),
                    ..EngineOptions::default()
                };
                let fast = cpu(&store, options).render(&full).unwrap();
                let what = format!("{what}, {}", set.name());
                if s.shading.model == ShadingModel::None {
                    assert_same_bits(&fast.image, &truth, &what);
                } else {
                    assert_twins(&fast.image, &truth, 0, &what);
                }
                assert_eq!(fast.stats.rays, oracle.stats.rays, "{what}: rays");
                assert_eq!(
                    fast.stats.samples + fast.stats.samples_skipped,
                    oracle.stats.samples,
                    "{what}: samples of all rays, taken or skipped"
                );
            }
            assert_eq!(
                oracle.stats.rays,
                pixels(&s) * pattern.places().len() as u64,
                "{what}: rays"
            );
        }
    }
}

/// And so the mean of the pictures of its rays, which the reference's picture is to the bit.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn full_on_the_gpu_is_that_of_the_reference() {
    let store = waves(VoxelType::U16);
    let mut engine = gpu(&store, EngineOptions::default());
    for mode in Mode::ALL {
        for pattern in PATTERNS {
            let what = format!("{} {}", mode.name(), pattern.name());
            let full = with(&of_level_0(&store, mode), AntiAliasing::Full(pattern));
            let truth = reference(&store, &full);
            assert!(coverage(&truth.image) > 0.05, "{what}: something is seen");
            let drawn = engine.render(&full).unwrap();
            let rays = truth.stats.rays;
            let allowed = by_comparison(mode, rays as usize);
            assert_twins(&drawn.image, &truth.image, allowed, &what);
            assert_eq!(drawn.stats.rays, rays, "{what}: rays");
        }
    }
}

/// The marked pixels of a picture without super-sampling, told as plainly as can be.
fn marked(off: &Image, threshold: f32) -> BTreeSet<[u32; 2]> {
    let at = |x: u32, y: u32| off.pixels[(y * off.width + x) as usize].to_array();
    let mut marked = BTreeSet::new();
    for y in 0..off.height {
        for x in 0..off.width {
            let neighbours = [
                (x.wrapping_sub(1), y),
                (x + 1, y),
                (x, y.wrapping_sub(1)),
                (x, y + 1),
            ];
            for (nx, ny) in neighbours {
                if nx < off.width && ny < off.height {
                    let pairs = at(x, y).into_iter().zip(at(nx, ny));
                    if pairs.map(|(a, b)| (a - b).abs()).any(|d| d > threshold) {
                        marked.insert([x, y]);
                    }
                }
            }
        }
    }
    marked
}

/// How many pixels of a selective picture are not to the bit what they must be: of `full` where marked, else of `off`.
fn wrong_pixels(selective: &Image, [off, full]: [&Image; 2], marked: &BTreeSet<[u32; 2]>) -> usize {
    let pixels = selective.pixels.iter().zip(&off.pixels).zip(&full.pixels);
    pixels
        .enumerate()
        .filter(|&(n, ((is, off), full))| {
            let at = [n as u32 % selective.width, n as u32 / selective.width];
            let must_be = if marked.contains(&at) { full } else { off };
            is.to_array().map(f32::to_bits) != must_be.to_array().map(f32::to_bits)
        })
        .count()
}

/// Off, full and selective by one engine; what was marked.
fn check_selective(
    mut draw: impl FnMut(&PictureSettings) -> Picture,
    settings: &PictureSettings,
    pattern: SamplePattern,
    threshold: f32,
    what: &str,
) -> ([Picture; 3], BTreeSet<[u32; 2]>) {
    let off = draw(&with(settings, AntiAliasing::Off));
    let full = draw(&with(settings, AntiAliasing::Full(pattern)));
    let how = AntiAliasing::Selective { pattern, threshold };
    let selective = draw(&with(settings, how));
    let marked = marked(&off.image, threshold);
    let share = marked.len() as f64 / pixels(settings) as f64;
    assert!(
        (0.01..0.95).contains(&share),
        "{what}: {share} of the pixels are marked"
    );
    let wrong = wrong_pixels(&selective.image, [&off.image, &full.image], &marked);
    assert_eq!(wrong, 0, "{what}: wrong pixels of {}", marked.len());
    let rays = pixels(settings) + (marked.len() * pattern.places().len()) as u64;
    assert_eq!(
        selective.stats.rays, rays,
        "{what}: only marked ones are cast again"
    );
    assert!(
        selective.stats.samples > off.stats.samples,
        "{what}: samples of all rays count"
    );
    ([off, full, selective], marked)
}

/// Sizes that fill no tile, packet or work-group.
const ODD_SIZES: [[u32; 2]; 3] = [[61, 47], [130, 3], [1, 77]];

#[test]
fn selective_is_full_where_marked_on_the_cpu() {
    let store = phantom("phantom:body:100,70,110:u8");
    for mode in Mode::ALL {
        for size in ODD_SIZES {
            let mut s = settings(&store.store, mode);
            s.size = size;
            s.classification.iso[0].value = 150.3;
            if size[1] == 3 {
                s.camera.fov_y_degrees = 1.0;
            }
            let what = format!("{} {size:?}", mode.name());
            let pattern = SamplePattern::FourRotated;
            check_selective(|s| reference(&store, s), &s, pattern, 0.04, &what);
            for set in InstructionSet::available() {
                let options = EngineOptions {
                    instructions: Some(set),
                    ..EngineOptions::default()
                };
                let mut engine = cpu(&store, options);
                let what = format!("{what} {}", set.name());
                check_selective(|s| engine.render(s).unwrap(), &s, pattern, 0.04, &what);
            }
        }
    }
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn selective_is_full_where_marked_on_the_gpu() {
    let store = phantom("phantom:body:100,70,110:u8");
    let mut engine = gpu(&store, EngineOptions::default());
    for mode in Mode::ALL {
        for size in ODD_SIZES {
            let mut s = settings(&store.store, mode);
            s.size = size;
            s.classification.iso[0].value = 150.3;
            if size[1] == 3 {
                s.camera.fov_y_degrees = 1.0;
            }
            for pattern in [SamplePattern::FourRotated, SamplePattern::Eight] {
                let what = format!("{} {} {size:?}", mode.name(), pattern.name());
                check_selective(|s| engine.render(s).unwrap(), &s, pattern, 0.04, &what);
            }
        }
    }
}

/// Pixels at the border of two tiles are neighbours, too.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn marks_go_across_tiles() {
    let store = waves(VoxelType::U16);
    let mut s = settings(&store.store, Mode::Dvr);
    s.size = [1100, 24];
    s.camera = inside(
        &store.store,
        DVec3::new(0.45, 0.55, 0.5),
        DVec3::new(0.3, 1.0, 0.2),
    );
    s.camera.fov_y_degrees = 2.0;
    let mut engine = gpu(&store, EngineOptions::default());
    let off = engine.render(&s).unwrap().image;
    // Columns 1023 and 1024 are in different tiles; marked by themselves, these would have other pixels.
    let by_tile = |threshold: f32| -> BTreeSet<[u32; 2]> {
        let part = |[from, to]: [usize; 2]| {
            let rows = off.pixels.chunks(1100);
            let part = Image {
                width: (to - from) as u32,
                height: 24,
                pixels: rows.flat_map(|row| row[from..to].to_vec()).collect(),
                depths: None,
            };
            let moved = move |[x, y]: [u32; 2]| [x + from as u32, y];
            marked(&part, threshold).into_iter().map(moved)
        };
        [[0, 1024], [1024, 1100]]
            .into_iter()
            .flat_map(part)
            .collect()
    };
    let steps = (0..24).map(|y| {
        let at = |x: usize| off.pixels[y * 1100 + x];
        (at(1023) - at(1024)).abs().max_element()
    });
    let threshold = steps
        .map(|step| step * 0.999)
        .find(|&threshold| threshold > 0.0 && by_tile(threshold) != marked(&off, threshold))
        .expect("a threshold for which the border counts");
    let pattern = SamplePattern::Two;
    check_selective(
        |s| engine.render(s).unwrap(),
        &s,
        pattern,
        threshold,
        "two tiles",
    );
}

#[test]
fn the_ends_of_the_threshold() {
    let store = waves(VoxelType::U16);
    // Inside a field without a flat place all pixels differ.
    let mut s = settings(&store.store, Mode::Dvr);
    s.size = [45, 38];
    s.camera = inside(
        &store.store,
        DVec3::new(0.45, 0.55, 0.5),
        DVec3::new(0.3, 1.0, 0.2),
    );
    let pattern = SamplePattern::Four;
    let mut engines = vec![("cpu", cpu(&store, EngineOptions::default()))];
    if cfg!(all(feature = "gpu", not(skip_gpu_tests))) {
        engines.push(("gpu", gpu(&store, EngineOptions::default())));
    }
    for (name, engine) in &mut engines {
        let mut draw = |how| engine.render(&with(&s, how)).unwrap();
        let [all, none] =
            [0.0, 1.0].map(|threshold| draw(AntiAliasing::Selective { pattern, threshold }));
        assert_eq!(all.stats.rays, pixels(&s) * 5, "{name}: 0 marks all");
        let full = draw(AntiAliasing::Full(pattern));
        assert_same_bits(&all.image, &full.image, name);
        assert_eq!(none.stats.rays, pixels(&s), "{name}: 1 marks none");
        let off = draw(AntiAliasing::Off);
        assert_same_bits(&none.image, &off.image, name);
        assert!(
            difference(&full.image, &off.image, TWIN_BOUND).beyond > 100,
            "{name}: what is told apart differs"
        );
    }
}

/// Root mean square of the differences of two pictures.
fn rms(a: &Image, b: &Image) -> f64 {
    let pairs = a.pixels.iter().zip(&b.pixels);
    let sum: f64 = pairs
        .map(|(a, b)| f64::from((*a - *b).length_squared()))
        .sum();
    (sum / (a.pixels.len() * 4) as f64).sqrt()
}

#[test]
fn more_rays_are_nearer_to_sixteen() {
    let store = phantom("phantom:body:100,70,110:u8");
    for mode in Mode::ALL {
        let mut s = settings(&store.store, mode);
        s.size = [96, 96];
        s.classification.iso[0].value = 150.3;
        let mut engine = cpu(&store, EngineOptions::default());
        let mut draw = |how| engine.render(&with(&s, how)).unwrap().image;
        let truth = draw(AntiAliasing::Full(SamplePattern::Sixteen));
        let [none, two, four, rotated, eight] =
            PATTERNS.map(|pattern| rms(&draw(AntiAliasing::Full(pattern)), &truth));
        println!(
            "{}: error to 16 rays: none {none:.5}, 2 {two:.5}, 4 {four:.5}, 4r {rotated:.5}, 8 {eight:.5}",
            mode.name()
        );
        assert!(none > two && two > four && four > eight, "{}", mode.name());
        assert!(none > rotated, "{}", mode.name());
        let mut of = |threshold| {
            let pattern = SamplePattern::FourRotated;
            rms(
                &draw(AntiAliasing::Selective { pattern, threshold }),
                &truth,
            )
        };
        let [strict, loose] = [of(0.02), of(0.3)];
        println!(
            "{}: selective 0.02 {strict:.5}, 0.3 {loose:.5}",
            mode.name()
        );
        assert!(
            none > strict && none >= loose && loose >= strict,
            "{}: a lower threshold leaves less",
            mode.name()
        );
    }
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn any_atlas_gives_the_same_picture() {
    let store = phantom("phantom:body:200,180,210:u16");
    let pattern = SamplePattern::FourRotated;
    let threshold = 0.04;
    let mut engines = [None, Some(9), Some(64)].map(|max_slots| {
        let options = EngineOptions {
            max_slots,
            slot_order_seed: max_slots.unwrap_or(0),
            ..EngineOptions::default()
        };
        (max_slots, gpu(&store, options))
    });
    // A minimum needs too few bricks to be short of slots.
    for mode in Mode::ALL.into_iter().filter(|&m| m != Mode::MinIp) {
        let s = many_levels(&store, mode);
        for how in [
            AntiAliasing::Full(pattern),
            AntiAliasing::Selective { pattern, threshold },
        ] {
            let s = with(&s, how);
            let [whole, small @ ..] = engines
                .each_mut()
                .map(|(slots, engine)| (*slots, engine.render(&s).unwrap()));
            let whole = whole.1;
            assert!(coverage(&whole.image) > 0.05, "something is seen");
            for (slots, small) in small {
                let what = format!("{} {how:?}, {slots:?} slots", mode.name());
                assert_same_bits(&small.image, &whole.image, &what);
                assert_eq!(whole.stats.rays, small.stats.rays, "{what}: rays");
                assert!(
                    slots > Some(9) || small.stats.bricks_evicted > Some(0),
                    "{what}: evicts"
                );
            }
        }
    }
}

/// Rays that don't pass through the centres of pixels are bounded by the mesh as well as those that do: blocks are little
/// larger than pixels here, and most stand alone.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_mesh_bounds_the_rays_of_every_pattern() {
    use brickscope::camera::{Camera, Projection};

    let store = speckle(47, oblique());
    let bounds = brickscope::scene::volume_bounds(store.store.meta().dims, &oblique());
    let mut engine = gpu(&store, EngineOptions::default());
    // Blocks are known once their bricks have been read, and to a mean all of them matter.
    let mut all = settings(&store.store, Mode::Mean);
    all.lod = LodChoice::Fixed(Lod(0));
    engine.render(&all).unwrap();
    for (n, pattern) in PATTERNS.into_iter().enumerate() {
        // To a minimum or a mean nearly all blocks matter: there is no mesh to speak of.
        for mode in Mode::ALL
            .into_iter()
            .filter(|m| ![Mode::MinIp, Mode::Mean].contains(m))
        {
            for projection in [Projection::Perspective, Projection::Orthographic] {
                let mut s = settings(&store.store, mode);
                s.size = [80, 64];
                s.lod = LodChoice::Fixed(Lod(0));
                s.camera =
                    Camera::orbit(&bounds, 50.0 * n as f64, 17.0 * n as f64 - 40.0, 1.1, 30.0)
                        .unwrap();
                s.camera.projection = projection;
                let s = with(&s, AntiAliasing::Full(pattern));
                let basic = PictureSettings {
                    technique: Technique::Basic,
                    ..s.clone()
                };
                let (meshed, plain) = (engine.render(&s).unwrap(), engine.render(&basic).unwrap());
                let what = format!("{} {} {projection:?}", mode.name(), pattern.name());
                let covered = coverage(&plain.image);
                assert!(
                    covered > 0.05,
                    "{what}: {covered} of the picture is covered"
                );
                assert!(
                    meshed.stats.mesh_triangles > Some(1000),
                    "{what}: a mesh of blocks"
                );
                assert_same_bits(&meshed.image, &plain.image, &what);
                assert!(
                    meshed.stats.samples < plain.stats.samples,
                    "{what}: it bounds"
                );
            }
        }
    }
}

/// Ticks until the picture converges: its rays.
fn ticked(engine: &mut Engine, settings: &PictureSettings) -> u64 {
    let budget = TickBudget {
        time: Duration::from_millis(20),
        upload_bytes: 1 << 20,
    };
    engine.set_picture(settings.clone());
    tick_to_end(engine, &budget);
    engine.statistics().unwrap().unwrap().rays
}

#[test]
fn ticks_come_to_the_same_picture() {
    let store = phantom("phantom:body:100,70,110:u8");
    let pattern = SamplePattern::Four;
    let mut s = settings(&store.store, Mode::Dvr);
    s.size = [90, 70];
    for how in [
        AntiAliasing::Full(pattern),
        AntiAliasing::Selective {
            pattern,
            threshold: 0.04,
        },
    ] {
        let s = with(&s, how);
        let mut pairs = vec![[(); 2].map(|()| cpu(&store, EngineOptions::default()))];
        if cfg!(all(feature = "gpu", not(skip_gpu_tests))) {
            pairs.push([(); 2].map(|()| gpu(&store, EngineOptions::default())));
        }
        for [live, other] in &mut pairs {
            let rendered = other.render(&s).unwrap();
            let what = format!("{how:?} on {}", live.device_name());
            let rays = ticked(live, &s);
            assert_same_bits(live.image().unwrap(), &rendered.image, &what);
            assert_eq!(rays, rendered.stats.rays, "{what}: rays");
            // Another picture after it begins anew.
            let plain = with(&s, AntiAliasing::Off);
            assert_eq!(ticked(live, &plain), pixels(&s), "{what}: then without");
            let off = other.render(&plain).unwrap();
            assert_same_bits(live.image().unwrap(), &off.image, &what);
        }
    }
}

/// What must not pass doesn't.
#[test]
fn negative_controls_fail() {
    let store = phantom("phantom:body:100,70,110:u8");
    let mut s = settings(&store.store, Mode::Iso);
    s.size = [61, 47];
    s.classification.iso[0].value = 150.3;
    let mut engine = cpu(&store, EngineOptions::default());
    let (pictures, mut marked) = check_selective(
        |s| engine.render(s).unwrap(),
        &s,
        SamplePattern::FourRotated,
        0.04,
        "the control's own control",
    );
    let [off, full, selective] = pictures.map(|p| p.image);
    let at = |[x, y]: [u32; 2]| (y * off.width + x) as usize;
    let changed: Vec<[u32; 2]> = marked
        .iter()
        .copied()
        .filter(|&p| off.pixels[at(p)] != full.pixels[at(p)])
        .collect();
    assert!(changed.len() > 100, "rays make a difference");

    let mut left_out = selective.clone();
    left_out.pixels[at(changed[7])] = off.pixels[at(changed[7])];
    assert_eq!(
        wrong_pixels(&left_out, [&off, &full], &marked),
        1,
        "a marked pixel that was left out is seen"
    );

    marked.remove(&changed[7]);
    assert_eq!(
        wrong_pixels(&selective, [&off, &full], &marked),
        1,
        "a pixel that was cast for nothing is seen"
    );

    // Other places of the rays.
    let s = PictureSettings {
        lod: LodChoice::Fixed(Lod(0)),
        ..s
    };
    let pattern = SamplePattern::FourRotated;
    let truth = mean_of_pixels(&large_picture(&store, &s, finer(pattern)), pattern);
    let other = engine
        .render(&with(&s, AntiAliasing::Full(SamplePattern::Four)))
        .unwrap();
    assert!(
        difference(&other.image, &truth, TWIN_BOUND).beyond > 100,
        "other places, another picture"
    );
}
