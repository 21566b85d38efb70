#!/usr/bin/env python3
"""Compares brickscope's pictures and times with those of VTK's GPU volume mapper: an outside opinion.

Pictures: AVM, engine, aorta-ct and tooth under DATA, DVR unshaded and MIP, 512 × 512, brickscope's default orbit turned
to --orbit, the same piecewise linear transfer function, a step of a quarter of the smallest spacing. For each: mean
absolute difference × 255 over the pixels where either is not background, the greatest one, the share of pixels off by
more than 8/255; how the silhouettes lie to each other: edges of what is more than 16/255 off the background, stray pixels
(clearly shown in one picture, nothing within one pixel in the other), and by how many pixels ours must be moved to lie
best on VTK's. OUT_FOLDER gets NAME-MODE.png (ours | VTK | 8 × difference).
Exit code 1 if a mean is above 2/255, there is a stray pixel, or the shift is above half a pixel.

What differs by design, so that no picture is equal to the last bit:
- the first sample: VTK's lies one step behind the box's face, ours on a grid of distances from the eye: seen where
  something dense is cut by the volume's face or is as thin as a voxel (gone with --step 0.05);
- VTK ends a ray at opacity 1 − 1/255, brickscope here at .9999;
- VTK's tables: 1024 or more 32-bit entries over the data's range, read with the texture unit's filter; opacities up to
  .0001 are not corrected for the step. Ours: 4096 entries over the function's range;
- VTK writes 8 bits and blends over 8 bits, we round once.
VTK gets the physical values as 32-bit floats here (its 8- and 16-bit textures are filtered with fewer bits by some
drivers), and the voxels as they are stored in the timings.

Times (--times N): VTK's is the wall time of Render and WaitForCompletion, the volume on the adapter, the camera turned by
2° for each frame. Ours is from `render --stats`, one process a frame: `passes` is the sum of passes_ms (what drawing
took on the adapter, the bricks there), `wall` is wall_ms (with reading, decompressing and uploading the bricks, making
tables, mesh and pipelines, and reading the picture back; no process start). Step 1, 512 × 512, median of N; the two take
turns; iso-surfaces are opaque in both. VTK's `first` (upload, shader build, first picture) is the nearest to our `wall`.

Needs: pip install numpy nibabel SimpleITK vtk pillow; an adapter whose name holds --device for brickscope, and one for
VTK: without a display VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow, which is set here when there is no DISPLAY.
"""
import argparse
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

if not os.environ.get("DISPLAY"):
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import numpy as np
from PIL import Image
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkCommonMath import vtkMatrix3x3
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction, vtkRenderer, vtkRenderWindow, vtkVolume, vtkVolumeProperty, vtkWindowToImageFilter,
)
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401: registers the window
from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

from compare_readers import program, read_outside

SIZE = 512
FOV = 30.0
BACKGROUND = (0.10, 0.15, 0.25)
STEP = 0.25

# Opacity: x, opacity. Colour: x, r, g, b. Physical values (HU for CT). Iso: the surface of the timings.
SCANS = {
    "AVM": dict(
        file="nifti/AVM.nii.gz", orbit=(30, 15), iso=250,
        opacity=[(0, 0), (80, 0), (150, 0.02), (250, 0.15), (350, 0.5), (563, 0.9)],
        color=[(0, 0, 0, 0.2), (100, 0.2, 0.1, 0.5), (200, 0.9, 0.3, 0.2), (350, 1, 0.8, 0.3), (563, 1, 1, 1)]),
    "engine": dict(
        file="nifti/engine.nii.gz", orbit=(30, 15), iso=100,
        opacity=[(0, 0), (50, 0), (80, 0.02), (150, 0.04), (190, 0.3), (255, 0.9)],
        color=[(0, 0, 0, 0), (80, 0.2, 0.4, 0.9), (160, 0.3, 0.9, 0.6), (200, 1, 0.7, 0.1), (255, 1, 1, 0.9)]),
    "aorta-ct": dict(
        file="labels/aorta-ct.nii.gz", orbit=(30, 15), iso=250,
        opacity=[(-1024, 0), (-50, 0), (60, 0.02), (150, 0.05), (300, 0.4), (800, 0.8), (1500, 1)],
        color=[(-200, 0.3, 0.1, 0.1), (60, 0.8, 0.4, 0.3), (200, 0.9, 0.2, 0.2), (400, 1, 0.9, 0.7), (1500, 0.9, 1, 1)]),
    "tooth": dict(
        file="nrrd/tooth.nhdr", orbit=(30, 15), iso=700,
        opacity=[(0, 0), (450, 0), (600, 0.03), (750, 0.02), (900, 0.2), (1300, 0.7)],
        color=[(0, 0, 0, 0), (500, 0.6, 0.3, 0.1), (750, 0.9, 0.7, 0.4), (950, 0.5, 0.8, 1), (1300, 1, 1, 1)]),
}


