//! Files written here in every way that VTK has; damaged ones are refused without a panic.

use std::io::Write;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use flate2::write::ZlibEncoder;
use proptest::prelude::*;

use super::*;
use crate::geom::VoxelBox;
use crate::volume::{ReadOrder, VoxelType};

/// Bytes of a block of the files written here: no multiple of a voxel, a row or base64's 3.
const BLOCK_BYTES: usize = 50;

const DIMS: U64Vec3 = U64Vec3::new(5, 4, 3);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Ascii,
    Inline,
    /// As [`Self::Inline`], but the length is a text of its own.
    InlineApart,
    AppendedBase64,
    AppendedRaw,
}

/// How to write a file of 5 × 4 × 3 voxels of i16, counting up from −30.
#[derive(Clone, Copy, Debug)]
struct Way {
    format: Format,
    codec: Codec,
    word: usize,
    big: bool,
}

impl Way {
    fn all() -> Vec<Self> {
        let mut ways = Vec::new();
        for format in [
            Format::Ascii,
            Format::Inline,
            Format::InlineApart,
            Format::AppendedBase64,
            Format::AppendedRaw,
        ] {
            for codec in [Codec::None, Codec::Zlib, Codec::Lz4] {
                if format == Format::Ascii && codec != Codec::None {
                    continue;
                }
                for (word, big) in [(4, false), (4, true), (8, false), (8, true)] {
                    ways.push(Self {
                        format,
                        codec,
                        word,
                        big,
                    });
                }
            }
        }
        ways
    }

    fn words(self, words: &[u64]) -> Vec<u8> {
        let bytes = words.iter().flat_map(|w| {
            if self.big {
                w.to_be_bytes()[8 - self.word..].to_vec()
            } else {
                w.to_le_bytes()[..self.word].to_vec()
            }
        });
        bytes.collect()
    }

    /// The bytes before the voxels, and the voxels, as `codec` has them.
    fn packed(self) -> (Vec<u8>, Vec<u8>) {
        let voxels = expected();
        let voxels: Vec<u8> = if self.big {
            voxels.chunks(2).flat_map(|v| [v[1], v[0]]).collect()
        } else {
            voxels
        };
        let blocks: Vec<Vec<u8>> = voxels
            .chunks(BLOCK_BYTES)
            .map(|block| match self.codec {
                Codec::None => Vec::new(),
                Codec::Zlib => {
                    let mut e = ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
                    e.write_all(block).unwrap();
                    e.finish().unwrap()
                }
                Codec::Lz4 => lz4_flex::block::compress(block),
            })
            .collect();
        if self.codec == Codec::None {
            return (self.words(&[voxels.len() as u64]), voxels);
        }
        let last = voxels.len() % BLOCK_BYTES;
        let mut table = vec![blocks.len() as u64, BLOCK_BYTES as u64, last as u64];
        table.extend(blocks.iter().map(|b| b.len() as u64));
        (self.words(&table), blocks.concat())
    }

    fn base64(self) -> String {
        let (head, body) = self.packed();
        if self.codec == Codec::None && self.format != Format::InlineApart {
            BASE64_STANDARD.encode([head, body].concat())
        } else {
            BASE64_STANDARD.encode(head) + &BASE64_STANDARD.encode(body)
        }
    }

