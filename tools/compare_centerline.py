#!/usr/bin/env python3
"""Compares the centre-line of `brickscope path` with two that other programs' methods give: an outside opinion.

FILE is bricked and `path` is run with --from, --to and --lumen. The flight (the centripetal Catmull-Rom curve through the
path's key frames) is then held against
- the voxels: the share of it, at every quarter voxel, that lies in voxels of the lumen, or in specks of at most 64 voxels
  that it encloses (noise), which count as lumen for all;
- `spheres`: the centre-line of maximum inscribed spheres as VMTK defines it (Antiga, Ene-Iordache, Remuzzi 2003): Voronoi
  diagram of the lumen's surface (marching cubes of the mask, smoothed by 0.7 voxel), its vertices inside the lumen as graph,
  the way of least ∫ds/R between the vertices next to the two ends; R is the distance to the surface;
- `skeleton`: the thinned mask (Lee, Kashyap, Chu 1994; scikit-image), the shortest way along it.
For each: mean and greatest distance of our line's points to theirs and of theirs to ours, in millimetres and in voxels (the
smallest spacing), theirs without what lies beyond our ends. Exit code 1 if the flight leaves the lumen, or the mean distance
to `spheres` is above 1.5 voxels.

For the stented aorta (aorta-label.nii.gz, from the descending aorta over the arch to the root):
  tools/compare_centerline.py target/release/brickscope aorta-label.nii.gz OUT_FOLDER --lumen 0.5,1.5 \\
      --from=-0.342,140.158,541.7 --to=-7.842,188.158,669.2

For a chest CT, from the trachea to a bronchus (air, HU):
  … chest.nii.gz OUT_FOLDER --lumen=-1024,-900 --from=13.5,-118.5,-411.8 --to=-26.2,-190.4,-549.8

Needs: pip install numpy nibabel scipy scikit-image
"""
import argparse
import json
import subprocess
import sys
from pathlib import Path

import nibabel
import numpy as np
from scipy import ndimage, sparse
from scipy.spatial import Voronoi, cKDTree
from skimage.measure import marching_cubes
from skimage.morphology import skeletonize

BOUND_VOXELS = 1.5
MOST_SPECK = 64


def triple(text):
    values = [float(v) for v in text.split(",")]
    if len(values) != 3:
        raise argparse.ArgumentTypeError(f"{text}: expected x,y,z")
    return np.array(values)


def flight(keys, step):
    """Points of the centripetal Catmull-Rom curve through `keys`, at most `step` apart (Barry and Goldman's pyramid)."""
    p = np.vstack([2 * keys[0] - keys[1], keys, 2 * keys[-1] - keys[-2]])
    out = []
    for a, b, c, d in zip(p, p[1:], p[2:], p[3:]):
        t = np.cumsum([0, *(np.sqrt(np.linalg.norm(v - u)) for u, v in ((a, b), (b, c), (c, d)))])
        s = np.linspace(t[1], t[2], int(np.ceil(1.2 * np.linalg.norm(c - b) / step)) + 1)[:-1, None]

        def mix(u, v, i, j):
            return ((t[j] - s) * u + (s - t[i]) * v) / (t[j] - t[i])
        ab, bc, cd = mix(a, b, 0, 1), mix(b, c, 1, 2), mix(c, d, 2, 3)
        out.append(mix(mix(ab, bc, 0, 2), mix(bc, cd, 1, 3), 1, 2))
    return np.vstack([*out, keys[-1:]])


def transform(affine, points):
    return points @ affine[:3, :3].T + affine[:3, 3]


