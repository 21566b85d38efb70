//! Going on with bricking that was killed: whatever the moment, the store is the same to the byte; whatever happened to
//! the journal or the files meanwhile, it is refused by kind or begun from an earlier state, never wrong.
//!
//! A kill is played by copying the folder of unfinished parts while the run goes on: what a dead process leaves. Kills of
//! the real binary are in `tests/cli/resumed.rs`.

#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[allow(dead_code, reason = "shared: not every test uses all of it")]
#[path = "support/memory_source.rs"]
mod memory_source;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

use brickscope::bricking::{self, BrickError, BrickOptions, BrickingReport, NoProgress, Progress};
use brickscope::geom::{BrickGrid, VoxelBox};
use brickscope::outfile::{Existing, PartialFolder};
use brickscope::store::{Store, StoreError, StoreWriter};
use brickscope::volume::{ReadOrder, SourceError, StoredType, VolumeDesc, VoxelSource, VoxelType};
use glam::U64Vec3;
use memory_source::{MemorySource, noise, voxels};
use proptest::prelude::*;

/// Slices of more than 256 KiB: a chunk is at most 32 of them, so that a run has several chunks.
const DIMS: [u64; 3] = [370, 360, 170];

fn options() -> BrickOptions {
    BrickOptions {
        memory_bytes: 128 << 20,
        threads: Some(2),
        checkpoint_every: Duration::ZERO,
        ..BrickOptions::default()
    }
}

fn resuming() -> BrickOptions {
    BrickOptions {
        resume: true,
        ..options()
    }
}

/// A source that, asked for a chunk, first waits until the pass has done the chunks before (there is a new checkpoint, and
/// nothing is written any more), and then copies what is there.
struct Killed<'a> {
    inner: MemorySource,
    partial: PathBuf,
    images: &'a Path,
    count: usize,
    /// The checkpoint that the last copy holds.
    checkpoint: u64,
}

impl VoxelSource for Killed<'_> {
    fn desc(&self) -> &VolumeDesc {
        self.inner.desc()
    }

    fn order(&self) -> ReadOrder {
        self.inner.order()
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        if voxels.min.z > 0 {
            // The first chunk finishes no layer, and so brings no checkpoint; others may not either.
            let limit =
                Instant::now() + Duration::from_millis(if self.count == 0 { 0 } else { 1500 });
            while newest_checkpoint(&self.partial) == self.checkpoint && Instant::now() < limit {
                std::thread::sleep(Duration::from_millis(10));
            }
            self.checkpoint = newest_checkpoint(&self.partial);
            let mut before = Vec::new();
            loop {
                std::thread::sleep(Duration::from_millis(40));
                let now = states(&self.partial);
                if now == before {
                    break;
                }
                before = now;
            }
            copy(&self.partial, &self.images.join(self.count.to_string()));
            self.count += 1;
        }
        self.inner.read_box(voxels, out)
    }
}

/// The journal files with a checkpoint in them and its number, newest first.
fn numbered_journals(folder: &Path) -> Vec<(u64, PathBuf)> {
    let mut found: Vec<(u64, PathBuf)> = ["journal-0", "journal-1"]
        .map(|name| folder.join(name))
        .into_iter()
        .filter_map(|path| {
            let bytes = fs::read(&path).unwrap();
            let number = u64::from_le_bytes(bytes.get(24..32)?.try_into().unwrap());
            Some((number, path))
        })
        .collect();
    found.sort_by(|a, b| b.cmp(a));
    found
}

fn journals(folder: &Path) -> Vec<PathBuf> {
    let found = numbered_journals(folder);
    found.into_iter().map(|(_, path)| path).collect()
}

fn newest_checkpoint(folder: &Path) -> u64 {
    numbered_journals(folder).first().map_or(0, |(n, _)| *n)
}

/// Length of every file, and when it was changed.
fn states(folder: &Path) -> Vec<(PathBuf, u64, std::time::SystemTime)> {
    let mut states: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap())
        .map(|e| (e.path(), e.metadata().unwrap()))
        .map(|(path, info)| (path, info.len(), info.modified().unwrap()))
        .collect();
    states.sort();
    states
}

/// Copies a folder of unfinished parts; the journal first, so that it never speaks of more than is copied.
fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    let mut names: Vec<_> = fs::read_dir(from)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort_by_key(|n| !n.starts_with("journal"));
    for name in names {
        fs::copy(from.join(&name), to.join(&name)).unwrap();
    }
}

/// A volume, the store that it becomes, and what is left when that is killed at several moments.
struct Case {
    dir: tempfile::TempDir,
    source: Box<dyn Fn() -> MemorySource>,
    whole: Vec<u8>,
    images: usize,
}

