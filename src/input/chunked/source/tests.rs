//! Boxes of an array whose chunks are counted as they are read.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use proptest::prelude::*;

use super::super::Block;
use super::*;
use crate::volume::VoxelType;

/// Chunks of an array of axes c, z, y, x whose elements count on; how often each was read is noted.
struct Counted {
    array: Array,
    reads: Arc<Mutex<HashMap<Vec<u64>, u32>>>,
}

impl Chunks for Counted {
    fn read(&self, index: &[u64]) -> Result<Option<Block>, SourceError> {
        *self
            .reads
            .lock()
            .unwrap()
            .entry(index.to_vec())
            .or_default() += 1;
        let Array { shape, chunk, .. } = &self.array;
        // One chunk is not stored, and those at the end of x are cut as N5 cuts them.
        if index[1..] == [1, 0, 0] {
            return Ok(None);
        }
        let mut extent = chunk.clone();
        extent[3] = extent[3].min(shape[3] - index[3] * chunk[3]);
        let mut bytes = Vec::new();
        for n in 0..extent.iter().product::<u64>() {
            let mut rest = n;
            let mut at = [0; 4];
            for axis in (0..4).rev() {
                at[axis] = index[axis] * chunk[axis] + rest % extent[axis];
                rest /= extent[axis];
            }
            bytes.extend(value(at).to_be_bytes());
        }
        Ok(Some(Block { bytes, extent }))
    }

    fn stamp(&self) -> String {
        String::new()
    }
}

fn value([c, z, y, x]: [u64; 4]) -> i16 {
    (x + 20 * y + 400 * z + 8000 * c) as i16
}

const DIMS: U64Vec3 = U64Vec3::new(11, 9, 10);
const FILL: i16 = -3;

type Reads = Arc<Mutex<HashMap<Vec<u64>, u32>>>;

fn counted(chunk: [u64; 4]) -> (Box<dyn VoxelSource>, Reads) {
    let mut fill = [0; 8];
    fill[..2].copy_from_slice(&FILL.to_le_bytes());
    let array = Array {
        shape: vec![3, DIMS.z, DIMS.y, DIMS.x],
        chunk: chunk.to_vec(),
        order: vec![0, 1, 2, 3],
        voxel_type: VoxelType::I16,
        is_big_endian: true,
        fill,
    };
    let found = Found {
        axes: Axes {
            xyz: [Some(3), Some(2), Some(1)],
            fixed: vec![(0, 1)],
        },
        spacing: DVec3::ONE,
        origin: DVec3::ZERO,
        world_from_index: None,
        unit: String::new(),
        name: "counted".to_owned(),
        notes: Vec::new(),
        is_remote: false,
        array: array.clone(),
    };
    let reads = Reads::default();
    let chunks = Counted {
        array,
        reads: Arc::clone(&reads),
    };
    let subject = Subject::new(std::path::Path::new("counted"));
    (found.open(&subject, Box::new(chunks)).unwrap(), reads)
}

/// What a box should hold where chunks are of `chunk` elements.
fn expected(voxels: VoxelBox, chunk: [u64; 4]) -> Vec<u8> {
    let mut out = Vec::new();
    for z in voxels.min.z..voxels.max.z {
        for y in voxels.min.y..voxels.max.y {
            for x in voxels.min.x..voxels.max.x {
                let is_missing = [z / chunk[1], y / chunk[2], x / chunk[3]] == [1, 0, 0];
                let v = if is_missing {
                    FILL
                } else {
                    value([1, z, y, x])
                };
                out.extend(v.to_le_bytes());
            }
        }
    }
    out
}

#[test]
fn slices_in_their_order_read_each_chunk_once() {
    for chunk in [[1, 4, 5, 6], [2, 1, 9, 11], [3, 16, 2, 32], [1, 3, 3, 3]] {
        for step in [1, 3, 4, 10] {
            let (mut source, reads) = counted(chunk);
            assert!(source.held_bytes() > 0, "decoded chunks take memory");
            for z in (0..DIMS.z).step_by(step) {
                let end = DIMS.z.min(z + step as u64);
                let slices =
                    VoxelBox::new(U64Vec3::new(0, 0, z), U64Vec3::new(DIMS.x, DIMS.y, end));
                let mut out = vec![0; slices.voxel_count().unwrap() as usize * 2];
                source.read_box(slices, &mut out).unwrap();
                assert_eq!(
                    out,
                    expected(slices, chunk),
                    "{chunk:?}, {step} slices from {z} on"
                );
            }
            let reads = reads.lock().unwrap();
            assert!(
                reads.values().all(|&n| n == 1),
                "{chunk:?}, {step} slices: {reads:?}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn any_box_in_any_order(
        chunk in prop::array::uniform4(1u64..13),
        boxes in prop::collection::vec(prop::array::uniform6(0u64..12), 1..6),
    ) {
        let (mut source, _) = counted(chunk);
        for [x0, y0, z0, x1, y1, z1] in boxes {
            let (a, b) = (U64Vec3::new(x0, y0, z0), U64Vec3::new(x1, y1, z1));
            let voxels = VoxelBox::new(a.min(b), a.max(b) + U64Vec3::ONE)
                .intersection(&VoxelBox::whole(DIMS));
            if !voxels.is_empty() {
                let mut out = vec![0; voxels.voxel_count().unwrap() as usize * 2];
                source.read_box(voxels, &mut out).unwrap();
                prop_assert_eq!(out, expected(voxels, chunk));
            }
        }
    }
}
