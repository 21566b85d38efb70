//! Colour maps: a line of opacity over a range.

use super::{BLACK, Colors, OWN, Preset, WHITE, map};
use crate::classify::colormaps;
use crate::classify::curve::ColorSpace;

const CC0: &str = "van der Walt, Smith and Firing; CC0";

pub(super) const GREY: Preset = map(
    "grey",
    "black to white over the window or percentile range",
    OWN,
    ColorSpace::Rgb,
    Colors::Points(&[(0.0, BLACK), (1.0, WHITE)]),
);

pub(super) const VIRIDIS: Preset = map(
    "viridis",
    "colour map: blue, green, yellow; even lightness",
    CC0,
    ColorSpace::Rgb,
    Colors::Map(&colormaps::VIRIDIS),
);

pub(super) const MAGMA: Preset = map(
    "magma",
    "colour map: black, purple, pale yellow; even lightness",
    CC0,
    ColorSpace::Rgb,
    Colors::Map(&colormaps::MAGMA),
);

pub(super) const INFERNO: Preset = map(
    "inferno",
    "colour map: black, red, pale yellow; even lightness",
    CC0,
    ColorSpace::Rgb,
    Colors::Map(&colormaps::INFERNO),
);

pub(super) const PLASMA: Preset = map(
    "plasma",
    "colour map: blue, magenta, yellow; even lightness",
    CC0,
    ColorSpace::Rgb,
    Colors::Map(&colormaps::PLASMA),
);

pub(super) const TURBO: Preset = map(
    "turbo",
    "colour map: a smooth rainbow",
    "Anton Mikhailov, © 2019 Google LLC; Apache-2.0",
    ColorSpace::Rgb,
    Colors::Map(&colormaps::TURBO),
);

pub(super) const COOL_WARM: Preset = map(
    "cool-warm",
    "colour map: blue, white, red, for values about a middle",
    "two end colours of Moreland's map (2009); no rights claimed",
    ColorSpace::Diverging,
    Colors::Points(&[(0.0, [0.230, 0.299, 0.754]), (1.0, [0.706, 0.016, 0.150])]),
);

pub(super) const HOT: Preset = map(
    "hot",
    "colour map: black, red, yellow, white",
    "the usual three ramps; no rights claimed",
    ColorSpace::Rgb,
    Colors::Points(&[
        (0.0, [0.0416, 0.0, 0.0]),
        (0.365079, [1.0, 0.0, 0.0]),
        (0.746032, [1.0, 1.0, 0.0]),
        (1.0, WHITE),
    ]),
);

pub(super) const BONE: Preset = map(
    "bone",
    "colour map: grey with a tinge of blue",
    "the usual three ramps; no rights claimed",
    ColorSpace::Rgb,
    Colors::Points(&[
        (0.0, BLACK),
        (0.365079, [0.319444, 0.319444, 0.444444]),
        (0.746032, [0.652778, 0.777778, 0.777778]),
        (1.0, WHITE),
    ]),
);
