//! JPEG-LS (ITU-T T.87, ISO 14495-1): pictures of one component, lossless and near-lossless.
//!
//! Own code, since what there is in Rust either needs a C++ compiler and CMake or brings a DICOM toolkit of its own. Section
//! numbers are those of T.87. Not here: colour, mapping tables, restart intervals.

/// Order of the Golomb code of run lengths (A.7.1.1, table A.3).
const J: [u32; 32] = [
    0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 13,
    14, 15,
];
/// Contexts of regular mode.
const CONTEXTS: usize = 365;
const DEFAULT_RESET: i32 = 64;

const SOI: u16 = 0xffd8;
const EOI: u16 = 0xffd9;
const SOS: u16 = 0xffda;
const SOF55: u16 = 0xfff7;
const LSE: u16 = 0xfff8;

/// What the headers say.
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    bits: u32,
    width: u32,
    height: u32,
}

/// Coding parameters (C.2.4.1.1); 0 for those that have their default.
#[derive(Clone, Copy, Debug, Default)]
struct Preset {
    max_value: i32,
    thresholds: [i32; 3],
    reset: i32,
}

/// The samples, row by row, of a picture that must be `size` pixels.
///
/// # Errors
/// In words: the stream is damaged, of another size, or of a kind that is not built.
pub(super) fn decode(bytes: &[u8], size: [u32; 2]) -> Result<Vec<u16>, String> {
    let mut reader = Markers { bytes, at: 0 };
    if reader.marker()? != SOI {
        return Err("no start of a picture".into());
    }
    let (mut frame, mut preset) = (Frame::default(), Preset::default());
    loop {
        let marker = reader.marker()?;
        if marker == EOI {
            return Err("no scan".into());
        }
        let segment = reader.segment()?;
        let word = |at: usize| -> Result<u32, String> {
            let two = segment
                .get(at..at + 2)
                .ok_or("a segment that is too short")?;
            Ok(u32::from(two[0]) << 8 | u32::from(two[1]))
        };
        let byte = |at: usize| {
            segment
                .get(at)
                .copied()
                .map(u32::from)
                .ok_or("a short segment")
        };
        match marker {
            SOF55 => {
                if byte(5)? != 1 {
                    return Err(format!("{} components", byte(5)?));
                }
                frame = Frame {
                    bits: byte(0)?,
                    height: word(1)?,
                    width: word(3)?,
                };
                if !(2..=16).contains(&frame.bits) {
                    return Err(format!("{} bits", frame.bits));
                }
                if [frame.width, frame.height] != size {
                    return Err(format!(
                        "{} × {} pixels, where the header says {} × {}",
                        frame.width, frame.height, size[0], size[1]
                    ));
                }
            }
            LSE if byte(0)? == 1 => {
                let value = |n: usize| word(1 + 2 * n).map(|v| v as i32);
                preset = Preset {
                    max_value: value(0)?,
                    thresholds: [value(1)?, value(2)?, value(3)?],
                    reset: value(4)?,
                };
            }
            LSE => return Err("mapping tables".into()),
            SOS => {
                if byte(0)? != 1 || byte(2)? != 0 {
                    return Err("several components or a mapping table".into());
                }
                let near = byte(3)? as i32;
                if frame.bits == 0 {
                    return Err("a scan before the frame's header".into());
                }
                let scan = Scan::new(frame, preset, near, &bytes[reader.at..])?;
                return scan.decode();
            }
            _ => {}
        }
    }
}