impl Case {
    fn new(source: impl Fn() -> MemorySource + 'static) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.bsk");
        let mut killed = Killed {
            inner: source(),
            partial: PartialFolder::path_for(&out),
            images: dir.path(),
            count: 0,
            checkpoint: 0,
        };
        bricking::brick(&mut killed, &out, &options(), &NoProgress).unwrap();
        let images = killed.count;
        let whole = fs::read(&out).unwrap();
        fs::remove_file(&out).unwrap();
        assert!(images >= 3, "killed at {images} moments");
        Self {
            dir,
            source: Box::new(source),
            whole,
            images,
        }
    }

    fn image(&self, i: usize) -> PathBuf {
        self.dir.path().join(i.to_string())
    }

    fn out(&self) -> PathBuf {
        self.dir.path().join("out.bsk")
    }

    fn partial(&self) -> PathBuf {
        PartialFolder::path_for(&self.out())
    }

    /// Puts image `i` where a run finds it.
    fn leave(&self, i: usize) {
        let _ = fs::remove_dir_all(self.partial());
        let _ = fs::remove_file(self.out());
        copy(&self.image(i), &self.partial());
    }

    fn resume(&self, options: &BrickOptions) -> Result<BrickingReport, BrickError> {
        bricking::brick(&mut (self.source)(), &self.out(), options, &NoProgress)
    }

    /// Resumes and compares; returns how many bytes were not read again.
    #[track_caller]
    fn finishes(&self, what: &str) -> u64 {
        let report = self
            .resume(&resuming())
            .unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(
            fs::read(self.out()).unwrap() == self.whole,
            "{what}: the store is the same to the byte"
        );
        assert!(!self.partial().exists(), "{what}: nothing else is left");
        report.bytes_resumed
    }

    /// A refusal leaves all as it was.
    #[track_caller]
    fn is_kept(&self, before: &[(String, u64)], what: &str) {
        assert_eq!(self.files(), before, "{what}: the unfinished parts stay");
        assert!(!self.out().exists(), "{what}: no output");
    }

    fn files(&self) -> Vec<(String, u64)> {
        let mut files: Vec<_> = fs::read_dir(self.partial())
            .unwrap()
            .map(|e| e.unwrap())
            .map(|e| {
                (
                    e.file_name().into_string().unwrap(),
                    e.metadata().unwrap().len(),
                )
            })
            .collect();
        files.sort();
        files
    }
}

fn u16_volume() -> MemorySource {
    // Made once: it costs more than bricking it.
    static VOXELS: OnceLock<Vec<u8>> = OnceLock::new();
    let n = DIMS.iter().product::<u64>() as usize;
    let bytes = VOXELS.get_or_init(|| voxels(VoxelType::U16, n, 1, 0.8));
    MemorySource::new(DIMS, VoxelType::U16, bytes.clone())
}

#[test]
fn killed_at_any_moment() {
    let case = Case::new(u16_volume);
    let mut resumed = Vec::new();
    for i in 0..case.images {
        case.leave(i);
        resumed.push(case.finishes(&format!("image {i}")));
    }
    assert!(
        resumed.iter().filter(|&&bytes| bytes > 0).count() >= 2,
        "not all began from the start: {resumed:?}"
    );
    assert!(
        resumed.is_sorted() && resumed.last() > resumed.first(),
        "later kills lose no more: {resumed:?}"
    );
}

