//! Units of length by the names that metadata gives them.

/// Millimetres in one `unit`: a name of UDUNITS-2, as OME-Zarr asks for, or a usual symbol.
pub(in crate::input) fn millimetres(unit: &str) -> Option<f64> {
    Some(match unit.trim() {
        "angstrom" | "Å" => 1e-7,
        "attometer" => 1e-15,
        "centimeter" | "cm" => 10.0,
        "decimeter" | "dm" => 100.0,
        "exameter" => 1e21,
        "femtometer" | "fm" => 1e-12,
        "foot" => 304.8,
        "gigameter" => 1e12,
        "hectometer" => 1e5,
        "inch" => 25.4,
        "kilometer" | "km" => 1e6,
        "megameter" => 1e9,
        "meter" | "metre" | "m" => 1e3,
        "micrometer" | "micrometre" | "micron" | "microns" | "um" | "µm" | "μm" => 1e-3,
        "mile" => 1_609_344.0,
        "millimeter" | "millimetre" | "mm" => 1.0,
        "nanometer" | "nanometre" | "nm" => 1e-6,
        "parsec" => 3.085_677_581_491_367e19,
        "petameter" => 1e18,
        "picometer" | "pm" => 1e-9,
        "terameter" => 1e15,
        "yard" => 914.4,
        "yoctometer" => 1e-21,
        "yottameter" => 1e27,
        "zeptometer" => 1e-18,
        "zettameter" => 1e24,
        _ => return None,
    })
}