struct Markers<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Markers<'a> {
    fn word(&mut self) -> Result<u16, String> {
        let two = self
            .bytes
            .get(self.at..self.at + 2)
            .ok_or("the end of the stream")?;
        self.at += 2;
        Ok(u16::from_be_bytes([two[0], two[1]]))
    }

    fn marker(&mut self) -> Result<u16, String> {
        let word = self.word()?;
        match word >> 8 {
            0xff => Ok(word),
            _ => Err(format!("{word:04x} where a marker belongs")),
        }
    }

    /// What follows a marker, without its length.
    fn segment(&mut self) -> Result<&'a [u8], String> {
        let length = usize::from(self.word()?);
        let end = self.at + length.checked_sub(2).ok_or("a length below 2")?;
        let segment = self
            .bytes
            .get(self.at..end)
            .ok_or("the end of the stream")?;
        self.at = end;
        Ok(segment)
    }
}

/// The bits of a scan: behind a byte of ones the next has seven (A.1).
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Bits that were fetched, the next one in the highest place.
    held: u64,
    count: u32,
    was_ones: bool,
}

impl Bits<'_> {
    fn fetch(&mut self) -> Result<(), String> {
        let Some(&byte) = self.bytes.get(self.at) else {
            return Err("the end of the stream".into());
        };
        let width = if self.was_ones { 7 } else { 8 };
        if self.was_ones && byte & 0x80 != 0 {
            return Err("a marker inside of the scan".into());
        }
        self.at += 1;
        self.was_ones = byte == 0xff;
        self.held |= u64::from(byte) << (64 - width - self.count);
        self.count += width;
        Ok(())
    }

    /// The next `count` bits, at most 32.
    fn read(&mut self, count: u32) -> Result<u32, String> {
        if count == 0 {
            return Ok(0);
        }
        while self.count < count {
            self.fetch()?;
        }
        let value = (self.held >> (64 - count)) as u32;
        self.held <<= count;
        self.count -= count;
        Ok(value)
    }

    /// Zeros before the next one, which is taken, too; at most `most`.
    fn zeros(&mut self, most: u32) -> Result<u32, String> {
        let mut zeros = 0;
        while self.read(1)? == 0 {
            zeros += 1;
            if zeros > most {
                return Err("a code that is too long".into());
            }
        }
        Ok(zeros)
    }
}

/// What a context has learnt (A.8).
#[derive(Clone, Copy, Debug)]
struct Context {
    a: i32,
    b: i32,
    c: i32,
    n: i32,
}

struct Scan<'a> {
    frame: Frame,
    max_value: i32,
    near: i32,
    range: i32,
    bits_of_range: u32,
    limit: u32,
    thresholds: [i32; 3],
    reset: i32,
    contexts: Vec<Context>,
    /// Of run interruptions: what lies beside differs, and not; negative errors in `b`.
    run_contexts: [Context; 2],
    run_index: usize,
    bits: Bits<'a>,
}

impl<'a> Scan<'a> {
    fn new(frame: Frame, preset: Preset, near: i32, bytes: &'a [u8]) -> Result<Self, String> {
        let most = (1 << frame.bits) - 1;
        let max_value = match preset.max_value {
            0 => most,
            value => value,
        };
        if max_value < 1 || max_value > most || near > (max_value / 2).min(255) {
            return Err(format!("a greatest value of {max_value}, NEAR {near}"));
        }
        let defaults = default_thresholds(max_value, near);
        let mut thresholds = preset.thresholds;
        for (given, default) in thresholds.iter_mut().zip(defaults) {
            if *given == 0 {
                *given = default;
            }
        }
        let range = (max_value + 2 * near) / (2 * near + 1) + 1;
        let bits_of = |values: i32| (values - 1).checked_ilog2().map_or(0, |b| b + 1);
        let bits = bits_of(max_value + 1).max(2);
        let start = Context {
            a: ((range + 32) / 64).max(2),
            b: 0,
            c: 0,
            n: 1,
        };
        Ok(Self {
            frame,
            max_value,
            near,
            range,
            bits_of_range: bits_of(range),
            limit: 2 * (bits + bits.max(8)),
            thresholds,
            reset: match preset.reset {
                0 => DEFAULT_RESET,
                reset => reset.max(3),
            },
            contexts: vec![start; CONTEXTS],
            run_contexts: [start; 2],
            run_index: 0,
            bits: Bits {
                bytes,
                at: 0,
                held: 0,
                count: 0,
                was_ones: false,
            },
        })
    }

