//! The `body` phantom: a torso as contrast CT shows it, from the hips to the neck, arms out of the picture.
//!
//! Coordinates are −1 to 1 along each edge of the box: +x the patient's right, +y anterior, +z the head. It is not
//! symmetric, as no body is (heart, stomach and spleen left, liver right), so a mirrored picture shows.

mod bones;
mod organs;
mod vasculature;

use glam::{DMat3, DVec3};

use super::levels::Material;
use super::raster::Scene;
use super::shapes::{Profile, Shape, key};

/// Numbers of the materials; [`MATERIALS`] has their levels.
mod is {
    pub(super) const AIR: u8 = 0;
    pub(super) const LUNG: u8 = 1;
    pub(super) const FAT: u8 = 2;
    pub(super) const MUSCLE: u8 = 3;
    pub(super) const BOWEL: u8 = 4;
    pub(super) const HEART: u8 = 5;
    pub(super) const LIVER: u8 = 6;
    pub(super) const SPLEEN: u8 = 7;
    pub(super) const KIDNEY: u8 = 8;
    pub(super) const CARTILAGE: u8 = 9;
    pub(super) const VESSEL: u8 = 10;
    pub(super) const MARROW: u8 = 11;
    pub(super) const BONE: u8 = 12;
    pub(super) const CORTEX: u8 = 13;
}

/// Thousandths of full scale, and whether there is noise; by the numbers of [`is`].
const MATERIALS: [(u32, bool); 14] = [
    (0, false),
    (80, true),
    (250, true),
    (350, true),
    (420, true),
    (440, true),
    (460, true),
    (480, true),
    (500, true),
    (450, true),
    (620, false),
    (720, true),
    (820, true),
    (930, true),
];

/// The skin.
static OUTLINE: Profile = Profile {
    keys: &[
        key([-1.0, 0.0, -0.02, 0.60, 0.41]),
        key([-0.78, 0.0, -0.02, 0.64, 0.45]),
        key([-0.52, 0.0, 0.0, 0.60, 0.43]),
        key([-0.20, 0.0, 0.01, 0.54, 0.40]),
        key([0.10, 0.0, 0.0, 0.59, 0.43]),
        key([0.42, 0.0, 0.0, 0.63, 0.45]),
        key([0.64, 0.0, -0.03, 0.62, 0.41]),
        key([0.77, 0.0, -0.05, 0.52, 0.32]),
        key([0.85, 0.0, -0.07, 0.28, 0.23]),
        key([0.92, 0.0, -0.07, 0.20, 0.20]),
        key([1.0, 0.0, -0.06, 0.19, 0.20]),
    ],
};

/// What is inside the fat under the skin.
static MUSCLES: Profile = Profile {
    keys: &[
        key([-1.0, 0.0, -0.02, 0.53, 0.34]),
        key([-0.78, 0.0, -0.02, 0.58, 0.37]),
        key([-0.52, 0.0, 0.0, 0.54, 0.36]),
        key([-0.20, 0.0, 0.0, 0.48, 0.34]),
        key([0.10, 0.0, 0.0, 0.55, 0.39]),
        key([0.42, 0.0, 0.0, 0.59, 0.41]),
        key([0.64, 0.0, -0.03, 0.58, 0.37]),
        key([0.77, 0.0, -0.05, 0.47, 0.28]),
        key([0.85, 0.0, -0.07, 0.24, 0.20]),
        key([0.92, 0.0, -0.07, 0.18, 0.18]),
        key([1.0, 0.0, -0.06, 0.17, 0.18]),
    ],
};

/// The curve that ribs follow, and the cavities lie inside of.
static RIB_CAGE: Profile = Profile {
    keys: &[
        key([-0.42, 0.0, 0.0, 0.44, 0.31]),
        key([-0.10, 0.0, 0.0, 0.48, 0.33]),
        key([0.10, 0.0, 0.0, 0.50, 0.34]),
        key([0.38, 0.0, 0.0, 0.50, 0.35]),
        key([0.58, 0.0, -0.03, 0.42, 0.31]),
        key([0.72, 0.0, -0.06, 0.29, 0.24]),
        key([0.82, 0.0, -0.08, 0.20, 0.18]),
        key([0.90, 0.0, -0.10, 0.14, 0.14]),
    ],
};

