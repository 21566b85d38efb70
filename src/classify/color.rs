//! Colour spaces in which control points are joined, with the constants of VTK's `vtkMath`.
//!
//! The conversions to CIE L*a*b* go through linear light (D65, white 0.9505, 1, 1.089); RGB in and out are display
//! values, 0 to 1.

use std::f64::consts::PI;

/// Reference white of VTK's L*a*b*, D65, 2° observer.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];
/// Where the cube root of L*a*b* becomes a line, and its slope.
const LAB_KNEE: f64 = 0.008856;
const LAB_SLOPE: f64 = 7.787;
/// Saturation (an angle of Msh) below which a colour counts as grey.
const UNSATURATED: f64 = 0.05;

/// The value at `t` (0…1) from `a` to `b`, componentwise.
pub(super) fn mix(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|i| (1.0 - t) * a[i] + t * b[i])
}

/// The colour at `t` between `a` and `b` with hue, saturation and value joined linearly; the hue, from red over green and
/// blue to red, never through red.
pub(super) fn mix_hsv(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    rgb_from_hsv(mix(hsv_from_rgb(a), hsv_from_rgb(b), t))
}

/// As [`mix_hsv`], but hue by the shorter way round.
pub(super) fn mix_hsv_wrapped(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    let (mut a, mut b) = (hsv_from_rgb(a), hsv_from_rgb(b));
    if (a[0] - b[0]).abs() > 0.5 {
        if a[0] > b[0] {
            a[0] -= 1.0;
        } else {
            b[0] -= 1.0;
        }
    }
    let mut hsv = mix(a, b, t);
    if hsv[0] < 0.0 {
        hsv[0] += 1.0;
    }
    rgb_from_hsv(hsv)
}

/// The colour at `t` between `a` and `b` with L*, a*, b* joined linearly.
pub(super) fn mix_lab(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    rgb_from_lab(mix(lab_from_rgb(a), lab_from_rgb(b), t))
}

/// The colour at `t` between `a` and `b` by Moreland's diverging maps ("Diverging Color Maps for Scientific
/// Visualization", 2009): joined in Msh, a polar form of L*a*b*, with white between two saturated, distinct colours.
pub(super) fn mix_diverging(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    let (mut a, mut b) = (msh_from_lab(lab_from_rgb(a)), msh_from_lab(lab_from_rgb(b)));
    let mut t = t;
    if a[1] > UNSATURATED && b[1] > UNSATURATED && hue_difference(a[2], b[2]) > 0.33 * PI {
        let white = [a[0].max(b[0]).max(88.0), 0.0, 0.0];
        if t < 0.5 {
            b = white;
            t *= 2.0;
        } else {
            a = white;
            t = 2.0 * t - 1.0;
        }
    }
    // A grey has no hue: give it one that makes the way to the other colour even.
    if a[1] < UNSATURATED && b[1] > UNSATURATED {
        a[2] = hue_for_grey(b, a[0]);
    } else if b[1] < UNSATURATED && a[1] > UNSATURATED {
        b[2] = hue_for_grey(a, b[0]);
    }
    rgb_from_lab(lab_from_msh(mix(a, b, t)))
}

/// The angle between two hues, 0 to π.
fn hue_difference(a: f64, b: f64) -> f64 {
    let difference = (a - b).abs() % (2.0 * PI);
    difference.min(2.0 * PI - difference)
}

/// The hue for a grey of magnitude `grey_m` that is joined to the colour `msh`.
fn hue_for_grey(msh: [f64; 3], grey_m: f64) -> f64 {
    let [m, s, h] = msh;
    if m >= grey_m - 0.1 {
        return h;
    }
    let spin = s * (grey_m * grey_m - m * m).sqrt() / (m * s.sin());
    // Away from 0, except in purple.
    if h > -0.3 * PI { h + spin } else { h - spin }
}

fn msh_from_lab([l, a, b]: [f64; 3]) -> [f64; 3] {
    let m = (l * l + a * a + b * b).sqrt();
    let s = if m > 0.001 { (l / m).acos() } else { 0.0 };
    let h = if s > 0.001 { b.atan2(a) } else { 0.0 };
    [m, s, h]
}

fn lab_from_msh([m, s, h]: [f64; 3]) -> [f64; 3] {
    [m * s.cos(), m * s.sin() * h.cos(), m * s.sin() * h.sin()]
}

