#!/usr/bin/env python3
"""A turn of OSPRay's SciVis renderer (OSPRay 3 with OpenVKL 2, CPU), through its C API.

The libraries are those in the folder OSPRAY_LIBS, which must be in LD_LIBRARY_PATH, too, since OSPRay loads its modules by
name; compare.py takes them out of the wheel `ovito`. One sample a pixel, volumeSamplingRate 1/step (OpenVKL's nominal step is
one voxel at spacing 1), no accumulation, 8-bit frame buffer. Timed are the camera's move and the frame; `first_ms` is the
making of all objects and the first frame; `load_ms` reading the file.

By design different: SciVis jitters the first sample, which can't be turned off; its lights are an ambient and a distant one
along −z; a transfer function is a table of 256 entries of colour and extinction; there is no maximum intensity projection.
"""
import ctypes as c
import os
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import scene
import turn

PTR = c.c_void_p

# OSPDataType, of ospray's ospray/OSPEnums.h.
OBJECT = 0x8000000
TYPES = {
    "data": OBJECT + 100, "gmodel": OBJECT + 104, "group": OBJECT + 106, "instance": OBJECT + 108, "light": OBJECT + 109,
    "material": OBJECT + 110, "tf": OBJECT + 113, "volume": OBJECT + 114, "vmodel": OBJECT + 115, "bool": 250, "uchar": 2500,
    "ushort": 3500, "int": 4000, "uint": 4500, "float": 6000, "vec3f": 6002, "vec4f": 6003, "box1f": 10000,
}
RGBA8, COLOR_CHANNEL = 1, 1
TABLE = 256


def load(folder):
    """The library; the modules that it opens by name first, so that they are found whatever their version."""
    for name in ("libtbb.so.12", "libtbbmalloc.so.2", "librkcommon.so.1", "libembree4.so.4", "libopenvkl.so.2",
                 "libopenvkl_module_cpu_device_4.so.2", "libopenvkl_module_cpu_device_8.so.2",
                 "libopenvkl_module_cpu_device.so.2"):
        c.CDLL(str(folder / name), mode=c.RTLD_GLOBAL)
    library = c.CDLL(str(folder / "libospray.so.3"), mode=c.RTLD_GLOBAL)
    for kind in ("Volume", "VolumetricModel", "Group", "Instance", "World", "Camera", "Renderer", "TransferFunction",
                 "FrameBuffer", "Geometry", "GeometricModel", "Light", "SharedData", "Data", "Material"):
        getattr(library, f"ospNew{kind}").restype = PTR
    for function in ("ospRenderFrame", "ospMapFrameBuffer", "ospGetCurrentDevice"):
        getattr(library, function).restype = PTR
    library.ospDeviceGetProperty.restype = c.c_int64
    return library


class Ospray:
    """Objects are plain pointers; what they point to is kept alive here."""

    def __init__(self, folder):
        self.lib = load(folder)
        self.kept = []
        code = self.lib.ospInit(None, None)
        if code:
            sys.exit(f"ospInit: error {code}")
        device = PTR(self.lib.ospGetCurrentDevice())
        on_error = c.CFUNCTYPE(None, PTR, c.c_int, c.c_char_p)
        self.kept.append(on_error(lambda _, code, text: print(f"OSPRay error {code}: {text.decode()}", file=sys.stderr)))
        self.lib.ospDeviceSetErrorCallback.argtypes = [PTR, on_error, PTR]
        self.lib.ospDeviceSetErrorCallback(device, self.kept[-1], None)
        # OSP_DEVICE_VERSION_MAJOR, _MINOR, _PATCH
        self.version = ".".join(str(self.lib.ospDeviceGetProperty(device, c.c_int(which))) for which in (1, 2, 3))

    def set(self, item, name, kind, value):
        """`value`: numbers, or the pointer of an object."""
        if isinstance(value, int) and kind not in ("int", "uint", "bool"):
            memory = c.byref(PTR(value))
        else:
            array = np.array(value, np.int32 if kind in ("int", "bool") else np.float32)
            memory = array.ctypes.data_as(PTR)
        self.lib.ospSetParam(PTR(item), name.encode(), c.c_uint32(TYPES[kind]), memory)

    def commit(self, item):
        self.lib.ospCommit(PTR(item))
        return item

    def data(self, array, kind, dims=None):
        """Shares `array`, which is not copied."""
        self.kept.append(array)
        x, y, z = dims or (len(array), 1, 1)
        stride = c.c_int64(0)
        return self.commit(self.lib.ospNewSharedData(
            array.ctypes.data_as(PTR), c.c_uint32(TYPES[kind]), c.c_uint64(x), stride, c.c_uint64(y), stride, c.c_uint64(z),
            stride, PTR(None), PTR(None)))

    def objects(self, kind, *items):
        """An array of objects; it must be a copy, OSPRay takes no shared ones."""
        shared = self.data(np.array(items, np.uint64), kind)
        copy = self.lib.ospNewData(c.c_uint32(TYPES[kind]), c.c_uint64(len(items)), c.c_uint64(1), c.c_uint64(1))
        zero = c.c_uint64(0)
        self.lib.ospCopyData(PTR(shared), PTR(copy), zero, zero, zero)
        return self.commit(copy)


def surface_group(osp, volume, grid):
    surface = osp.lib.ospNewGeometry(b"isosurface")
    osp.set(surface, "isovalue", "float", [scene.ISO_VALUE * volume.full_scale])
    osp.set(surface, "volume", "volume", grid)
    material = osp.lib.ospNewMaterial(b"obj")
    osp.set(material, "kd", "vec3f", scene.ISO_COLOR)
    model = osp.lib.ospNewGeometricModel(PTR(osp.commit(surface)))
    osp.set(model, "material", "data", osp.objects("material", osp.commit(material)))
    group = osp.lib.ospNewGroup()
    osp.set(group, "geometry", "data", osp.objects("gmodel", osp.commit(model)))
    return group


