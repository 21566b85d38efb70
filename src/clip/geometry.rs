//! All that cuts a picture's volume or is drawn with it, and what it makes of a ray.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::{Crossing, Plane, TriangleMesh};

/// Which side of a closed mesh is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// Where the mesh winds around a point.
    Inside,
    /// Where it does not.
    Outside,
}

/// A closed mesh that cuts the volume.
#[derive(Clone, Debug)]
pub struct ClipMesh {
    /// Closed: [`TriangleMesh::check_closed`].
    pub mesh: Arc<TriangleMesh>,
    /// What is kept.
    pub side: Side,
}

/// A mesh that is drawn with the volume, itself never cut.
#[derive(Clone, Debug)]
pub struct SurfaceMesh {
    /// Any mesh.
    pub mesh: Arc<TriangleMesh>,
    /// Display colour, 0–1.
    pub color: Vec3,
    /// In (0, 1]; 1 ends rays.
    pub opacity: f32,
}

/// The same mesh is not compared vertex by vertex.
fn is_same(a: &Arc<TriangleMesh>, b: &Arc<TriangleMesh>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

impl PartialEq for ClipMesh {
    fn eq(&self, other: &Self) -> bool {
        self.side == other.side && is_same(&self.mesh, &other.mesh)
    }
}

impl PartialEq for SurfaceMesh {
    fn eq(&self, other: &Self) -> bool {
        let look = |s: &Self| (s.color, s.opacity);
        look(self) == look(other) && is_same(&self.mesh, &other.mesh)
    }
}

/// What cuts the volume, all of it by intersection, and what is drawn with it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Geometry {
    /// Half spaces that are kept; a box is six of them.
    pub planes: Vec<Plane>,
    /// Closed meshes, at most [`Self::MOST_CLIP_MESHES`].
    pub clip_meshes: Vec<ClipMesh>,
    /// Drawn at their depth.
    pub surfaces: Vec<SurfaceMesh>,
    /// How the faces look that cuts make.
    pub faces: CutFaces,
}

/// How cut faces look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CutFaces {
    /// They show the data that they cut, as a slice does: opaque, in the colour of the transfer function, wherever it shows
    /// something (mode iso: wherever the value lies above the least iso-value).
    pub are_capped: bool,
    /// What lies within a sample of them is lit by their normal.
    pub have_normals: bool,
}

impl CutFaces {
    /// Do they need to be known to those who take samples?
    pub fn matter(self) -> bool {
        self.are_capped || self.have_normals
    }
}

/// A part of a ray in which the volume is sampled, and the layer that lies at its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where it begins, mm from the ray's origin; samples at `begin_mm ≤ t < end_mm` are taken. Infinite where there is but
    /// a layer.
    pub begin_mm: f64,
    /// Where it ends, and where its layer lies. Infinite at a ray's last.
    pub end_mm: f64,
    /// Where it begins at a cut face: that face's unit normal, towards the ray's origin.
    pub cut: Option<DVec3>,
    /// What is composited behind it.
    pub layer: Option<Layer>,
}

/// Where a ray meets a mesh that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Which of [`Geometry::surfaces`].
    pub surface: usize,
    /// Its distance, mm from the ray's origin.
    pub at_mm: f64,
    /// Unit normal there, interpolated between the triangle's corners.
    pub normal: DVec3,
}

/// What a ray meets.
#[derive(Clone, Copy, Debug)]
struct Event {
    crossing: Crossing,
    /// Numbers clip meshes, then surfaces.
    id: usize,
}

impl Geometry {
    /// Most clip meshes: what the GPU counts windings of.
    pub const MOST_CLIP_MESHES: usize = 16;

    /// Is there nothing that cuts and nothing to draw?
    pub fn is_empty(&self) -> bool {
        self.planes.is_empty() && !self.has_meshes()
    }

    /// Is there a mesh, be it one that cuts or one to draw?
    pub fn has_meshes(&self) -> bool {
        !(self.clip_meshes.is_empty() && self.surfaces.is_empty())
    }

    /// The part of the ray that all planes keep, mm, from `near_mm`; the plane that it begins at. Empty when the first is not
    /// less than the second.
    fn kept_by_planes(
        &self,
        origin: DVec3,
        direction: DVec3,
        near_mm: f64,
    ) -> ([f64; 2], Option<DVec3>) {
        let mut kept = [near_mm, f64::INFINITY];
        let mut cut = None;
        for plane in &self.planes {
            let (distance, slope) = (plane.distance(origin), plane.normal().dot(direction));
            if slope > 0.0 {
                if -distance / slope > kept[0] {
                    kept[0] = -distance / slope;
                    cut = Some(-plane.normal());
                }
            } else if slope < 0.0 {
                kept[1] = kept[1].min(-distance / slope);
            } else if distance < 0.0 {
                kept[1] = f64::NEG_INFINITY;
            }
        }
        (kept, cut)
    }

    /// Everything the ray meets behind `near_mm`, by distance, then mesh, then triangle.
    fn events(&self, origin: DVec3, direction: DVec3, near_mm: f64) -> Vec<Event> {
        let clips = self.clip_meshes.iter().map(|c| &c.mesh);
        let surfaces = self.surfaces.iter().map(|s| &s.mesh);
        let mut events = Vec::new();
        let mut crossings = Vec::new();
        for (id, mesh) in clips.chain(surfaces).enumerate() {
            crossings.clear();
            mesh.crossings(origin, direction, &mut crossings);
            let behind = crossings.iter().filter(|c| c.at_mm > near_mm);
            events.extend(behind.map(|&crossing| Event { crossing, id }));
        }
        let key = |e: &Event| (e.id, e.crossing.triangle);
        events.sort_by(|a, b| {
            let by_distance = a.crossing.at_mm.total_cmp(&b.crossing.at_mm);
            by_distance.then_with(|| key(a).cmp(&key(b)))
        });
        events
    }

