//! Tier 5: pictures as they were when somebody looked at them, on Mesa's software adapter.
//!
//! A missing, unreadable or unused reference fails. `UPDATE_GOLDEN=NAME` (or `all`) writes, and refuses under `CI`. A
//! failure leaves `actual.png`, `diff.png` and `report.json` in `target/golden/NAME`.
#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use brickscope::camera::{Camera, Projection};
use brickscope::engine::EngineOptions;
use brickscope::export::write_png;
use brickscope::outfile::{Existing, write_whole};
use brickscope::scene::{Background, Mode, PictureSettings, Shading, ShadingModel, volume_bounds};
use brickscope::volume::VoxelType;
use glam::{DVec3, Vec3};
use scenes::{TestStore, field, gpu, inside, oblique, phantom, settings, store_of};

/// Mesa on which the references were made, as the driver names it: others are compared with the wider tolerance.
const MESA_OF_REFERENCES: &str = "Mesa 22.3";
/// Greatest size of a reference, bytes.
const MOST_BYTES: u64 = 64 << 10;

/// How far a picture may be from its reference.
#[derive(Clone, Copy, Debug)]
struct Tolerance {
    /// Levels of 255 that nearly all pixels keep to.
    usual: u8,
    /// Share of pixels that must.
    share: f64,
    /// Levels that no pixel may pass.
    most: u8,
}

/// On the references' Mesa: runs in one machine are equal to the bit; the room is for other processors' f32 code.
const SAME_MESA: Tolerance = Tolerance {
    usual: 2,
    share: 0.999,
    most: 16,
};
/// On other drivers: silhouettes may move by a sample.
const OTHER_DRIVER: Tolerance = Tolerance {
    usual: 4,
    share: 0.99,
    most: 255,
};

struct Rgba {
    size: [u32; 2],
    bytes: Vec<u8>,
}

fn read_png(path: &Path) -> Result<Rgba, String> {
    let file = fs::File::open(path)
        .map_err(|e| format!("{}: {e}; make it with UPDATE_GOLDEN", path.display()))?;
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .map_err(|e| e.to_string())?;
    let mut bytes = vec![0; reader.output_buffer_size().ok_or("a picture too large")?];
    let info = reader.next_frame(&mut bytes).map_err(|e| e.to_string())?;
    if info.color_type != png::ColorType::Rgb {
        return Err(format!(
            "{}: expected RGB, found {:?}",
            path.display(),
            info.color_type
        ));
    }
    let bytes = bytes
        .chunks_exact(3)
        .flat_map(|p| [p[0], p[1], p[2], 255])
        .collect();
    Ok(Rgba {
        size: [info.width, info.height],
        bytes,
    })
}

/// Says what is wrong, or nothing.
fn compare(actual: &Rgba, expected: &Rgba, tolerance: Tolerance) -> Result<(), String> {
    if actual.size != expected.size {
        return Err(format!(
            "the size is {:?}, the reference's {:?}",
            actual.size, expected.size
        ));
    }
    let worst_of = |(a, b): (&[u8], &[u8])| {
        a.iter()
            .zip(b)
            .map(|(x, y)| x.abs_diff(*y))
            .max()
            .unwrap_or(0)
    };
    let worst: Vec<u8> = actual
        .bytes
        .chunks_exact(4)
        .zip(expected.bytes.chunks_exact(4))
        .map(worst_of)
        .collect();
    let kept = worst.iter().filter(|d| **d <= tolerance.usual).count() as f64 / worst.len() as f64;
    let most = worst.iter().max().copied().unwrap_or(0);
    if kept < tolerance.share || most > tolerance.most {
        return Err(format!(
            "{:.4} of the pixels within {}, the worst off by {most}",
            kept, tolerance.usual
        ));
    }
    Ok(())
}

