"""Which programs draw which rows of the table, and the command line of each."""
import json
import os
from dataclasses import dataclass, field
from pathlib import Path

import scene

HERE = Path(__file__).resolve().parent
SIZE = 512
STEP = 1.0
# Where a ray counts as opaque: VTK GPU .996, VTK FixedPoint .992, OSPRay .99 (minContribution). We take the strictest.
OPACITY_CUTOFF = 0.9961


@dataclass(frozen=True)
class Row:
    """A volume in a mode. `memory`: bound of our GPU and our host memory; `variants`: ours once more, in other ways."""
    volume: str
    mode: str
    memory: str | None = None
    variants: tuple = ()
    # Also how fast the store is made.
    bricking: bool = False

    @property
    def id(self):
        return f"{self.volume}-{self.mode}"


@dataclass(frozen=True)
class Variant:
    """Our program in another way, or another of its benches. `measures`: see [`Program`]."""
    id: str
    label: str
    options: tuple = ()
    bench: tuple = ("render",)
    # Only that bench knows these.
    bench_options: tuple = ("--no-ceiling",)
    measures: str = "turn"
    select: tuple = ()


# No mesh, no skipping.
BASIC = Variant("basic", "technique basic", ("--technique", "basic"))
# A pixel is 2.8 voxels wide: by itself ours draws level 1 in steps of its voxels. This is what the peers do.
LEVEL_0 = Variant("level0", "level 0", ("--lod", 0))
# Until every sample is of a level whose voxel is at most 4 pixels.
FIRST = Variant("first", "first whole picture", bench_options=("--no-ceiling", "--whole", "--frames", 1), measures="first")
# Beside a kernel that does the same at the same positions, without bricks and without skipping.
CEILING = Variant("ceiling", "beside the bare kernel", bench_options=("--frames", 12), measures="ceiling")
EDIT = Variant("edit", "edit of the transfer function", bench=("classify",), bench_options=(), measures="edit",
               select=(("mode", "dvr"), ("what", "edit")))


ROWS = (
    Row("ct256", "ramp"),
    Row("ct256", "bone", variants=(CEILING,)),
    Row("ct256", "bone-shaded"),
    Row("ct256", "mip"),
    Row("ct256", "iso"),
    Row("ct512", "ramp"),
    Row("ct512", "bone"),
    Row("ct512", "mip"),
    Row("ct1024", "bone", memory="256MiB", variants=(LEVEL_0, FIRST, EDIT), bricking=True),
    Row("marschner-lobb", "ramp", variants=(BASIC,)),
)


@dataclass(frozen=True)
class Program:
    """One line of a row's table: prints JSON lines, of which the last one with the items of `select` counts. `picture`: the
    command that writes its picture, where that is another. `measures`: "turn", the frames of one, or something else of ours."""
    id: str
    label: str
    command: list
    png: Path | None = None
    picture: list | None = None
    environment: dict = field(default_factory=dict)
    is_ours: bool = False
    measures: str = "turn"
    select: tuple = ()


@dataclass(frozen=True)
class Device:
    """A device of ours: `choice` as in --device."""
    id: str
    choice: str
    label: str


