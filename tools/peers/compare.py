#!/usr/bin/env python3
"""Brickscope beside its peers: VTK's fixed-point and GPU mappers and OSPRay, on the same volumes, in one run.

Sets up a Python environment, OSPRay's libraries, volumes and brick stores under OUT_FOLDER, runs all programs in turn, and
writes OUT_FOLDER/report.md, report.json and pictures/. The report goes to standard output, too. README.md says what is
measured and how to read it.

Needs Linux on x86-64, Python 3.11 with venv, the network for the first run, and for VTK GPU and ours on Mesa:
apt-get install python3-venv mesa-vulkan-drivers libegl1 libgl1-mesa-dri
Exit code 1 if a program failed; missed targets are listed, and no failure.
"""
import argparse
import json
import os
import platform
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

import environment
import report
import targets
from programs import ROWS, Builder, Device

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
SOFTWARE = "llvmpipe"


class Failed(Exception):
    """A program ended otherwise than it should."""


def call(command, more_environment):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True,
                          env={**os.environ, **more_environment})
    if done.returncode:
        raise Failed(f"{shlex.join(map(str, command))}\nexit code {done.returncode}\n{done.stderr.strip()[-2000:]}")
    return done.stdout


def measured(program):
    """The program's figures."""
    out = call(program.command, program.environment)
    try:
        lines = [json.loads(line) for line in out.splitlines()]
        return [line for line in lines if all(line.get(key) == value for key, value in program.select)][-1]
    except (IndexError, json.JSONDecodeError) as error:
        wanted = f"a JSON line with {dict(program.select)}" if program.select else "a JSON line"
        raise Failed(f"{shlex.join(map(str, program.command))}\nexpected {wanted}, found {out[-300:]!r}") from error


def medians(runs):
    """By key: of numbers the median, of all else the first run's."""
    out = dict(runs[0])
    for key, value in out.items():
        values = [run[key] for run in runs if isinstance(run.get(key), (int, float))]
        if isinstance(value, (int, float)) and not isinstance(value, bool) and values:
            out[key] = statistics.median(values)
    return out


def devices(args, store):
    """Ours: the CPU renderer, the software adapter, and a real one where `--device auto` finds one."""
    found = [Device("cpu", "cpu", "CPU"), Device(SOFTWARE, SOFTWARE, SOFTWARE)]
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        call([args.brickscope, "render", store, "-o", Path(folder) / "p.png", "--size", "16x16", "--stats", stats], {})
        auto = json.loads(stats.read_text(encoding="utf-8"))
    if auto["device"] == "gpu" and SOFTWARE not in auto["adapter"]:
        found.append(Device("gpu", auto["adapter"], auto["adapter"]))
    return found


def machine():
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    model = next((line.split(": ", 1)[1] for line in info.splitlines() if line.startswith("model name")), platform.machine())
    return f"{len(os.sched_getaffinity(0))} cores, {model}"


def versions(entry):
    """What drew: the program and, on a graphics adapter, its name."""
    median = entry["median"]
    yield f"Brickscope {median['version']}" if entry["is_ours"] else median["version"]
    adapter = median.get("adapter") or median.get("renderer")
    if adapter:
        yield adapter


def measure_row(row, programs, args, results, failures):
    """All rounds of a row: in each, every program once."""
    entries = {p.id: dict(label=p.label, is_ours=p.is_ours, measures=p.measures, runs=[], median=None, error=None) for p in programs}
    results[row.id] = entries
    for turn in range(args.rounds):
        # Who comes first changes, so that nobody always follows the same neighbour.
        shift = turn % len(programs)
        for program in programs[shift:] + programs[:shift]:
            entry = entries[program.id]
            if entry["error"]:
                continue
            print(f"== {row.id}, round {turn + 1} of {args.rounds}: {program.label}", file=sys.stderr)
            try:
                entry["runs"].append(measured(program))
            except Failed as failure:
                entry["error"] = str(failure)
                failures.append((f"{row.id}, {program.label}", str(failure)))
    for entry in entries.values():
        if entry["runs"] and not entry["error"]:
            entry["median"] = medians(entry["runs"])


