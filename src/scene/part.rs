//! Rays cut to parts: what clip geometry leaves of them, and the layers of meshes that lie between the parts.
//!
//! Sample positions stay where they are (invariant 1 of design.md): a sample is taken if its position is kept. A layer that lies
//! between two samples splits what the segment between them contributes, by length.

use glam::{DVec3, Vec3, Vec4};

use super::{Mode, PictureSettings, RayFrame, Shading, phong};
use crate::camera::{Projection, fan};
use crate::clip::Geometry;

/// What a contribution to a ray belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contribution {
    /// Sample i: the segment from it to the next, composited.
    Sample,
    /// The segment from the sample before to sample i, with the values at both.
    Segment,
    /// Its value alone: where it lies between layers doesn't matter.
    Value,
}

impl Contribution {
    /// That of a picture.
    pub fn of(settings: &PictureSettings) -> Self {
        match settings.mode {
            Mode::Mip | Mode::MinIp | Mode::Mean => Self::Value,
            _ if settings.is_by_segment() => Self::Segment,
            _ => Self::Sample,
        }
    }
}

/// A part of a ray in which the volume is sampled, and the layer behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayPart {
    /// Where it begins, mm from the eye (orthographic: from the eye plane).
    pub begin_mm: f32,
    /// Where it ends and its layer lies; before its beginning where there is no volume in front of the layer.
    pub end_mm: f32,
    /// It begins at the layer at which the part before ended.
    pub continues: bool,
    /// Where what is kept began: its own beginning, or that of the first of the parts that it continues.
    pub since_mm: f32,
    /// Where it begins at a cut face: the face's unit normal, world, towards the eye.
    pub cut: Option<Vec3>,
    /// The layer behind it: lit colour, premultiplied, and opacity. An opacity of 1 ends the ray.
    pub layer: Option<Vec4>,
}

impl RayPart {
    /// All of a ray.
    pub const WHOLE: Self = Self {
        begin_mm: f32::NEG_INFINITY,
        end_mm: f32::INFINITY,
        continues: false,
        since_mm: f32::NEG_INFINITY,
        cut: None,
        layer: None,
    };

    /// Its samples at a level whose sample 0 lies at `first_mm`, and whose others follow every `step_mm`.
    pub fn samples(&self, first_mm: f32, step_mm: f32, of: Contribution) -> PartSamples {
        let at = |mm: f32| (mm - first_mm) / step_mm;
        let (begin, end) = (at(self.begin_mm), at(self.end_mm));
        let splits = of != Contribution::Value;
        // The sample in front of a layer is taken on both sides of it, if it is kept; so is, with segments, the one behind it.
        let first = if self.continues && splits && at(self.since_mm) <= begin.floor() {
            begin.floor()
        } else {
            begin.ceil()
        };
        let is_far_end_needed = of == Contribution::Segment && self.layer.is_some();
        let last = end.ceil() - f32::from(u8::from(!is_far_end_needed));
        let is_empty = begin >= end;
        PartSamples {
            begin,
            first: first.clamp(-2e9, 2e9) as i32,
            last: if is_empty {
                i32::MIN
            } else {
                last.clamp(-2e9, 2e9) as i32
            },
            between: [
                if self.continues && splits {
                    begin
                } else {
                    -1e30
                },
                if self.layer.is_some() && splits {
                    end
                } else {
                    1e30
                },
            ],
        }
    }
}

/// The samples of a part of a ray at a level, in steps of that level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartSamples {
    /// Where the part begins, between samples.
    pub begin: f32,
    /// The first one.
    pub first: i32,
    /// The last one; none when it is less than the first.
    pub last: i32,
    /// The layers at its ends; far away where there is none.
    pub between: [f32; 2],
}

impl PartSamples {
    /// How much of the segment behind sample `i` lies between the layers, 0 to 1.
    pub fn share(&self, i: i32) -> f32 {
        (i as f32 + 1.0).min(self.between[1]) - (i as f32).max(self.between[0])
    }

    /// Does it end behind where it begins? It may have no sample all the same.
    pub fn has_volume(&self) -> bool {
        self.last > i32::MIN
    }

    /// Does sample `i`, or the segment behind it, lie within a sample of where the part begins?
    pub fn is_at_face(&self, i: i32) -> bool {
        (i as f32) < self.begin + 1.0
    }
}

