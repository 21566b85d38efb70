//! Values as they are typed: sizes in bytes, triples of numbers, colours.

use std::str::FromStr;

use glam::{DVec3, U64Vec3, Vec3};

use crate::geom::{Lod, VoxelBox};
use crate::scene::{AntiAliasing, Background, IsoSurface, LodChoice, SamplePattern};

/// A number of bytes: `512MiB`, `2GiB`, `4096`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ByteSize(pub u64);

impl FromStr for ByteSize {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let digits = s.bytes().take_while(u8::is_ascii_digit).count();
        let (number, suffix) = s.split_at(digits);
        let shift = match suffix {
            "" | "B" => 0,
            "KiB" => 10,
            "MiB" => 20,
            "GiB" => 30,
            "TiB" => 40,
            _ => {
                return Err(format!(
                    "'{s}' is not a size; expected for example 512MiB, 2GiB or a number of bytes"
                ));
            }
        };
        number
            .parse::<u64>()
            .ok()
            .and_then(|n| n.checked_mul(1 << shift))
            .map(Self)
            .ok_or_else(|| {
                format!(
                    "'{s}' is not a size; expected for example 512MiB, 2GiB or a number of bytes"
                )
            })
    }
}

/// Exactly `N` finite numbers joined by commas.
pub(super) fn numbers<const N: usize>(s: &str) -> Result<[f64; N], String> {
    let parsed: Option<Vec<f64>> = s
        .split(',')
        .map(|p| p.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
        .collect();
    parsed
        .and_then(|v| <[f64; N]>::try_from(v).ok())
        .ok_or_else(|| format!("'{s}': expected {N} finite numbers joined by commas"))
}

/// `x,y,z`.
pub fn vec3(s: &str) -> Result<DVec3, String> {
    numbers::<3>(s).map(DVec3::from_array)
}

/// `a,b`: two finite numbers.
pub fn pair(s: &str) -> Result<[f64; 2], String> {
    numbers::<2>(s)
}

/// `X,Y,Z`: three whole numbers, each at least 1.
pub fn dims(s: &str) -> Result<U64Vec3, String> {
    let parsed: Option<Vec<u64>> = s
        .split(',')
        .map(|p| p.trim().parse::<u64>().ok().filter(|&v| v > 0))
        .collect();
    parsed
        .and_then(|v| <[u64; 3]>::try_from(v).ok())
        .map(U64Vec3::from_array)
        .ok_or_else(|| format!("'{s}': expected X,Y,Z, three whole numbers of at least 1"))
}

/// `x0,y0,z0,x1,y1,z1`: a box of whole voxels, the second corner exclusive.
pub fn voxel_box(s: &str) -> Result<VoxelBox, String> {
    let parsed: Option<Vec<u64>> = s.split(',').map(|p| p.trim().parse().ok()).collect();
    parsed
        .and_then(|v| <[u64; 6]>::try_from(v).ok())
        .map(|[x0, y0, z0, x1, y1, z1]| VoxelBox::new(U64Vec3::new(x0, y0, z0), U64Vec3::new(x1, y1, z1)))
        .filter(|b| !b.is_empty())
        .ok_or_else(|| {
            format!("'{s}': expected x0,y0,z0,x1,y1,z1, six whole numbers, each of the last three above its first")
        })
}

/// Most pixels of a picture: it is held in memory whole, at 20 bytes a pixel.
const MOST_PIXELS: u64 = 1 << 28;

/// `WxH`: a picture's size in pixels, each from 1 to 65536, at most 2²⁸ together.
pub fn picture_size(s: &str) -> Result<[u32; 2], String> {
    let parse = |part: &str| part.parse::<u32>().ok().filter(|v| (1..=65536).contains(v));
    s.split_once('x')
        .and_then(|(w, h)| Some([parse(w)?, parse(h)?]))
        .filter(|[w, h]| u64::from(*w) * u64::from(*h) <= MOST_PIXELS)
        .ok_or_else(|| {
            format!(
                "'{s}': expected WIDTHxHEIGHT in pixels, each from 1 to 65536 and at most {MOST_PIXELS} \
                 together, such as 1024x768"
            )
        })
}

/// A display colour: `r,g,b` (0 to 1) or `#rrggbb`.
pub fn color(s: &str) -> Result<Vec3, String> {
    let wrong =
        || format!("'{s}': expected a colour as r,g,b with numbers from 0 to 1, or #rrggbb");
    if let Some(hex) = s.strip_prefix('#') {
        let value = u32::from_str_radix(hex, 16)
            .ok()
            .filter(|_| hex.len() == 6)
            .ok_or_else(wrong)?;
        let channel = |shift: u32| (value >> shift & 0xff) as f32 / 255.0;
        return Ok(Vec3::new(channel(16), channel(8), channel(0)));
    }
    let rgb = vec3(s).map_err(|_| wrong())?;
    if rgb.min_element() < 0.0 || rgb.max_element() > 1.0 {
        return Err(wrong());
    }
    Ok(rgb.as_vec3())
}

/// `transparent` or a colour.
pub fn background(s: &str) -> Result<Background, String> {
    if s == "transparent" {
        return Ok(Background::Transparent);
    }
    color(s)
        .map(Background::Color)
        .map_err(|e| format!("{e}, or transparent"))
}

/// The surfaces of one `--iso`.
#[derive(Clone, Debug, PartialEq)]
pub struct IsoSurfaces(pub Vec<IsoSurface>);

/// `VALUE[:COLOR[:OPACITY]]`, a surface of mode iso, or `LOW..HIGH[:COLOR[:OPACITY]]`, the two that bound an interval of values.
pub fn iso_surfaces(s: &str) -> Result<IsoSurfaces, String> {
    let mut parts = s.splitn(3, ':');
    let number = |v: &str| v.parse::<f64>().ok().filter(|v| v.is_finite());
    let values = parts
        .next()
        .and_then(|v| match v.split_once("..") {
            None => Some(vec![number(v)?]),
            Some((low, high)) => {
                let (low, high) = (number(low)?, number(high)?);
                (low < high).then(|| vec![low, high])
            }
        })
        .ok_or_else(|| {
            format!(
                "'{s}': expected VALUE or LOW..HIGH (LOW below HIGH), then if wanted :COLOR and :OPACITY; values are finite \
                 numbers in physical units"
            )
        })?;
    let color = parts.next().map_or(Ok(IsoSurface::DEFAULT_COLOR), color)?;
    let opacity = parts.next().map_or(Ok(1.0), |o| {
        o.parse::<f32>()
            .ok()
            .filter(|o| (0.0..=1.0).contains(o))
            .ok_or_else(|| format!("'{s}': expected an opacity from 0 to 1 behind the colour"))
    })?;
    let surface = |value| IsoSurface {
        value,
        color,
        opacity,
    };
    Ok(IsoSurfaces(values.into_iter().map(surface).collect()))
}

/// `1`, `2`, `4`, `4r` or `8`: rays of a pixel.
pub fn sample_pattern(s: &str) -> Result<SamplePattern, String> {
    use SamplePattern::{Eight, Four, FourRotated, One, Two};
    [One, Two, Four, FourRotated, Eight]
        .into_iter()
        .find(|p| p.name() == s)
        .ok_or_else(|| format!("'{s}': expected 1, 2, 4, 4r (rotated grid) or 8"))
}

/// What `--aa` says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AaArg {
    /// `off`.
    Off,
    /// `full`.
    Full,
    /// `selective[:THRESHOLD]`.
    Selective(f32),
}

