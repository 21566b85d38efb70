"""Sets up, under one folder, what the comparison runs: Python packages, OSPRay's libraries, volumes, brick stores.

What is there already is left as it is, so that a second run begins at once.
"""
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import scene

HERE = Path(__file__).resolve().parent
# Figures depend on the peers' versions: these are the ones that the tables name.
VTK = "vtk==9.7.2"
# The only package of PyPI with OSPRay's libraries inside. They are loaded by their C interface: which Python the wheel is for
# makes no difference.
OVITO = "ovito==3.17.2"
OVITO_WHEEL = ("--python-version", "3.11", "--implementation", "cp", "--abi", "cp311", "--platform", "manylinux_2_34_x86_64")
OSPRAY_FAMILIES = ("libtbb", "librkcommon", "libembree", "libopenvkl", "libospray")


def run(command, **options):
    """Runs a command whose failure ends everything; its output goes where diagnostics go."""
    done = subprocess.run([str(word) for word in command], stdout=sys.stderr, **options)
    if done.returncode:
        sys.exit(f"error: exit code {done.returncode} of: {' '.join(map(str, command))}")


def python(out):
    """The interpreter of a virtual environment with VTK, numpy and Pillow."""
    folder = out / "python"
    interpreter = folder / "bin" / "python3"
    ready = folder / "ready"
    if not ready.exists():
        print(f"== Python packages: {VTK}, numpy, pillow", file=sys.stderr)
        try:
            venv.create(folder, with_pip=True, clear=True)
        except subprocess.CalledProcessError:
            sys.exit("error: this Python makes no virtual environments; on Debian: apt-get install python3-venv")
        run([interpreter, "-m", "pip", "install", "--quiet", VTK, "numpy", "pillow"])
        ready.touch()
    return interpreter


def ospray(out, interpreter):
    """The folder of OSPRay's libraries."""
    folder = out / "ospray"
    if not folder.exists():
        print(f"== OSPRay's libraries, of the wheel {OVITO}", file=sys.stderr)
        wheels, part = out / "wheels", out / "ospray.part"
        run([interpreter, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:", *OVITO_WHEEL, "-d", wheels,
             OVITO])
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        with zipfile.ZipFile(next(wheels.glob("ovito-*.whl"))) as wheel:
            for name in wheel.namelist():
                library = Path(name).name
                if name.startswith("ovito/plugins/") and library.startswith(OSPRAY_FAMILIES):
                    (part / library).write_bytes(wheel.read(name))
        # OSPRay opens its module by the name without a version.
        module = next(part.glob("libospray_module_cpu.so.*"))
        (part / "libospray_module_cpu.so").symlink_to(module.name)
        shutil.rmtree(wheels)
        os.replace(part, folder)
    return folder


def volume(out, interpreter, name):
    """The volume `name`, made when it is not there."""
    folder = out / "volumes"
    header = folder / f"{name}.nhdr"
    if not header.exists():
        print(f"== volume {name}", file=sys.stderr)
        run([interpreter, HERE / "volumes.py", folder, name])
    return scene.read_volume(header)


def store(out, brickscope, header):
    """The brick store of a volume, made when it is not there."""
    path = out / "stores" / f"{header.stem}.bsk"
    if not path.exists():
        print(f"== brick store {path.name}", file=sys.stderr)
        path.parent.mkdir(exist_ok=True)
        run([brickscope, "brick", header, "-o", path])
    return path
