//! Running the binary in a folder of its own, and the small files that the tests feed it.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tempfile::TempDir;

/// What a run left.
pub struct Run {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    /// Fails the test unless the run ended with `code`, and without a panic.
    #[track_caller]
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(
            self.code,
            Some(code),
            "exit code; stdout: {}\nstderr: {}",
            self.stdout,
            self.stderr
        );
        assert!(
            !self.stderr.contains("panicked"),
            "no panic; stderr: {}",
            self.stderr
        );
        self
    }
}

/// A temporary folder to run in.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    /// The command `brickscope ARGS` in this folder, not started.
    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_brickscope"));
        command
            .args(args)
            .current_dir(self.path())
            .stdin(Stdio::null())
            .env_remove("BRICKSCOPE_LOG");
        command
    }

    /// Runs `brickscope ARGS` in this folder.
    pub fn run(&self, args: &[&str]) -> Run {
        finish(self.command(args))
    }

    /// Writes a file and returns its name.
    pub fn write<'a>(&self, name: &'a str, bytes: &[u8]) -> &'a str {
        fs::write(self.file(name), bytes).expect("a file in the temporary folder");
        name
    }

    /// Bricks `input` into `name`.
    pub fn brick<'a>(&self, input: &str, name: &'a str) -> &'a str {
        self.run(&["brick", input, "-o", name, "--threads", "1"])
            .expect(0);
        name
    }

    /// Names of all files that are there, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(self.path())
            .expect("the temporary folder")
            .map(|e| {
                e.expect("an entry")
                    .file_name()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        names.sort();
        names
    }
}

/// Runs a command to its end.
pub fn finish(mut command: Command) -> Run {
    let output = command.output().expect("the binary starts");
    Run {
        code: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// A NIfTI-1 header for voxels of `datatype` (`bits` each), with spacing 1 and no place in the world, and the four bytes
/// after it. Change it with [`put`].
pub fn nifti_header(dims: [i16; 3], datatype: i16, bits: i16) -> Vec<u8> {
    let mut header = vec![0; 352];
    put(&mut header, 0, &348i32.to_le_bytes());
    for (i, n) in [3, dims[0], dims[1], dims[2], 1, 1, 1, 1]
        .into_iter()
        .enumerate()
    {
        put(&mut header, 40 + 2 * i, &n.to_le_bytes());
    }
    put(&mut header, 70, &datatype.to_le_bytes());
    put(&mut header, 72, &bits.to_le_bytes());
    for i in 0..4 {
        put(&mut header, 76 + 4 * i, &1f32.to_le_bytes());
    }
    put(&mut header, 108, &352f32.to_le_bytes());
    put(&mut header, 344, b"n+1\0");
    header
}

/// Overwrites bytes from `at` on.
pub fn put(bytes: &mut [u8], at: usize, new: &[u8]) {
    bytes[at..at + new.len()].copy_from_slice(new);
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).expect("writing to memory");
    encoder.finish().expect("writing to memory")
}

/// Bytes that don't compress, the same each time.
pub fn noise(len: usize) -> Vec<u8> {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    (0..len)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u8
        })
        .collect()
}

/// Width, height and pixels of a PNG, whose signature is checked; RGB or RGBA.
pub fn read_png(path: &Path) -> (u32, u32, Vec<u8>) {
    let bytes = fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    assert!(
        bytes.starts_with(b"\x89PNG\r\n\x1a\n"),
        "{}: the signature of a PNG",
        path.display()
    );
    let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    let mut reader = decoder.read_info().expect("a PNG header");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size that fits")];
    let info = reader.next_frame(&mut pixels).expect("the PNG's pixels");
    (info.width, info.height, pixels)
}
