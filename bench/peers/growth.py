"""Seconds and memory against the number of triangles: Hemilux beside Mitsuba 3 with denoising.

    bench/peers/run --growth [options of growth.py]

Rooms of ten thousand to four million triangles, 256 × 256 pixels. Times are from the file to the picture:
reading, hierarchies and rendering. Ours are those of the whole program, kernels of Mitsuba are warm. The errors are judged
by two halves of our unbiased path tracer, without pixels near the lamp. Memory is the largest
resident size of the process; that of a triangle is how much more the larger scene takes.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import types

import numpy as np

SIZE = 256
SAMPLES = (4, 16, 64, 256)  # of Mitsuba, a pixel
TARGETS = (0.05, 0.03)  # of ours, first picture and what follows


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--hemilux", default="target/release/hemilux")
    parser.add_argument("--exporter", default="target/release/hemilux-bench")
    parser.add_argument("--triangles", nargs="+", type=int, default=[10_000, 100_000, 1_000_000, 3_900_000])
    parser.add_argument("--reference-seconds", type=float, default=30.0, help="each of two halves")
    parser.add_argument("--out", default="out/growth")
    parser.add_argument("--mitsuba", help=argparse.SUPPRESS)
    return parser.parse_args()


def mitsuba(path):
    """In a process of its own: loads the scene and renders it with ever more samples."""
    import peer  # first: it takes standard output
    import peer_mitsuba

    # Kernels, which do not depend on the triangles, are compiled by a first scene and render.
    peer_mitsuba.make(path, SIZE)(1, 0)
    began = time.perf_counter()
    render = peer_mitsuba.make(path, SIZE)
    loading = time.perf_counter() - began
    rows = []
    for number, samples in enumerate(SAMPLES):
        seconds, picture = render(samples, 1 + number)["mitsuba+oidn"]
        np.save(f"{path}-mitsuba-{samples}.npy", np.asarray(picture, np.float32))
        rows.append({"samples": samples, "seconds": loading + seconds})
    print(json.dumps({"loading": loading, "rows": rows}), file=peer.answers, flush=True)


def measured(command):
    """Seconds, largest resident bytes and standard output of a program."""
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        raise RuntimeError(f"{command} ended with {status}")
    return time.perf_counter() - began, 1024 * usage.ru_maxrss, output


def ours(options, scene, judge):
    rows = []
    for target in TARGETS:
        files = ["-o", f"{scene}-ours.exr", "--stats", f"{scene}-ours.json"]
        command = [options.hemilux, "render", scene, "--method", "hemilux", "--device", "cpu", "-q"]
        command += ["--size", f"{SIZE}x{SIZE}", "--target-error", str(target), *files]
        seconds, memory, _ = measured(command)
        with open(f"{scene}-ours.json") as file:
            predicted = json.load(file)["estimated_error"]
        picture = programs.read_exr(f"{scene}-ours.exr")
        row = {"program": f"**Hemilux**, asked for {100 * target:.0f} %", "seconds": seconds, "memory": memory}
        rows.append({**row, "error": judge.error(picture), "predicted": predicted})
    return rows


def theirs(scene, judge):
    _, memory, output = measured([sys.executable, __file__, "--mitsuba", scene])
    rows = []
    for row in json.loads(output)["rows"]:
        picture = np.load(f"{scene}-mitsuba-{row['samples']}.npy").astype(np.float64)
        name = f"Mitsuba 3 + OIDN, {row['samples']} samples"
        error = judge.error(picture)
        rows.append({"program": name, "seconds": row["seconds"], "memory": memory, "error": error})
    return rows


def table(rows):
    """Markdown; bytes of a triangle are those beyond the next smaller scene."""
    lines = ["| triangles | program | seconds from the file | error | predicted | MiB | bytes a triangle more |"]
    lines.append("|---:|---|---:|---:|---:|---:|---:|")
    smaller = {}
    for row in rows:
        before = smaller.get(row["program"])
        more = "–"
        if before:
            bytes_more = row["memory"] - before["memory"]
            more = f"{bytes_more / (row['triangles'] - before['triangles']):.0f}"
        smaller[row["program"]] = row
        predicted = f"{100 * row['predicted']:.1f} %" if "predicted" in row else "–"
        lines.append(
            f"| {row['triangles']} | {row['program']} | {row['seconds']:.2f} | {100 * row['error']:.1f} % "
            f"| {predicted} | {row['memory'] / 2**20:.0f} | {more} |"
        )
    return "\n".join(lines)


def slope(rows, program):
    """By which power of the number of triangles the seconds of a program grow."""
    own = [row for row in rows if row["program"] == program]
    logs = [np.log([row[key] for row in own]) for key in ("triangles", "seconds")]
    return np.polyfit(*logs, 1)[0]


def main():
    options = arguments()
    if options.mitsuba:
        return mitsuba(options.mitsuba)
    global programs
    import programs
    import truth as truths

    truths.SIZE = SIZE
    os.makedirs(options.out, exist_ok=True)
    rows = []
    for triangles in options.triangles:
        name = f"tessellated-{triangles}"
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([options.exporter, "export", name, "--out", folder], check=True)
            scene = os.path.join(folder, f"{name}.glb")
            how = types.SimpleNamespace(**vars(options), reference=None)
            judge = truths.reference(how, name, scene, folder)
            for row in ours(options, scene, judge) + theirs(scene, judge):
                rows.append({"triangles": triangles, **row})
                print(rows[-1], flush=True)
    print(table(rows))
    for program in dict.fromkeys(row["program"] for row in rows):
        print(f"- {program}: slope {slope(rows, program):.2f}")


if __name__ == "__main__":
    sys.exit(main())
