//! On Mesa's software adapter a condition that depends on uniforms alone has their values put into the shader, which is then
//! compiled anew whenever they change: half a second for every frame (shaders/README.md). Here every look is drawn, at rest and
//! moving, from several cameras, and the driver's cache of compiled shaders must not grow behind the first of each kind.

#![cfg(feature = "gpu")]

#[path = "support/compare.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod compare;
#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use brickscope::camera::{Camera, Projection};
use brickscope::clip::{ClipMesh, CutFaces, Geometry, Plane, Side, SurfaceMesh, TriangleMesh};
use brickscope::engine::EngineOptions;
use brickscope::scene::{PictureSettings, volume_bounds};
use glam::{DVec3, Vec3};
use scenes::{gpu, inside, looks, phantom};

/// The driver's cache, which only a process that begins with it uses.
const CACHE: &str = "MESA_SHADER_CACHE_DIR";
/// How many cameras the process draws.
const CAMERAS: &str = "BRICKSCOPE_TEST_CAMERAS";

/// Compiled shaders that are larger than helpers of the driver.
fn compiled(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).expect("the driver's cache");
    let entries = entries.map(|e| e.expect("an entry"));
    entries
        .map(|e| match e.metadata() {
            Ok(data) if data.is_dir() => compiled(&e.path()),
            Ok(data) => usize::from(data.len() > 8 << 10 && data.len() < 1 << 20),
            // A file that is being renamed.
            Err(_) => 0,
        })
        .sum()
}

/// Draws every look from the first so many cameras, in a process of its own: the driver writes its cache until it ends.
fn draw(cameras: usize, cache: &Path) -> usize {
    let output = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "draw_every_look", "--ignored"])
        .env(CACHE, cache)
        .env(CAMERAS, cameras.to_string())
        .output()
        .expect("this program runs");
    let text = [output.stdout, output.stderr].concat();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&text)
    );
    compiled(cache)
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_new_camera_compiles_nothing() {
    // Side by side, each with a cache of its own: a process draws on one thread most of the time.
    let [first, all] = std::thread::scope(|scope| {
        let drawn = [2, 4].map(|cameras| {
            scope.spawn(move || {
                let folder = tempfile::tempdir().expect("a folder");
                draw(cameras, folder.path())
            })
        });
        drawn.map(|thread| thread.join().expect("a count"))
    });
    assert!(first > 20, "the driver keeps what it compiles: {first}");
    assert_eq!(first, all, "shaders for two cameras, and for four");
}

#[test]
#[ignore = "the other test runs it, with a cache of its own"]
fn draw_every_look() {
    let count = std::env::var(CAMERAS).expect("started by the other test");
    let count: i32 = count.parse().expect("a number");
    let store = phantom("phantom:body:120,100,130:u16");
    let meta = store.store.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let mut engine = gpu(&store, EngineOptions::default());
    let ball = |off: DVec3| {
        let mesh = TriangleMesh::sphere(bounds.center + off, 0.4 * bounds.radius, 2);
        Arc::new(mesh.expect("a sphere"))
    };
    let geometry = Arc::new(Geometry {
        planes: vec![Plane::new(DVec3::X, -bounds.center.x).expect("a plane")],
        clip_meshes: vec![ClipMesh {
            mesh: ball(DVec3::ZERO),
            side: Side::Outside,
        }],
        surfaces: vec![SurfaceMesh {
            mesh: ball(DVec3::Y * 20.0),
            color: Vec3::X,
            opacity: 0.5,
        }],
        faces: CutFaces {
            are_capped: true,
            have_normals: true,
        },
    });
    let mut all = looks(&store.store);
    // These are others with other constants.
    all.retain(|(look, _)| !look.starts_with("jittered") && *look != "filtered surfaces");
    for (look, s) in all.clone() {
        if look == "dvr" || look == "iso" {
            let mut cut = s;
            cut.geometry = Arc::clone(&geometry);
            all.push((look, cut.clone()));
            cut.camera.projection = Projection::Fisheye;
            all.push((look, cut));
        }
    }
    for (look, s) in all {
        for n in 0..count {
            let turn = f64::from(n);
            let camera = if n % 2 == 0 {
                Camera::orbit(&bounds, 37.0 * turn, 9.0 * turn, 0.7 + 0.2 * turn, 35.0)
                    .expect("a camera")
            } else {
                let place = DVec3::new(0.1 * turn, 0.5, 0.4);
                inside(&store.store, place, DVec3::new(0.3, 0.2, -0.5 + 0.1 * turn))
            };
            let camera = Camera {
                projection: s.camera.projection,
                ..camera
            };
            let s = PictureSettings {
                camera,
                size: [48, 40],
                lod_error: 0.3,
                ..s.clone()
            };
            engine.render(&s).expect(look);
            engine.draw_moving(&s).expect(look);
        }
    }
}
