#!/usr/bin/env python3
"""A turn of VTK's volume mappers, off screen: vtkFixedPointVolumeRayCastMapper (CPU) or vtkOpenGLGPUVolumeRayCastMapper.

Timed is the camera's move, Render and WaitForCompletion (glFinish); no read-back. `first_ms` is the volume's first frame
(upload, shader build, tables), the window and its context being there; `load_ms` reading the file. Linear sampling, a fixed
step, no jitter, no automatic change of sample distances.
"""
import os
import sys

# Before VTK is loaded: no display is needed.
os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import vtkmodules.vtkRenderingOpenGL2  # noqa: F401: registers the window
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkIOImage import vtkPNGWriter
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction, vtkRenderer, vtkRenderWindow, vtkVolume, vtkVolumeProperty, vtkWindowToImageFilter,
)
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper
from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

import scene
import turn


def image_of(volume, array):
    image = vtkImageData()
    image.SetDimensions(volume.n, volume.n, volume.n)
    image.SetSpacing(1, 1, 1)
    image.GetPointData().SetScalars(numpy_to_vtk(array, deep=0))
    return image


def property_of(volume, mode):
    opacity, color = vtkPiecewiseFunction(), vtkColorTransferFunction()
    for x, a in mode.opacity:
        opacity.AddPoint(x * volume.full_scale, a)
    for x, rgb in mode.color:
        color.AddRGBPoint(x * volume.full_scale, *rgb)
    out = vtkVolumeProperty()
    out.SetColor(color)
    out.SetScalarOpacity(opacity)
    out.SetScalarOpacityUnitDistance(volume.opacity_unit)
    out.SetInterpolationTypeToLinear()
    out.SetShade(1 if mode.is_shaded else 0)
    out.SetAmbient(scene.AMBIENT)
    out.SetDiffuse(scene.DIFFUSE)
    out.SetSpecular(scene.SPECULAR)
    out.SetSpecularPower(scene.SPECULAR_POWER)
    if mode.projection == "iso":
        out.GetIsoSurfaceValues().SetValue(0, scene.ISO_VALUE * volume.full_scale)
    return out


def mapper_of(args, mode):
    if args.mapper == "gpu":
        out = vtkOpenGLGPUVolumeRayCastMapper()
        out.SetUseJittering(0)
        out.SetMaxMemoryInBytes(16 << 30)
        out.SetMaxMemoryFraction(1.0)
        if args.partitions > 1:
            out.SetPartitions(args.partitions, args.partitions, args.partitions)
    else:
        out = vtkFixedPointVolumeRayCastMapper()
        out.SetInteractiveSampleDistance(args.step)
    out.SetAutoAdjustSampleDistances(0)
    out.LockSampleDistanceToInputSpacingOff()
    out.SetSampleDistance(args.step)
    out.SetImageSampleDistance(1.0)
    if mode.projection == "mip":
        out.SetBlendModeToMaximumIntensity()
    elif mode.projection == "iso":
        out.SetBlendModeToIsoSurface()
    else:
        out.SetBlendModeToComposite()
    return out


def main():
    parser = turn.arguments(__doc__, scene.MODES)
    parser.add_argument("--mapper", choices=["fixed", "gpu"], required=True)
    parser.add_argument("--partitions", type=int, default=1, metavar="P",
                        help="(gpu) P³ blocks, uploaded one after another in each frame: for volumes that are no texture")
    args = parser.parse_args()
    mode, volume = scene.MODES[args.mode], args.volume
    if args.mapper == "fixed" and mode.projection == "iso":
        sys.exit("the fixed-point mapper draws no iso-surfaces")

    array, load_ms = turn.voxels(volume)
    image = image_of(volume, array)
    rss_base = turn.resident_mib()
    mapper = mapper_of(args, mode)
    mapper.SetInputData(image)
    prop = vtkVolume()
    prop.SetMapper(mapper)
    prop.SetProperty(property_of(volume, mode))
    renderer = vtkRenderer()
    renderer.SetBackground(0, 0, 0)
    renderer.AddVolume(prop)
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(args.size, args.size)
    window.SetDesiredUpdateRate(0.0001)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetViewAngle(scene.FOV)
    camera.SetFocalPoint(volume.centre, volume.centre, volume.centre)

    def draw(azimuth):
        camera.SetPosition(*volume.eye(azimuth))
        camera.SetViewUp(0, 1, 0)
        renderer.ResetCameraClippingRange()
        window.Render()
        window.WaitForCompletion()

    # The window and its context apart from the volume.
    prop.SetVisibility(0)
    clock = turn.Clock()
    window.Render()
    window.WaitForCompletion()
    context_ms = clock.ms()
    prop.SetVisibility(1)
    clock = turn.Clock()
    draw(scene.azimuth(0))
    first_ms = clock.ms()
    cost = turn.measure(draw, args.frames)

    draw(scene.azimuth(scene.PICTURE_FRAME))
    grab = vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.ShouldRerenderOff()
    grab.Update()
    if args.png:
        writer = vtkPNGWriter()
        writer.SetFileName(str(args.png))
        writer.SetInputData(grab.GetOutput())
        writer.Write()
    renderer_name = next((line.split(":", 1)[1].strip() for line in window.ReportCapabilities().splitlines()
                          if "OpenGL renderer" in line), None)
    turn.report(args, **cost, mapper=args.mapper, partitions=args.partitions, first_ms=round(first_ms, 1),
                context_ms=round(context_ms, 1), load_ms=round(load_ms, 1), rss_base_mib=round(rss_base),
                # A mapper that runs out of texture memory draws nothing, says nothing and exits 0.
                is_black=not vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars()).any(),
                version=f"VTK {vtkVersion.GetVTKVersion()}",
                renderer=renderer_name if args.mapper == "gpu" else None)


if __name__ == "__main__":
    main()
