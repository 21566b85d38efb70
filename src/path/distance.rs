//! Exact Euclidean distances to the nearest voxel outside, axis by axis.
//!
//! Felzenszwalb and Huttenlocher 2012 ("Distance transforms of sampled functions"): along each axis the lower envelope of
//! parabolas. Linear in the number of voxels; axes may have different spacings, but must be perpendicular to each other.

use glam::DVec3;

/// Distance in millimetres of each voxel's centre from the nearest centre of a voxel that is not inside; x fastest. Infinite
/// when all are inside. What lies outside the box does not count.
pub fn distances_mm(is_inside: &[bool], size: [usize; 3], spacing_mm: DVec3) -> Vec<f32> {
    let [nx, ny, nz] = size;
    assert_eq!(is_inside.len(), nx * ny * nz, "invariant: a flag per voxel");
    let mut field: Vec<f32> = is_inside
        .iter()
        .map(|&inside| if inside { f32::INFINITY } else { 0.0 })
        .collect();
    let mut line = Line::default();
    for row in field.chunks_exact_mut(nx.max(1)) {
        line.transform(row, 0, 1, nx, spacing_mm.x);
    }
    for z in 0..nz {
        for x in 0..nx {
            line.transform(&mut field, z * nx * ny + x, nx, ny, spacing_mm.y);
        }
    }
    for yx in 0..nx * ny {
        line.transform(&mut field, yx, nx * ny, nz, spacing_mm.z);
    }
    for d in &mut field {
        *d = d.sqrt();
    }
    field
}

/// Buffers for one line.
#[derive(Default)]
struct Line {
    values: Vec<f32>,
    /// Places of the parabolas of the envelope.
    sites: Vec<usize>,
    /// From where on each is the lowest.
    from: Vec<f64>,
}

impl Line {
    /// Replaces the squared distances of `n` voxels, `stride` apart, by min over q of value(q) + (spacing·(p − q))².
    fn transform(
        &mut self,
        field: &mut [f32],
        start: usize,
        stride: usize,
        n: usize,
        spacing: f64,
    ) {
        self.values.clear();
        self.values
            .extend((0..n).map(|i| field[start + i * stride]));
        self.sites.clear();
        self.from.clear();
        let unit = spacing * spacing;
        let height = |values: &[f32], q: usize| f64::from(values[q]) + unit * (q * q) as f64;
        for q in 0..n {
            if self.values[q] == f32::INFINITY {
                continue;
            }
            loop {
                let Some(&last) = self.sites.last() else {
                    self.from.push(f64::NEG_INFINITY);
                    break;
                };
                // Where the parabola of q comes below that of the last.
                let cross = (height(&self.values, q) - height(&self.values, last))
                    / (2.0 * unit * (q - last) as f64);
                if cross > self.from[self.from.len() - 1] {
                    self.from.push(cross);
                    break;
                }
                self.sites.pop();
                self.from.pop();
            }
            self.sites.push(q);
        }
        if self.sites.is_empty() {
            return;
        }
        let mut k = 0;
        for p in 0..n {
            while k + 1 < self.sites.len() && self.from[k + 1] < p as f64 {
                k += 1;
            }
            let q = self.sites[k];
            let away = p.abs_diff(q) as f64;
            field[start + p * stride] = (f64::from(self.values[q]) + unit * away * away) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn brute(is_inside: &[bool], size: [usize; 3], spacing: DVec3) -> Vec<f32> {
        let place = |i: usize| {
            let (x, y, z) = (i % size[0], i / size[0] % size[1], i / size[0] / size[1]);
            DVec3::new(x as f64, y as f64, z as f64) * spacing
        };
        (0..is_inside.len())
            .map(|i| {
                (0..is_inside.len())
                    .filter(|&j| !is_inside[j])
                    .map(|j| place(i).distance(place(j)) as f32)
                    .fold(f32::INFINITY, f32::min)
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn equal_to_brute_force(
            size in prop::array::uniform3(1usize..9),
            spacing in prop::array::uniform3(0.1f64..4.0),
            seed in any::<u64>(),
            density in 0.0f64..0.5,
        ) {
            let n = size.iter().product();
            let mut state = seed | 1;
            let is_inside: Vec<bool> = (0..n)
                .map(|_| {
                    state ^= state << 13;
                    state ^= state >> 7;
                    state ^= state << 17;
                    ((state >> 11) as f64 / (1u64 << 53) as f64) >= density
                })
                .collect();
            let spacing = DVec3::from_array(spacing);
            let (found, wanted) = (distances_mm(&is_inside, size, spacing), brute(&is_inside, size, spacing));
            for (i, (a, b)) in found.iter().zip(&wanted).enumerate() {
                let same = a == b || (a - b).abs() <= 1e-5 * b;
                prop_assert!(same, "voxel {}: {} for {}", i, a, b);
            }
        }
    }

    #[test]
    fn spacing_matters() {
        let mut is_inside = vec![true; 27];
        is_inside[0] = false;
        let d = distances_mm(&is_inside, [3, 3, 3], DVec3::new(1.0, 2.0, 4.0));
        assert_eq!(
            (d[1], d[3], d[9]),
            (1.0, 2.0, 4.0),
            "one step along each axis"
        );
        assert_eq!(d[26], 84f32.sqrt(), "the far corner");
    }
}