# ---- the same camera -------------------------------------------------------------------------------------------------

def orbit_camera(affine, dims, azimuth, elevation):
    """Eye and target of cli.md's orbit (zoom 1): the box between the centres of the outermost voxels."""
    last = [(0, n - 1) for n in dims]
    corners = np.array([(x, y, z, 1.0) for x in last[0] for y in last[1] for z in last[2]]) @ affine.T
    corners = corners[:, :3]
    centre = corners.mean(axis=0)
    radius = np.linalg.norm(corners - centre, axis=1).max()
    az, el = math.radians(azimuth), math.radians(elevation)
    toward = np.array([-math.sin(az) * math.cos(el), math.cos(az) * math.cos(el), math.sin(el)])
    return centre + toward * radius / math.sin(math.radians(FOV) / 2), centre


# ---- VTK -------------------------------------------------------------------------------------------------------------

class VtkScene:
    """One volume in an off-screen window."""

    def __init__(self, voxels, affine, background=BACKGROUND):
        spacing = np.linalg.norm(affine[:3, :3], axis=0)
        direction = affine[:3, :3] / spacing
        if np.abs(direction.T @ direction - np.eye(3)).max() > 1e-5:
            sys.exit("a sheared affine: VTK images can't have one")
        self.spacing = spacing
        image = vtkImageData()
        image.SetDimensions(*voxels.shape)
        image.SetSpacing(*spacing)
        image.SetOrigin(*affine[:3, 3])
        matrix = vtkMatrix3x3()
        matrix.DeepCopy(direction.flatten().tolist())
        image.SetDirectionMatrix(matrix)
        self.flat = np.ascontiguousarray(voxels.flatten(order="F"))
        image.GetPointData().SetScalars(numpy_to_vtk(self.flat, deep=0))

        mapper = vtkOpenGLGPUVolumeRayCastMapper()
        mapper.SetUseJittering(0)
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.LockSampleDistanceToInputSpacingOff()
        mapper.SetImageSampleDistance(1.0)
        mapper.SetMaxMemoryInBytes(16 << 30)
        mapper.SetMaxMemoryFraction(1.0)
        mapper.SetInputData(image)
        self.mapper = mapper

        volume = vtkVolume()
        volume.SetMapper(mapper)
        self.volume = volume
        renderer = vtkRenderer()
        renderer.SetBackground(*background)
        renderer.AddVolume(volume)
        self.renderer = renderer
        window = vtkRenderWindow()
        window.SetOffScreenRendering(1)
        window.SetMultiSamples(0)
        window.SetSize(SIZE, SIZE)
        window.SetDesiredUpdateRate(0.0001)
        window.AddRenderer(renderer)
        self.window = window

    def set_mode(self, mode, opacity, color, step_mm, unit_mm, shaded=False, iso=None):
        prop = vtkVolumeProperty()
        opacities, colors = vtkPiecewiseFunction(), vtkColorTransferFunction()
        for x, a in opacity:
            # VTK's iso-surfaces have the opacity of the function at their value: translucent ones would not end a ray.
            opacities.AddPoint(x, 1.0 if mode == "iso" else a)
        colors.SetColorSpaceToRGB()
        for point in color:
            colors.AddRGBPoint(*point)
        prop.SetScalarOpacity(opacities)
        prop.SetColor(colors)
        prop.SetInterpolationTypeToLinear()
        prop.SetScalarOpacityUnitDistance(unit_mm)
        prop.SetShade(1 if shaded or mode == "iso" else 0)
        self.mapper.SetSampleDistance(step_mm)
        if mode == "mip":
            self.mapper.SetBlendModeToMaximumIntensity()
        elif mode == "iso":
            self.mapper.SetBlendModeToIsoSurface()
            prop.GetIsoSurfaceValues().SetValue(0, iso)
        else:
            self.mapper.SetBlendModeToComposite()
        self.volume.SetProperty(prop)

    def draw(self, eye, target):
        """Draws one frame; ms."""
        start = time.perf_counter()
        camera = self.renderer.GetActiveCamera()
        camera.SetViewAngle(FOV)
        camera.SetPosition(*eye)
        camera.SetFocalPoint(*target)
        camera.SetViewUp(0, 0, 1)
        self.renderer.ResetCameraClippingRange()
        self.window.Render()
        self.window.WaitForCompletion()
        return (time.perf_counter() - start) * 1e3

    def picture(self):
        grab = vtkWindowToImageFilter()
        grab.SetInput(self.window)
        grab.ReadFrontBufferOff()
        grab.ShouldRerenderOff()
        grab.Update()
        out = grab.GetOutput()
        pixels = vtk_to_numpy(out.GetPointData().GetScalars()).reshape(SIZE, SIZE, -1)[::-1, :, :3]
        return pixels.astype(np.float64) / 255


