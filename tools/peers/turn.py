"""A measured turn of the camera: what the peers' programs have in common. One configuration a process, one JSON line."""
import argparse
import json
import os
import resource
import statistics
import time
from pathlib import Path

import numpy as np

import scene


def arguments(description, modes):
    """The parser of a peer's program."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("volume", type=scene.read_volume, metavar="VOLUME.nhdr", help="made by volumes.py")
    parser.add_argument("--mode", choices=modes, required=True)
    parser.add_argument("--size", type=int, default=512, help="pixels, both ways [default: %(default)s]")
    parser.add_argument("--step", type=float, default=1.0, help="voxels [default: %(default)s]")
    parser.add_argument("--frames", type=int, default=scene.TURN, help="of a whole turn [default: %(default)s]")
    parser.add_argument("--png", type=Path, help=f"write the view at {360 * scene.PICTURE_FRAME // scene.TURN}° here")
    return parser


class Clock:
    """Milliseconds since it was made."""

    def __init__(self):
        self.start = time.perf_counter()

    def ms(self):
        return (time.perf_counter() - self.start) * 1e3


def voxels(volume):
    """All voxels as one row, and the ms that reading them took."""
    clock = Clock()
    array = np.fromfile(volume.raw, dtype=np.dtype(volume.voxel_type).newbyteorder("<"))
    return array, clock.ms()


def resident_mib():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def cpu_seconds():
    """User and system time of all threads: steadier than wall time on a machine that others use, too."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def measure(draw, frames):
    """Draws a turn by `draw(azimuth)`, which has drawn its first frame already; what a frame took."""
    cpu, wall = cpu_seconds(), []
    for i in range(frames):
        clock = Clock()
        draw(scene.azimuth(i, frames))
        wall.append(clock.ms())
    cpu_ms = (cpu_seconds() - cpu) / frames * 1e3
    return dict(
        median_ms=round(statistics.median(wall), 2), min_ms=round(min(wall), 2),
        p90_ms=round(float(np.percentile(wall, 90)), 2), cpu_ms=round(cpu_ms, 1), frames=frames,
        rss_peak_mib=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))


def report(args, **values):
    print(json.dumps(dict(vol=args.volume.name, mode=args.mode, size=args.size, step=args.step, **values)), flush=True)
