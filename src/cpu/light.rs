//! Phong's model, as `shaders/lib/shade.wgsl` and [`crate::reference`] have it, for a packet.

use super::rays::{Vec3, axes, dot};
use super::simd::Lanes;
use crate::scene::Shading;

/// Light and material, as the lanes need them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    shading: Shading,
    /// Towards the light; `None`: towards the eye.
    to_light: Option<[f32; 3]>,
}

impl Light {
    pub(super) fn new(shading: &Shading) -> Self {
        Self {
            shading: *shading,
            to_light: shading.light.map(|d| (-d.as_vec3().normalize()).to_array()),
        }
    }

    /// The colour of lit samples: two-sided Phong with a white highlight. `gradient` is in world units (zero means no
    /// surface: ambient only), `ray` the unit direction of the rays.
    #[inline(always)]
    pub(super) fn shade<L: Lanes>(
        &self,
        l: L,
        color: Vec3<L>,
        gradient: Vec3<L>,
        ray: Vec3<L>,
    ) -> Vec3<L> {
        let (zero, one) = (l.f(0.0), l.f(1.0));
        let ambient = l.f(self.shading.ambient);
        let length = l.sqrt(dot::<L>(gradient, gradient));
        let is_surface = l.gt(length, l.f(f32::MIN_POSITIVE));
        let divisor = l.pick(is_surface, length, one);
        let normal = axes!(n => gradient[n] / divisor);
        let to_eye = axes!(n => zero - ray[n]);
        let to_light = match &self.to_light {
            Some(d) => axes!(n => l.f(d[n])),
            None => to_eye,
        };
        let diffuse = absolute(l, dot::<L>(normal, to_light));
        let half = axes!(n => to_light[n] + to_eye[n]);
        let half_length = l.sqrt(dot::<L>(half, half));
        let has_half = l.gt(half_length, l.f(1e-6));
        let highlight = absolute(
            l,
            dot::<L>(normal, half) / l.pick(has_half, half_length, one),
        );
        let highlight = l.pick(has_half, highlight, zero);
        let specular = l.f(self.shading.specular) * power(l, highlight, self.shading.shininess);
        let matte = ambient + l.f(self.shading.diffuse) * diffuse;
        axes!(n => {
            let lit = l.max(l.min(color[n] * matte + specular, one), zero);
            l.pick(is_surface, lit, color[n] * ambient)
        })
    }
}

#[inline(always)]
fn absolute<L: Lanes>(l: L, a: L::F) -> L::F {
    l.max(a, l.f(0.0) - a)
}

/// `base`^`exponent` for a base from 0 to about 1 and an exponent ≥ 0: as 2^(exponent · log₂ base), within 1e-5 for
/// exponents up to 100.
#[inline(always)]
fn power<L: Lanes>(l: L, base: L::F, exponent: f32) -> L::F {
    if exponent == 0.0 {
        return l.f(1.0);
    }
    let smallest = l.f(f32::MIN_POSITIVE);
    let is_zero = l.gt(smallest, base);
    let base = l.max(base, smallest);
    let exact = log2(l, base) * l.f(exponent);
    l.pick(is_zero, l.f(0.0), exp2(l, exact))
}

/// log₂ of positive normal numbers: exponent, and for the mantissa m in [√½, √2) the series of artanh,
/// ln m = 2 (s + s³/3 + s⁵/5 + …), s = (m − 1)/(m + 1), |s| < 0.172.
#[inline(always)]
fn log2<L: Lanes>(l: L, v: L::F) -> L::F {
    // √½ as bits: what is above its mantissa goes to the next exponent.
    let sqrt_half = l.i(0x3f35_04f3);
    let exponent = l.shr::<23>(l.as_i(v) - sqrt_half);
    let mantissa = l.as_f(l.as_i(v) - l.shl::<23>(exponent));
    let one = l.f(1.0);
    let s = (mantissa - one) / (mantissa + one);
    let s2 = s * s;
    let mut series = l.f(2.0 / 9.0);
    for term in [2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0] {
        series = series * s2 + l.f(term);
    }
    l.to_f(exponent) + s * series * l.f(std::f32::consts::LOG2_E)
}

/// 2^x for x ≤ 127; below −126 it is 0. The fraction by the series of the exponential function.
#[inline(always)]
fn exp2<L: Lanes>(l: L, x: L::F) -> L::F {
    let is_tiny = l.gt(l.f(-126.0), x);
    let x = l.max(x, l.f(-126.0));
    let whole = l.floor(x + l.f(0.5));
    let rest = (x - whole) * l.f(std::f32::consts::LN_2);
    let mut series = l.f(1.0 / 5040.0);
    for term in [
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        series = series * rest + l.f(term);
    }
    let scale = l.as_f(l.shl::<23>(l.to_i(whole) + l.i(127)));
    l.pick(is_tiny, l.f(0.0), series * scale)
}

#[cfg(test)]
mod tests {
    use super::super::simd::{InstructionSet, Kernel, MAX_LANES};
    use super::*;

    struct Powers(f32);

    impl Kernel for Powers {
        type Output = f32;

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> f32 {
            let mut worst = 0.0_f32;
            for i in 0..1000 {
                let base = i as f32 / 999.0;
                let got = l.store_f(power(l, l.load_f(&[base; MAX_LANES]), self.0))[0];
                worst = worst.max((got - base.powf(self.0)).abs());
            }
            worst
        }
    }

    #[test]
    fn powers() {
        for set in InstructionSet::available() {
            for exponent in [0.0, 0.3, 1.0, 2.0, 20.0, 30.0, 100.0] {
                let worst = set.run(Powers(exponent));
                assert!(worst < 1e-5, "{set:?}, exponent {exponent}: off by {worst}");
            }
        }
    }
}