    fn decode(mut self) -> Result<Vec<u16>, String> {
        let (width, height) = (self.frame.width as usize, self.frame.height as usize);
        let mut samples = Vec::with_capacity(width * height);
        // A sample before the first and one behind the last.
        let (mut above, mut line) = (vec![0; width + 2], vec![0; width + 2]);
        for _ in 0..height {
            line[0] = above[1];
            above[width + 1] = above[width];
            self.line(&above, &mut line)?;
            samples.extend(line[1..=width].iter().map(|&v: &i32| v as u16));
            std::mem::swap(&mut above, &mut line);
        }
        Ok(samples)
    }

    fn line(&mut self, above: &[i32], line: &mut [i32]) -> Result<(), String> {
        let end = line.len() - 1;
        let mut x = 1;
        while x < end {
            let (a, b, c, d) = (line[x - 1], above[x], above[x - 1], above[x + 1]);
            let gradients = [d - b, b - c, c - a];
            if gradients.iter().all(|g| g.abs() <= self.near) {
                x = self.run(above, line, x)?;
            } else {
                line[x] = self.regular(gradients, [a, b, c])?;
                x += 1;
            }
        }
        Ok(())
    }

    /// Regular mode (A.3 to A.6).
    fn regular(&mut self, gradients: [i32; 3], [a, b, c]: [i32; 3]) -> Result<i32, String> {
        let [q1, q2, q3] = gradients.map(|g| self.quantised(g));
        let q = 81 * q1 + 9 * q2 + q3;
        let sign = if q < 0 { -1 } else { 1 };
        let at = q.unsigned_abs() as usize;
        let median = if c >= a.max(b) {
            a.min(b)
        } else if c <= a.min(b) {
            a.max(b)
        } else {
            a + b - c
        };
        let context = self.contexts[at];
        let predicted = (median + sign * context.c).clamp(0, self.max_value);
        let k = golomb_order(context.n, context.a);
        let mapped = self.golomb(k, self.limit)?;
        let is_swapped = self.near == 0 && k == 0 && 2 * context.b <= -context.n;
        let error = match (is_swapped, mapped % 2) {
            (false, 0) => mapped / 2,
            (false, _) => -(mapped + 1) / 2,
            (true, 0) => -(mapped / 2) - 1,
            (true, _) => (mapped - 1) / 2,
        };
        self.contexts[at] = self.learnt(context, error);
        Ok(self.rebuilt(predicted, sign * error))
    }

    /// What a context learns from an error (A.6).
    fn learnt(&self, mut context: Context, error: i32) -> Context {
        context.b = context
            .b
            .saturating_add(error.saturating_mul(2 * self.near + 1));
        context.a = context.a.saturating_add(error.saturating_abs());
        if context.n == self.reset {
            context.a >>= 1;
            context.b >>= 1;
            context.n >>= 1;
        }
        context.n += 1;
        if context.b <= -context.n {
            context.b = (context.b + context.n).max(1 - context.n);
            context.c = (context.c - 1).max(-128);
        } else if context.b > 0 {
            context.b = (context.b - context.n).min(0);
            context.c = (context.c + 1).min(127);
        }
        context
    }

    /// Run mode (A.7): returns where the line goes on.
    fn run(&mut self, above: &[i32], line: &mut [i32], begin: usize) -> Result<usize, String> {
        let end = line.len() - 1;
        let value = line[begin - 1];
        let mut x = begin;
        while self.bits.read(1)? == 1 {
            let length = 1 << J[self.run_index];
            let taken = length.min(end - x);
            line[x..x + taken].fill(value);
            x += taken;
            if taken == length {
                self.run_index = (self.run_index + 1).min(J.len() - 1);
            }
            if x == end {
                return Ok(end);
            }
        }
        let rest = self.bits.read(J[self.run_index])? as usize;
        if rest >= end - x {
            return Err("a run beyond the end of its line".into());
        }
        line[x..x + rest].fill(value);
        x += rest;
        line[x] = self.interruption(value, above[x])?;
        self.run_index = self.run_index.saturating_sub(1);
        Ok(x + 1)
    }