/// `off`, `full`, or `selective[:THRESHOLD]`.
pub fn anti_aliasing(s: &str) -> Result<AaArg, String> {
    match s.split_once(':') {
        None if s == "off" => Ok(AaArg::Off),
        None if s == "full" => Ok(AaArg::Full),
        None if s == "selective" => Ok(AaArg::Selective(AntiAliasing::THRESHOLD)),
        Some(("selective", t)) => t
            .parse::<f32>()
            .ok()
            .filter(|t| (0.0..=1.0).contains(t))
            .map(AaArg::Selective)
            .ok_or_else(|| format!("'{s}': expected a threshold from 0 to 1 behind selective:")),
        _ => Err(format!(
            "'{s}': expected off, full or selective[:THRESHOLD]"
        )),
    }
}

/// `AZIMUTH,ELEVATION[,ZOOM]`, degrees.
pub fn orbit(s: &str) -> Result<[f64; 3], String> {
    vec3(s)
        .map(|v| v.to_array())
        .or_else(|_| pair(s).map(|[azimuth, elevation]| [azimuth, elevation, 1.0]))
        .map_err(|_| {
            format!(
                "'{s}': expected AZIMUTH,ELEVATION or AZIMUTH,ELEVATION,ZOOM, angles in degrees"
            )
        })
}

