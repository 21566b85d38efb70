//! What was typed about geometry: what cuts the volume, and what is drawn with it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use glam::{DVec3, Vec3};

use super::args;
use super::config::Switch;
use crate::clip::{
    ClipMesh, CutFaces, Geometry, OrientedBox, Plane, Side, SurfaceMesh, TriangleMesh,
};
use crate::scene::IsoSurface;

#[derive(Clone, Debug, clap::Args)]
pub(super) struct GeometryArgs {
    /// Keep the half space n·x + d ≥ 0, world mm (repeatable; all cuts together keep what each of them keeps)
    #[arg(long, value_name = "nx,ny,nz,d", value_parser = plane, help_heading = "Clipping and geometry")]
    clip_plane: Vec<Plane>,
    /// Keep the inside of a box between two corners, world mm
    #[arg(long, value_name = "x0,y0,z0,x1,y1,z1", value_parser = clip_box, help_heading = "Clipping and geometry")]
    clip_box: Option<OrientedBox>,
    /// Keep what is inside (or outside) a closed mesh: STL, PLY or OBJ, world mm (repeatable)
    #[arg(long, value_name = "FILE[:inside|outside]", value_parser = clip_mesh, help_heading = "Clipping and geometry")]
    clip_mesh: Vec<ClipMeshArg>,
    /// Show on cut faces the data that they cut, opaque, as a slice does
    #[arg(
        long,
        value_enum,
        default_value = "off",
        help_heading = "Clipping and geometry"
    )]
    caps: Switch,
    /// Light what lies at a cut face by the face's normal instead of the gradient
    #[arg(
        long,
        value_enum,
        default_value = "off",
        help_heading = "Clipping and geometry"
    )]
    cut_normals: Switch,
    /// Draw a mesh with the volume: STL, PLY or OBJ, world mm (repeatable)
    #[arg(long, value_name = "FILE[:COLOR[:OPACITY]]", value_parser = mesh, help_heading = "Clipping and geometry")]
    mesh: Vec<MeshArg>,
}

#[derive(Clone, Debug)]
struct ClipMeshArg {
    path: PathBuf,
    side: Side,
}

#[derive(Clone, Debug)]
struct MeshArg {
    path: PathBuf,
    color: Vec3,
    opacity: f32,
}

fn plane(s: &str) -> Result<Plane, String> {
    let [x, y, z, d] = args::numbers::<4>(s)?;
    Plane::new(DVec3::new(x, y, z), d)
        .ok_or_else(|| format!("'{s}': expected a normal nx,ny,nz that is not 0, and d"))
}

fn clip_box(s: &str) -> Result<OrientedBox, String> {
    let [x0, y0, z0, x1, y1, z1] = args::numbers::<6>(s)?;
    OrientedBox::between(DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)).ok_or_else(|| {
        format!("'{s}': expected x0,y0,z0,x1,y1,z1 in mm, each of the last three above its first")
    })
}

fn clip_mesh(s: &str) -> Result<ClipMeshArg, String> {
    let (path, side) = match s.rsplit_once(':') {
        Some((path, "inside")) => (path, Side::Inside),
        Some((path, "outside")) => (path, Side::Outside),
        _ => (s, Side::Inside),
    };
    if path.is_empty() {
        return Err(format!("'{s}': expected FILE, FILE:inside or FILE:outside"));
    }
    Ok(ClipMeshArg {
        path: path.into(),
        side,
    })
}