def volume_group(osp, volume, mode, grid):
    xs = np.linspace(0, 1, TABLE)
    opacity = np.interp(xs, *zip(*mode.opacity))
    colors = [color for _, color in mode.color]
    color = np.stack([np.interp(xs, [x for x, _ in mode.color], channel) for channel in zip(*colors)], axis=-1)
    extinction = -np.log(1 - opacity) / volume.opacity_unit
    function = osp.lib.ospNewTransferFunction(b"piecewiseLinear")
    osp.set(function, "color", "data", osp.data(np.ascontiguousarray(color, np.float32), "vec3f", (TABLE, 1, 1)))
    osp.set(function, "opacity", "data", osp.data(extinction.astype(np.float32), "float"))
    osp.set(function, "value", "box1f", [0, volume.full_scale])
    model = osp.lib.ospNewVolumetricModel(PTR(grid))
    osp.set(model, "transferFunction", "tf", osp.commit(function))
    if mode.is_shaded:
        osp.set(model, "gradientShadingScale", "float", [1])
    group = osp.lib.ospNewGroup()
    osp.set(group, "volume", "data", osp.objects("vmodel", osp.commit(model)))
    return group


def world_of(osp, volume, mode, array):
    grid = osp.lib.ospNewVolume(b"structuredRegular")
    osp.set(grid, "gridOrigin", "vec3f", [0, 0, 0])
    osp.set(grid, "gridSpacing", "vec3f", [1, 1, 1])
    osp.set(grid, "data", "data", osp.data(array, "uchar" if array.itemsize == 1 else "ushort", (volume.n,) * 3))
    osp.commit(grid)
    group = surface_group(osp, volume, grid) if mode.projection == "iso" else volume_group(osp, volume, mode, grid)
    instance = osp.lib.ospNewInstance(PTR(osp.commit(group)))
    ambient, distant = osp.lib.ospNewLight(b"ambient"), osp.lib.ospNewLight(b"distant")
    osp.set(ambient, "intensity", "float", [scene.AMBIENT])
    osp.set(distant, "direction", "vec3f", [0, 0, -1])
    osp.set(distant, "intensity", "float", [2.5])
    world = osp.lib.ospNewWorld()
    osp.set(world, "instance", "data", osp.objects("instance", osp.commit(instance)))
    osp.set(world, "light", "data", osp.objects("light", osp.commit(ambient), osp.commit(distant)))
    return osp.commit(world)


def main():
    args = turn.arguments(__doc__, [name for name, mode in scene.MODES.items() if mode.projection != "mip"]).parse_args()
    mode, volume = scene.MODES[args.mode], args.volume
    array, load_ms = turn.voxels(volume)
    osp = Ospray(Path(os.environ["OSPRAY_LIBS"]))
    rss_base = turn.resident_mib()

    clock = turn.Clock()
    world = world_of(osp, volume, mode, array)
    renderer = osp.lib.ospNewRenderer(b"scivis")
    osp.set(renderer, "pixelSamples", "int", [1])
    osp.set(renderer, "volumeSamplingRate", "float", [1 / args.step])
    osp.set(renderer, "backgroundColor", "vec4f", [0, 0, 0, 1])
    osp.set(renderer, "minContribution", "float", [0.01])
    osp.commit(renderer)
    frame_buffer = osp.commit(osp.lib.ospNewFrameBuffer(args.size, args.size, RGBA8, COLOR_CHANNEL))
    camera = osp.lib.ospNewCamera(b"perspective")
    osp.set(camera, "fovy", "float", [scene.FOV])
    osp.set(camera, "aspect", "float", [1])
    osp.set(camera, "up", "vec3f", [0, 1, 0])

    def draw(azimuth):
        eye = volume.eye(azimuth)
        osp.set(camera, "position", "vec3f", eye)
        osp.set(camera, "direction", "vec3f", [volume.centre - p for p in eye])
        osp.commit(camera)
        future = osp.lib.ospRenderFrame(PTR(frame_buffer), PTR(renderer), PTR(camera), PTR(world))
        # OSP_TASK_FINISHED
        osp.lib.ospWait(PTR(future), c.c_uint32(100000))
        osp.lib.ospRelease(PTR(future))

    draw(scene.azimuth(0))
    first_ms = clock.ms()
    cost = turn.measure(draw, args.frames)

    draw(scene.azimuth(scene.PICTURE_FRAME))
    mapped = osp.lib.ospMapFrameBuffer(PTR(frame_buffer), c.c_uint32(COLOR_CHANNEL))
    pixels = np.frombuffer((c.c_ubyte * (args.size * args.size * 4)).from_address(mapped), np.uint8)
    # Its first row is the lowest.
    picture = pixels.reshape(args.size, args.size, 4)[::-1, :, :3].copy()
    osp.lib.ospUnmapFrameBuffer(PTR(mapped), PTR(frame_buffer))
    if args.png:
        Image.fromarray(picture).save(args.png)
    turn.report(args, **cost, first_ms=round(first_ms, 1), load_ms=round(load_ms, 1), rss_base_mib=round(rss_base),
                is_black=not picture.any(), version=f"OSPRay {osp.version}", renderer=None)
    # Python's shutdown and OSPRay's own threads wait for each other.
    os._exit(0)


if __name__ == "__main__":
    main()
