"""Hemilux and its peers in turn on the same scenes: error against seconds.

bench/peers/run sets everything up and calls this. Writes into --out: runs.csv (every picture),
times.csv (seconds to given errors), chart.svg, and a contact sheet of pictures and differences.
"""

import argparse
import csv
import math
import os
import subprocess
import sys
import tempfile

import numpy as np

import programs
import report
import scene as scenes

SIZE = 500
TARGETS = (0.10, 0.05, 0.03, 0.01)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--hemilux", default="target/release/hemilux", help="our program")
    parser.add_argument("--scenes", nargs="+", default=["cornell", "office"])
    parser.add_argument("--peers", nargs="*", default=["mitsuba", "cycles", "luxcore"])
    parser.add_argument(
        "--methods",
        nargs="+",
        default=["hemilux", "stochastic,preset=paper"],
        help="methods of ours, each with settings of its own",
    )
    parser.add_argument("--set", nargs="*", default=[], help="settings of ours, name=value")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0, help="longest render")
    parser.add_argument("--reference-seconds", type=float, default=900.0, help="each of two halves")
    parser.add_argument("--reference", help="folder with SCENE-half-a.exr and SCENE-half-b.exr")
    parser.add_argument("--out", default="out/peers")
    return parser.parse_args()


class Reference:
    """Two independent halves; errors are free of the reference's own noise."""

    def __init__(self, halves, counted):
        self.halves, self.counted = halves, counted
        self.mean = np.mean([half[counted].mean() for half in halves])

    def error(self, picture):
        """rRMSE; negative where the estimate of its square is."""
        a, b = (picture[self.counted] - half[self.counted] for half in self.halves)
        squared = (a * b).mean() / self.mean**2
        return math.copysign(math.sqrt(abs(squared)), squared)

    def energy(self, picture):
        """Mean radiance over the reference's."""
        return picture[self.counted].mean() / self.mean

    def own_error(self):
        """rRMSE of the mean of both halves."""
        difference = self.halves[0][self.counted] - self.halves[1][self.counted]
        return math.sqrt((difference**2).mean() / 4) / self.mean

    def picture(self):
        return (self.halves[0] + self.halves[1]) / 2


def reference(options, name, scene, folder):
    """Given halves, or our unbiased path tracer run long, kept for the next time."""
    halves = []
    for seed, half in enumerate("ab"):
        path = os.path.join(folder, f"{name}-half-{half}.exr")
        given = os.path.join(options.reference or "", f"{name}-half-{half}.exr")
        if options.reference and os.path.exists(given):
            path = given
        elif not os.path.exists(path):
            print(f"{name}: reference, half {half}", flush=True)
            command = [options.hemilux, "render", scene, "--method", "ray-traced", "-o", path]
            command += ["--size", f"{SIZE}x{SIZE}", "--seconds", str(options.reference_seconds)]
            command += ["--seed", str(900_001 + seed), "--device", "cpu"]
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        halves.append(programs.read_exr(path))
    # What an emitter touches is far brighter than what anything reflects, and alike in both halves.
    meshes, _ = scenes.load(scene)
    dimmest = min(mesh.emission.max() for mesh in meshes if mesh.emission.any())
    bright = ((halves[0] + halves[1]) / 2).max(axis=-1) > 0.02 * dimmest
    emitter = near(bright & (np.minimum(*halves).max(axis=-1) > 0.9 * dimmest)) & bright
    return Reference(halves, ~near(emitter))


def near(mask):
    """The mask and its neighbouring pixels."""
    grown = mask.copy()
    for axis in (0, 1):
        for shift in (-1, 1):
            grown |= np.roll(mask, shift, axis)
    return grown


def efforts(options, ours):
    """Budgets in seconds for us, samples a pixel for peers."""
    if ours:
        budgets = [0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20, 30, 60]
        return [budget for budget in budgets if budget <= options.seconds]
    return [4**level for level in range(10)]


def measure(options, name, scene, folder, rows, best):
    """All programs on one scene, in turn within each effort and repetition."""
    truth = reference(options, name, scene, folder)
    print(f"{name}: the reference's own error is {truth.own_error():.4f}", flush=True)
    ours = [
        programs.Hemilux(options.hemilux, scene, method, SIZE, options.set)
        for method in options.methods
    ]
    peers = [programs.Peer(peer, scene) for peer in options.peers]
    try:
        with tempfile.TemporaryDirectory() as scratch:
            for repetition in range(options.repetitions):
                plan = {program: efforts(options, program in ours) for program in ours + peers}
                done = set()
                for level in range(max(map(len, plan.values()))):
                    for program, levels in plan.items():
                        if program in done or level >= len(levels):
                            continue
                        effort, seed = levels[level], 1 + 100 * repetition + level
                        results = program.render(effort, seed, os.path.join(scratch, "picture"))
                        for result, (seconds, picture) in results.items():
                            row = {
                                "scene": name,
                                "program": result,
                                "effort": effort,
                                "repetition": repetition,
                                "seconds": seconds,
                                "error": truth.error(picture),
                                "energy": truth.energy(picture),
                            }
                            rows.append(row)
                            best[name, result] = (seconds, picture)
                            print(
                                f"{name} {result:24} {effort:8} {seconds:8.2f} s"
                                f"  error {row['error']:.4f}  energy {row['energy']:.4f}",
                                flush=True,
                            )
                        # The next effort is four times this one.
                        if program in peers and 4 * max(s for s, _ in results.values()) > options.seconds:
                            done.add(program)
    finally:
        for peer in peers:
            peer.close()
    return truth


def start_ups(options, name, scene, folder, rows):
    """Seconds of the whole program: ours with reading the scene, theirs until the first answer."""
    for method in options.methods:
        program = programs.Hemilux(options.hemilux, scene, method, SIZE, options.set)
        _, _, whole = program.run(["--seconds", "0.1"], os.path.join(folder, "start"))
        rows.append({"scene": name, "program": f"hemilux {method}", "seconds": whole - 0.1})
    for peer in options.peers:
        program = programs.Peer(peer, scene)
        rows.append({"scene": name, "program": peer, "seconds": program.start_up})
        program.close()


def write(path, rows):
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            shown = {k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()}
            writer.writerow(shown)


def main():
    options = arguments()
    os.makedirs(options.out, exist_ok=True)
    cache = os.path.join(options.out, "reference")
    os.makedirs(cache, exist_ok=True)
    rows, best, truths, starts = [], {}, {}, []
    for name in options.scenes:
        scene = os.path.join(cache, f"{name}.glb")
        scenes.diffuse_copy(os.path.join("scenes", f"{name}.glb"), scene)
        truths[name] = measure(options, name, scene, cache, rows, best)
        start_ups(options, name, scene, cache, starts)
        write(os.path.join(options.out, "runs.csv"), rows)
    write(os.path.join(options.out, "start-up.csv"), starts)
    times = report.times(rows, TARGETS)
    write(os.path.join(options.out, "times.csv"), times)
    report.chart(rows, TARGETS, os.path.join(options.out, "chart.svg"))
    report.sheet(best, truths, options.out)
    print(report.table(times, starts, TARGETS))


if __name__ == "__main__":
    sys.exit(main())
