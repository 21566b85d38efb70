#!/usr/bin/env python3
"""Compares what brickscope reads with what other programs' libraries read.

Every scan under DATA (CASES below: a pattern, who reads it outside, and how brickscope is asked) is bricked, verified,
and extracted to .nii.gz, .nrrd and .zarr. Voxels must be equal exactly, as stored and after rescaling; the affine (voxel to
world, RAS+ mm) must agree within --tolerance mm over the whole volume: the figure is the greatest distance, over the
eight corners, between where the two affines put them. What must be refused is tried, too.

The outside reading of NIfTI is nibabel's (best affine; a file without sform and qform gets its spacings), that of
NRRD, MetaImage and DICOM is SimpleITK's (LPS turned to RAS; an NRRD without `space` gets its spacings), that of TIFF
tifffile's, of OME-Zarr zarr-python's, of .vti VTK's. Slices at uneven distances are resampled by SimpleITK, each new
slice from the two around it, and compared within half a step of the stored values. The files that brickscope writes
are read by nibabel, SimpleITK and zarr-python.

One row per file; exit code 1 if anything is unequal, 2 for bad usage.

Needs: pip install numpy nibabel SimpleITK tifffile imagecodecs zarr vtk
"""
import argparse
import itertools
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import nibabel
import numpy as np
import SimpleITK as sitk

LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


class Scan:
    """Voxels as stored (x first), physical values, affine (RAS+ mm), and a note on where the affine is from."""

    def __init__(self, stored, physical, affine, note=""):
        self.stored, self.physical, self.affine, self.note = stored, physical, affine, note


def read_nifti(path):
    image = nibabel.load(path)
    header = image.header
    stored = np.asanyarray(image.dataobj.get_unscaled())
    slope, intercept = image.dataobj.slope, image.dataobj.inter
    note, affine = "", image.affine
    if header["sform_code"] == 0 and header["qform_code"] == 0:
        affine = np.diag([*header.get_zooms()[:3], 1.0])
        note = "no orientation: spacings only"
    return Scan(stored, stored * np.float64(slope) + np.float64(intercept), affine, note)


def nrrd_has_space(path):
    with open(path, "rb") as file:
        for line in file:
            line = line.strip()
            if not line:
                break
            if line.lower().startswith((b"space:", b"space dimension:")):
                return True
    return False


