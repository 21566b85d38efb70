//! The order in which a software adapter gets the work-groups of a dispatch.

/// Work-groups that stay together: a square of 4×4 of them.
const TOGETHER: usize = 16;

/// Work-groups that are sorted by place, in an order for software adapters. These give each thread a contiguous range of the
/// dispatch, and the costly parts of a picture lie together: squares of work-groups are spread far apart. Inside a square
/// neighbours follow each other, so that the second finds in the caches what the first has read.
pub(super) fn spread(near: &[u32]) -> Vec<u32> {
    let squares: Vec<&[u32]> = near.chunks(TOGETHER).collect();
    let stride = spreading_stride(squares.len());
    (0..squares.len())
        .flat_map(|i| squares[i * stride % squares.len()])
        .copied()
        .collect()
}

/// A stride through `count` that meets each once and spreads neighbours far apart: near the golden section of `count`, and
/// coprime with it.
fn spreading_stride(count: usize) -> usize {
    let coprime = |a: usize| {
        let (mut a, mut b) = (a, count);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a == 1
    };
    let golden = (count as f64 * 0.618) as usize;
    (golden.max(1)..count).find(|&s| coprime(s)).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_group_is_met_once() {
        for count in [1_u32, 2, 3, 7, 8, 64, 1000, 4096, 128 * 96, 1 << 14] {
            let groups: Vec<u32> = (0..count).map(|g| g * 3).collect();
            let mut met = spread(&groups);
            met.sort_unstable();
            assert_eq!(met, groups, "{count} groups");
        }
    }
}