    /// The spans of the ray from `origin` along `direction` (unit), in order; the first begins at `near_mm` or behind it.
    /// A ray ends at the first opaque surface. Spans without volume and without a layer are left out.
    ///
    /// A point is inside a closed mesh where the mesh winds around it (non-zero rule). The winding is counted from the far
    /// end, where it is 0: what lies between the eye and the near plane does not matter.
    pub fn spans(&self, origin: DVec3, direction: DVec3, near_mm: f64) -> Vec<Span> {
        let events = self.events(origin, direction, near_mm);
        let clips = self.clip_meshes.len();
        let mut windings = vec![0_i32; clips];
        for event in events.iter().filter(|e| e.id < clips) {
            windings[event.id] -= if event.crossing.enters { 1 } else { -1 };
        }
        let keeps = |windings: &[i32]| {
            let sides = self.clip_meshes.iter().map(|c| c.side);
            windings
                .iter()
                .zip(sides)
                .all(|(&w, side)| (w != 0) == (side == Side::Inside))
        };
        let ([first_mm, last_mm], plane_cut) = self.kept_by_planes(origin, direction, near_mm);

        let mut cutter = Cutter {
            kept_mm: [first_mm, last_mm],
            face: plane_cut,
            spans: Vec::new(),
        };
        let mut is_kept = keeps(&windings);
        let mut begin = Begin {
            at_mm: near_mm,
            cut: None,
        };
        for event in events {
            let at_mm = event.crossing.at_mm;
            if let Some(surface) = event.id.checked_sub(clips) {
                let mesh = &self.surfaces[surface].mesh;
                let layer = Layer {
                    surface,
                    at_mm,
                    normal: mesh.normal_at(event.crossing.triangle, origin + direction * at_mm),
                };
                cutter.end(begin, at_mm, is_kept, Some(layer));
                if self.surfaces[surface].opacity >= 1.0 {
                    return cutter.spans;
                }
                // A face that is cut and drawn is cut behind its layer.
                let is_at_cut = at_mm - begin.at_mm <= thin(at_mm);
                begin = Begin {
                    at_mm,
                    cut: begin.cut.filter(|_| is_at_cut),
                };
                continue;
            }
            windings[event.id] += if event.crossing.enters { 1 } else { -1 };
            let keeps = keeps(&windings);
            if keeps == is_kept {
                continue;
            }
            if keeps {
                begin = cutter.reopened(at_mm).unwrap_or_else(|| {
                    let mesh = &self.clip_meshes[event.id].mesh;
                    let normal = mesh.face_normal(event.crossing.triangle);
                    Begin {
                        at_mm,
                        cut: Some(-normal * normal.dot(direction).signum()),
                    }
                });
            } else {
                cutter.end(begin, at_mm, true, None);
            }
            is_kept = keeps;
        }
        cutter.end(begin, f64::INFINITY, is_kept, None);
        cutter.spans
    }
}

/// What is thinner, at a distance, is rounding.
fn thin(at_mm: f64) -> f64 {
    if at_mm.is_finite() { at_mm * 1e-6 } else { 0.0 }
}

/// Where a part began that is kept, and the normal of the cut face there.
#[derive(Clone, Copy)]
struct Begin {
    at_mm: f64,
    cut: Option<DVec3>,
}

/// Makes spans of what meshes keep.
struct Cutter {
    /// What planes keep, and the face at its beginning.
    kept_mm: [f64; 2],
    face: Option<DVec3>,
    spans: Vec<Span>,
}

impl Cutter {
    /// The part from `begin` ends, at a layer or not.
    fn end(&mut self, begin: Begin, to_mm: f64, is_kept: bool, layer: Option<Layer>) {
        let [first_mm, last_mm] = self.kept_mm;
        let (begin_mm, cut) = if begin.at_mm < first_mm {
            (first_mm, self.face)
        } else {
            (begin.at_mm, begin.cut)
        };
        let end_mm = to_mm.min(last_mm);
        let is_kept = is_kept && end_mm - begin_mm > thin(end_mm);
        let reaches = is_kept && end_mm == to_mm;
        if is_kept {
            self.spans.push(Span {
                begin_mm,
                end_mm,
                cut,
                layer: layer.filter(|_| reaches),
            });
        }
        if layer.is_some() && !reaches {
            self.spans.push(Span {
                begin_mm: f64::INFINITY,
                end_mm: to_mm,
                cut: None,
                layer,
            });
        }
    }

    /// Where shells touch, one is left where another is entered, or nearly so: nothing is cut there, and the part before goes
    /// on. Where that began.
    fn reopened(&mut self, at_mm: f64) -> Option<Begin> {
        let touches = |s: &mut Span| s.layer.is_none() && at_mm - s.end_mm <= thin(at_mm);
        self.spans.pop_if(touches).map(|before| Begin {
            at_mm: before.begin_mm,
            cut: before.cut,
        })
    }
}

#[cfg(test)]
mod tests;