    /// The sample that ends a run (A.7.2).
    fn interruption(&mut self, a: i32, b: i32) -> Result<i32, String> {
        let kind = i32::from((a - b).abs() <= self.near);
        let context = self.run_contexts[kind as usize];
        let sum = context.a + if kind == 1 { context.n >> 1 } else { 0 };
        let k = golomb_order(context.n, sum);
        let mapped = self.golomb(k, self.limit - J[self.run_index] - 1)?;
        let whole = mapped + kind;
        let map = whole & 1;
        let size = (whole + map) / 2;
        let is_negative = (k != 0 || 2 * context.b >= context.n) == (map == 1);
        let error = if is_negative { -size } else { size };
        let learnt = &mut self.run_contexts[kind as usize];
        learnt.b += i32::from(error < 0);
        learnt.a = learnt.a.saturating_add((mapped + 1 - kind) >> 1);
        if learnt.n == self.reset {
            learnt.a >>= 1;
            learnt.n >>= 1;
            learnt.b >>= 1;
        }
        learnt.n += 1;
        Ok(match kind {
            1 => self.rebuilt(a, error),
            _ => self.rebuilt(b, if b < a { -error } else { error }),
        })
    }

    /// A sample from what was predicted and its error (A.4.5).
    fn rebuilt(&self, predicted: i32, error: i32) -> i32 {
        let step = 2 * self.near + 1;
        let mut value = predicted.saturating_add(error.saturating_mul(step));
        if value < -self.near {
            value = value.saturating_add(self.range * step);
        } else if value > self.max_value + self.near {
            value = value.saturating_sub(self.range * step);
        }
        value.clamp(0, self.max_value)
    }

    fn quantised(&self, gradient: i32) -> i32 {
        let [t1, t2, t3] = self.thresholds;
        let size = gradient.abs();
        let level = if size <= self.near {
            0
        } else if size < t1 {
            1
        } else if size < t2 {
            2
        } else if size < t3 {
            3
        } else {
            4
        };
        level * gradient.signum()
    }

    /// A number in the limited Golomb code of order `k` (A.5.3).
    fn golomb(&mut self, k: u32, limit: u32) -> Result<i32, String> {
        let escape = limit
            .checked_sub(self.bits_of_range + 1)
            .ok_or("a code without room")?;
        let zeros = self.bits.zeros(limit)?;
        let value = if zeros < escape {
            u64::from(zeros) << k | u64::from(self.bits.read(k)?)
        } else {
            u64::from(self.bits.read(self.bits_of_range)?) + 1
        };
        i32::try_from(value).map_err(|_| "a code that is too large".into())
    }
}

/// The least k with n · 2^k ≥ a (A.5.1).
fn golomb_order(n: i32, a: i32) -> u32 {
    (0..31)
        .find(|&k| i64::from(n) << k >= i64::from(a))
        .unwrap_or(31)
}

/// C.2.4.1.1.1.
fn default_thresholds(max_value: i32, near: i32) -> [i32; 3] {
    let basic = if max_value >= 128 {
        let factor = (max_value.min(4095) + 128) / 256;
        [
            factor + 2 + 3 * near,
            4 * factor + 3 + 5 * near,
            17 * factor + 4 + 7 * near,
        ]
    } else {
        let factor = 256 / (max_value + 1);
        [
            (3 / factor + 3 * near).max(2),
            (7 / factor + 5 * near).max(3),
            (21 / factor + 7 * near).max(4),
        ]
    };
    let mut least = near + 1;
    basic.map(|t| {
        least = if t > max_value || t < least { least } else { t };
        least
    })
}
