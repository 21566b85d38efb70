#!/usr/bin/env python3
"""Makes the volumes of the comparison.

ct256 (256³, u8), ct512 (512³, u16), ct1024 (1024³, u16, 2 GiB): a CT-like torso, analytic in the unit cube, so that every
size shows the same object; a noise of the voxel's index in tissue only, air is exactly 0. In fractions of full scale (255 or
4095): lung .08, fat .25, muscle .35, organs .42 to .50, contrast vessels .62, bone .70 to .95. marschner-lobb (128³, u8): the
Marschner–Lobb signal, nowhere empty. Each is NAME.nhdr and NAME.raw, x fastest, little-endian, spacing 1.

The header says RAS: peers know no orientation and take indices as world, and so do we.
"""
import argparse
import hashlib
import os
import sys
from pathlib import Path

import numpy as np

# The first 16 digits of the voxels' SHA-256: another numpy does not give other voxels unseen.
VOLUMES = {
    "ct256": (256, "uint8", "427c928caf206431"),
    "ct512": (512, "uint16", "b3560552b8a0335f"),
    "ct1024": (1024, "uint16", "6f0fa166e5e04973"),
    "marschner-lobb": (128, "uint8", "15c2e360444bbe24"),
}


def ellipsoid(x, y, z, centre, radii):
    """Below 1 inside."""
    return sum(((p - c) / r) ** 2 for p, c, r in zip((x, y, z), centre, radii))


def hash_noise(n, k):
    """[-1, 1) for each voxel of slice k: an integer hash of its index, no state."""
    with np.errstate(over="ignore"):
        i = np.arange(n * n, dtype=np.uint64) + np.uint64(k) * np.uint64(n * n)
        for _ in range(2):
            i = (i ^ (i >> np.uint64(16))) * np.uint64(0x45D9F3B)
            i &= np.uint64(0xFFFFFFFF)
        i ^= i >> np.uint64(16)
        return ((i & np.uint64(0xFFFF)).astype(np.float32) / 32768.0 - 1.0).reshape(n, n)


def ct_slice(n, k):
    """Slice k of the torso, [0, 1]. Later parts replace earlier ones."""
    f = np.float32
    axis = (np.arange(n, dtype=f) + f(0.5)) / f(n)
    # x is right to left, y front to back, z feet to head.
    x, y, z = axis[None, :], axis[:, None], f((k + 0.5) / n)
    v = np.zeros((n, n), f)

    # The trunk: an elliptic column whose width changes slowly.
    width, depth = 0.40 + 0.04 * np.cos(6.2831853 * z * 1.5), 0.28 + 0.03 * np.sin(6.2831853 * z)
    trunk = np.sqrt(((x - 0.5) / width) ** 2 + ((y - 0.5) / depth) ** 2)
    if not 0.03 < z < 0.97:
        trunk = np.full((n, n), 9.0, f)
    v[trunk < 1.0] = 0.25
    v[trunk < 0.92] = 0.35

    # Lungs, each with seven winding vessels.
    for cx in (0.33, 0.67):
        lung = ellipsoid(x, y, z, (cx, 0.47, 0.68), (0.13, 0.17, 0.22))
        v[lung < 1] = 0.08
        for j in range(7):
            px = cx + 0.10 * np.sin(7 * z + j * 0.9) * (0.3 + 0.1 * j)
            py = 0.47 + 0.12 * np.cos(9 * z + j * 1.7) * (0.3 + 0.1 * j)
            vessel = ((x - px) ** 2 + (y - py) ** 2) < (0.0045 + 0.0006 * (j % 3)) ** 2
            v[vessel & (lung < 1)] = 0.45

    # Heart, liver, kidneys.
    v[ellipsoid(x, y, z, (0.46, 0.40, 0.60), (0.09, 0.09, 0.10)) < 1] = 0.48
    v[ellipsoid(x, y, z, (0.38, 0.48, 0.33), (0.20, 0.16, 0.12)) < 1] = 0.42
    for cx in (0.36, 0.64):
        kidney = ellipsoid(x, y, z, (cx, 0.62, 0.24), (0.055, 0.045, 0.09))
        v[kidney < 1] = 0.50
        v[kidney < 0.25] = 0.30

    # The aorta with contrast, and ten branches in turn to either side.
    if 0.06 < z < 0.80:
        v[((x - 0.53) ** 2 + (y - 0.60) ** 2) < 0.017**2] = 0.62
    for j in range(10):
        side = 1 if j % 2 else -1
        cz = 0.12 + 0.07 * j + 0.35 * np.abs(x - 0.53)
        cy = 0.60 - 0.5 * (x - 0.53) ** 2
        branch = ((z - cz) ** 2 + (y - cy) ** 2) < 0.0055**2
        v[branch & (side * (x - 0.53) > 0) & (trunk < 0.84)] = 0.62

    # Slanted ribs; spine of vertebrae and discs; pelvis.
    phase = (z * 14 + 1.5 * (y - 0.5)) % 1.0
    v[(np.abs(trunk - 0.86) < 0.018) & (phase < 0.45) & (z > 0.35) & (z < 0.92)] = 0.80
    spine = np.sqrt((x - 0.5) ** 2 + (y - 0.69) ** 2)
    is_vertebra = ((z * 22) % 1.0) < 0.72
    if 0.05 < z < 0.95:
        v[spine < 0.045] = 0.70 if is_vertebra else 0.38
        v[(spine < 0.045) & (spine > 0.034)] = 0.92 if is_vertebra else 0.38
        v[(np.abs(x - 0.5) < 0.010) & (y > 0.69) & (y < 0.775)] = 0.80 if is_vertebra else 0.35
        v[spine < 0.012] = 0.33
    pelvis = ellipsoid(x, y, z, (0.5, 0.54, 0.14), (0.30, 0.20, 0.10))
    v[(np.abs(np.sqrt(pelvis) - 0.9) < 0.05) & (y > 0.47) & (trunk < 0.88)] = 0.85

    # Arms beside the trunk, with bone and marrow.
    for cx in (0.055, 0.945):
        arm = np.sqrt((x - cx - 0.01 * np.sin(5 * z)) ** 2 + (y - 0.52) ** 2)
        if 0.2 < z < 0.95:
            v[arm < 0.04] = 0.32
            v[arm < 0.016] = 0.90
            v[arm < 0.009] = 0.45

    tissue = v > 0
    v[tissue] += 0.02 * hash_noise(n, k)[tissue]
    return np.clip(v, 0, 1)


