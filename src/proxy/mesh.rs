//! The mesh: quads of all bricks, in the order of the bricks.

use glam::UVec3;
use rayon::prelude::*;

use super::active::{ActiveBlocks, ProxyError};
use super::faces::{faces, rectangles};
use crate::classify::Occupancy;
use crate::geom::{BLOCK_EDGE, BLOCKS_PER_EDGE};

/// Bricks per piece of parallel work.
const BRICKS_PER_TASK: usize = 128;

/// What the mesh is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Granularity {
    /// Active blocks, exactly.
    #[default]
    Blocks,
    /// Each brick with an active block as a whole: for where blocks would be smaller than pixels.
    Bricks,
}

/// The side of a block that a face is on: the face's outward normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Direction {
    NegX,
    PosX,
    NegY,
    PosY,
    NegZ,
    PosZ,
}

impl Direction {
    /// All, in the order in which a brick's faces come.
    pub const ALL: [Self; 6] = [
        Self::NegX,
        Self::PosX,
        Self::NegY,
        Self::PosY,
        Self::NegZ,
        Self::PosZ,
    ];

    fn axis(self) -> usize {
        self as usize / 2
    }

    fn is_positive(self) -> bool {
        self as usize % 2 == 1
    }
}

/// Quads, four vertices each (not shared), two triangles each.
///
/// A vertex is the corner of a block in whole blocks of the level (x, y, z) and the [`Direction`] of its face; 8 bytes.
/// Triangles are counter-clockwise seen from outside, in this right-handed space.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mesh {
    /// x, y, z in blocks, direction.
    pub vertices: Vec<[u16; 4]>,
    /// Three per triangle, six per quad.
    pub indices: Vec<u32>,
}

impl Mesh {
    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// Place of a vertex in continuous voxel coordinates of the level (voxel i spans i to i + 1). May lie up to three
    /// voxels beyond the level's far sides.
    pub fn voxel_from_vertex(vertex: [u16; 4]) -> UVec3 {
        let [x, y, z, _] = vertex.map(u32::from);
        UVec3::new(x, y, z) * BLOCK_EDGE
    }
}

/// The faces between active and inactive blocks (outside the level all are inactive), merged into rectangles within each
/// brick. The order is that of bricks (z, y, x), then directions, then planes: the same for the same input.
///
/// # Errors
/// There are more than 2³⁰ quads.
pub fn bounding_mesh(active: &ActiveBlocks, granularity: Granularity) -> Result<Mesh, ProxyError> {
    let whole;
    let active = match granularity {
        Granularity::Blocks => active,
        Granularity::Bricks => {
            whole = active.whole_bricks();
            &whole
        }
    };
    let pieces: Vec<Vec<[u16; 4]>> = active
        .entries()
        .par_chunks(BRICKS_PER_TASK)
        .map(|bricks| {
            let mut vertices = Vec::new();
            for (index, occupancy) in bricks {
                push_brick(active, active.grid().xyz(*index), occupancy, &mut vertices);
            }
            vertices
        })
        .collect();
    let vertices = pieces.concat();
    let quads = vertices.len() / 4;
    let Some(count) = u32::try_from(quads).ok().filter(|&n| n <= 1 << 30) else {
        return Err(ProxyError::TooManyQuads { quads });
    };
    let indices = (0..count)
        .flat_map(|quad| [0, 1, 2, 0, 2, 3].map(|corner| 4 * quad + corner))
        .collect();
    Ok(Mesh { vertices, indices })
}

