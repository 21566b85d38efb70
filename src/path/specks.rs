//! Specks: a few voxels that are not lumen but lie in the middle of it, with lumen all around. They are noise, not wall: one of
//! them in the middle of a trachea would push the way to its side.

use std::collections::VecDeque;

/// Most voxels of a speck: a block of 4³. What is larger and enclosed is an obstacle.
const MOST_VOXELS: usize = 64;

const UNSEEN: u8 = 0;
/// Belongs to something that is no speck.
const WALL: u8 = 1;
/// Seen by the search that is under way.
const PENDING: u8 = 2;

/// Opens the specks of a box, x fastest, and returns their places. What touches the box's faces is none.
pub(super) fn open_specks(is_open: &mut [bool], size: [usize; 3]) -> Vec<usize> {
    let [nx, ny, nz] = size;
    let mut seen = vec![UNSEEN; is_open.len()];
    let mut specks = Vec::new();
    let (mut queue, mut group) = (VecDeque::new(), Vec::new());
    for start in 0..is_open.len() {
        // Every speck has a first voxel, and there is lumen before it.
        if is_open[start] || seen[start] != UNSEEN || start == 0 || !is_open[start - 1] {
            continue;
        }
        group.clear();
        queue.clear();
        queue.push_back(start);
        seen[start] = PENDING;
        let mut is_speck = true;
        while let Some(at) = queue.pop_front() {
            group.push(at);
            let (x, y, z) = (at % nx, at / nx % ny, at / nx / ny);
            let is_face = x == 0 || y == 0 || z == 0 || x + 1 == nx || y + 1 == ny || z + 1 == nz;
            if is_face || group.len() > MOST_VOXELS {
                is_speck = false;
                break;
            }
            for to in [at - 1, at + 1, at - nx, at + nx, at - nx * ny, at + nx * ny] {
                if is_open[to] || seen[to] == PENDING {
                    continue;
                }
                if seen[to] == WALL {
                    is_speck = false;
                } else {
                    seen[to] = PENDING;
                    queue.push_back(to);
                }
            }
            if !is_speck {
                break;
            }
        }
        group.extend(queue.iter());
        for &at in &group {
            seen[at] = WALL;
        }
        if is_speck {
            specks.extend(&group);
        }
    }
    for &at in &specks {
        is_open[at] = true;
    }
    specks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_small_and_enclosed_is_opened() {
        let size = [14, 14, 14];
        let at = |x: usize, y: usize, z: usize| (z * 14 + y) * 14 + x;
        let mut is_open = vec![true; 14 * 14 * 14];
        let close = |is_open: &mut Vec<bool>, low: [usize; 3], high: [usize; 3]| {
            for z in low[2]..high[2] {
                for y in low[1]..high[1] {
                    for x in low[0]..high[0] {
                        is_open[at(x, y, z)] = false;
                    }
                }
            }
        };
        // A bent speck, one too large, a wall at the face with a spur.
        close(&mut is_open, [2, 2, 2], [4, 3, 3]);
        close(&mut is_open, [3, 2, 3], [4, 3, 4]);
        close(&mut is_open, [6, 6, 6], [11, 11, 11]);
        close(&mut is_open, [0, 0, 0], [1, 14, 14]);
        close(&mut is_open, [1, 8, 2], [4, 9, 3]);
        let before = is_open.clone();
        let mut specks = open_specks(&mut is_open, size);
        specks.sort_unstable();
        assert_eq!(specks, [at(2, 2, 2), at(3, 2, 2), at(3, 2, 3)], "one speck");
        let changed = (0..before.len()).filter(|&i| before[i] != is_open[i]);
        assert_eq!(changed.collect::<Vec<_>>(), specks, "and nothing else");
    }
}
