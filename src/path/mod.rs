//! Centre-lines: the way through a hollow organ, from a store to a camera path.
//!
//! ```text
//! store ─ lumen ─▶ bits ─ fill ─▶ the connected lumen ─ distance ─▶ distance to the wall ─ shortest ─▶ voxels in the middle
//!                                                                            ─ axis, smooth ─▶ Centerline ─▶ CameraPath
//! ```
//! `find` does it on the finest level whose working memory fits, then again along what was found on the finer ones
//! (`finer`). All lengths are world millimetres, whatever the voxels' spacing and orientation. Not here: pictures, GPU,
//! segmentation beyond a range of values.

mod axis;
mod distance;
mod error;
mod fill;
mod find;
mod finer;
mod leak;
mod lumen;
mod region;
mod seeds;
mod shortest;
mod smooth;
mod space;
mod specks;

pub use axis::AxisPoint;
pub use distance::distances_mm;
pub use error::{CenterlineError, NearestLumen};
pub use find::{Centerline, CenterlineRequest, Destination, centerline};
