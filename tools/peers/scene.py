"""What all programs draw: volumes, cameras, transfer functions, light. Numbers only, so that every program can read it.

Camera: perspective, 30° vertical; for a cube of n voxels the eye is 1.5 · n · √3 from the centre of the box, up is +y,
and the azimuth goes about +y, beginning at +z: as `brickscope bench render` turns. Opacities hold per n/256 voxels.
Transfer functions are in units of full scale: 255 for u8, 4095 for u16.
"""
import math
from dataclasses import dataclass
from pathlib import Path

FOV = 30.0
TURN = 36
# The view of the pictures, and their number in a whole turn: 40°.
PICTURE_FRAME = 4
FULL_SCALE = {"uint8": 255, "uint16": 4095}

AMBIENT, DIFFUSE, SPECULAR, SPECULAR_POWER = 0.2, 0.8, 0.3, 30

GREY = ((0, (0, 0, 0)), (1, (1, 1, 1)))
BONE_OPACITY = ((0, 0), (0.60, 0), (0.75, 0.5), (1, 0.9))
BONE_COLOR = ((0, (0.6, 0.3, 0.2)), (0.65, (0.8, 0.5, 0.3)), (1, (1, 1, 0.95)))
ISO_VALUE = 0.6
ISO_COLOR = (1, 0.9, 0.8)


@dataclass(frozen=True)
class Mode:
    """A way to show a volume. `opacity`: (value, opacity); `color`: (value, (r, g, b))."""
    projection: str  # dvr, mip or iso
    opacity: tuple
    color: tuple
    is_shaded: bool = False


MODES = {
    "ramp": Mode("dvr", ((0, 0), (1, 0.06)), GREY),
    "bone": Mode("dvr", BONE_OPACITY, BONE_COLOR),
    "bone-shaded": Mode("dvr", BONE_OPACITY, BONE_COLOR, is_shaded=True),
    "mip": Mode("mip", ((0, 0), (1, 1)), GREY),
    # A surface of VTK's has the opacity of the function at its value. The older tables have it at .6: rays go on behind
    # it. The other one ends a ray, as OSPRay's and ours do.
    "iso": Mode("iso", ((0, 0), (1, 1)), ((0, ISO_COLOR), (1, ISO_COLOR)), is_shaded=True),
    "iso-opaque": Mode("iso", ((0, 1), (1, 1)), ((0, ISO_COLOR), (1, ISO_COLOR)), is_shaded=True),
}


@dataclass(frozen=True)
class Volume:
    """A cube of n voxels, x fastest, spacing 1, described by the NRRD header that volumes.py writes."""
    name: str
    n: int
    voxel_type: str
    header: Path
    raw: Path

    @property
    def full_scale(self):
        return FULL_SCALE[self.voxel_type]

    @property
    def opacity_unit(self):
        """The length for which opacities hold, in voxels."""
        return self.n / 256

    @property
    def centre(self):
        return (self.n - 1) / 2

    def eye(self, azimuth):
        """Where the camera is at `azimuth` (radians); it looks at the centre."""
        distance = 1.5 * math.sqrt(3) * self.n
        return (self.centre + distance * math.sin(azimuth), self.centre, self.centre + distance * math.cos(azimuth))


def azimuth(frame, frames=TURN):
    """Radians, of one of `frames` equal steps of a turn."""
    return 2 * math.pi * frame / frames


def read_volume(header):
    """The volume of a header of volumes.py."""
    lines = Path(header).read_text(encoding="ascii").splitlines()
    fields = dict(line.split(": ", 1) for line in lines if ": " in line)
    sizes = {int(size) for size in fields["sizes"].split()}
    if len(sizes) != 1:
        raise SystemExit(f"{header}: expected a cube, found sizes {fields['sizes']}")
    header = Path(header)
    return Volume(header.stem, sizes.pop(), fields["type"], header, header.parent / fields["data file"])