class Builder:
    """Makes the programs of a row."""

    def __init__(self, args, interpreter, ospray, devices):
        self.args, self.interpreter, self.ospray, self.devices = args, interpreter, ospray, devices

    def programs(self, row, volume, store):
        found = [*self.peers(row, volume), *self.ours(row, volume, store)]
        return [p for p in found if not self.args.programs or p.id in self.args.programs]

    # ---- peers -------------------------------------------------------------------------------------------------------

    def peer(self, row, volume, id, label, script, mode, *options, **environment):
        png = self.args.out / "pictures" / f"{row.id}.{id}.png"
        command = [self.interpreter, HERE / script, volume.header, "--mode", mode, "--size", SIZE, "--step",
                   STEP, "--frames", self.args.frames, "--png", png, *options]
        return Program(id, label, command, png, environment=environment)

    def peers(self, row, volume):
        projection = scene.MODES[row.mode].projection
        if projection != "iso":
            yield self.peer(row, volume, "vtk-fixed", "VTK FixedPoint", "vtk_bench.py", row.mode, "--mapper", "fixed")
        if volume.n >= 1024:
            # As one texture it is black, without a word; in blocks it is drawn, slowly.
            if self.args.partitions:
                yield self.peer(row, volume, "vtk-gpu", f"VTK GPU, {self.args.partitions}³ blocks", "vtk_bench.py", row.mode,
                                "--mapper", "gpu", "--partitions", self.args.partitions)
        elif projection == "iso":
            yield self.peer(row, volume, "vtk-gpu", "VTK GPU (translucent, .6)", "vtk_bench.py", row.mode, "--mapper", "gpu")
            yield self.peer(row, volume, "vtk-gpu-opaque", "VTK GPU (opaque)", "vtk_bench.py", f"{row.mode}-opaque",
                            "--mapper", "gpu")
        else:
            yield self.peer(row, volume, "vtk-gpu", "VTK GPU", "vtk_bench.py", row.mode, "--mapper", "gpu")
        if projection != "mip":
            libraries = os.pathsep.join(filter(None, [str(self.ospray), os.environ.get("LD_LIBRARY_PATH")]))
            yield self.peer(row, volume, "ospray", "OSPRay", "ospray_bench.py", row.mode, OSPRAY_LIBS=str(self.ospray),
                            LD_LIBRARY_PATH=libraries)

    # ---- ours --------------------------------------------------------------------------------------------------------

    def options(self, row, volume):
        """What makes the same picture."""
        mode = scene.MODES[row.mode]
        out = ["--size", f"{SIZE}x{SIZE}", "--step", STEP, "--mode", mode.projection, "--background", "0,0,0",
               "--opacity-cutoff", OPACITY_CUTOFF, "--shading", "phong" if mode.is_shaded else "none"]
        if mode.is_shaded:
            out += ["--ambient", scene.AMBIENT, "--diffuse", scene.DIFFUSE, "--specular", scene.SPECULAR, "--shininess",
                    scene.SPECULAR_POWER]
        if mode.projection == "iso":
            out += ["--iso", f"{scene.ISO_VALUE * volume.full_scale:g}:{','.join(map(str, scene.ISO_COLOR))}"]
        else:
            out += ["--tf", self.transfer_function(row.mode, volume), "--opacity-unit", volume.opacity_unit]
        if row.memory:
            out += ["--gpu-memory", row.memory, "--ram", row.memory]
        return out

    def transfer_function(self, name, volume):
        """The file of a transfer function in ParaView's format, in the volume's values."""
        mode = scene.MODES[name]
        path = self.args.out / "stores" / f"{name}-{volume.full_scale}.json"
        path.write_text(json.dumps([{
            "Name": name,
            "ColorSpace": "RGB",
            "RGBPoints": [v for x, rgb in mode.color for v in (x * volume.full_scale, *rgb)],
            # Midpoint .5 and sharpness 0: linear.
            "Points": [v for x, a in mode.opacity for v in (x * volume.full_scale, a, 0.5, 0)],
        }], indent=1), encoding="utf-8")
        return path

    def ours(self, row, volume, store):
        options = self.options(row, volume)
        triple = ",".join(f"{p:.6f}" for p in volume.eye(scene.azimuth(scene.PICTURE_FRAME)))
        camera = ["--eye", triple, "--target", ",".join([str(volume.centre)] * 3), "--up", "0,1,0", "--fov", scene.FOV]
        for device in self.devices:
            for variant in (Variant("", ""), *row.variants):
                id = "-".join(filter(None, [device.id, variant.id]))
                label = ", ".join(filter(None, ["ours", device.label, variant.label]))
                more = [*options, "--device", device.choice, *variant.options]
                bench = [self.args.brickscope, "bench", *variant.bench, store, "--json", *more, *variant.bench_options]
                if variant.measures != "turn":
                    yield Program(id, label, bench, is_ours=True, measures=variant.measures, select=variant.select)
                    continue
                png = self.args.out / "pictures" / f"{row.id}.{id}.png"
                yield Program(id, label, [*bench, "--frames", self.args.frames], png, is_ours=True,
                              picture=[self.args.brickscope, "render", store, "-o", png, *more, *camera])
        if row.bricking:
            yield Program("brick", "ours, bricking",
                          [self.args.brickscope, "bench", "brick", volume.header, "--json", "--dir", store.parent],
                          is_ours=True, measures="bricking")
