//! Arrays cut into chunks that lie one by one in a folder or behind a URL: what OME-Zarr, N5 and precomputed share.
//!
//! [`Store`] fetches bytes, [`Packing`] unpacks them, [`Array`] and [`Axes`] say how the elements of a chunk become voxels,
//! and `Chunked` is the volume. A format reads its metadata and tells where a chunk lies ([`Chunks`]); nothing here knows
//! a format. Everything that comes from a store is untrusted.

mod array;
mod axes;
mod http;
pub(super) mod json;
mod packing;
mod source;
mod store;
mod units;

pub(super) use array::{Array, Block, Chunks};
pub(super) use axes::{Axes, Axis, AxisKind};
pub(super) use packing::{Packing, most_packed_bytes, unpack};
pub(super) use source::Found;
pub(super) use store::Store;
pub(super) use units::millimetres;