#[test]
fn thick_slices_and_streams_with_nan() {
    // Levels 1 and 2 keep z; f32 that has to be read forward, with NaN whose replacement was found beforehand.
    let dims = [300, 300, 100];
    let n = dims.iter().product::<u64>() as usize;
    let mut bytes = voxels(VoxelType::F32, n, 7, 0.5);
    for i in [n / 3, n - 5] {
        bytes[4 * i..4 * i + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    }
    let range = bricking::finite_range(
        &mut MemorySource::new(dims, VoxelType::F32, bytes.clone()),
        9,
    )
    .unwrap();
    let source = {
        let bytes = bytes.clone();
        move || MemorySource::new(dims, VoxelType::F32, bytes.clone()).with_spacing([1.0, 1.0, 3.5])
    };
    let case = Case::new(source);
    let mut most = 0;
    for i in 0..case.images {
        case.leave(i);
        // As a stream: read forward only, and nobody tells the range unless the journal does.
        let mut source = (case.source)().forward();
        let known = BrickOptions {
            finite_range: Some(range),
            ..resuming()
        };
        let report = bricking::brick(&mut source, &case.out(), &known, &NoProgress).unwrap();
        assert!(
            fs::read(case.out()).unwrap() == case.whole,
            "image {i}: the same to the byte"
        );
        assert_eq!(
            report.conversion.nan_values, 2,
            "image {i}: both counted once"
        );
        most = most.max(report.bytes_resumed);
    }
    assert!(most > 0, "something was resumed");
    // The last image is behind the first NaN: its journal knows the range.
    case.leave(case.images - 1);
    let mut source = (case.source)().forward();
    bricking::brick(&mut source, &case.out(), &resuming(), &NoProgress).unwrap();
    assert!(
        fs::read(case.out()).unwrap() == case.whole,
        "the range came from the journal"
    );
}

#[test]
fn killed_again_and_again() {
    let first = Case::new(u16_volume);
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.bsk");
    // Each run starts with what the one before left when it was killed in its second chunk.
    copy(&first.image(0), &PartialFolder::path_for(&out));
    let mut reached = Vec::new();
    for round in 0..4 {
        let images = tempfile::tempdir().unwrap();
        let mut killed = Killed {
            inner: u16_volume(),
            partial: PartialFolder::path_for(&out),
            images: images.path(),
            count: 0,
            checkpoint: 0,
        };
        let report = bricking::brick(&mut killed, &out, &resuming(), &NoProgress).unwrap();
        assert!(
            fs::read(&out).unwrap() == first.whole,
            "round {round}: the same to the byte"
        );
        reached.push(report.bytes_resumed);
        if killed.count < 2 {
            break;
        }
        fs::remove_file(&out).unwrap();
        copy(&images.path().join("1"), &PartialFolder::path_for(&out));
    }
    assert!(reached.len() >= 3, "killed several times: {reached:?}");
    assert!(
        reached.is_sorted(),
        "each went on from the last: {reached:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn any_size_and_spacing(
        dims in [300u64..420, 300u64..420, 66u64..150],
        thick in 0usize..4,
        seed: u32,
    ) {
        let mut spacing = [1.0; 3];
        if thick < 3 {
            spacing[thick] = 2.5;
        }
        let n = dims.iter().product::<u64>() as usize;
        let bytes = voxels(VoxelType::U16, n, seed, 0.9);
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.bsk");
        let mut killed = Killed {
            inner: MemorySource::new(dims, VoxelType::U16, bytes.clone()).with_spacing(spacing),
            partial: PartialFolder::path_for(&out),
            images: dir.path(),
            count: 0,
            checkpoint: 0,
        };
        bricking::brick(&mut killed, &out, &options(), &NoProgress).unwrap();
        let whole = fs::read(&out).unwrap();
        fs::remove_file(&out).unwrap();
        let last = dir.path().join((killed.count - 1).to_string());
        copy(&last, &PartialFolder::path_for(&out));
        let mut source = MemorySource::new(dims, VoxelType::U16, bytes).with_spacing(spacing);
        let report = bricking::brick(&mut source, &out, &resuming(), &NoProgress).unwrap();
        prop_assert!(report.bytes_resumed > 0, "resumed");
        prop_assert!(fs::read(&out).unwrap() == whole, "the same to the byte");
    }
}

/// The last image of which this holds.
fn last_with(case: &Case, holds: impl Fn(&Path) -> bool) -> usize {
    (0..case.images)
        .rev()
        .find(|&i| holds(&case.image(i)))
        .expect("an image of that kind")
}

#[test]
fn damaged_journals_are_never_believed() {
    let case = Case::new(u16_volume);
    let last = last_with(&case, |image| journals(image).len() == 2);
    case.leave(last);
    let undamaged = case.finishes("undamaged");
    let newest = |folder: PathBuf| journals(&folder).swap_remove(0);
    let len = fs::metadata(newest(case.image(last))).unwrap().len() as usize;
    // Every field of the head, and places all over the state.
    let flips = [0, 9, 13, 17, 25, 33, 41, 47, 53].into_iter();
    let flips = flips.chain((56..len).step_by(len / 4));
    for at in flips {
        case.leave(last);
        let newest = newest(case.partial());
        let mut bytes = fs::read(&newest).unwrap();
        bytes[at] ^= 1 << (at % 8);
        fs::write(&newest, &bytes).unwrap();
        let resumed = case.finishes(&format!("byte {at} of the newest flipped"));
        assert!(
            0 < resumed && resumed < undamaged,
            "byte {at}: from the checkpoint before, {resumed} of {undamaged}"
        );
    }
    for cut in [0, 20, 100, len - 1] {
        case.leave(last);
        let newest = newest(case.partial());
        let file = fs::File::options().write(true).open(&newest).unwrap();
        file.set_len(cut as u64).unwrap();
        let resumed = case.finishes(&format!("the newest cut to {cut} bytes"));
        assert!(0 < resumed && resumed < undamaged, "cut to {cut}");
    }
    // Both gone: from the beginning.
    case.leave(last);
    for (path, cut) in journals(&case.partial()).iter().zip([10, 0]) {
        let file = fs::File::options().write(true).open(path).unwrap();
        file.set_len(cut).unwrap();
    }
    assert_eq!(case.finishes("both damaged"), 0, "from the beginning");
}

#[test]
fn damaged_parts_are_refused() {
    let case = Case::new(u16_volume);
    // With a finished layer of level 1, by the newest checkpoint.
    let last = last_with(&case, |image| {
        let newest = journals(image).first().map(|path| fs::read(path).unwrap());
        newest.is_some_and(|bytes| bytes[56..60] != [0; 4])
    });
    // With that one alone: else the run may go on from the one before, which needs less.
    let leave_newest = || {
        case.leave(last);
        for older in journals(&case.partial()).iter().skip(1) {
            fs::write(older, "").unwrap();
        }
    };
    let refusal = |what: &str| {
        let before = case.files();
        match case.resume(&resuming()) {
            Err(BrickError::Store(StoreError::NotResumable { path, .. })) => {
                assert_eq!(path, case.out(), "{what}: names the store");
                case.is_kept(&before, what);
            }
            other => panic!("{what}: {other:?}"),
        }
    };
    // Too short for either checkpoint.
    for name in ["store", "level-0.index", "level-1.records", "level-1.index"] {
        leave_newest();
        let file = fs::File::options()
            .write(true)
            .open(case.partial().join(name))
            .unwrap();
        file.set_len(10).unwrap();
        refusal(&format!("{name} cut to 10 bytes"));
        leave_newest();
        fs::remove_file(case.partial().join(name)).unwrap();
        refusal(&format!("{name} gone"));
    }
    // An index entry, and a record that has to be read back.
    for name in ["level-0.index", "level-1.index"] {
        leave_newest();
        let path = case.partial().join(name);
        let mut bytes = fs::read(&path).unwrap();
        bytes[12] ^= 1;
        fs::write(&path, &bytes).unwrap();
        refusal(&format!("{name} flipped"));
    }
    leave_newest();
    let entries = fs::read(case.partial().join("level-0.index")).unwrap();
    let entry = entries
        .chunks(32)
        .rev()
        .skip(13 * 11)
        .find(|e| e[8..12] != [0; 4])
        .expect("a brick with a record");
    let offset = u64::from_le_bytes(entry[0..8].try_into().unwrap());
    let path = case.partial().join("store");
    let mut bytes = fs::read(&path).unwrap();
    bytes[offset as usize + 100] ^= 1;
    fs::write(&path, &bytes).unwrap();
    // That is found after the files were cut to what the journal speaks of.
    match case.resume(&resuming()) {
        Err(BrickError::Store(StoreError::NotResumable { what, .. })) => {
            assert!(
                what.contains("of level 0") && what.contains("CRC32C"),
                "{what}"
            );
        }
        other => panic!("a record flipped: {other:?}"),
    }
    assert!(path.exists() && !case.out().exists(), "kept");
}

#[test]
fn other_runs_are_refused_by_what_differs() {
    let case = Case::new(u16_volume);
    let last = case.images - 1;
    case.leave(last);
    let before = case.files();
    let refusal = |source: &mut MemorySource, options: &BrickOptions, words: &[&str]| {
        match bricking::brick(source, &case.out(), options, &NoProgress) {
            Err(error @ BrickError::OtherRun { .. }) => {
                let text = error.to_string();
                for word in words {
                    assert!(text.contains(word), "'{word}' in: {text}");
                }
                assert!(text.contains("out.bsk"), "names the store: {text}");
            }
            other => panic!("{words:?}: {other:?}"),
        }
        case.is_kept(&before, words[0]);
    };
    let zstd = BrickOptions {
        zstd_level: 3,
        ..resuming()
    };
    refusal(&mut u16_volume(), &zstd, &["--zstd was 1 and is 3"]);
    let levels = BrickOptions {
        levels: Some(2),
        ..resuming()
    };
    refusal(&mut u16_volume(), &levels, &["--levels was 5 and is 2"]);
    let stored = BrickOptions {
        store_type: Some(StoredType::F32),
        ..resuming()
    };
    refusal(&mut u16_volume(), &stored, &["stored type", "u16", "f32"]);
    let mut other = u16_volume();
    other.desc.name = "another".into();
    other.desc.rescale.slope = 3.0;
    refusal(
        &mut other,
        &resuming(),
        &["the source was memory and is another", "the rescale"],
    );
    let mut moved = u16_volume().with_spacing([1.0, 1.0, 1.1]);
    refusal(&mut moved, &resuming(), &["the affine"]);
    let n = (DIMS[0] * DIMS[1] * (DIMS[2] - 1)) as usize;
    let bytes = voxels(VoxelType::U16, n, 1, 0.8);
    let mut smaller = MemorySource::new([DIMS[0], DIMS[1], DIMS[2] - 1], VoxelType::U16, bytes);
    refusal(&mut smaller, &resuming(), &["the size in voxels"]);

    // The same description, other voxels.
    let mut changed = u16_volume();
    for (b, n) in changed.bytes.iter_mut().zip(noise(usize::MAX, 99)) {
        *b = n as u8;
    }
    match bricking::brick(&mut changed, &case.out(), &resuming(), &NoProgress) {
        Err(BrickError::SourceChanged { slice, .. }) => {
            assert_eq!(slice % 32, 31, "the last of a finished layer: {slice}");
        }
        other => panic!("other voxels: {other:?}"),
    }

    // Threads and memory don't count. After all these refusals the work is still there.
    let options = BrickOptions {
        threads: Some(1),
        memory_bytes: 1 << 30,
        ..resuming()
    };
    let report = case.resume(&options).unwrap();
    assert!(report.bytes_resumed > 0, "resumed");
    assert!(fs::read(case.out()).unwrap() == case.whole, "to the byte");
}

/// Keeps what is said.
#[derive(Default)]
struct Said(Mutex<Vec<String>>);

impl Progress for Said {
    fn begin(&self, _what: &str, _total: u64) {}
    fn advance(&self, _bytes: u64) {}
    fn end(&self) {}
    fn note(&self, message: &str) {
        self.0.lock().unwrap().push(message.into());
    }
}

#[test]
fn what_is_there_decides_and_is_said() {
    let case = Case::new(u16_volume);
    let run = |options: &BrickOptions| {
        let said = Said::default();
        let report = bricking::brick(&mut u16_volume(), &case.out(), options, &said).unwrap();
        assert!(fs::read(case.out()).unwrap() == case.whole, "to the byte");
        fs::remove_file(case.out()).unwrap();
        (
            report.bytes_resumed,
            said.0.into_inner().unwrap().join("\n"),
        )
    };
    let (resumed, said) = run(&resuming());
    assert_eq!(resumed, 0);
    assert!(said.contains("nothing to resume"), "{said}");
    assert_eq!(run(&options()), (0, String::new()), "nothing to say");
    case.leave(case.images - 1);
    let (resumed, said) = run(&options());
    assert_eq!(resumed, 0, "a plain run starts from the beginning");
    assert!(
        said.contains("killed run") && said.contains("--resume"),
        "{said}"
    );
    case.leave(case.images - 1);
    let (resumed, said) = run(&resuming());
    assert!(
        resumed > 0 && said.contains("resuming after slice"),
        "{said}"
    );

    // An output that is there is not touched, nor is what is unfinished.
    case.leave(case.images - 1);
    let before = case.files();
    fs::write(case.out(), "something else").unwrap();
    let refused = case.resume(&resuming());
    assert!(
        matches!(refused, Err(BrickError::Store(StoreError::Out(_)))),
        "{refused:?}"
    );
    assert_eq!(case.files(), before, "the unfinished parts stay");
    let replacing = BrickOptions {
        existing: Existing::Replace,
        ..resuming()
    };
    assert!(case.resume(&replacing).unwrap().bytes_resumed > 0);
    assert!(fs::read(case.out()).unwrap() == case.whole, "replaced");
}

#[test]
fn unfinished_stores_are_not_opened() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.bsk");
    let partial = PartialFolder::path_for(&out);
    let grid = BrickGrid::for_voxels(U64Vec3::splat(40)).unwrap();
    let mut writer = StoreWriter::create(&out, Existing::Refuse, StoredType::U8, &[grid]).unwrap();
    writer.mark().unwrap();
    for path in [out, partial.clone(), partial.join("store")] {
        let error = Store::open(&path).unwrap_err();
        assert!(
            matches!(error, StoreError::Unfinished { .. }),
            "{}: {error:?}",
            path.display()
        );
        let text = error.to_string();
        assert!(
            text.contains("not finished") && text.contains("--resume"),
            "{text}"
        );
    }
}