def read_itk(path):
    image = sitk.ReadImage(str(path))
    stored = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    direction = np.array(image.GetDirection()).reshape(3, 3)
    affine = np.eye(4)
    affine[:3, :3] = direction @ np.diag(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    note = ""
    if path.suffix in (".nrrd", ".nhdr") and not nrrd_has_space(path):
        note = "no space: spacings only"
        affine = np.diag([*image.GetSpacing(), 1.0])
    else:
        affine = LPS_TO_RAS @ affine
    return Scan(stored, stored.astype(np.float64), affine, note)


def itk_affine(image):
    direction = np.array(image.GetDirection()).reshape(3, 3)
    affine = np.eye(4)
    affine[:3, :3] = direction @ np.diag(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    return LPS_TO_RAS @ affine


def dicom_files(path):
    """The files of the only series of a folder, in the order of their places."""
    series = sitk.ImageSeriesReader.GetGDCMSeriesIDs(str(path))
    if len(series) != 1:
        raise ValueError(f"{len(series)} series")
    return sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(path), series[0])


def read_dicom(path):
    """Physical values: SimpleITK applies the rescale. Stored ones are compared through it."""
    image = sitk.ReadImage(dicom_files(path))
    physical = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    return Scan(physical, physical.astype(np.float64), itk_affine(image), "physical values compared")


def read_dicom_resampled(path):
    """Slices at even places on the line from the first to the last, as many as the least distance asks for."""
    slices = [sitk.ReadImage(name) for name in dicom_files(path)]
    places = np.array([s.GetOrigin() for s in slices])
    along = np.linalg.norm(places - places[0], axis=1)
    steps = round(along[-1] / np.diff(along).min())
    values = np.stack([sitk.GetArrayFromImage(s)[0].T for s in slices], axis=-1).astype(np.float64)
    even = np.linspace(0.0, along[-1], steps + 1)
    resampled = np.empty((*values.shape[:2], steps + 1))
    for k, at in enumerate(even):
        before = min(int(np.searchsorted(along, at, side="right")) - 1, len(slices) - 2)
        pair = sitk.GetImageFromArray(np.ascontiguousarray(values[..., before:before + 2].transpose(2, 1, 0)))
        pair.SetSpacing((1.0, 1.0, float(along[before + 1] - along[before])))
        target = sitk.Image(*pair.GetSize()[:2], 1, sitk.sitkFloat64)
        # Rounding must not put a place outside of the two slices.
        target.SetOrigin((0.0, 0.0, float(np.clip(at - along[before], 0, pair.GetSpacing()[2] * (1 - 1e-12)))))
        resampled[..., k] = sitk.GetArrayFromImage(sitk.Resample(pair, target))[0].T
    affine = itk_affine(slices[0])
    affine[:3, 2] = LPS_TO_RAS[:3, :3] @ (places[-1] - places[0]) / steps
    return Scan(resampled, resampled, affine, "resampled by SimpleITK; half a step allowed")


def read_vti(path):
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    stored = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(image.GetDimensions(), order="F")
    affine = np.diag([*image.GetSpacing(), 1.0])
    affine[:3, 3] = image.GetOrigin()
    return Scan(stored, stored.astype(np.float64), affine)


def read_tiff_series(path):
    import tifffile

    files = sorted(path.iterdir(), key=lambda f: [int(t) if t.isdigit() else t for t in re.split(r"(\d+)", f.name)])
    stored = np.stack([tifffile.imread(f) for f in files], axis=-1).transpose(1, 0, 2)
    return Scan(stored, stored.astype(np.float64), np.eye(4), "spacing as given")


MM = {"mm": 1.0, "millimeter": 1.0, "cm": 10.0, "inch": 25.4, "micron": 1e-3, "\\u00B5m": 1e-3, "\u00b5m": 1e-3, "um": 1e-3, "nm": 1e-6}


def read_tiff(path, channel=None):
    """A stack with the spacing of ImageJ's tags."""
    import tifffile

    with tifffile.TiffFile(path) as tiff:
        series = tiff.series[0]
        stored = series.asarray()
        if channel is not None:
            stored = stored.take(channel, axis=series.axes.index("C"))
        imagej = tiff.imagej_metadata or {}
        tags = tiff.pages[0].tags
        spacing = [1.0, 1.0, 1.0]
        unit = MM.get(imagej.get("unit"))
        if unit is not None:
            pixels = [tags[n].value for n in ("XResolution", "YResolution")]
            spacing = [unit * d / n for n, d in pixels] + [unit * imagej.get("spacing", 1.0)]
    stored = stored.transpose(2, 1, 0)
    return Scan(stored, stored.astype(np.float64), np.diag([*spacing, 1.0]), "no spacing" if unit is None else "")


def read_zarr(path):
    """The first scale of an OME-Zarr image; its unit is taken as mm where it says none. What brickscope wrote has the whole
    affine in an attribute."""
    import zarr

    group = zarr.open_group(str(path), mode="r")
    attributes = dict(group.attrs)
    multiscale = attributes.get("ome", attributes)["multiscales"][0]
    data = multiscale["datasets"][0]
    stored = np.asarray(group[data["path"]])
    scale, shift = np.ones(stored.ndim), np.zeros(stored.ndim)
    for of in (data, multiscale):
        for step in of.get("coordinateTransformations", []):
            if step["type"] == "scale":
                scale, shift = scale * step["scale"], shift * step["scale"]
            if step["type"] == "translation":
                shift = shift + step["translation"]
    units = {"micrometer": 1e-3, "nanometer": 1e-6, "millimeter": 1.0, "meter": 1e3, "angstrom": 1e-7}
    unit = [units.get(axis.get("unit"), 1.0) for axis in multiscale["axes"]]
    keep = [n for n, axis in enumerate(multiscale["axes"]) if axis["type"] == "space"]
    index = tuple(slice(None) if n in keep else 0 for n in range(stored.ndim))
    stored = stored[index].transpose()
    affine = np.eye(4)
    for n, axis in enumerate(reversed(keep)):
        affine[n, n], affine[n, 3] = scale[axis] * unit[axis], shift[axis] * unit[axis]
    if "brickscope" in attributes:
        affine[:3] = attributes["brickscope"]["world_from_index"]
    return Scan(stored, stored.astype(np.float64), affine)


class Case:
    """What a pattern finds: its outside reading, the options of `brick`, and by how much values may differ."""

    def __init__(self, pattern, read, *options, within=0.0, refused=None):
        self.pattern, self.read, self.options = pattern, read, options
        self.within, self.refused = within, refused


CASES = [
    Case("nifti/*.nii.gz", read_nifti),
    Case("nifti/orientations/*.nii.gz", read_nifti),
    Case("labels/*.nii.gz", read_nifti),
    Case("nrrd/*.nhdr", read_itk),
    Case("nrrd/*.nrrd", read_itk),
    Case("metaimage/*.mha", read_itk),
    Case("metaimage/*.mhd", read_itk),
    Case("vti/*.vti", read_vti),
    Case("dicom/chest-ct", read_dicom),
    Case("dicom/pet", read_dicom),
    Case("dicom/ct-jpeg2000", read_dicom),
    Case("dicom/head-tilted", None, refused="4.22 mm"),
    Case("dicom/head-tilted", read_dicom_resampled, "--resample-gaps", within=0.5 + 1e-6),
    Case("dicom/pet-seg", None, refused="DICOM-SEG"),
    Case("tiff/em-series", read_tiff_series, "--spacing", "1,1,1"),
    Case("tiff/xyz_*.tif", read_tiff),
    Case("tiff/*3d.tif", read_tiff),
    Case("tiff/xyzc_*.tif", None, refused="--channel"),
    Case("tiff/xyzc_*.tif", lambda path: read_tiff(path, 0), "--channel", "0"),
    Case("tiff/xyzc_*.tif", lambda path: read_tiff(path, 1), "--channel", "1"),
    Case("zarr/simple_*", read_zarr),
]


def corner_distance(a, b, dims):
    """The greatest distance of the eight outermost voxel centres under two affines, mm."""
    corners = np.array([(*c, 1.0) for c in itertools.product(*[(0, n - 1) for n in dims])])
    return float(np.linalg.norm((corners @ (a - b).T)[:, :3], axis=1).max())


def program(text):
    """The program's full path: `./name` must not be looked for in PATH."""
    found = shutil.which(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text}: no such program")
    return Path(found).absolute()


def run(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr.strip()


def unequal_voxels(ours, theirs, within=0.0):
    """How many voxels differ, 0 for none, or why they can't be compared; NaN equals NaN."""
    if ours.shape != theirs.shape:
        return f"dims {ours.shape}"
    if within:
        return int(np.count_nonzero(np.abs(ours - theirs) > within))
    different = ours != theirs
    if ours.dtype.kind == "f" and theirs.dtype.kind == "f":
        different &= ~(np.isnan(ours) & np.isnan(theirs))
    return int(np.count_nonzero(different))


def compare(brickscope, path, name, case, folder, tolerance, with_extract):
    """One file's row and whether all of it is well."""
    row = dict(file=name, dims="-", type="-", stored="-", brick="-", verify="-", voxels="-", affine="-", note="")
    row["file"] = " ".join([name, *case.options])
    if case.refused is not None:
        code, _, error = run(brickscope, "brick", path, "-o", folder / "refused.bsk", "--force", *case.options)
        row["brick"] = "refused" if code == 2 else f"exit {code}"
        row["note"] = error.replace("\n", " ")
        return row, code == 2 and case.refused in error
    try:
        theirs = case.read(path)
    except Exception as error:  # noqa: BLE001: what the library can't read is part of the table
        row["note"] = f"not read by the library: {error}"
        return row, False
    row["dims"] = ",".join(map(str, theirs.stored.shape))
    row["type"] = theirs.stored.dtype.newbyteorder("=").name
    notes = [theirs.note] if theirs.note else []
    stem = re.sub(r"[^\w.,-]+", "_", row["file"])
    store = folder / (stem + ".bsk")

    code, _, error = run(brickscope, "brick", path, "-o", store, "--force", *case.options)
    row["brick"] = "ok" if code == 0 else f"exit {code}"
    if code:
        row["note"] = error.replace("\n", " ")
        return row, False
    well = True
    code, _, error = run(brickscope, "verify", store)
    row["verify"] = "ok" if code == 0 else f"exit {code}"
    if code:
        notes.append(error)
        well = False

    code, out, error = run(brickscope, "info", store, "--json")
    if code:
        row["note"] = f"info: {error}"
        return row, False
    info = json.loads(out)
    row["stored"] = info["voxel_type"]
    affine = np.vstack([np.array(info["affine"], dtype=np.float64)[:3], [0, 0, 0, 1]])
    distances = [corner_distance(affine, theirs.affine, theirs.stored.shape)]
    if tuple(info["dims"]) != theirs.stored.shape:
        notes.append(f"info says dims {info['dims']}")
        well = False

    counts = []
    if with_extract:
        for ending, reader in ((".nii.gz", read_nifti), (".nrrd", read_itk), (".zarr", read_zarr)):
            out_file = folder / (stem + ".out" + ending)
            shutil.rmtree(out_file) if out_file.is_dir() else out_file.unlink(missing_ok=True)
            code, _, error = run(brickscope, "extract", store, "-o", out_file)
            if code:
                notes.append(f"extract {ending}: exit {code}: {error}")
                well = False
                continue
            ours = reader(out_file)
            distances.append(corner_distance(ours.affine, theirs.affine, theirs.stored.shape))
            # NRRD and OME-Zarr have no slope: such a file may hold physical values instead of stored ones.
            count = unequal_voxels(ours.stored, theirs.stored, case.within)
            physical = unequal_voxels(ours.physical, theirs.physical, case.within)
            if count != 0 and physical == 0:
                if case.read is not read_dicom:
                    notes.append(f"{ending} holds physical values ({ours.stored.dtype.name})")
                count = 0
            elif count == 0 and physical != 0 and ending == ".nii.gz":
                notes.append(f"{ending}: another rescaling")
                count = physical
            if count != 0 and ending == ".nii.gz" and np.allclose(ours.physical, theirs.physical, rtol=1e-6, atol=0):
                notes.append(".nii.gz keeps slope and intercept as f32")
                count = 0
            counts.append(count)
            if count != 0:
                notes.append(f"{ending}: {count} voxels differ")
                well = False
        row["voxels"] = "equal" if counts == [0, 0, 0] else "UNEQUAL"
    row["affine"] = f"{max(distances):.2g}"
    if not max(distances) <= tolerance:
        notes.append("affine differs: %s mm (info, files)" % " ".join(f"{d:.3g}" for d in distances))
        well = False
    row["note"] = "; ".join(notes)
    return row, well


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("brickscope", type=program, metavar="BRICKSCOPE", help="the program")
    parser.add_argument("data", type=Path, metavar="DATA", help="folder with nifti/, dicom/, tiff/ and so on")
    parser.add_argument("out", type=Path, metavar="OUT_FOLDER", help="stores and extracted files go here")
    parser.add_argument("--tolerance", type=float, default=1e-3, metavar="MM",
                        help="greatest distance of a corner under the two affines [default: %(default)s]")
    parser.add_argument("--only", default="", metavar="TEXT", help="files whose name contains this")
    parser.add_argument("--no-extract", action="store_true", help="brick, verify and info only")
    args = parser.parse_args()

    found = [(p, str(p.relative_to(args.data)), case) for case in CASES for p in sorted(args.data.glob(case.pattern))]
    found = [(p, name, case) for p, name, case in found if args.only in name]
    if not found:
        parser.error(f"{args.data}: no scans that match")
    args.out.mkdir(parents=True, exist_ok=True)

    columns = ["file", "dims", "type", "stored", "brick", "verify", "voxels", "affine", "note"]
    titles = dict(zip(columns, ["file", "dims", "type", "stored type", "brick", "verify", "voxels",
                                "affine max difference mm", "note"]))
    print("| " + " | ".join(titles[c] for c in columns) + " |")
    print("|" + " --- |" * len(columns))
    bad = 0
    for path, name, case in found:
        row, well = compare(args.brickscope, path, name, case, args.out, args.tolerance, not args.no_extract)
        bad += not well
        print("| " + " | ".join(row[c] for c in columns) + " |", flush=True)
    print(f"\n{len(found)} files, {bad} unequal")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
