#!/usr/bin/env python3
"""Compares what brickscope reads with what nibabel and SimpleITK read.

Every scan under DATA in a format that is built (nifti/*.nii.gz, nifti/orientations/*, nrrd/*, metaimage/*,
labels/*.nii.gz) is bricked, verified, and extracted to .nii.gz and .nrrd. Voxels must be equal exactly, as stored
and after rescaling; the affine (voxel to world, RAS+ mm) must agree within --tolerance mm over the whole volume: the
figure is the greatest distance, over the eight corners, between where the two affines put them.

The outside reading of NIfTI is nibabel's (best affine; a file without sform and qform gets its spacings, as cli.md
has it), that of NRRD and MetaImage is SimpleITK's (LPS turned to RAS; an NRRD without `space` gets its spacings). The
files that brickscope writes are read by the same two.

One row per file; exit code 1 if anything is unequal, 2 for bad usage.

Needs: pip install numpy nibabel SimpleITK
"""
import argparse
import itertools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import nibabel
import numpy as np
import SimpleITK as sitk

PATTERNS = [
    "nifti/*.nii.gz", "nifti/orientations/*.nii.gz", "nrrd/*.nhdr", "nrrd/*.nrrd", "metaimage/*.mha",
    "metaimage/*.mhd", "labels/*.nii.gz",
]
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


def read_outside(path):
    return read_nifti(path) if path.name.endswith((".nii", ".nii.gz")) else read_itk(path)


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


def unequal_voxels(ours, theirs):
    """How many voxels differ, 0 for none, or why they can't be compared; NaN equals NaN."""
    if ours.shape != theirs.shape:
        return f"dims {ours.shape}"
    different = ours != theirs
    if ours.dtype.kind == "f" and theirs.dtype.kind == "f":
        different &= ~(np.isnan(ours) & np.isnan(theirs))
    return int(np.count_nonzero(different))


def compare(brickscope, path, name, folder, tolerance, with_extract):
    """One file's row and whether all of it is well."""
    row = dict(file=name, dims="-", type="-", stored="-", brick="-", verify="-", voxels="-", affine="-", note="")
    try:
        theirs = read_outside(path)
    except Exception as error:  # noqa: BLE001: what the library can't read is part of the table
        row["note"] = f"not read by the library: {error}"
        return row, False
    row["dims"] = ",".join(map(str, theirs.stored.shape))
    row["type"] = theirs.stored.dtype.newbyteorder("=").name
    notes = [theirs.note] if theirs.note else []
    store = folder / (name.replace("/", "_") + ".bsk")

    code, _, error = run(brickscope, "brick", path, "-o", store, "--force")
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
        for ending, reader in ((".nii.gz", read_nifti), (".nrrd", read_itk)):
            out_file = folder / (name.replace("/", "_") + ".out" + ending)
            out_file.unlink(missing_ok=True)
            code, _, error = run(brickscope, "extract", store, "-o", out_file)
            if code:
                notes.append(f"extract {ending}: exit {code}: {error}")
                well = False
                continue
            ours = reader(out_file)
            distances.append(corner_distance(ours.affine, theirs.affine, theirs.stored.shape))
            # NRRD has no slope: such a file may hold physical values instead of stored ones.
            count, physical = unequal_voxels(ours.stored, theirs.stored), unequal_voxels(ours.physical, theirs.physical)
            if count != 0 and physical == 0:
                notes.append(f"{ending} holds physical values ({ours.stored.dtype.name})")
                count = 0
            elif count == 0 and physical != 0 and ending == ".nii.gz":
                notes.append(f"{ending}: another rescaling")
                count = physical
            counts.append(count)
            if count != 0:
                notes.append(f"{ending}: {count} voxels differ")
                well = False
        row["voxels"] = "equal" if counts == [0, 0] else "UNEQUAL"
    row["affine"] = f"{max(distances):.2g}"
    if not max(distances) <= tolerance:
        notes.append("affine differs: %s mm (info, files)" % " ".join(f"{d:.3g}" for d in distances))
        well = False
    row["note"] = "; ".join(notes)
    return row, well


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("brickscope", type=program, metavar="BRICKSCOPE", help="the program")
    parser.add_argument("data", type=Path, metavar="DATA", help="folder with nifti/, nrrd/, metaimage/, labels/")
    parser.add_argument("out", type=Path, metavar="OUT_FOLDER", help="stores and extracted files go here")
    parser.add_argument("--tolerance", type=float, default=1e-3, metavar="MM",
                        help="greatest distance of a corner under the two affines [default: %(default)s]")
    parser.add_argument("--only", default="", metavar="TEXT", help="files whose name contains this")
    parser.add_argument("--no-extract", action="store_true", help="brick, verify and info only")
    args = parser.parse_args()

    found = [(p, str(p.relative_to(args.data))) for pattern in PATTERNS for p in sorted(args.data.glob(pattern))]
    found = [(p, name) for p, name in found if args.only in name]
    if not found:
        parser.error(f"{args.data}: no scans that match")
    args.out.mkdir(parents=True, exist_ok=True)

    columns = ["file", "dims", "type", "stored", "brick", "verify", "voxels", "affine", "note"]
    titles = dict(zip(columns, ["file", "dims", "type", "stored type", "brick", "verify", "voxels",
                                "affine max difference mm", "note"]))
    print("| " + " | ".join(titles[c] for c in columns) + " |")
    print("|" + " --- |" * len(columns))
    bad = 0
    for path, name in found:
        row, well = compare(args.brickscope, path, name, args.out, args.tolerance, not args.no_extract)
        bad += not well
        print("| " + " | ".join(row[c] for c in columns) + " |", flush=True)
    print(f"\n{len(found)} files, {bad} unequal")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
