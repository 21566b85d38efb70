//! Stores, settings and engines for the tests of pictures.

use std::sync::Arc;

use brickscope::bricking::{self, BrickOptions, NoProgress};
use brickscope::camera::Camera;
use brickscope::classify::{
    ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint, TransferFunction,
};
use brickscope::engine::{DeviceChoice, Engine, EngineOptions, Picture, TickBudget};
use brickscope::scene::{
    GradientFilter, IsoSurface, Jitter, LodChoice, Mode, PictureSettings, ShadingModel,
    TransferMode, volume_bounds,
};
use brickscope::store::Store;
use brickscope::volume::{VoxelSource, VoxelType};
use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::memory_source::{MemorySource, noise};

/// A store on disk that goes with its folder.
pub struct TestStore {
    _folder: tempfile::TempDir,
    /// The store.
    pub store: Arc<Store>,
}

/// Bricks a source into a temporary store.
pub fn store_of(source: &mut dyn VoxelSource) -> TestStore {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("test.bsk");
    bricking::brick(source, &path, &BrickOptions::default(), &NoProgress)
        .expect("the source can be bricked");
    let store = Store::open(&path).expect("a store just written opens");
    store.check_all_levels().expect("its indices are sound");
    TestStore {
        store: Arc::new(store),
        _folder: folder,
    }
}

/// A phantom's store.
pub fn phantom(spec: &str) -> TestStore {
    store_of(
        brickscope::input::open(spec, &Default::default())
            .expect("a known phantom")
            .as_mut(),
    )
}

/// A volume of `dims` from a function of the voxel's centre (0–1 per axis) with values 0–1, stretched to the type.
pub fn field(dims: [u64; 3], voxel_type: VoxelType, value: impl Fn(DVec3) -> f64) -> MemorySource {
    let mut bytes = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let at = (DVec3::new(x as f64, y as f64, z as f64) + 0.5)
                    / DVec3::new(dims[0] as f64, dims[1] as f64, dims[2] as f64);
                let v = value(at).clamp(0.0, 1.0);
                match voxel_type {
                    VoxelType::U8 => bytes.push((v * 255.0).round() as u8),
                    VoxelType::U16 => bytes.extend(((v * 65535.0).round() as u16).to_le_bytes()),
                    VoxelType::F32 => bytes.extend((v as f32).to_le_bytes()),
                    other => panic!("no field of {other}"),
                }
            }
        }
    }
    MemorySource::new(dims, voxel_type, bytes)
}

/// A field with structure at every scale and with empty regions, over several bricks in each axis, in oblique voxels.
pub fn waves(voxel_type: VoxelType) -> TestStore {
    waves_of([70, 45, 52], voxel_type)
}

/// The same field in as many voxels as `dims` says.
pub fn waves_of(dims: [u64; 3], voxel_type: VoxelType) -> TestStore {
    let mut source = field(dims, voxel_type, |p| {
        let r = (p - 0.5).length();
        0.5 + 0.5 * (r * 19.0).cos() * (1.0 - r) + 0.1 * (p.x * 40.0).sin() * (p.y * 31.0).cos()
    });
    source.desc.world_from_index = oblique();
    store_of(&mut source)
}

/// Random single 4³ blocks of 255 in zeros, 96³: the hardest mesh there is.
pub fn speckle(share: u32, affine: DAffine3) -> TestStore {
    const EDGE: usize = 96;
    const BLOCKS: usize = EDGE / 4;
    let on: Vec<bool> = noise(BLOCKS.pow(3), 7).map(|v| v % share == 0).collect();
    let mut bytes = vec![0_u8; EDGE.pow(3)];
    for (i, byte) in bytes.iter_mut().enumerate() {
        let (x, y, z) = (i % EDGE / 4, i / EDGE % EDGE / 4, i / EDGE / EDGE / 4);
        if on[(z * BLOCKS + y) * BLOCKS + x] {
            *byte = 255;
        }
    }
    let mut source = MemorySource::new([EDGE as u64; 3], VoxelType::U8, bytes);
    source.desc.world_from_index = affine;
    store_of(&mut source)
}