def draw_row(row, programs, interpreter, args, results, failures):
    """Pictures side by side; how they differ."""
    sides = {True: [], False: []}
    for program in programs:
        if program.png is None or results[row.id][program.id]["error"]:
            continue
        try:
            if program.picture:
                call(program.picture, program.environment)
        except Failed as failure:
            failures.append((f"{row.id}, picture of {program.label}", str(failure)))
            continue
        sides[program.is_ours].append(f"{program.label}={program.png}")
    if not sides[True]:
        return []
    words = [interpreter, HERE / "pictures.py", args.out / "pictures" / f"{row.id}.png", "--ours", *sides[True]]
    return json.loads(call([*words, "--peers", *sides[False]] if sides[False] else words, {}))


def command(args):
    """What repeats this run elsewhere: without the folders of this machine."""
    words = ["python3", "tools/peers/compare.py", "OUT_FOLDER", "--frames", args.frames, "--rounds", args.rounds]
    if args.only != [""]:
        words += ["--only", ",".join(args.only)]
    if args.programs:
        words += ["--programs", ",".join(args.programs)]
    if args.partitions:
        words += ["--partitions", args.partitions]
    return shlex.join(map(str, words))


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=lambda text: Path(text).resolve(), metavar="OUT_FOLDER", help="everything is kept here")
    parser.add_argument("--only", type=lambda text: text.split(","), default=[""], metavar="A,B",
                        help=f"rows whose name contains one of these; rows: {', '.join(row.id for row in ROWS)}")
    parser.add_argument("--programs", type=lambda text: text.split(","), default=[], metavar="A,B",
                        help="of vtk-fixed, vtk-gpu, vtk-gpu-opaque, ospray, brick, cpu, llvmpipe, gpu, and the last three with "
                             "-basic, -level0, -first, -edit, -ceiling [default: all]")
    parser.add_argument("--frames", type=int, default=36, metavar="N", help="of a whole turn [default: %(default)s]")
    parser.add_argument("--rounds", type=int, default=3, metavar="N", help="medians are over these [default: %(default)s]")
    parser.add_argument("--partitions", type=int, default=0, metavar="P",
                        help="also VTK GPU on ct1024, in P³ blocks (2 works on Mesa): very slow")
    parser.add_argument("--brickscope", type=lambda text: Path(text).resolve(), metavar="PATH",
                        default=REPOSITORY / "target" / "release" / "brickscope", help="[default: target/release/brickscope]")
    args = parser.parse_args()
    args.rows = [row for row in ROWS if any(text in row.id for text in args.only)]
    if not args.rows:
        parser.error(f"--only: no row's name contains {' or '.join(args.only)}")
    if args.frames < 1 or args.rounds < 1:
        parser.error("--frames and --rounds: 1 or more")
    if not args.brickscope.exists():
        parser.error(f"{args.brickscope}: not there; build it with 'cargo build --release', or name it with --brickscope")
    return args


def main():
    args = parse()
    # Vulkan's window-system code asks for it, also where there are no windows.
    os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.gettempdir())
    (args.out / "pictures").mkdir(parents=True, exist_ok=True)
    interpreter = environment.python(args.out)
    libraries = environment.ospray(args.out, interpreter)
    volumes = {name: environment.volume(args.out, interpreter, name) for name in dict.fromkeys(r.volume for r in args.rows)}
    stores = {name: environment.store(args.out, args.brickscope, volume.header) for name, volume in volumes.items()}
    ours = devices(args, next(iter(stores.values())))
    builder = Builder(args, interpreter, libraries, ours)

    load = [os.getloadavg()[0]]
    results, pictures, failures = {}, {}, []
    began = time.monotonic()
    for row in args.rows:
        programs = builder.programs(row, volumes[row.volume], stores[row.volume])
        if not programs:
            continue
        measure_row(row, programs, args, results, failures)
        pictures[row.id] = draw_row(row, programs, interpreter, args, results, failures)
    load.append(os.getloadavg()[0])

    entries = [entry for programs in results.values() for entry in programs.values() if entry["median"]]
    names = dict.fromkeys(name for entry in entries for name in versions(entry))
    labels = {(row, id): entry["label"] for row, programs in results.items() for id, entry in programs.items()}
    ids = [device.id for device in ours]
    made = dict(
        date=date.today().isoformat(), machine=machine(), versions=list(names), devices=ids, frames=args.frames,
        rounds=args.rounds, load=load, minutes=round((time.monotonic() - began) / 60, 1),
        command=command(args), results=results,
        targets=targets.check(results, labels, ids), pictures=pictures, failures=failures)
    (args.out / "report.json").write_text(json.dumps(made, indent=1), encoding="utf-8")
    text = report.markdown(made)
    (args.out / "report.md").write_text(text, encoding="utf-8")
    print(text, end="")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
