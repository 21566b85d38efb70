//! What geometry costs, and what it saves: frames with nothing, a plane, six planes, a box, closed meshes of 10⁵ triangles, an
//! opaque mesh in front and a translucent one, on the first graphics adapter (the software one first) and on the CPU.
//!
//! Measures: process-CPU and wall milliseconds per frame of a small turn, everything resident after one warm-up frame, by
//! turns in one run; samples per frame; and, of the first frame of a fresh engine, the bricks that were loaded. Does not
//! measure: reading mesh files, the compilation of pipelines.
//!
//! `cargo bench --bench geometry -- STORE.bsk [--frames N] [--size N] [--mode dvr|iso] [--iso VALUE]`

#[cfg(not(feature = "gpu"))]
fn main() {
    eprintln!("this bench needs the feature `gpu`");
}

#[cfg(feature = "gpu")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    gpu::main()
}

#[cfg(feature = "gpu")]
mod gpu {
    use std::error::Error;
    use std::path::PathBuf;
    use std::sync::Arc;

    use brickscope::camera::{BoundingSphere, Camera};
    use brickscope::classify::grey_ramp;
    use brickscope::clip::{
        ClipMesh, CutFaces, Geometry, OrientedBox, Plane, Side, SurfaceMesh, TriangleMesh,
    };
    use brickscope::clock::Stopwatch;
    use brickscope::engine::{DeviceChoice, Engine, EngineOptions};
    use brickscope::scene::{
        IsoSurface, LodChoice, Mode, PictureSettings, default_window, volume_bounds,
    };
    use comfy_table::Table;
    use glam::{DMat3, DVec3, Vec3};

    struct Args {
        store: PathBuf,
        frames: u32,
        size: u32,
        mode: Mode,
        iso: Option<f64>,
    }

