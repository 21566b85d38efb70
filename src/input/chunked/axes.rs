//! [`Axes`]: which axes of an array are x, y and z, and which element of each other one is taken.

use crate::input::OpenOptions;
use crate::input::problem::{Subject, quoted};
use crate::volume::SourceError;

/// What an axis stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::input) enum AxisKind {
    Space,
    Time,
    Channel,
    Other,
}

/// An axis as metadata describe it.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::input) struct Axis {
    pub(in crate::input) name: String,
    pub(in crate::input) kind: AxisKind,
    /// Unit of length; empty where none is given.
    pub(in crate::input) unit: String,
}

impl Axis {
    /// The axis called `name`, its kind told by that.
    pub(in crate::input) fn named(name: &str) -> Self {
        let kind = match name.to_ascii_lowercase().as_str() {
            "x" | "y" | "z" => AxisKind::Space,
            "t" | "time" => AxisKind::Time,
            "c" | "c^" | "channel" => AxisKind::Channel,
            _ => AxisKind::Other,
        };
        Self {
            name: name.to_owned(),
            kind,
            unit: String::new(),
        }
    }
}

/// The volume that is taken out of an array.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::input) struct Axes {
    /// The array's axes that are x, y and z; a picture has no z.
    pub(in crate::input) xyz: [Option<usize>; 3],
    /// Every other axis, with the index that is taken there.
    pub(in crate::input) fixed: Vec<(usize, u64)>,
}

impl Axes {
    /// Chooses a volume of an array of `shape`; `channels` are names of channels for a message.
    ///
    /// # Errors
    /// There are fewer than two or more than three axes of space, or several channels or points in time and none is chosen,
    /// or one that is not there.
    pub(in crate::input) fn choose(
        subject: &Subject<'_>,
        axes: &[Axis],
        shape: &[u64],
        channels: &[String],
        options: &OpenOptions,
    ) -> Result<Self, SourceError> {
        if axes.len() != shape.len() {
            return Err(subject.malformed(
                "the axes",
                format!("{} of them, as the array has", shape.len()),
                axes.len().to_string(),
            ));
        }
        let xyz = space(subject, axes)?;
        let mut fixed = Vec::new();
        for (n, (axis, &size)) in axes.iter().zip(shape).enumerate() {
            let index = match axis.kind {
                AxisKind::Space => continue,
                AxisKind::Time => one_of(
                    subject,
                    &Several {
                        size,
                        what: "points in time",
                        flag: "--time",
                        names: &[],
                    },
                    options.time,
                )?,
                AxisKind::Channel => one_of(
                    subject,
                    &Several {
                        size,
                        what: "channels",
                        flag: "--channel",
                        names: channels,
                    },
                    options.channel,
                )?,
                AxisKind::Other if size == 1 => 0,
                AxisKind::Other => {
                    return Err(subject.unsupported(
                        format!("an axis {} of {size} elements", quoted(&axis.name)),
                        "supported are axes of space, one of time and one of channels",
                    ));
                }
            };
            fixed.push((n, index));
        }
        for (kind, index, flag) in [
            (AxisKind::Time, options.time, "--time"),
            (AxisKind::Channel, options.channel, "--channel"),
        ] {
            let number = axes.iter().filter(|a| a.kind == kind).count();
            if number == 0 && index.is_some_and(|i| i > 0) {
                return Err(subject.malformed(
                    flag,
                    "0, since the array has no such axis",
                    index.unwrap_or_default().to_string(),
                ));
            }
            if number > 1 {
                return Err(subject.malformed(
                    "the axes",
                    "at most one of time and one of channels",
                    format!("{number}"),
                ));
            }
        }
        Ok(Self { xyz, fixed })
    }
}

/// Which axes are x, y and z: by their names, or else the last three.
fn space(subject: &Subject<'_>, axes: &[Axis]) -> Result<[Option<usize>; 3], SourceError> {
    let space: Vec<usize> = (0..axes.len())
        .filter(|&n| axes[n].kind == AxisKind::Space)
        .collect();
    let names = || {
        let names: Vec<&str> = axes.iter().map(|a| a.name.as_str()).collect();
        quoted(&names.join(", "))
    };
    if !(2..=3).contains(&space.len()) {
        return Err(subject.unsupported(
            format!("an array with {} axes of space ({})", space.len(), names()),
            "supported are volumes of z, y, x and pictures of y, x",
        ));
    }
    let by_name = |name: &str| {
        let mut named = space
            .iter()
            .filter(|&&n| axes[n].name.eq_ignore_ascii_case(name));
        let first = named.next().copied();
        (first, named.next().is_some())
    };
    let (found, doubled): (Vec<_>, Vec<_>) = ["x", "y", "z"].into_iter().map(by_name).unzip();
    let number = found.iter().flatten().count();
    if doubled.contains(&true) || (number > 0 && number < space.len()) {
        return Err(subject.malformed(
            "the axes",
            "different names, x, y and z for those of space",
            names(),
        ));
    }
    if number == 0 {
        let mut last = space.iter().rev().copied();
        return Ok([last.next(), last.next(), last.next()]);
    }
    let xyz = [found[0], found[1], found[2]];
    if number == 2 && xyz[2].is_some() {
        // A picture across other axes: its plane is what is seen.
        let mut rest = space.iter().rev().copied();
        return Ok([rest.next(), rest.next(), None]);
    }
    Ok(xyz)
}

/// An axis of which one element is to be chosen.
struct Several<'a> {
    size: u64,
    what: &'a str,
    flag: &'a str,
    names: &'a [String],
}

fn one_of(
    subject: &Subject<'_>,
    several: &Several<'_>,
    chosen: Option<u64>,
) -> Result<u64, SourceError> {
    let Several {
        size,
        what,
        flag,
        names,
    } = *several;
    match chosen {
        Some(index) if index < size => Ok(index),
        Some(index) => Err(subject.malformed(
            flag,
            format!("0 to {}, as there are {size} {what}", size - 1),
            index.to_string(),
        )),
        None if size == 1 => Ok(0),
        None => {
            let names = if names.is_empty() {
                String::new()
            } else {
                format!(": {}", quoted(&names.join(", ")))
            };
            Err(subject.unsupported(
                format!("an array of {size} {what} as one volume"),
                format!("choose one with {flag} 0 to {}{names}", size - 1),
            ))
        }
    }
}
