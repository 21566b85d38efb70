//! Where the slices of a volume lie: their order along the normal, the affine, tilt, and gaps. Pure: no file is read.

use glam::{DAffine3, DVec3};

use super::super::affine::{RAS_FROM_LPS, from_axes};
use super::image::Picture;

/// Distances of slices are even if none differs from the middle one by more than this share of it, or by this many mm
/// (positions are written with few digits).
const EVEN_SHARE: f64 = 0.01;
const EVEN_MM: f64 = 0.005;
/// Slices nearer to each other than this share of the usual distance are at one place.
const SAME_PLACE: f64 = 0.01;
/// Positions lie on a line if none is farther from it than this share of a pixel.
const ON_LINE: f64 = 0.25;
/// Resampling makes at most so many slices of one.
const MOST_MORE: f64 = 8.0;

/// Pictures in the order of their places.
#[derive(Clone, Debug)]
pub(super) struct Ordered {
    /// Those at each place along the normal.
    pub(super) places: Vec<Vec<Picture>>,
    /// The places: mm from the first one, along the line from the first to the last.
    pub(super) along_mm: Vec<f64>,
}

/// Orders pictures by where they lie along the normal; `None` where one has no position or orientation.
pub(super) fn ordered(mut pictures: Vec<Picture>) -> Option<Ordered> {
    let [row, column] = pictures.first()?.orientation?;
    let normal = row.cross(column).normalize();
    if pictures.iter().any(|p| p.position.is_none()) {
        return None;
    }
    let at = |p: &Picture| p.position.map_or(0.0, |p| p.dot(normal));
    let by_time = |a: &Picture, b: &Picture| {
        let times = a.when.iter().zip(&b.when).map(|(a, b)| a.total_cmp(b));
        let order = times.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then);
        order.then(a.instance.total_cmp(&b.instance))
    };
    pictures.sort_by(|a, b| at(a).total_cmp(&at(b)));
    // The usual distance is that in the middle of those that are no repetition.
    let mut gaps: Vec<f64> = pictures.windows(2).map(|w| at(&w[1]) - at(&w[0])).collect();
    let widest = gaps.iter().copied().fold(0.0, f64::max);
    gaps.retain(|&g| g > SAME_PLACE * widest);
    let same = SAME_PLACE * middle(&gaps);
    let mut places: Vec<Vec<Picture>> = Vec::new();
    let mut along_mm: Vec<f64> = Vec::new();
    for picture in pictures {
        let mm = at(&picture);
        match along_mm.last() {
            Some(&last) if mm - last <= same => {
                if let Some(place) = places.last_mut() {
                    place.push(picture);
                }
            }
            _ => {
                along_mm.push(mm);
                places.push(vec![picture]);
            }
        }
    }
    for place in &mut places {
        place.sort_by(by_time);
    }
    // Tilted slices are farther from each other than their planes are.
    let of = |place: &Vec<Picture>| place.first().and_then(|p| p.position);
    let (first, last) = (of(places.first()?)?, of(places.last()?)?);
    let line = (last - first).normalize_or_zero();
    let along_mm = places.iter().filter_map(of).map(|p| (p - first).dot(line));
    Some(Ordered {
        along_mm: along_mm.collect(),
        places,
    })
}

/// The value in the middle; 0 of none.
pub(super) fn middle(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// How slices follow each other.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Spacing {
    /// All at this distance, mm.
    Even(f64),
    /// Not; the distances, mm.
    Uneven(Vec<f64>),
}

/// The distances of places along the normal.
pub(super) fn spacing(along_mm: &[f64]) -> Spacing {
    let gaps: Vec<f64> = along_mm.windows(2).map(|w| w[1] - w[0]).collect();
    let usual = middle(&gaps);
    let tolerance = (EVEN_SHARE * usual).max(EVEN_MM);
    if gaps.iter().all(|g| (g - usual).abs() <= tolerance) {
        let mean = gaps.iter().sum::<f64>() / gaps.len().max(1) as f64;
        return Spacing::Even(mean);
    }
    Spacing::Uneven(gaps)
}

/// Distances in words: each run of equal ones with its slices, and where slices are missing.
pub(super) fn gaps_in_words(gaps: &[f64]) -> String {
    const MOST_NAMED: usize = 12;
    let usual = middle(gaps);
    let tolerance = (EVEN_SHARE * usual).max(EVEN_MM);
    let mut runs: Vec<(f64, std::ops::Range<usize>)> = Vec::new();
    for (n, &gap) in gaps.iter().enumerate() {
        match runs.last_mut() {
            Some((mm, run)) if (gap - *mm).abs() <= tolerance => run.end = n + 1,
            _ => runs.push((gap, n..n + 1)),
        }
    }
    let words = |(mm, run): &(f64, std::ops::Range<usize>)| {
        let times = (mm / usual).round();
        let is_missing = times >= 2.0 && (mm - times * usual).abs() <= tolerance * times;
        let missing = match is_missing {
            true => format!(" ({} missing between two)", times - 1.0),
            false => String::new(),
        };
        format!(
            "{mm:.2} mm from slice {} to {}{missing}",
            run.start, run.end
        )
    };
    let mut named: Vec<String> = runs.iter().take(MOST_NAMED).map(words).collect();
    if runs.len() > MOST_NAMED {
        named.push(format!("and {} more", runs.len() - MOST_NAMED));
    }
    named.join(", ")
}

/// Even places for slices at uneven ones: as dense as the densest, but for tiny distances.
pub(super) fn even_places(along_mm: &[f64]) -> Vec<f64> {
    let (Some(&first), Some(&last)) = (along_mm.first(), along_mm.last()) else {
        return Vec::new();
    };
    let length = last - first;
    let least = along_mm
        .windows(2)
        .map(|w| w[1] - w[0])
        .fold(f64::INFINITY, f64::min);
    let most = along_mm.len() as f64 * MOST_MORE;
    let steps = (length / least).round().clamp(1.0, most);
    (0..=steps as u64)
        .map(|n| first + length * n as f64 / steps)
        .collect()
}

/// From voxel indices to RAS+ mm, of slices of which the first and the last lie at these positions (LPS), `count` in all. Of
/// one slice the third axis is the normal, `thickness_mm` long.
pub(super) fn affine(
    [row, column]: [DVec3; 2],
    spacing: [f64; 2],
    (first, last): (DVec3, DVec3),
    count: u64,
    thickness_mm: f64,
) -> DAffine3 {
    let third = match count {
        0 | 1 => row.cross(column) * thickness_mm,
        n => (last - first) / (n - 1) as f64,
    };
    let columns = [row * spacing[0], column * spacing[1], third];
    from_axes(columns, first, RAS_FROM_LPS)
}

/// Do all positions lie on the line from the first to the last, as far as a pixel's width matters?
pub(super) fn are_on_a_line(positions: &[DVec3], pixel_mm: f64) -> bool {
    let (Some(&first), Some(&last)) = (positions.first(), positions.last()) else {
        return true;
    };
    let Some(along) = (last - first).try_normalize() else {
        return true;
    };
    positions
        .iter()
        .all(|&p| (p - first).reject_from_normalized(along).length() <= ON_LINE * pixel_mm)
}

/// How far the slices' line leans from their normal, degrees.
pub(super) fn tilt_degrees([row, column]: [DVec3; 2], first: DVec3, last: DVec3) -> f64 {
    let normal = row.cross(column).normalize();
    (last - first).try_normalize().map_or(0.0, |along| {
        along.dot(normal).abs().min(1.0).acos().to_degrees()
    })
}