    fn args() -> Result<Args, Box<dyn Error>> {
        let mut out = Args {
            store: PathBuf::new(),
            frames: 5,
            size: 512,
            mode: Mode::Dvr,
            iso: None,
        };
        let mut words = std::env::args().skip(1).filter(|w| w != "--bench");
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or(format!("{word} needs a value"));
            match word.as_str() {
                "--frames" => out.frames = value()?.parse()?,
                "--size" => out.size = value()?.parse()?,
                "--iso" => out.iso = Some(value()?.parse()?),
                "--mode" => {
                    let name = value()?;
                    let mode = Mode::ALL.into_iter().find(|m| m.name() == name);
                    out.mode = mode.ok_or(format!("no mode {name}"))?;
                }
                store => out.store = store.into(),
            }
        }
        Ok(out)
    }

    /// A ball of two shells, 81 920 and 20 480 triangles: the outer one, and one inside it that is turned over.
    fn shells(center: DVec3, radius: f64) -> Result<TriangleMesh, Box<dyn Error>> {
        let outer = TriangleMesh::sphere(center, radius, 6)?;
        let inner = TriangleMesh::sphere(center, radius * 0.25, 5)?;
        let first = outer.vertices().len() as u32;
        let vertices = [outer.vertices(), inner.vertices()].concat();
        let turned = inner
            .triangles()
            .iter()
            .map(|t| [t[0], t[2], t[1]].map(|v| v + first));
        let triangles = outer.triangles().iter().copied().chain(turned).collect();
        Ok(TriangleMesh::new(vertices, triangles, None)?)
    }

    fn geometries(
        bounds: &BoundingSphere,
        to_eye: DVec3,
    ) -> Result<Vec<(&'static str, Geometry)>, Box<dyn Error>> {
        let BoundingSphere { center, radius } = *bounds;
        let plane = |normal: DVec3, off: f64| {
            Plane::new(
                normal,
                -normal.dot(center + normal.normalize() * off * radius),
            )
            .expect("a normal")
        };
        // Beside the eye, so that half of every ray's volume goes.
        let side = to_eye.cross(DVec3::Z).normalize();
        let clips = |mesh: &Arc<TriangleMesh>, side| Geometry {
            clip_meshes: vec![ClipMesh {
                mesh: Arc::clone(mesh),
                side,
            }],
            ..Geometry::default()
        };
        let planes = |planes: Vec<Plane>| Geometry {
            planes,
            ..Geometry::default()
        };
        let drawn = |opacity, off: f64, size: f64| -> Result<Geometry, Box<dyn Error>> {
            let mesh = Arc::new(shells(center + to_eye * (off * radius), size * radius)?);
            Ok(Geometry {
                surfaces: vec![SurfaceMesh {
                    mesh,
                    color: Vec3::new(0.9, 0.6, 0.3),
                    opacity,
                }],
                ..Geometry::default()
            })
        };
        let turned = OrientedBox {
            center,
            half_extent: DVec3::splat(0.35 * radius),
            world_from_box: DMat3::from_rotation_z(0.4),
        };
        let ball = Arc::new(shells(center, 0.5 * radius)?);
        let capped = Geometry {
            faces: CutFaces {
                are_capped: true,
                have_normals: true,
            },
            ..planes(vec![plane(-to_eye, 0.0)])
        };
        Ok(vec![
            ("nothing", Geometry::default()),
            (
                "a plane that removes half, seen from the side",
                planes(vec![plane(side, 0.0)]),
            ),
            (
                "a plane that removes the front half",
                planes(vec![plane(-to_eye, 0.0)]),
            ),
            ("the same, capped", capped),
            (
                "six planes that remove nothing",
                planes(
                    [DVec3::X, DVec3::Y, DVec3::Z]
                        .into_iter()
                        .flat_map(|n| [plane(n, -2.0), plane(-n, -2.0)])
                        .collect(),
                ),
            ),
            ("a box", planes(turned.planes().to_vec())),
            (
                "inside a mesh of 102 400 triangles",
                clips(&ball, Side::Inside),
            ),
            ("outside it", clips(&ball, Side::Outside)),
            ("an opaque mesh through the middle", drawn(1.0, 0.0, 0.6)?),
            ("an opaque mesh in front", drawn(1.0, 1.3, 0.3)?),
            ("a translucent mesh", drawn(0.4, 0.0, 0.6)?),
        ])
    }

    struct Row {
        name: &'static str,
        settings: PictureSettings,
        loaded: Option<u64>,
        samples: u64,
        ms: Vec<[f64; 2]>,
    }

    fn median(values: impl Iterator<Item = f64>) -> f64 {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    }

    pub fn main() -> Result<(), Box<dyn Error>> {
        let args = args()?;
        for device in [DeviceChoice::SoftwareGpu, DeviceChoice::Cpu] {
            let open = || {
                let options = EngineOptions {
                    device: device.clone(),
                    ..EngineOptions::default()
                };
                Engine::open(&args.store, options)
            };
            let mut engine = open()?;
            let meta = engine.meta().clone();
            let bounds = volume_bounds(meta.dims, &meta.world_from_index);
            let [low, high] = default_window(&meta);
            let camera = Camera::orbit(&bounds, 30.0, 20.0, 1.0, 30.0)?;
            let to_eye = (camera.eye - bounds.center).normalize();
            let mut base = PictureSettings::new(args.mode, grey_ramp(low, high, 0.5)?, camera);
            base.size = [args.size; 2];
            (base.step, base.lod) = (1.0, LodChoice::Fixed(brickscope::geom::Lod(0)));
            let middle = args.iso.unwrap_or(0.5 * (low + high));
            base.classification.iso = vec![IsoSurface::opaque(middle)];
            let mut rows = Vec::new();
            for (name, geometry) in geometries(&bounds, to_eye)? {
                let settings = PictureSettings {
                    geometry: Arc::new(geometry),
                    ..base.clone()
                };
                let fresh = open()?.render(&settings)?;
                rows.push(Row {
                    name,
                    settings,
                    loaded: fresh.stats.bricks_read,
                    samples: fresh.stats.samples,
                    ms: Vec::new(),
                });
            }
            for frame in 0..=args.frames {
                for row in &mut rows {
                    let turn = 30.0 + f64::from(frame) * 0.5;
                    row.settings.camera = Camera::orbit(&bounds, turn, 20.0, 1.0, 30.0)?;
                    let watch = Stopwatch::start();
                    engine.render(&row.settings)?;
                    let lap = watch.elapsed();
                    // The first turn makes pipelines and brings bricks.
                    if frame > 0 {
                        row.ms.push([lap.cpu_ms.unwrap_or(f64::NAN), lap.wall_ms]);
                    }
                }
            }
            let mut table = Table::new();
            table.set_header([
                "geometry",
                "bricks loaded",
                "of all",
                "samples (M)",
                "of all",
                "CPU ms",
                "of nothing",
                "wall ms",
            ]);
            let ms = |row: &Row, n: usize| median(row.ms.iter().map(|m| m[n]));
            let first = &rows[0];
            for row in &rows {
                let share = |n: f64, all: f64| format!("{:.3}", n / all);
                let bricks = |r: &Row| r.loaded.unwrap_or(0) as f64;
                table.add_row([
                    row.name.to_owned(),
                    format!("{}", bricks(row)),
                    share(bricks(row), bricks(first)),
                    format!("{:.2}", row.samples as f64 / 1e6),
                    share(row.samples as f64, first.samples as f64),
                    format!("{:.1}", ms(row, 0)),
                    share(ms(row, 0), ms(first, 0)),
                    format!("{:.1}", ms(row, 1)),
                ]);
            }
            println!(
                "{} {}², {}, {} frames\n{table}",
                engine.device_name(),
                args.size,
                args.mode.name(),
                args.frames
            );
        }
        Ok(())
    }
}
