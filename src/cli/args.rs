//! Values as they are typed: sizes in bytes, triples of numbers, colours.

use std::str::FromStr;

use glam::{DVec3, U64Vec3};

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
fn numbers<const N: usize>(s: &str) -> Result<[f64; N], String> {
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
    }
}