    fn file(self) -> Vec<u8> {
        let compressor = match self.codec {
            Codec::None => "",
            Codec::Zlib => r#" compressor="vtkZLibDataCompressor""#,
            Codec::Lz4 => r#" compressor="vtkLZ4DataCompressor""#,
        };
        let order = if self.big {
            "BigEndian"
        } else {
            "LittleEndian"
        };
        let (format, text) = match self.format {
            Format::Ascii => {
                let numbers = (-30i16..30).map(|v| v.to_string()).collect::<Vec<_>>();
                (r#""ascii""#, numbers.join(" \n "))
            }
            Format::Inline | Format::InlineApart => (r#""binary""#, self.base64()),
            Format::AppendedBase64 | Format::AppendedRaw => {
                (r#""appended" offset="3""#, String::new())
            }
        };
        let mut file = format!(
            r#"<?xml version="1.0"?>
<!-- a > b -->
<VTKFile type="ImageData" version="1.0" byte_order="{order}" header_type="UInt{}"{compressor}>
  <ImageData WholeExtent="2 6 -1 2 0 2" Origin="10 20 30" Spacing="2 3 4" Direction="0 -1 0 1 0 0 0 0 1">
    <Piece Extent="2 6 -1 2 0 2">
      <PointData Scalars="a > b">
        <DataArray type="Int16" Name="a > b" format={format}>
          <InformationKey name="a">1 2 3</InformationKey>
          {text}
        </DataArray>
      </PointData>
    </Piece>
  </ImageData>
"#,
            8 * self.word
        )
        .into_bytes();
        let (head, body) = self.packed();
        match self.format {
            Format::AppendedRaw => {
                file.extend(b"<AppendedData encoding=\"raw\">\n _abc");
                file.extend([head, body].concat());
                file.extend(b"\n</AppendedData>");
            }
            Format::AppendedBase64 => {
                file.extend(b"<AppendedData encoding=\"base64\">_abc");
                file.extend(self.base64().into_bytes());
                file.extend(b"\n</AppendedData>");
            }
            _ => {}
        }
        file.extend(b"\n</VTKFile>\n");
        file
    }
}

fn expected() -> Vec<u8> {
    (-30i16..30).flat_map(i16::to_le_bytes).collect()
}

fn source(bytes: &[u8], dataset: Option<&str>) -> Result<Box<dyn VoxelSource>, SourceError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let options = OpenOptions {
        dataset: dataset.map(str::to_owned),
        ..OpenOptions::default()
    };
    open(file.path(), &options)
}

fn read_whole(source: &mut dyn VoxelSource) -> Result<Vec<u8>, SourceError> {
    let desc = source.desc().clone();
    let mut out = vec![0; desc.byte_count().unwrap() as usize];
    let slice = out.len() / desc.dims.z as usize;
    let mut whole = VoxelBox::whole(desc.dims);
    for (z, bytes) in out.chunks_mut(slice).enumerate() {
        (whole.min.z, whole.max.z) = (z as u64, z as u64 + 1);
        source.read_box(whole, bytes)?;
    }
    Ok(out)
}

fn read(bytes: &[u8]) -> Result<Vec<u8>, SourceError> {
    read_whole(&mut *source(bytes, None)?)
}

fn refused(bytes: &[u8], dataset: Option<&str>) -> String {
    let error = source(bytes, dataset).err();
    error.map(|e| e.to_string()).unwrap_or_default()
}

/// A file of 2 × 2 × 2 points with `arrays` inside its piece, those of the points first.
fn with_arrays(points: &str, cells: &str) -> Vec<u8> {
    format!(
        r#"<VTKFile type="ImageData"><ImageData WholeExtent="0 1 0 1 0 1" Spacing="2 2 2"><Piece Extent="0 1 0 1 0 1">
        <PointData {points}</PointData><CellData {cells}</CellData></Piece></ImageData></VTKFile>"#
    )
    .into_bytes()
}

fn array(name: &str, attributes: &str, text: &str) -> String {
    format!(
        r#"<DataArray type="UInt8" Name="{name}" format="ascii" {attributes}>{text}</DataArray>"#
    )
}

fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes
        .windows(from.len())
        .position(|w| w == from.as_bytes())
        .unwrap_or_else(|| panic!("{from} is not in the file"));
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

#[test]
fn every_way_of_writing() {
    for way in Way::all() {
        let mut source = source(&way.file(), None).unwrap_or_else(|e| panic!("{way:?}: {e}"));
        assert_eq!(source.desc().dims, DIMS, "{way:?}");
        assert_eq!(source.desc().voxel_type, VoxelType::I16, "{way:?}");
        assert_eq!(read_whole(&mut *source).unwrap(), expected(), "{way:?}");
        if source.order() == ReadOrder::ForwardZ {
            assert_eq!(way.format, Format::Ascii, "only numbers are a stream");
            continue;
        }
        for (min, max) in [
            ([0, 0, 0], [5, 4, 3]),
            ([4, 3, 2], [5, 4, 3]),
            ([1, 0, 1], [4, 4, 3]),
            ([0, 0, 1], [5, 4, 2]),
            ([0, 2, 0], [5, 3, 2]),
        ] {
            let part = VoxelBox::new(U64Vec3::from_array(min), U64Vec3::from_array(max));
            let mut out = vec![0; part.voxel_count().unwrap() as usize * 2];
            source.read_box(part, &mut out).unwrap();
            let mut wanted = Vec::new();
            for z in min[2]..max[2] {
                for y in min[1]..max[1] {
                    for x in min[0]..max[0] {
                        let v = ((z * 4 + y) * 5 + x) as i16 - 30;
                        wanted.extend(v.to_le_bytes());
                    }
                }
            }
            assert_eq!(out, wanted, "{way:?}, box {min:?}..{max:?}");
        }
    }
}

#[test]
fn the_first_voxel_counts_from_the_extent() {
    let source = source(&Way::all()[0].file(), None).unwrap();
    let affine = source.desc().world_from_index;
    assert_eq!(affine.matrix3.x_axis, DVec3::Y * 2.0, "x");
    assert_eq!(affine.matrix3.y_axis, DVec3::X * -3.0, "y");
    assert_eq!(
        affine.translation,
        DVec3::new(13.0, 24.0, 30.0),
        "first voxel"
    );
    assert!(
        source.notes()[0].contains("millimetres"),
        "{:?}",
        source.notes()
    );
}

#[test]
fn one_of_several_arrays() {
    let counted = "1 2 3 4 5 6 7 8";
    let two = array("a", "", counted) + &array("b&quot;", "", "8 7 6 5 4 3 2 1");
    let file = with_arrays(&format!("Scalars='b&quot;'>{two}"), ">");
    let mut active = source(&file, None).unwrap();
    assert_eq!(
        read_whole(&mut *active).unwrap(),
        [8, 7, 6, 5, 4, 3, 2, 1],
        "the active one"
    );
    assert!(
        active.notes()[1].contains("--dataset"),
        "{:?}",
        active.notes()
    );
    let mut named = source(&file, Some("a")).unwrap();
    assert_eq!(
        read_whole(&mut *named).unwrap(),
        [1, 2, 3, 4, 5, 6, 7, 8],
        "the named one"
    );
    let error = refused(&file, Some("c"));
    assert!(error.contains(r#""a", "b\"", found "c""#), "{error}");

    let error = refused(&with_arrays(&format!(">{two}"), ">"), None);
    assert!(
        error.contains(r#""a", "b\"""#) && error.contains("--dataset NAME"),
        "{error}"
    );
    let rgb = array("rgb", "NumberOfComponents='3'", counted);
    let error = refused(&with_arrays(&format!(">{rgb}"), ">"), None);
    assert!(error.contains(r#""rgb" of 3 components"#), "{error}");
    let error = refused(&with_arrays(">", ">"), None);
    assert!(error.contains("an array of voxels"), "{error}");
}

#[test]
fn cells_lie_between_the_points() {
    let cells = array("c", "", "7");
    let mut source = source(&with_arrays(">", &format!(">{cells}")), None).unwrap();
    assert_eq!(source.desc().dims, U64Vec3::ONE, "one cell");
    assert_eq!(
        source.desc().world_from_index.translation,
        DVec3::ONE,
        "its middle"
    );
    assert!(source.notes()[1].contains("cells"), "{:?}", source.notes());
    assert_eq!(read_whole(&mut *source).unwrap(), [7], "its value");
}

#[test]
fn numbers_are_of_the_type_and_as_many() {
    let read = |text: &str| read(&with_arrays(&format!(">{}", array("a", "", text)), ">"));
    assert_eq!(
        read(" 1 2 3\n4 5\t6 7 255 ").unwrap()[7],
        255,
        "white space"
    );
    for (text, word) in [
        ("1 2 3 4 5 6 7", "a text of"),
        ("1 2 3 4 5 6  7  ", "number 7"),
        ("1 2 3 4 5 6 7 8 9", "number 8"),
        ("1 2 3 4 5 6 7 256", "number 7"),
        ("1 2 3 4 5 6 7 x", "number 7"),
        ("1 2 3 4 5 6 7 0.5", "number 7"),
    ] {
        let error = read(text).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(word), "{text}: {error}");
    }
    assert!(
        read(&("0".repeat(500) + " 2 3 4 5 6 7 8")).is_err(),
        "500 digits"
    );
}

#[test]
fn what_is_not_built_or_wrong_is_named() {
    let way = |codec| Way {
        format: Format::AppendedRaw,
        codec,
        word: 4,
        big: false,
    };
    let file = way(Codec::Zlib).file();
    for (from, to, word) in [
        ("vtkZLibData", "vtkLZMAData", "vtkLZMADataCompressor"),
        ("\"Int16\"", "\"Int64\"", "type Int64"),
        ("\"Int16\"", "\"Int9\"", "the type of array"),
        ("type=\"ImageData\"", "type=\"PolyData\"", "PolyData"),
        ("</Piece>", "</Piece><Piece/>", "2 pieces"),
        ("Piece Extent=\"2 6", "Piece Extent=\"3 6", "a piece"),
        ("WholeExtent=\"2 6", "WholeExtent=\"7 6", "WholeExtent"),
        ("Spacing=\"2 3 4\"", "Spacing=\"2 0 4\"", "Spacing"),
        ("Spacing=\"2 3 4\"", "Spacing=\"2 3\"", "Spacing"),
        ("offset=\"3\"", "offset=\"99999\"", "AppendedData"),
        ("offset=\"3\"", "offset=\"-1\"", "the offset"),
        ("encoding=\"raw\"", "encoding=\"hex\"", "AppendedData"),
        ("LittleEndian", "Middle", "byte_order"),
        ("UInt32", "UInt16", "header_type"),
        ("</PointData>", "</CellData>", "well-formed"),
        ("<VTKFile", "<!DOCTYPE a><VTKFile", "DOCTYPE"),
        ("_abc", "#abc", "'_' before the data"),
    ] {
        let error = refused(&replaced(&file, from, to), None);
        assert!(error.contains(word), "{from} → {to}: {error}");
    }
}

#[test]
fn lying_sizes_are_refused_at_once() {
    for codec in [Codec::None, Codec::Zlib, Codec::Lz4] {
        for word in [4, 8] {
            let way = Way {
                format: Format::AppendedRaw,
                codec,
                word,
                big: false,
            };
            let file = way.file();
            let extent = "\"0 999999 0 999999 0 999999\"";
            let huge = replaced(&file, "\"2 6 -1 2 0 2\"", extent);
            let error = refused(&replaced(&huge, "\"2 6 -1 2 0 2\"", extent), None);
            assert!(
                error.contains("2000000000000000000 bytes"),
                "{way:?}: {error}"
            );

            let start = file.windows(4).position(|w| w == b"_abc").unwrap() + 4;
            let words = if codec == Codec::None { 1 } else { 4 };
            for n in 0..words {
                let mut lying = file.clone();
                lying[start + n * word..start + (n + 1) * word].fill(0xfe);
                assert!(source(&lying, None).is_err(), "{way:?}, word {n}");
            }
            if codec == Codec::None {
                continue;
            }
            // As many blocks as the image needs, if each were of one byte.
            let mut tiny = file.clone();
            tiny[start..start + 3 * word].copy_from_slice(&way.words(&[120, 1, 0]));
            assert!(
                source(&tiny, None).is_err(),
                "{way:?}: a table beyond the end"
            );
        }
    }
}

#[test]
fn endless_markup_is_refused() {
    let error = refused(&b"<a>".repeat(200_000), None);
    assert!(error.contains("the VTK XML"), "{error}");
    let error = refused(&b"<a>".repeat(2 << 20), None);
    assert!(error.contains("bytes of tags"), "{error}");
    let mut tag = b"<VTKFile type=\"".to_vec();
    tag.resize(5 << 20, b'a');
    let error = refused(&tag, None);
    assert!(error.contains("bytes of tags"), "{error}");
    let error = refused(b"<VTKFile type=\"ImageData\" <!-- ", None);
    assert!(error.contains("its end '>'"), "{error}");
}

#[test]
fn a_damaged_block_is_named() {
    for format in [Format::AppendedRaw, Format::AppendedBase64] {
        let way = Way {
            format,
            codec: Codec::Zlib,
            word: 8,
            big: false,
        };
        let mut file = way.file();
        let end = file.windows(2).rposition(|w| w == b"\n<").unwrap();
        // In raw data it is a byte of the last block's checksum.
        let at = file[..end].windows(2).rposition(|w| w == b"\n<").unwrap() - 3;
        file[at] = if file[at] == b'A' { b'B' } else { b'A' };
        let error = read(&file).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains("compressed block 2"), "{format:?}: {error}");
    }
}

#[test]
fn a_cut_file_is_refused_or_whole() {
    // Half of the ways: what comes of the byte order does not depend on where the file ends.
    let ways = Way::all().into_iter().filter(|w| w.big == (w.word == 8));
    for (i, way) in ways.enumerate() {
        let file = way.file();
        // What is before the array is the same in all.
        let array = file.windows(10).position(|w| w == b"<DataArray").unwrap();
        let first = if i == 0 { 0 } else { array };
        for n in first..file.trim_ascii_end().len() {
            if let Ok(voxels) = read(&file[..n]) {
                let data_end = file.windows(15).position(|w| w == b"</AppendedData>");
                // Nothing behind the appended data counts, nor the padding at their end.
                assert!(
                    data_end.is_some_and(|end| n + 4 > end),
                    "{way:?} cut at {n}"
                );
                assert_eq!(voxels, expected(), "{way:?} cut at {n}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        way in 0usize..52,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let mut file = Way::all()[way].file();
        for (at, value) in changes {
            let n = file.len();
            file[at.index(n)] = value;
        }
        if let Ok(mut source) = source(&file, None)
            && source.desc().byte_count().is_some_and(|n| n < 1 << 20)
        {
            let _ = read_whole(&mut *source);
        }
    }
}