fn mesh(s: &str) -> Result<MeshArg, String> {
    // From the right: a path may have colons of its own.
    let with = |path: &str, color, opacity| MeshArg {
        path: path.into(),
        color,
        opacity,
    };
    let opacity_of = |o: &str| o.parse::<f32>().ok().filter(|o| *o > 0.0 && *o <= 1.0);
    let parsed = match s.rsplit_once(':') {
        None => with(s, IsoSurface::DEFAULT_COLOR, 1.0),
        Some((front, last)) => match (front.rsplit_once(':'), args::color(last)) {
            (_, Ok(color)) => with(front, color, 1.0),
            (Some((path, color)), Err(_)) if args::color(color).is_ok() => {
                let opacity = opacity_of(last).ok_or_else(|| {
                    format!("'{s}': expected an opacity above 0 and at most 1 behind the colour")
                })?;
                with(path, args::color(color)?, opacity)
            }
            (_, Err(error)) if !Path::new(s).exists() && Path::new(front).exists() => {
                return Err(format!("'{s}': behind the file: {error}"));
            }
            _ => with(s, IsoSurface::DEFAULT_COLOR, 1.0),
        },
    };
    if parsed.path.as_os_str().is_empty() {
        return Err(format!(
            "'{s}': expected FILE, then if wanted :COLOR and :OPACITY"
        ));
    }
    Ok(parsed)
}

fn read(path: &Path, flag: &'static str) -> anyhow::Result<TriangleMesh> {
    TriangleMesh::read(path).context(flag)
}

impl GeometryArgs {
    /// The geometry that is meant, its files read.
    ///
    /// # Errors
    /// A mesh can't be read, a mesh that cuts is not closed, or there are too many of these.
    pub(super) fn geometry(&self) -> anyhow::Result<Arc<Geometry>> {
        if self.clip_mesh.len() > Geometry::MOST_CLIP_MESHES {
            bail!(
                "{} --clip-mesh, and at most {} cut one picture; join meshes into one file",
                self.clip_mesh.len(),
                Geometry::MOST_CLIP_MESHES
            );
        }
        let mut geometry = Geometry {
            planes: self.clip_plane.clone(),
            faces: CutFaces {
                are_capped: self.caps == Switch::On,
                have_normals: self.cut_normals == Switch::On,
            },
            ..Geometry::default()
        };
        geometry
            .planes
            .extend(self.clip_box.iter().flat_map(OrientedBox::planes));
        for arg in &self.clip_mesh {
            let mesh = read(&arg.path, "--clip-mesh")?
                .into_closed()
                .map_err(|e| e.of_file(&arg.path))
                .context("--clip-mesh")?;
            geometry.clip_meshes.push(ClipMesh {
                mesh: Arc::new(mesh),
                side: arg.side,
            });
        }
        for arg in &self.mesh {
            geometry.surfaces.push(SurfaceMesh {
                mesh: Arc::new(read(&arg.path, "--mesh")?),
                color: arg.color,
                opacity: arg.opacity,
            });
        }
        Ok(Arc::new(geometry))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_are_told_from_the_right() {
        let parsed = mesh("C:/a:b.stl:#00ff00:0.5").unwrap();
        assert_eq!(parsed.path, PathBuf::from("C:/a:b.stl"));
        assert_eq!((parsed.color, parsed.opacity), (Vec3::Y, 0.5));
        let parsed = mesh("skin.ply:1,0,0").unwrap();
        assert_eq!((parsed.color, parsed.opacity), (Vec3::X, 1.0));
        assert_eq!(
            mesh("C:/skin.ply").unwrap().path,
            PathBuf::from("C:/skin.ply")
        );
        assert!(mesh("a.stl:1,0,0:0").is_err() && mesh("a.stl:1,0,0:2").is_err());
        assert!(mesh("").is_err());
    }

    #[test]
    fn cuts_are_told() {
        assert_eq!(clip_mesh("a.stl").unwrap().side, Side::Inside);
        let outside = clip_mesh("a:b.stl:outside").unwrap();
        assert_eq!(
            (outside.path, outside.side),
            ("a:b.stl".into(), Side::Outside)
        );
        assert!(clip_mesh(":inside").is_err());
        assert!(plane("0,0,0,1").is_err() && plane("1,0,0").is_err());
        assert!(clip_box("0,0,0,1,1,0").is_err() && clip_box("-1,-1,-1,1,1,1").is_ok());
    }
}