fn scenes_by_name() -> Vec<(&'static str, TestStore, PictureSettings)> {
    let body = || phantom("phantom:body:128,84,150:u16");
    let vessels = || phantom("phantom:vessels:96,96,96:u8");
    let waves = || {
        let mut source = field([70, 45, 52], VoxelType::F32, |p| {
            let r = (p - 0.5).length();
            0.5 + 0.5 * (r * 19.0).cos() * (1.0 - r)
        });
        source.desc.world_from_index = oblique();
        store_of(&mut source)
    };
    let mut out: Vec<(&'static str, TestStore, PictureSettings)> = Vec::new();
    let mut add = |name, store: TestStore, change: &dyn Fn(&Camera, &mut PictureSettings), mode| {
        let mut s = settings(&store.store, mode);
        s.size = [256, 256];
        let camera = s.camera;
        change(&camera, &mut s);
        out.push((name, store, s));
    };
    add(
        "body_iso_bone",
        body(),
        &|_, s| s.classification.iso[0].value = 2700.0,
        Mode::Iso,
    );
    add(
        "body_iso_skin_from_the_front",
        body(),
        &|_, s| s.classification.iso[0].value = 500.0,
        Mode::Iso,
    );
    add("body_dvr", body(), &|_, _| {}, Mode::Dvr);
    add(
        "body_dvr_shaded_on_grey",
        body(),
        &|_, s| {
            s.shading = Shading {
                model: ShadingModel::Phong,
                light: Some(DVec3::new(1.0, -0.5, -1.0)),
                ..s.shading
            };
            s.background = Background::Color(Vec3::splat(0.5));
        },
        Mode::Dvr,
    );
    add("body_mip", body(), &|_, _| {}, Mode::Mip);
    add("vessels_mip", vessels(), &|_, _| {}, Mode::Mip);
    add(
        "vessels_iso_step_4",
        vessels(),
        &|_, s| s.step = 4.0,
        Mode::Iso,
    );
    add(
        "waves_dvr_orthographic",
        waves(),
        &|_, s| s.camera.projection = Projection::Orthographic,
        Mode::Dvr,
    );
    add(
        "waves_iso_level_1",
        waves(),
        &|_, s| s.lod = brickscope::scene::LodChoice::Fixed(brickscope::geom::Lod(1)),
        Mode::Iso,
    );
    let sponge = phantom("phantom:sponge:80,80,80:u8");
    let camera = inside(
        &sponge.store,
        DVec3::new(0.5, 0.5, 0.5),
        DVec3::new(1.0, 0.4, 0.2),
    );
    add(
        "sponge_iso_from_inside",
        sponge,
        &move |_, s| s.camera = camera,
        Mode::Iso,
    );
    let marschner = phantom("phantom:marschner-lobb:64,64,64:f32");
    let above = {
        let meta = marschner.store.meta();
        let bounds = volume_bounds(meta.dims, &meta.world_from_index);
        Camera::orbit(&bounds, 0.0, 60.0, 1.2, 30.0).expect("a sound camera")
    };
    add(
        "marschner_lobb_iso",
        marschner,
        &move |_, s| s.camera = above,
        Mode::Iso,
    );
    out
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn pictures_are_as_they_were() {
    let update = std::env::var("UPDATE_GOLDEN").ok();
    assert!(
        update.is_none() || std::env::var_os("CI").is_none(),
        "references are not written under CI"
    );
    let mut failures = Vec::new();
    let mut names = BTreeSet::new();
    for (name, store, settings) in scenes_by_name() {
        names.insert(format!("{name}.png"));
        let mut engine = gpu(&store, EngineOptions::default());
        let picture = engine.render(&settings).expect("the GPU draws");
        let actual = Rgba {
            size: settings.size,
            bytes: picture.image.to_rgba8(settings.background),
        };
        let reference = folder().join(format!("{name}.png"));
        if update.as_deref().is_some_and(|u| u == "all" || u == name) {
            write_png(&reference, 256, 256, &actual.bytes, true, Existing::Replace)
                .expect("the reference is written");
        }
        let driver = picture.stats.driver.unwrap_or_default();
        let same_mesa = driver.contains(MESA_OF_REFERENCES);
        let tolerance = if same_mesa { SAME_MESA } else { OTHER_DRIVER };
        let result = read_png(&reference).and_then(|expected| {
            let size = fs::metadata(&reference).map_or(u64::MAX, |m| m.len());
            if size > MOST_BYTES {
                return Err(format!(
                    "the reference takes {size} bytes, more than {MOST_BYTES}"
                ));
            }
            compare(&actual, &expected, tolerance).inspect_err(|reason| {
                report(name, &actual, &expected, reason, &driver);
            })
        });
        if !same_mesa {
            eprintln!("{name}: compared with the wider tolerance, on '{driver}'");
        }
        failures.extend(result.err().map(|reason| format!("{name}: {reason}")));
    }
    for entry in fs::read_dir(folder())
        .expect("tests/golden is there")
        .flatten()
    {
        let file = entry.file_name().to_string_lossy().into_owned();
        if !names.contains(&file) {
            failures.push(format!("{file}: no scene uses this reference"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Leaves behind what one needs to see what went wrong.
fn report(name: &str, actual: &Rgba, expected: &Rgba, reason: &str, driver: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("target/golden")
        .join(name);
    let write = || -> Result<(), Box<dyn std::error::Error>> {
        fs::create_dir_all(&folder)?;
        let [w, h] = actual.size;
        write_png(
            &folder.join("actual.png"),
            w,
            h,
            &actual.bytes,
            true,
            Existing::Replace,
        )?;
        if actual.size == expected.size {
            let amplified: Vec<u8> = actual
                .bytes
                .iter()
                .zip(&expected.bytes)
                .map(|(a, b)| a.abs_diff(*b).saturating_mul(8))
                .collect();
            write_png(
                &folder.join("diff.png"),
                w,
                h,
                &amplified,
                true,
                Existing::Replace,
            )?;
        }
        let json = serde_json::json!({ "name": name, "reason": reason, "driver": driver });
        write_whole(
            &folder.join("report.json"),
            Existing::Replace,
            json.to_string().as_bytes(),
        )?;
        Ok(())
    };
    if let Err(error) = write() {
        eprintln!("{name}: the report can't be written: {error}");
    }
}

#[test]
fn the_comparison_sees_what_it_must() {
    let grey = |v: u8| Rgba {
        size: [100, 100],
        bytes: vec![v; 40_000],
    };
    assert!(
        compare(&grey(100), &grey(102), SAME_MESA).is_ok(),
        "two levels are within tolerance"
    );
    assert!(
        compare(&grey(100), &grey(103), SAME_MESA).is_err(),
        "three levels everywhere are not"
    );
    let mut one_off = grey(100);
    one_off.bytes[0] = 130;
    assert!(
        compare(&grey(100), &one_off, SAME_MESA).is_err(),
        "one pixel far off is not"
    );
    let other_size = Rgba {
        size: [50, 200],
        bytes: vec![100; 40_000],
    };
    assert!(
        compare(&grey(100), &other_size, OTHER_DRIVER).is_err(),
        "another size is not"
    );
    assert!(
        read_png(Path::new("no/such.png")).is_err(),
        "a missing reference fails"
    );
}