def shortest(points, edges, costs, start, end):
    n = len(points)
    graph = sparse.coo_matrix((costs, (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    _, before = sparse.csgraph.dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    way = [end]
    while way[-1] != start:
        if before[way[-1]] < 0:
            raise SystemExit("the reference's graph is not connected between the ends")
        way.append(before[way[-1]])
    return points[way[::-1]]


def spheres(mask, affine, ends):
    """Centre-line of maximum inscribed spheres on the Voronoi diagram of the surface."""
    soft = ndimage.gaussian_filter(np.pad(mask, 2).astype(np.float32), 0.7)
    vertices, *_ = marching_cubes(soft, 0.5)
    surface = transform(affine, vertices - 2)
    diagram = Voronoi(surface)
    index = np.rint(transform(np.linalg.inv(affine), diagram.vertices)).astype(int)
    inside = ((index >= 0) & (index < mask.shape)).all(axis=1)
    inside[inside] = mask[tuple(index[inside].T)]
    edges = np.vstack([np.column_stack([ring, np.roll(ring, 1)]) for ring in diagram.ridge_vertices if -1 not in ring])
    edges = np.unique(np.sort(edges[inside[edges].all(axis=1)], axis=1), axis=0)
    points = diagram.vertices
    radius, _ = cKDTree(surface).query(points)
    a, b = edges.T
    costs = np.linalg.norm(points[a] - points[b], axis=1) * 2 / (radius[a] + radius[b])
    # The largest sphere near each end, as VMTK takes the poles of the seeds.
    inner = np.unique(edges)
    tree = cKDTree(points[inner])

    def pole(end):
        _, near = tree.query(end, k=50)
        return inner[near[np.argmax(radius[inner[near]])]]
    return shortest(points, edges, np.maximum(costs, 1e-12), pole(ends[0]), pole(ends[1]))


def skeleton(mask, affine, ends):
    """The shortest way along the thinned mask."""
    voxels = np.argwhere(skeletonize(mask))
    points = transform(affine, voxels)
    edges = cKDTree(voxels).query_pairs(1.8, output_type="ndarray")
    costs = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    _, near = cKDTree(points).query(ends)
    return shortest(points, edges, costs, *near)


def dense(line, step):
    parts = [np.linspace(a, b, int(np.ceil(np.linalg.norm(b - a) / step)) + 1)[:-1] for a, b in zip(line, line[1:])]
    return np.vstack([*parts, line[-1:]])


def distances(points, line):
    """Distance of each point to a line, without points that are beyond the line's ends."""
    d, near = cKDTree(line).query(points)
    return d[(near > 0) & (near < len(line) - 1)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("brickscope", type=lambda t: Path(t).absolute(), metavar="BRICKSCOPE", help="the program")
    parser.add_argument("file", type=Path, metavar="FILE", help="a NIfTI volume")
    parser.add_argument("out", type=Path, metavar="OUT_FOLDER", help="store and path go here")
    parser.add_argument("--lumen", required=True, metavar="LOW,HIGH")
    parser.add_argument("--from", dest="start", type=triple, required=True, metavar="x,y,z")
    parser.add_argument("--to", dest="end", type=triple, required=True, metavar="x,y,z")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    store, path = args.out / "volume.bsk", args.out / "path.json"
    subprocess.run([args.brickscope, "brick", args.file, "-o", store, "--force"], check=True, stdout=subprocess.DEVNULL)
    seeds = [f"--{name}=" + ",".join(map(str, v)) for name, v in (("from", args.start), ("to", args.end))]
    done = subprocess.run([args.brickscope, "path", store, *seeds, f"--lumen={args.lumen}", "-o", path, "--json"],
                          check=True, stdout=subprocess.PIPE, text=True)
    print(done.stdout.strip())
    image = nibabel.load(args.file)
    low, high = map(float, args.lumen.split(","))
    values = image.get_fdata()
    mask = (values >= low) & (values <= high)
    labels, _ = ndimage.label(mask)
    seed = tuple(np.rint(transform(np.linalg.inv(image.affine), args.start)).astype(int))
    mask = labels == labels[seed]
    specks = ndimage.binary_fill_holes(mask) & ~mask
    groups, _ = ndimage.label(specks)
    mask |= specks & (np.bincount(groups.ravel())[groups] <= MOST_SPECK)
    voxel = float(np.linalg.norm(image.affine[:3, :3], axis=0).min())
    keys = np.array([k["eye"] for k in json.loads(path.read_text())["keys"]])
    ours = flight(keys, voxel / 4)
    index = np.rint(transform(np.linalg.inv(image.affine), ours)).astype(int)
    inside = float(mask[tuple(index.T)].mean())
    print(f"inside the lumen: {inside * 100:.2f} % of {len(ours)} points")
    bad = inside < 1
    print("| reference | ours to it: mean | max | it to ours: mean | max | length, ours |")
    for name, make in (("spheres", spheres), ("skeleton", skeleton)):
        line = dense(make(mask, image.affine, ours[[0, -1]]), voxel / 4)
        there, back = distances(ours, line), distances(line, ours)
        length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        own = np.linalg.norm(np.diff(ours, axis=0), axis=1).sum()
        cells = [f"{v:.2f} mm ({v / voxel:.2f} voxels)" for v in (there.mean(), there.max(), back.mean(), back.max())]
        print(f"| {name} | {' | '.join(cells)} | {length:.1f}, {own:.1f} mm |")
        bad |= name == "spheres" and there.mean() > BOUND_VOXELS * voxel
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
