"""The figures that the comparison is to show, and whether it does. All ratios are of process-CPU ms per frame."""
from dataclasses import dataclass

# Palace (a Vulkan volume renderer) on ct512, bone, when it was measured, and VTK FixedPoint beside it: process-CPU ms per
# frame. It is not run here; scaled by VTK FixedPoint then and now.
PALACE_CPU_MS, VTK_FIXED_CPU_MS_BESIDE_PALACE = 1383, 330


@dataclass(frozen=True)
class AtLeast:
    """`peer` needs `factor` times as much as ours."""
    row: str
    peer: str
    factor: float

    def judge(self, results, device):
        return ratio(results, self.row, self.peer, device)

    def met(self, value):
        return value >= self.factor


# How peers are called where a row was not run.
NAMES = {"vtk-fixed": "VTK FixedPoint", "vtk-gpu": "VTK GPU", "vtk-gpu-opaque": "VTK GPU (opaque)", "ospray": "OSPRay"}

RATIOS = (
    AtLeast("ct256-ramp", "vtk-fixed", 1.3),
    AtLeast("ct256-bone", "vtk-fixed", 2),
    AtLeast("ct256-mip", "vtk-fixed", 2),
    AtLeast("ct256-ramp", "vtk-gpu", 4),
    AtLeast("ct256-bone", "vtk-gpu", 4),
    AtLeast("ct256-bone-shaded", "vtk-gpu", 15),
    AtLeast("ct256-iso", "vtk-gpu", 25),
    AtLeast("ct256-iso", "vtk-gpu-opaque", 25),
    AtLeast("ct256-iso", "ospray", 2),
    AtLeast("ct512-bone", "vtk-fixed", 2),
    AtLeast("ct512-bone", "vtk-gpu", 8),
    AtLeast("marschner-lobb-ramp", "vtk-gpu", 1),
)


def figure(results, row, program, key):
    """A median, or None where there is none."""
    median = results.get(row, {}).get(program, {}).get("median") or {}
    return median.get(key)


def ratio(results, row, peer, device, key="cpu_ms"):
    theirs, ours = figure(results, row, peer, key), figure(results, row, device, key)
    return theirs / ours if theirs and ours else None


def palace(results, device):
    then, ours = figure(results, "ct512-bone", "vtk-fixed", "cpu_ms"), figure(results, "ct512-bone", device, "cpu_ms")
    return PALACE_CPU_MS * then / VTK_FIXED_CPU_MS_BESIDE_PALACE / ours if then and ours else None


def first_share(results, device):
    """Our first whole picture, from the start of the process, ÷ VTK FixedPoint's first frame, its volume in memory."""
    ours = figure(results, "ct1024-bone", f"{device}-first", "first_whole_ms")
    theirs = figure(results, "ct1024-bone", "vtk-fixed", "first_ms")
    return ours / theirs if ours and theirs else None


def check(results, labels, devices):
    """A list of dicts: what, wanted, and by device the figure and whether it is met (None: not measured in this run)."""
    out = []

    def add(what, wanted, value_of, met):
        by_device = {}
        for device in devices:
            value = value_of(device)
            by_device[device] = dict(value=value, met=None if value is None else met(value))
        out.append(dict(what=what, wanted=wanted, by_device=by_device))

    for target in RATIOS:
        peer = labels.get((target.row, target.peer), NAMES[target.peer])
        add(f"{target.row}: {peer} ÷ ours", f"≥ {target.factor:g}", lambda d, t=target: t.judge(results, d), target.met)
    add("ct512-bone: Palace (old figure, scaled) ÷ ours", "≥ 6", lambda d: palace(results, d), lambda v: v >= 6)
    add("ct1024-bone: our first whole picture from process start ÷ VTK FixedPoint's first frame", "≤ 0.1",
        lambda d: first_share(results, d), lambda v: v <= 0.1)
    add("ct1024-bone: our peak RSS, MiB", "≤ 700", lambda d: figure(results, "ct1024-bone", d, "rss_peak_mib"),
        lambda v: v <= 700)
    add("ct256-bone: samples ÷ (time × rate of the bare kernel)", "≥ 0.5",
        lambda d: figure(results, "ct256-bone", f"{d}-ceiling", "efficiency"), lambda v: v >= 0.5)
    add("ct1024-bone: edit of the transfer function to the next whole picture, less the render itself, ms", "≤ 150",
        lambda d: figure(results, "ct1024-bone", f"{d}-edit", "over_render_ms"), lambda v: v <= 150)
    add("ct1024: bricking ÷ the machine's ceiling (disk, zstd -1 × cores)", "≥ 0.6",
        lambda d: figure(results, "ct1024-bone", "brick", "of_plain_ceiling"), lambda v: v >= 0.6)
    return out