/// Appends the quads of one brick.
fn push_brick(
    active: &ActiveBlocks,
    xyz: UVec3,
    occupancy: &Occupancy,
    vertices: &mut Vec<[u16; 4]>,
) {
    let around = Direction::ALL.map(|direction| beyond(active, xyz, direction));
    let origin = (xyz * BLOCKS_PER_EDGE)
        .to_array()
        .map(|n| u16::try_from(n).expect("invariant: ActiveBlocks bounds the grid"));
    for (direction, planes) in Direction::ALL.into_iter().zip(faces(occupancy, &around)) {
        let axis = direction.axis();
        let (u, v) = [(1, 2), (0, 2), (0, 1)][axis];
        // u × v points along +axis, except across y, where x × z = −y.
        let is_counter_clockwise = direction.is_positive() != (axis == 1);
        for (plane, bits) in (0_u16..).zip(planes) {
            for r in rectangles(bits) {
                let mut corners = [(r.u0, r.v0), (r.u1, r.v0), (r.u1, r.v1), (r.u0, r.v1)];
                if !is_counter_clockwise {
                    corners.swap(1, 3);
                }
                vertices.extend(corners.map(|(cu, cv)| {
                    let mut vertex = [origin[0], origin[1], origin[2], direction as u16];
                    vertex[axis] += plane + u16::from(direction.is_positive());
                    vertex[u] += cu;
                    vertex[v] += cv;
                    vertex
                }));
            }
        }
    }
}

/// The brick beside `xyz`; empty outside the level.
fn beyond(active: &ActiveBlocks, xyz: UVec3, direction: Direction) -> Occupancy {
    let mut at = xyz;
    let axis = direction.axis();
    if direction.is_positive() {
        at[axis] += 1;
    } else if at[axis] > 0 {
        at[axis] -= 1;
    } else {
        return Occupancy::EMPTY;
    }
    active.get(at)
}

#[cfg(test)]
mod tests {
    use glam::{I64Vec3, U64Vec3};
    use proptest::prelude::*;

    use super::*;
    use crate::geom::BrickGrid;

    const NORMALS: [I64Vec3; 6] = [
        I64Vec3::NEG_X,
        I64Vec3::X,
        I64Vec3::NEG_Y,
        I64Vec3::Y,
        I64Vec3::NEG_Z,
        I64Vec3::Z,
    ];

    /// A unit face: the active block that it belongs to, and the direction.
    type UnitFace = ([i64; 3], usize);

    fn active(voxels: [u64; 3], bricks: &[([u32; 3], Occupancy)]) -> ActiveBlocks {
        let grid = BrickGrid::for_voxels(U64Vec3::from_array(voxels)).unwrap();
        let bricks = bricks.iter().map(|&(xyz, o)| (UVec3::from_array(xyz), o));
        ActiveBlocks::new(grid, bricks).unwrap()
    }