/// The parts of the ray through a point of the image plane, front to back. One where there is no geometry.
pub fn ray_parts(
    frame: &RayFrame,
    geometry: &Geometry,
    shading: &Shading,
    plane: [f32; 2],
) -> Vec<RayPart> {
    if geometry.is_empty() {
        return vec![RayPart::WHOLE];
    }
    let (origin, direction, near_mm) = world_ray(frame, plane);
    let mut continues = false;
    let mut since_mm = 0.0;
    let spans = geometry.spans(origin, direction, near_mm);
    let part = |span: crate::clip::Span| {
        let layer = span.layer.map(|layer| {
            let surface = &geometry.surfaces[layer.surface];
            let normal = layer.normal.as_vec3();
            phong(surface.color, normal, direction.as_vec3(), shading).extend(1.0) * surface.opacity
        });
        let begin_mm = span.begin_mm as f32;
        let is_kept = begin_mm.is_finite();
        let continues_now = continues && span.cut.is_none();
        if is_kept && !continues_now {
            since_mm = begin_mm;
        }
        let part = RayPart {
            begin_mm,
            end_mm: span.end_mm as f32,
            continues: continues_now,
            since_mm,
            cut: span.cut.map(|n| n.as_vec3()),
            layer,
        };
        continues = layer.is_some();
        part
    };
    spans.into_iter().map(part).collect()
}

/// Origin, unit direction and the distance of the near plane of a ray, mm.
fn world_ray(frame: &RayFrame, plane: [f32; 2]) -> (DVec3, DVec3, f64) {
    let [u, v] = plane.map(f64::from);
    let near_mm = f64::from(frame.near_mm);
    let view = frame.world_from_view.matrix3;
    let eye = frame.world_from_view.translation;
    let across =
        view.x_axis * (u * frame.half_extent[0]) + view.y_axis * (v * frame.half_extent[1]);
    let forward = -view.z_axis;
    match frame.projection {
        Projection::Perspective => {
            let direction = forward + across;
            let stretch = direction.length();
            (eye, direction / stretch, near_mm * stretch)
        }
        Projection::Orthographic => (eye + across, forward, near_mm),
        Projection::Fisheye | Projection::Equirectangular => {
            let [half_width, half_height] = frame.half_extent;
            let [ahead, aside, above] = fan(frame.projection, [u * half_width, v * half_height]);
            let direction = forward * ahead + view.x_axis * aside + view.y_axis * above;
            (eye, direction, near_mm)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(begin_mm: f32, end_mm: f32, continues: bool, has_layer: bool) -> RayPart {
        RayPart {
            begin_mm,
            end_mm,
            continues,
            since_mm: 0.0,
            cut: None,
            layer: has_layer.then_some(Vec4::ONE),
        }
    }

    #[test]
    fn samples_lie_between_cuts() {
        let samples =
            |begin, end| part(begin, end, false, false).samples(10.0, 0.5, Contribution::Sample);
        let of = |s: PartSamples| (s.first, s.last);
        assert_eq!(of(samples(10.1, 12.1)), (1, 4));
        assert_eq!(
            of(samples(12.1, 13.0)),
            (5, 5),
            "the next part goes on where that one ends"
        );
        assert_eq!(
            of(samples(13.0, 13.5)),
            (6, 6),
            "the first is inside, the last is not"
        );
        assert_eq!(samples(10.1, 12.1).share(4), 1.0, "a cut doesn't split");
        let empty = samples(12.0, 12.0);
        assert!(empty.last < empty.first);
    }

    #[test]
    fn a_layer_splits_the_segment_it_lies_in() {
        for of in [Contribution::Sample, Contribution::Segment] {
            let front = part(0.0, 2.3, false, true).samples(0.0, 1.0, of);
            let between = part(2.3, 2.7, true, true).samples(0.0, 1.0, of);
            let back = part(2.7, 9.0, true, false).samples(0.0, 1.0, of);
            let behind = i32::from(of == Contribution::Segment);
            assert_eq!(front.last, 2 + behind);
            assert_eq!((between.first, between.last), (2, 2 + behind));
            assert_eq!(back.first, 2);
            let shares = [front, between, back].map(|p| p.share(2));
            assert!((shares[0] - 0.3).abs() < 1e-6 && (shares[1] - 0.4).abs() < 1e-6);
            assert!(
                (shares.iter().sum::<f32>() - 1.0).abs() < 1e-6,
                "{shares:?}"
            );
            assert_eq!((front.share(1), back.share(3)), (1.0, 1.0));
        }
        // Where a cut lies between the sample in front and the layer, the part behind takes none that was cut away.
        let begun = |since_mm| RayPart {
            since_mm,
            ..part(2.7, 9.0, true, false)
        };
        for (since_mm, first) in [(2.0, 2), (2.4, 3)] {
            let samples = begun(since_mm).samples(0.0, 1.0, Contribution::Segment);
            assert_eq!(samples.first, first, "kept from {since_mm}");
        }
        let value = part(0.0, 2.3, false, true).samples(0.0, 1.0, Contribution::Value);
        let next = part(2.3, 9.0, true, false).samples(0.0, 1.0, Contribution::Value);
        assert_eq!((value.last, next.first), (2, 3), "values are taken once");
    }
}