def marschner_lobb_slice(n, k):
    """Slice k of the signal, [0, 1]."""
    axis = np.linspace(-1, 1, n, dtype=np.float64)
    frequency, alpha = 6.0, 0.25
    y, x = np.meshgrid(axis, axis, indexing="ij")
    rho = np.cos(2 * np.pi * frequency * np.cos(np.pi * np.sqrt(x * x + y * y) / 2))
    return (1 - np.sin(np.pi * axis[k] / 2) + alpha * (1 + rho)) / (2 * (1 + alpha))


def make(folder, name):
    """Writes NAME.raw, then NAME.nhdr; says so when the voxels are not those of other machines."""
    n, voxel_type, expected = VOLUMES[name]
    slice_of, scale = (marschner_lobb_slice, 255) if name == "marschner-lobb" else (ct_slice, 255 if n <= 256 else 4095)
    dtype = {"uint8": "<u1", "uint16": "<u2"}[voxel_type]
    digest = hashlib.sha256()
    with open(folder / f"{name}.raw", "wb") as out:
        for k in range(n):
            voxels = np.rint(slice_of(n, k) * scale).astype(dtype).tobytes()
            digest.update(voxels)
            out.write(voxels)
    found = digest.hexdigest()[: len(expected)]
    if found != expected:
        print(f"warning: {folder / name}.raw: expected voxels with SHA-256 {expected}…, made {found}…: this numpy or processor "
              "rounds otherwise; compare figures within this run only", file=sys.stderr)
    # Last, so that its presence says that the volume is whole.
    part = folder / f"{name}.nhdr.part"
    part.write_text(
        f"NRRD0004\ntype: {voxel_type}\ndimension: 3\nspace: right-anterior-superior\nsizes: {n} {n} {n}\n"
        f"space directions: (1,0,0) (0,1,0) (0,0,1)\nkinds: domain domain domain\nendian: little\nencoding: raw\n"
        f"space origin: (0,0,0)\ndata file: {name}.raw\n", encoding="ascii")
    os.replace(part, folder / f"{name}.nhdr")
    print(f"{name}: {n}³ {voxel_type}, SHA-256 {found}…", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="+", choices=VOLUMES, metavar="NAME", help=", ".join(VOLUMES))
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    for name in args.names:
        make(args.folder, name)


if __name__ == "__main__":
    main()