fn lab_from_rgb(rgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(|c| {
        if c > 0.04045 {
            ((c + 0.055) / 1.055).powf(2.4)
        } else {
            c / 12.92
        }
    });
    let xyz = [
        r * 0.4124 + g * 0.3576 + b * 0.1805,
        r * 0.2126 + g * 0.7152 + b * 0.0722,
        r * 0.0193 + g * 0.1192 + b * 0.9505,
    ];
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| {
        let v = xyz[i] / WHITE[i];
        if v > LAB_KNEE {
            v.powf(1.0 / 3.0)
        } else {
            LAB_SLOPE * v + 16.0 / 116.0
        }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn rgb_from_lab([l, a, b]: [f64; 3]) -> [f64; 3] {
    let y = (l + 16.0) / 116.0;
    let f = [a / 500.0 + y, y, y - b / 200.0];
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| {
        let cube = f[i].powi(3);
        WHITE[i]
            * if cube > LAB_KNEE {
                cube
            } else {
                (f[i] - 16.0 / 116.0) / LAB_SLOPE
            }
    });
    let linear = [
        x * 3.2406 + y * -1.5372 + z * -0.4986,
        x * -0.9689 + y * 1.8758 + z * 0.0415,
        x * 0.0557 + y * -0.2040 + z * 1.0570,
    ];
    let rgb = linear.map(|c: f64| {
        if c > 0.0031308 {
            1.055 * c.powf(1.0 / 2.4) - 0.055
        } else {
            12.92 * c
        }
    });
    // Out of gamut: scaled down to 1, cut off at 0.
    let most = rgb.into_iter().fold(1.0, f64::max);
    rgb.map(|c| (c / most).max(0.0))
}

fn hsv_from_rgb([r, g, b]: [f64; 3]) -> [f64; 3] {
    let most = r.max(g).max(b);
    let least = r.min(g).min(b);
    let range = most - least;
    if most <= 0.0 || range <= 0.0 {
        return [0.0, 0.0, most];
    }
    let hue = if r == most {
        (g - b) / range
    } else if g == most {
        2.0 + (b - r) / range
    } else {
        4.0 + (r - g) / range
    } / 6.0;
    [if hue < 0.0 { hue + 1.0 } else { hue }, range / most, most]
}

fn rgb_from_hsv([h, s, v]: [f64; 3]) -> [f64; 3] {
    // The distance round the circle from red, green and blue, as ramps cut to 0…1.
    let ramp = |centre: f64| {
        let d = (h - centre).abs();
        (2.0 - 6.0 * d.min(1.0 - d)).clamp(0.0, 1.0)
    };
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|centre| v * (s * ramp(centre) + 1.0 - s))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(rgb: [f64; 3]) -> [u8; 3] {
        rgb.map(|c| (255.0 * c + 0.5) as u8)
    }

    #[test]
    fn conversions_go_there_and_back() {
        for i in 0..125_u32 {
            let rgb = [i % 5, i / 5 % 5, i / 25].map(|c| f64::from(c) / 4.0);
            for (name, back, bound) in [
                ("HSV", rgb_from_hsv(hsv_from_rgb(rgb)), 1e-12),
                // VTK's matrices have four digits.
                ("Lab", rgb_from_lab(lab_from_rgb(rgb)), 2e-3),
                (
                    "Msh",
                    rgb_from_lab(lab_from_msh(msh_from_lab(lab_from_rgb(rgb)))),
                    2e-3,
                ),
            ] {
                for c in 0..3 {
                    assert!(
                        (back[c] - rgb[c]).abs() < bound,
                        "{name}: {rgb:?} came back as {back:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn known_values() {
        // L*a*b* of sRGB red, as in any table.
        let [l, a, b] = lab_from_rgb([1.0, 0.0, 0.0]);
        assert!(
            (l - 53.24).abs() < 0.05 && (a - 80.1).abs() < 0.1 && (b - 67.2).abs() < 0.1,
            "Lab of red: {l} {a} {b}"
        );
        assert_eq!(
            bytes(mix_hsv([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], 0.5)),
            [0, 255, 0],
            "blue to red is a rainbow, through green"
        );
        assert_eq!(
            bytes(mix_hsv_wrapped([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.5)),
            [255, 0, 255],
            "red to blue goes the short way, through magenta"
        );
        assert_eq!(
            bytes(mix_hsv([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.5)),
            [255, 255, 0],
            "red to green goes through yellow"
        );
    }

    #[test]
    fn cool_to_warm_is_morelands() {
        // The 33-entry table of the paper's supplement: ends, quarter points and middle.
        let (cool, warm) = ([0.230, 0.299, 0.754], [0.706, 0.016, 0.150]);
        for (t, expected) in [
            (0.0, [59, 76, 192]),
            (0.25, [141, 176, 254]),
            (0.5, [221, 221, 221]),
            (0.75, [244, 154, 123]),
            (1.0, [180, 4, 38]),
        ] {
            let got = bytes(mix_diverging(cool, warm, t));
            for c in 0..3 {
                assert!(
                    got[c].abs_diff(expected[c]) <= 1,
                    "at {t}: {got:?}, published {expected:?}"
                );
            }
        }
    }
}
