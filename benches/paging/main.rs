//! What paging costs: pictures of volumes that are larger than the atlas, against those of one that holds everything.
//!
//! | part | shows |
//! |---|---|
//! | `equality` | the picture under a small budget is that under a large one, to the bit; its cost |
//! | `first` | time from open to the first whole picture, the store not in the page cache |
//! | `overfetch` | bricks read per brick sampled, four views |
//! | `orbit` | hit rate of the atlas over 36 views, against LRU and against Bélády's rule |
//! | `edit` | time to the next picture after a change of colours, opacity or iso-value, and what it uploads |
//! | `least` | the smallest `--gpu-memory` that is not refused, and whether its picture is right |
//!
//! Each measurement is a process of its own (peak memory never falls within one). Does not measure: bricking, the cost of
//! a frame with everything resident (`frame`), or pictures against another renderer (tests do).
//!
//! `cargo bench --bench paging -- STORE.bsk [--iso VALUE] [--only PART,…] [--gpu-memory SIZE] [--ram SIZE] [--size N]
//! [--view-size N] [--zoom Z] [--step S] [--pictures FOLDER] [--device NAME]`

#[cfg(not(all(feature = "gpu", target_os = "linux")))]
fn main() {
    eprintln!("this bench needs the feature `gpu`, and Linux for its figures of memory and reads");
}

#[cfg(all(feature = "gpu", target_os = "linux"))]
mod job;
#[cfg(all(feature = "gpu", target_os = "linux"))]
mod parts;
#[cfg(all(feature = "gpu", target_os = "linux"))]
mod process;
#[cfg(all(feature = "gpu", target_os = "linux"))]
mod scene;

#[cfg(all(feature = "gpu", target_os = "linux"))]
fn main() -> anyhow::Result<()> {
    // A child is this program with its task as the only word.
    let mut words = std::env::args().skip(1);
    if words.next().as_deref() == Some(process::CHILD) {
        return process::run_child(&words.next().unwrap_or_default());
    }
    parts::run()
}