/// `auto` or a level's number.
pub fn lod(s: &str) -> Result<LodChoice, String> {
    if s == "auto" {
        return Ok(LodChoice::Auto);
    }
    s.parse::<u8>()
        .map(|l| LodChoice::Fixed(Lod(l)))
        .map_err(|_| format!("'{s}': expected auto or a level's number, 0 or more"))
}

/// A finite number above 0.
pub fn positive(s: &str) -> Result<f64, String> {
    s.parse::<f64>()
        .ok()
        .filter(|v| v.is_finite() && *v > 0.0)
        .ok_or_else(|| format!("'{s}': expected a finite number above 0"))
}

/// A finite number of at least 0.
pub fn not_negative(s: &str) -> Result<f64, String> {
    s.parse::<f64>()
        .ok()
        .filter(|v| v.is_finite() && *v >= 0.0)
        .ok_or_else(|| format!("'{s}': expected a finite number of at least 0"))
}

/// A number above 0 and at most 1.
pub fn cutoff(s: &str) -> Result<f32, String> {
    s.parse::<f32>()
        .ok()
        .filter(|v| *v > 0.0 && *v <= 1.0)
        .ok_or_else(|| format!("'{s}': expected a number above 0 and at most 1"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!("512MiB".parse(), Ok(ByteSize(512 << 20)));
        assert_eq!("2GiB".parse(), Ok(ByteSize(2 << 30)));
        assert_eq!("77".parse(), Ok(ByteSize(77)));
        for bad in ["", "MiB", "-1", "1.5GiB", "2GB", "99999999999TiB"] {
            assert!(bad.parse::<ByteSize>().is_err(), "{bad:?} is not a size");
        }
    }

    #[test]
    fn triples() {
        assert_eq!(vec3("-1,2,3.5"), Ok(DVec3::new(-1.0, 2.0, 3.5)));
        assert!(
            vec3("1,2").is_err() && vec3("1,2,nan").is_err() && dims("0,1,1").is_err(),
            "refused"
        );
        let whole = VoxelBox::new(U64Vec3::new(0, 1, 2), U64Vec3::new(3, 4, 5));
        assert_eq!(voxel_box("0,1,2,3,4,5"), Ok(whole));
        for bad in ["0,1,2,3,4", "-1,0,0,1,1,1", "0,0,0,1,0,1", "2,0,0,1,1,1"] {
            assert!(voxel_box(bad).is_err(), "{bad:?} is no box");
        }
    }

    #[test]
    fn pictures() {
        assert_eq!(picture_size("1024x768"), Ok([1024, 768]));
        assert!(
            picture_size("65536x65536").is_err(),
            "more than memory holds"
        );
        assert!(
            picture_size("0x5").is_err()
                && picture_size("5").is_err()
                && picture_size("5x5x5").is_err()
        );
        assert_eq!(color("#ff0000"), Ok(Vec3::X));
        assert_eq!(color("0,0.5,1"), Ok(Vec3::new(0.0, 0.5, 1.0)));
        assert!(color("0,0,2").is_err() && color("#ff").is_err() && color("red").is_err());
        assert_eq!(
            iso_surfaces("-300"),
            Ok(IsoSurfaces(vec![IsoSurface::opaque(-300.0)]))
        );
        let IsoSurfaces(interval) = iso_surfaces("-30..1e2:#00ff00:0.5").unwrap();
        assert_eq!(
            interval.iter().map(|s| s.value).collect::<Vec<_>>(),
            [-30.0, 100.0]
        );
        assert_eq!((interval[1].color, interval[1].opacity), (Vec3::Y, 0.5));
        for bad in ["nan", "5..1", "1..", "3:#00ff00:2", "3:#00ff00:", "3:x"] {
            assert!(iso_surfaces(bad).is_err(), "{bad:?} is no surface");
        }
        assert_eq!(sample_pattern("4r"), Ok(SamplePattern::FourRotated));
        assert!(sample_pattern("16").is_err() && sample_pattern("3").is_err());
        assert_eq!(anti_aliasing("selective:0.1"), Ok(AaArg::Selective(0.1)));
        assert!(anti_aliasing("selective:2").is_err() && anti_aliasing("full:1").is_err());
        assert_eq!(orbit("30,-20"), Ok([30.0, -20.0, 1.0]));
    }
}