# ---- brickscope ------------------------------------------------------------------------------------------------------

def call(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\nexit {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def write_function(path, name, opacity, color):
    path.write_text(json.dumps([{
        "Name": name,
        "ColorSpace": "RGB",
        "RGBPoints": [float(v) for point in color for v in point],
        "Points": [float(v) for x, a in opacity for v in (x, a, 0.5, 0.0)],
    }], indent=1))


def render(args, store, out, *options):
    """One picture of brickscope's and what it took."""
    stats = out.with_suffix(".json")
    call(args.brickscope, "render", store, "-o", out, "--size", f"{SIZE}x{SIZE}", "--device", args.device,
         "--background", ",".join(map(str, BACKGROUND)), "--stats", stats, *options)
    return np.asarray(Image.open(out).convert("RGB")).astype(np.float64) / 255, json.loads(stats.read_text())


# ---- how alike -------------------------------------------------------------------------------------------------------

def not_background(picture, threshold):
    return np.abs(picture - np.round(np.array(BACKGROUND) * 255) / 255).max(axis=2) > threshold


def edges(mask):
    """Left, right, top, bottom of what is set."""
    ys, xs = np.nonzero(mask)
    return np.array([xs.min(), xs.max(), ys.min(), ys.max()])


def widened(mask):
    """The mask and the eight neighbours of each of its pixels."""
    out = np.zeros_like(mask)
    padded = np.pad(mask, 1)
    for dy in range(3):
        for dx in range(3):
            out |= padded[dy:dy + SIZE, dx:dx + SIZE]
    return out


def stray_pixels(ours, theirs):
    """Pixels clearly shown in one picture with nothing at all in the other within one pixel."""
    a, b = not_background(ours, 8 / 255), not_background(theirs, 8 / 255)
    reach_a, reach_b = widened(not_background(ours, 0.5 / 255)), widened(not_background(theirs, 0.5 / 255))
    return np.count_nonzero(a & ~reach_b) + np.count_nonzero(b & ~reach_a)


def best_shift(ours, theirs):
    """By how many pixels (x, y) ours must be moved to lie best on theirs: an integer and a parabola through three."""
    def cost(dx, dy):
        moved = np.roll(ours, (dy, dx), axis=(0, 1))
        return float(((moved - theirs) ** 2)[8:-8, 8:-8].mean())
    costs = {(dx, dy): cost(dx, dy) for dx in range(-4, 5) for dy in range(-4, 5)}
    x, y = min(costs, key=costs.get)

    def between(a, b, c):
        return 0.0 if a - 2 * b + c == 0 else 0.5 * (a - c) / (a - 2 * b + c)
    fx = between(cost(x - 1, y), costs[x, y], cost(x + 1, y))
    fy = between(cost(x, y - 1), costs[x, y], cost(x, y + 1))
    return x + fx, y + fy


def compare_pictures(args):
    print(f"\n## Pictures: brickscope ({args.device}) and VTK {vtkVersion.GetVTKVersion()}, step {args.step}\n")
    print("| picture | mean ×255 | max ×255 | off by > 8/255 | pixels | edges l,r,t,b (ours − VTK) | "
          "stray pixels | shift x,y | |")
    print("|" + " --- |" * 9)
    bad = 0
    for name, scan in SCANS.items():
        if args.only not in name:
            continue
        outside = read_outside(args.data / scan["file"])
        store = args.out / f"{name}.bsk"
        call(args.brickscope, "brick", args.data / scan["file"], "-o", store, "--force")
        function = args.out / f"{name}.tf.json"
        write_function(function, name, scan["opacity"], scan["color"])
        scene = VtkScene(outside.physical.astype(np.float32), outside.affine)
        unit = float(scene.spacing.min())
        azimuth, elevation = args.orbit or scan["orbit"]
        eye, target = orbit_camera(outside.affine, outside.stored.shape, azimuth, elevation)
        for mode in ("dvr", "mip"):
            ours, _ = render(args, store, args.out / f"{name}-{mode}-ours.png", "--mode", mode, "--tf", function,
                             f"--orbit={azimuth},{elevation}", "--step", args.step, "--opacity-cutoff", 0.9999)
            scene.set_mode(mode, scan["opacity"], scan["color"], args.step * unit, unit)
            scene.draw(eye, target)
            theirs = scene.picture()
            difference = np.abs(ours - theirs)
            shown = not_background(ours, 0.5 / 255) | not_background(theirs, 0.5 / 255)
            inside = difference[shown] * 255
            off = (difference.max(axis=2)[shown] > 8.5 / 255).mean()
            apart = edges(not_background(ours, 16 / 255)) - edges(not_background(theirs, 16 / 255))
            stray = stray_pixels(ours, theirs)
            shift = best_shift(ours, theirs)
            well = inside.mean() <= 2 and stray == 0 and max(map(abs, shift)) <= 0.5
            bad += not well
            print(f"| {name} {mode} | {inside.mean():.3f} | {inside.max():.0f} | {off:.3%} | {shown.sum()} | "
                  f"{','.join(map(str, apart))} | {stray} | "
                  f"{shift[0]:+.3f},{shift[1]:+.3f} | {'ok' if well else 'OFF'} |", flush=True)
            side = np.concatenate([ours, theirs, np.clip(difference * 8, 0, 1)], axis=1)
            Image.fromarray(np.round(side * 255).astype(np.uint8)).save(args.out / f"{name}-{mode}.png")
    return bad


def compare_times(args):
    print(f"\n## Times: ms per frame, median of {args.times}, {SIZE}×{SIZE}, step 1\n")
    print("| scan, mode | VTK wall | VTK first | ours passes | ours wall | VTK wall ÷ ours passes | VTK first ÷ ours wall |")
    print("|" + " --- |" * 7)
    scans = {name: dict(SCANS[name], path=args.data / SCANS[name]["file"]) for name in ("AVM", "engine")}
    if args.ct:
        scans["ct"] = dict(SCANS["aorta-ct"], path=args.ct)
    for name, scan in scans.items():
        if args.only not in name:
            continue
        outside = read_outside(scan["path"])
        store = args.out / f"{name}.bsk"
        call(args.brickscope, "brick", scan["path"], "-o", store, "--force")
        function = args.out / f"{name}.tf.json"
        write_function(function, name, scan["opacity"], scan["color"])
        # Stored voxels: the functions are moved to stored values.
        low = np.unravel_index(outside.stored.argmin(), outside.stored.shape)
        high = np.unravel_index(outside.stored.argmax(), outside.stored.shape)
        s, p = [np.float64(outside.stored[i]) for i in (low, high)], [outside.physical[i] for i in (low, high)]
        slope = (p[1] - p[0]) / (s[1] - s[0])

        def stored(x, slope=slope, s0=s[0], p0=p[0]):
            return s0 + (x - p0) / slope
        opacity = [(stored(x), a) for x, a in scan["opacity"]]
        color = [(stored(x), r, g, b) for x, r, g, b in scan["color"]]
        for label, mode, shaded in (("dvr", "dvr", False), ("dvr shaded", "dvr", True), ("mip", "mip", False),
                                    ("iso", "iso", True)):
            if label not in args.modes:
                continue
            scene = VtkScene(outside.stored, outside.affine)
            unit = float(scene.spacing.min())
            # The window and its context are there before the volume's first frame.
            scene.volume.SetVisibility(0)
            scene.window.Render()
            scene.volume.SetVisibility(1)
            scene.set_mode(mode, opacity, color, unit, unit, shaded, stored(scan["iso"]))
            first = scene.draw(*orbit_camera(outside.affine, outside.stored.shape, 28, 15))
            theirs, passes, walls = [], [], []
            for i in range(args.times):
                azimuth = 30 + 2 * i
                theirs.append(scene.draw(*orbit_camera(outside.affine, outside.stored.shape, azimuth, 15)))
                options = ["--mode", mode, f"--orbit={azimuth},15", "--step", 1]
                options += ["--iso", scan["iso"]] if mode == "iso" else ["--tf", function]
                options += ["--shading", "phong"] if shaded else []
                _, stats = render(args, store, args.out / "time.png", *options)
                passes.append(sum(v for v in stats["passes_ms"].values() if v))
                walls.append(stats["wall_ms"])
            v, p_ms, w = (float(np.median(t)) for t in (theirs, passes, walls))
            print(f"| {name}, {label} | {v:.0f} | {first:.0f} | {p_ms:.0f} | {w:.0f} | {v / p_ms:.2f} | {first / w:.2f} |",
                  flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("brickscope", type=program, metavar="BRICKSCOPE", help="the program")
    parser.add_argument("data", type=Path, metavar="DATA", help="folder with nifti/, nrrd/, labels/")
    parser.add_argument("out", type=Path, metavar="OUT_FOLDER", help="stores and pictures go here")
    parser.add_argument("--device", default="llvmpipe", help="brickscope's --device [default: %(default)s]")
    parser.add_argument("--orbit", type=lambda t: tuple(float(v) for v in t.split(",")), metavar="AZ,EL",
                        help="the camera [default: 30,15]")
    parser.add_argument("--step", type=float, default=STEP, help="of the pictures, in voxels [default: %(default)s]")
    parser.add_argument("--only", default="", metavar="TEXT", help="scans whose name contains this")
    parser.add_argument("--times", type=int, default=0, metavar="N", help="also compare times, N frames each")
    parser.add_argument("--modes", type=lambda t: t.split(","), default=["dvr", "dvr shaded", "mip", "iso"], metavar="A,B",
                        help="what is timed: of 'dvr,dvr shaded,mip,iso' [default: all]")
    parser.add_argument("--no-pictures", action="store_true", help="times only")
    parser.add_argument("--ct", type=Path, metavar="FILE", help="another CT (HU) for the times: .nii.gz, .nrrd, …")
    args = parser.parse_args()
    if args.orbit and len(args.orbit) != 2:
        parser.error("--orbit: two numbers, AZ,EL")
    args.out.mkdir(parents=True, exist_ok=True)
    bad = 0 if args.no_pictures else compare_pictures(args)
    if args.times:
        compare_times(args)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