/// All of the torso, in the order in which it is painted.
pub(super) fn scene() -> Scene {
    let materials = MATERIALS.map(|(level, noisy)| Material { level, noisy });
    let mut body = Body {
        scene: Scene::new(materials.to_vec()),
    };
    for side in [-1.0, 1.0] {
        body.ball(is::FAT, [0.53 * side, -0.05, 0.66], [0.17, 0.20, 0.17]);
    }
    body.scene.paint(is::FAT, Shape::Profile(&OUTLINE));
    for side in [-1.0, 1.0] {
        body.ball(
            is::MUSCLE,
            [0.53 * side, -0.05, 0.66],
            [0.135, 0.165, 0.135],
        );
    }
    body.scene.paint(is::MUSCLE, Shape::Profile(&MUSCLES));
    organs::paint(&mut body);
    bones::paint(&mut body);
    vasculature::paint(&mut body);
    organs::paint_airways(&mut body);
    body.scene
}

/// A scene, with the words in which a body is described.
struct Body {
    scene: Scene,
}

impl Body {
    /// An ellipsoid along the box's axes.
    fn ball(&mut self, material: u8, center: [f64; 3], radii: [f64; 3]) {
        self.tilted(material, center, radii, DMat3::IDENTITY);
    }

    /// An ellipsoid along the columns of `axes`.
    fn tilted(&mut self, material: u8, center: [f64; 3], radii: [f64; 3], axes: DMat3) {
        let (center, radii) = (DVec3::from_array(center), DVec3::from_array(radii));
        self.scene
            .paint(material, Shape::ellipsoid(center, radii, axes));
    }

    /// A tube through `points`, its radius changing evenly from `radii[0]` to `radii[1]`.
    fn tube(&mut self, material: u8, points: &[DVec3], radii: [f64; 2]) {
        let last = points.len().saturating_sub(2).max(1) as f64;
        for (i, pair) in points.windows(2).enumerate() {
            let radius = radii[0] + (radii[1] - radii[0]) * (i as f64 / last);
            self.scene
                .paint(material, Shape::capsule(pair[0], pair[1], radius));
        }
    }

    /// As [`Self::tube`], through a smooth curve that passes all of `points`.
    fn vessel(&mut self, material: u8, points: &[[f64; 3]], radii: [f64; 2]) {
        self.tube(material, &smooth(points), radii);
    }
}

/// A Catmull–Rom curve through `points`, as short straight pieces.
fn smooth(points: &[[f64; 3]]) -> Vec<DVec3> {
    const PIECES: usize = 8;
    let at = |i: isize| {
        let i = i.clamp(0, points.len() as isize - 1) as usize;
        DVec3::from_array(points[i])
    };
    let mut curve = vec![at(0)];
    for i in 0..points.len() as isize - 1 {
        let [a, b, c, d] = [at(i - 1), at(i), at(i + 1), at(i + 2)];
        for step in 1..=PIECES {
            let t = step as f64 / PIECES as f64;
            let cubic = (b - c) * 3.0 + d - a;
            let square = a * 2.0 - b * 5.0 + c * 4.0 - d;
            curve.push((b * 2.0 + (c - a + (square + cubic * t) * t) * t) * 0.5);
        }
    }
    curve
}

/// A rotation whose third column points along `along`, and whose first lies as near to `near` as it can.
fn frame(along: [f64; 3], near: [f64; 3]) -> DMat3 {
    let z = DVec3::from_array(along).normalize();
    let near = DVec3::from_array(near);
    let x = (near - z * near.dot(z)).normalize();
    DMat3::from_cols(x, z.cross(x), z)
}
