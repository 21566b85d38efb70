//! DICOM: a series of pictures, one to a file or many, as a volume.
//!
//! All files are looked at first ([`image`]): what series they are of, where each picture lies. One series makes the volume
//! ([`series`]); its pictures are ordered by their place along the normal, checked for gaps and repetitions, and give the
//! affine ([`geometry`]), sheared where the gantry was tilted. Pixels are read slice by slice ([`pixels`], [`volume`]).
//!
//! Not here: segmentations, structure sets, reports, colour; each is refused by name. Nothing that tells of the patient is
//! taken over unless it was asked for: what a store is called is made from the modality alone.

mod dataset;
mod dicomdir;
mod geometry;
mod image;
mod jpegls;
mod open;
mod pixels;
mod series;
mod volume;

pub(super) use dicomdir::files_of as files_of_dicomdir;
pub(super) use open::{is_header, open};

#[cfg(test)]
mod tests;