/// A rotated, anisotropic, slightly sheared affine: nothing may rely on axes.
pub fn oblique() -> DAffine3 {
    let rotation = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(0.3);
    let shear = DMat3::from_cols(
        DVec3::X,
        DVec3::new(0.1, 1.0, 0.0),
        DVec3::new(0.0, 0.15, 1.0),
    );
    DAffine3::from_mat3_translation(
        rotation * shear * DMat3::from_diagonal(DVec3::new(0.8, 1.1, 1.7)),
        DVec3::new(-30.0, 12.0, 5.0),
    )
}

/// A coloured transfer function over 0–1 of the physical range, transparent below `from`.
pub fn transfer(store: &Store, from: f64) -> TransferFunction {
    let meta = store.meta();
    let ends = [meta.value_min, meta.value_max].map(|v| meta.rescale.physical(v));
    let at = |t: f64| ends[0] + (ends[1] - ends[0]) * t;
    let colors = [
        (0.0, [0.1, 0.1, 0.6]),
        (0.4, [0.9, 0.3, 0.1]),
        (0.7, [0.2, 0.8, 0.4]),
        (1.0, [1.0, 1.0, 0.9]),
    ];
    let opacities = [
        (from, 0.0),
        (from + 0.15, 0.08),
        (0.6, 0.05),
        (0.8, 0.5),
        (1.0, 0.7),
    ];
    TransferFunction::new(
        "test",
        ColorCurve::new(
            colors
                .iter()
                .map(|&(x, rgb)| ColorPoint { x: at(x), rgb })
                .collect(),
            ColorSpace::Rgb,
        )
        .expect("rising points"),
        OpacityCurve::new(
            opacities
                .iter()
                .map(|&(x, a)| OpacityPoint::linear(at(x), a))
                .collect(),
        )
        .expect("rising points"),
    )
}

/// A picture of `store`: 128², step 0.5, orbit 35, 20; iso at half of the range.
pub fn settings(store: &Store, mode: Mode) -> PictureSettings {
    let meta = store.meta();
    let half = meta
        .rescale
        .physical(0.5 * (meta.value_min + meta.value_max));
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let camera = Camera::orbit(&bounds, 35.0, 20.0, 1.0, 30.0).expect("a sound camera");
    let mut settings = PictureSettings::new(mode, transfer(store, 0.25), camera);
    settings.size = [128, 128];
    settings.classification.iso = vec![IsoSurface {
        value: half,
        color: Vec3::new(0.9, 0.8, 0.7),
        opacity: 1.0,
    }];
    let opacity = |low: f64, high: f64| {
        let points = settings.classification.transfer.opacity.points();
        let ends = [points[0].x, points[points.len() - 1].x];
        OpacityCurve::new(vec![
            OpacityPoint::linear(ends[0], low),
            OpacityPoint::linear(ends[1], high),
        ])
        .expect("rising points")
    };
    match mode {
        // What is low shows.
        Mode::MinIp => settings.classification.transfer.opacity = opacity(0.9, 0.2),
        // Whatever it is shows.
        Mode::Mean => settings.classification.transfer.opacity = opacity(0.3, 0.9),
        // What is behind shows, too.
        Mode::Xray => settings.classification.opacity_unit_mm = Some(30.0),
        _ => (),
    }
    settings
}

/// Every mode, and what changes how a mode draws: names and settings as [`settings`] has them.
pub fn looks(store: &Store) -> Vec<(&'static str, PictureSettings)> {
    let of = |mode| settings(store, mode);
    let mut looks: Vec<(&str, PictureSettings)> =
        Mode::ALL.map(|mode| (mode.name(), of(mode))).to_vec();
    let lit = |mut s: PictureSettings| {
        s.shading.model = ShadingModel::Phong;
        s
    };
    let mut preintegrated = of(Mode::Dvr);
    preintegrated.classification.transfer_mode = TransferMode::Preintegrated;
    preintegrated.step = 1.0;
    let mut surfaces = of(Mode::Iso);
    surfaces.classification.iso = translucent_surfaces(store);
    let filtered = |mut s: PictureSettings| {
        s.shading.gradient = GradientFilter::Filtered;
        s
    };
    let jittered = |mut s: PictureSettings| {
        s.jitter = Jitter::Interleaved;
        s.step = 1.5;
        s
    };
    looks.extend([
        ("lit pre-integrated", lit(preintegrated.clone())),
        ("pre-integrated", preintegrated),
        ("filtered surfaces", filtered(surfaces.clone())),
        ("surfaces", surfaces),
        ("filtered dvr", filtered(lit(of(Mode::Dvr)))),
        ("filtered gradient", filtered(of(Mode::Gradient))),
        ("jittered dvr", jittered(of(Mode::Dvr))),
        ("jittered iso", jittered(of(Mode::Iso))),
    ]);
    looks
}