    /// Every triangle pair of the mesh cut into unit faces, directions taken from the winding alone.
    fn unit_faces(mesh: &Mesh) -> Vec<UnitFace> {
        let at = |i: u32| {
            let [x, y, z, _] = mesh.vertices[i as usize].map(i64::from);
            I64Vec3::new(x, y, z)
        };
        let mut out = Vec::new();
        for quad in mesh.indices.chunks_exact(6) {
            let normal = |t: &[u32]| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).signum();
            assert_eq!(
                normal(&quad[..3]),
                normal(&quad[3..]),
                "both triangles face the same way"
            );
            let direction = NORMALS
                .iter()
                .position(|&n| n == normal(&quad[..3]))
                .unwrap();
            for &i in quad {
                assert_eq!(
                    usize::from(mesh.vertices[i as usize][3]),
                    direction,
                    "the vertex names its direction"
                );
            }
            let corners = [quad[0], quad[1], quad[2], quad[5]].map(at);
            let min = corners.into_iter().reduce(I64Vec3::min).unwrap();
            let mut max = corners.into_iter().reduce(I64Vec3::max).unwrap();
            max[direction / 2] += 1;
            for z in min.z..max.z {
                for y in min.y..max.y {
                    for x in min.x..max.x {
                        let outward = NORMALS[direction].max(I64Vec3::ZERO);
                        out.push(((I64Vec3::new(x, y, z) - outward).to_array(), direction));
                    }
                }
            }
        }
        out.sort_unstable();
        out
    }

    fn brute_force(active: &ActiveBlocks) -> Vec<UnitFace> {
        let blocks = (active.grid().bricks * 8).as_i64vec3();
        let is_active = |p: I64Vec3| {
            p.cmpge(I64Vec3::ZERO).all() && p.cmplt(blocks).all() && {
                let (brick, b) = ((p / 8).as_uvec3(), (p % 8).as_uvec3());
                active.get(brick).get(b.x, b.y, b.z)
            }
        };
        let mut out = Vec::new();
        for z in 0..blocks.z {
            for y in 0..blocks.y {
                for x in 0..blocks.x {
                    let p = I64Vec3::new(x, y, z);
                    for (direction, &n) in NORMALS.iter().enumerate() {
                        if is_active(p) && !is_active(p + n) {
                            out.push((p.to_array(), direction));
                        }
                    }
                }
            }
        }
        out.sort_unstable();
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Exactly the faces between active and inactive blocks, each once, facing outward: watertight.
        #[test]
        fn speckle_is_covered_exactly(
            seeds in proptest::collection::vec((any::<[u32; 16]>(), any::<[u32; 16]>(), 0..4_u8), 12),
            voxels in (65..=96_u64, 33..=64_u64, 33..=64_u64),
        ) {
            let bricks: Vec<_> = seeds.iter().zip(0_u32..).map(|((a, b, kind), i)| {
                let (a, b) = (Occupancy::from_words(*a), Occupancy::from_words(*b));
                let o = match kind {
                    0 => Occupancy::EMPTY,
                    1 => Occupancy::FULL,
                    2 => a.intersection(&b),
                    _ => a.union(&b),
                };
                ([i % 3, i / 3 % 2, i / 6], o)
            }).collect();
            let active = active([voxels.0, voxels.1, voxels.2], &bricks);
            let mesh = bounding_mesh(&active, Granularity::Blocks).unwrap();
            prop_assert_eq!(unit_faces(&mesh), brute_force(&active));
            let coarse = bounding_mesh(&active, Granularity::Bricks).unwrap();
            prop_assert_eq!(unit_faces(&coarse), brute_force(&active.whole_bricks()));
        }
    }

    #[test]
    fn single_block() {
        let mut one = Occupancy::EMPTY;
        one.set(7, 0, 3, true);
        let mesh = bounding_mesh(
            &active([64, 32, 32], &[([1, 0, 0], one)]),
            Granularity::Blocks,
        )
        .unwrap();
        assert_eq!(mesh.triangle_count(), 12, "a cube");
        let place = |f: fn(UVec3, UVec3) -> UVec3| {
            let corners = mesh.vertices.iter().map(|&v| Mesh::voxel_from_vertex(v));
            corners.reduce(f).unwrap()
        };
        assert_eq!(
            place(UVec3::min),
            UVec3::new(60, 0, 12),
            "least corner, in voxels"
        );
        assert_eq!(place(UVec3::max), UVec3::new(64, 4, 16), "greatest corner");
    }

    #[test]
    fn full_bricks_merge_and_share_no_face() {
        let one = active([32, 32, 32], &[([0, 0, 0], Occupancy::FULL)]);
        let mesh = bounding_mesh(&one, Granularity::Blocks).unwrap();
        assert_eq!(mesh.vertices.len(), 6 * 4, "six quads");
        let full = Occupancy::FULL;
        let two = active([64, 32, 32], &[([0, 0, 0], full), ([1, 0, 0], full)]);
        let mesh = bounding_mesh(&two, Granularity::Blocks).unwrap();
        assert_eq!(mesh.vertices.len(), 10 * 4, "no face between them");
        assert_eq!(unit_faces(&mesh), brute_force(&two), "and the right ones");
    }

    #[test]
    fn empty_levels_and_far_edges() {
        let empty = active([100, 100, 100], &[]);
        let mesh = bounding_mesh(&empty, Granularity::Bricks).unwrap();
        assert_eq!(mesh, Mesh::default(), "nothing");
        // The farthest brick of the largest level: corners still fit.
        let n = u64::from(ActiveBlocks::MAX_BRICKS) * 32;
        let last = ActiveBlocks::MAX_BRICKS - 1;
        let far = active([n, n, n], &[([last; 3], Occupancy::FULL)]);
        let mesh = bounding_mesh(&far, Granularity::Blocks).unwrap();
        let greatest = mesh.vertices.iter().map(|v| v[0]).max();
        assert_eq!(greatest, Some(65528), "8 · 8191");
    }
}
