//! How a picture is cut into tiles, and these into work-groups. Pure arithmetic.

use glam::UVec3;

use super::frame::Tile;
use super::passes::{PartsPass, RaycastPass, RaycastTargets};
use super::renderer::Renderer;
use super::several::Flow;
use crate::geom::morton;
use crate::scene::{PictureSettings, SlabShape, Technique};

/// Greatest width and height of a tile, pixels: 2²⁰ rays.
pub const TILE_EDGE: u32 = 1024;

/// Tiles are not halved below 64 by 64 pixels.
const LEAST_TILE_EDGE: u32 = 64;
/// Pixels of the smallest tile that others are halved to.
pub const LEAST_TILE_PIXELS: u64 = (LEAST_TILE_EDGE as u64).pow(2);

/// Bytes per pixel of a tile: what the caster has, and three depths.
const BYTES_PER_PIXEL: u64 = RaycastTargets::BYTES_PER_PIXEL + 3 * 4;

/// The pixels of a tile that are cast, each row << 16 | column within the tile, in an order in which neighbours are near.
/// `None`: all.
pub type PixelList<'a> = Option<&'a [u32]>;

impl Renderer {
    /// The tiles that pictures are cut into when per-pixel buffers may take `budget_bytes`, of at most `most_pixels` pixels.
    pub fn tile_size(settings: &PictureSettings, budget_bytes: u64, most_pixels: u64) -> [u32; 2] {
        let bytes_per_pixel = BYTES_PER_PIXEL
            + Flow::bytes_per_pixel(settings.technique)
            + PartsPass::bytes_per_pixel(&settings.geometry);
        let most_pixels = most_pixels.min(budget_bytes / bytes_per_pixel);
        let mut tile = settings.size.map(|s| s.min(TILE_EDGE));
        while u64::from(tile[0]) * u64::from(tile[1]) > most_pixels
            && tile.iter().any(|&t| t > LEAST_TILE_EDGE)
        {
            let longer = usize::from(tile[1] > tile[0]);
            tile[longer] = (tile[longer] / 2).max(LEAST_TILE_EDGE);
        }
        tile
    }

    /// Bytes of the per-pixel buffers of a tile.
    pub fn tile_bytes(tile: [u32; 2], technique: Technique) -> u64 {
        let bytes_per_pixel = BYTES_PER_PIXEL + Flow::bytes_per_pixel(technique);
        u64::from(tile[0] + 2) * u64::from(tile[1] + 2) * bytes_per_pixel
    }

    /// The tiles of a picture, row by row.
    pub fn tiles(picture: [u32; 2], tile: [u32; 2]) -> Vec<Tile> {
        let mut tiles = Vec::new();
        for y in (0..picture[1]).step_by(tile[1] as usize) {
            for x in (0..picture[0]).step_by(tile[0] as usize) {
                tiles.push(Tile {
                    origin: [x, y],
                    size: tile,
                    part_size: [tile[0].min(picture[0] - x), tile[1].min(picture[1] - y)],
                });
            }
        }
        tiles
    }

    /// Sorts work-groups of a tile, or of its list, so that neighbours in the picture follow each other.
    pub fn sort_by_place(
        tile: &Tile,
        slab: Option<SlabShape>,
        is_listed: bool,
        groups: &mut [u32],
    ) {
        if is_listed {
            // As the list is.
            groups.sort_unstable();
        } else {
            let wide = RaycastPass::group_count(tile.size, slab).x;
            groups.sort_unstable_by_key(|&g| morton(UVec3::new(g % wide, g / wide, 0)));
        }
    }

    /// The work-groups of a tile, in the order of the picture, where rays advance in these slabs or by themselves; or those
    /// of its list.
    pub fn groups(tile: &Tile, slab: Option<SlabShape>, pixels: PixelList<'_>) -> Vec<u32> {
        if let Some(list) = pixels {
            return (0..RaycastPass::list_groups(list.len() as u32)).collect();
        }
        let wide = RaycastPass::group_count(tile.size, slab).x;
        let part = RaycastPass::group_count(tile.part_size, slab);
        (0..part.y)
            .flat_map(|y| (0..part.x).map(move |x| y * wide + x))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_picture_once() {
        let tiles = Renderer::tiles([130, 70], [64, 64]);
        let pixels: u32 = tiles.iter().map(|t| t.part_size[0] * t.part_size[1]).sum();
        assert_eq!((tiles.len(), pixels), (6, 130 * 70));
        assert_eq!(tiles[2].part_size, [2, 64], "the last of a row is cut");
        assert_eq!(
            Renderer::groups(&tiles[5], None, None),
            [0],
            "2 × 6 pixels are one work-group"
        );
        assert_eq!(
            Renderer::groups(&tiles[3], None, None),
            (0..8).collect::<Vec<u32>>(),
            "64 × 6 pixels"
        );
    }
}