/// Four surfaces at parts of the range, the last opaque, in no order.
pub fn translucent_surfaces(store: &Store) -> Vec<IsoSurface> {
    let meta = store.meta();
    let at = |part: f64| {
        let stored = meta.value_min + part * (meta.value_max - meta.value_min);
        meta.rescale.physical(stored)
    };
    [
        (0.55, [0.2, 0.9, 0.3], 0.5),
        (0.3, [0.9, 0.3, 0.2], 0.3),
        (0.42, [0.3, 0.3, 0.9], 0.4),
        (0.75, [0.9, 0.9, 0.7], 1.0),
    ]
    .map(|(part, color, opacity)| IsoSurface {
        value: at(part),
        color: Vec3::from(color),
        opacity,
    })
    .to_vec()
}

/// A camera in the middle of the volume, looking along `direction`.
pub fn inside(store: &Store, place: DVec3, direction: DVec3) -> Camera {
    let meta = store.meta();
    let eye = meta
        .world_from_index
        .transform_point3(meta.dims.as_dvec3() * place);
    Camera {
        eye,
        target: eye + direction,
        up: if direction.normalize().z.abs() > 0.9 {
            DVec3::Y
        } else {
            DVec3::Z
        },
        fov_y_degrees: 60.0,
        projection: brickscope::camera::Projection::Perspective,
        near_mm: 0.0,
    }
}

/// The same picture from inside [`waves`], of which several levels are seen.
pub fn through_levels(store: &TestStore, mut settings: PictureSettings) -> PictureSettings {
    settings.camera = inside(
        &store.store,
        DVec3::new(0.45, 0.2, 0.5),
        DVec3::new(0.3, 1.0, 0.2),
    );
    // Voxels are 0.8 mm and more, a pixel of 128 is 0.009 mm per mm of distance: level 1 begins at about 15 mm.
    (settings.lod, settings.lod_error) = (LodChoice::Auto, 12.0);
    settings
}

/// A picture of several levels of a volume of some 200³ voxels: from inside, with voxels of a few pixels nearby.
pub fn many_levels(store: &TestStore, mode: Mode) -> PictureSettings {
    let mut s = settings(&store.store, mode);
    s.size = [96, 80];
    s.camera = inside(
        &store.store,
        DVec3::new(0.5, 0.1, 0.45),
        DVec3::new(0.1, 1.0, 0.2),
    );
    s.lod_error = 3.0;
    s
}

/// An engine on the software adapter.
pub fn gpu(store: &TestStore, options: EngineOptions) -> Engine {
    let options = EngineOptions {
        device: DeviceChoice::SoftwareGpu,
        ..options
    };
    Engine::with_store(Arc::clone(&store.store), options)
        .expect("a graphics adapter: install mesa-vulkan-drivers, or set SKIP_GPU_TESTS=1")
}

/// The picture that the CPU reference draws.
pub fn reference(store: &TestStore, settings: &PictureSettings) -> Picture {
    let options = EngineOptions {
        device: DeviceChoice::Reference,
        ..EngineOptions::default()
    };
    Engine::with_store(Arc::clone(&store.store), options)
        .and_then(|mut engine| engine.render(settings))
        .expect("the reference draws")
}

/// An engine on the CPU.
pub fn cpu(store: &TestStore, options: EngineOptions) -> Engine {
    let options = EngineOptions {
        device: DeviceChoice::Cpu,
        ..options
    };
    Engine::with_store(Arc::clone(&store.store), options).expect("there is always a CPU")
}

/// The picture that the GPU draws with fresh caches.
pub fn drawn(store: &TestStore, settings: &PictureSettings) -> Picture {
    gpu(store, EngineOptions::default())
        .render(settings)
        .expect("the GPU draws")
}

/// Ticks until the picture has converged.
pub fn tick_to_end(engine: &mut Engine, budget: &TickBudget) {
    let ended = (0..20_000).any(|_| engine.tick(budget).expect("a tick").converged);
    assert!(ended, "20 000 ticks and no end");
}
