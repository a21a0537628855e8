"""Hemilux and its peers in turn on the same scenes: error against seconds.

bench/peers/run sets everything up and calls this. Writes into --out: runs.csv (every picture),
times.csv (seconds to given errors), agreement.csv (converged pictures of peers beside ours),
chart.svg, and a contact sheet of pictures and differences.
"""

import argparse
import csv
import os
import sys
import tempfile

import compared
import programs
import report
import truth as truths
from truth import SIZE

TARGETS = (0.10, 0.05, 0.03, 0.02, 0.01)
# On diffuse scenes: the default method, path tracing by the same engine, and the paper's method at its best and
# as printed.
OURS = ["hemilux", "ray-traced", "stochastic,constant_radiance=corrected", "stochastic,preset=paper"]
AGREEING = 0.005  # difference of means up to which a peer's converged picture counts as truth too


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--hemilux", default="target/release/hemilux", help="our program")
    parser.add_argument(
        "--exporter", default="target/release/hemilux-bench", help="writes our benchmark's scenes"
    )
    parser.add_argument(
        "--scenes", nargs="+", default=list(compared.DIFFUSE),
        choices=[*compared.DIFFUSE, *compared.WHOLE],
    )
    parser.add_argument("--peers", nargs="*", default=["mitsuba", "cycles", "luxcore"])
    parser.add_argument(
        "--methods",
        nargs="+",
        help="methods of ours, each with settings of its own; hemilux, and on diffuse scenes"
        " ray-traced and the paper's method, too",
    )
    parser.add_argument("--set", nargs="*", default=[], help="settings of ours, name=value")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0, help="longest render")
    parser.add_argument("--reference-seconds", type=float, default=900.0, help="each of two halves")
    parser.add_argument(
        "--converged-seconds", type=float,
        help="each of two halves of a peer's own reference; a third of --reference-seconds",
    )
    parser.add_argument("--reference", help="folder with SCENE-half-a.exr and SCENE-half-b.exr")
    parser.add_argument("--out", default="out/peers")
    options = parser.parse_args()
    if options.converged_seconds is None:
        options.converged_seconds = options.reference_seconds / 3
    return options


def methods_on(options, name):
    if options.methods:
        return options.methods
    return OURS if name in compared.DIFFUSE else ["hemilux"]


def peers_on(options, name):
    """Those that are given the scene's materials."""
    return [
        peer for peer in options.peers if name in compared.DIFFUSE or peer in compared.KNOWING
    ]


def efforts(options, ours):
    """Budgets in seconds for us, samples a pixel for peers."""
    if ours:
        budgets = [0.016, 0.05, 0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20, 30, 60, 120, 300]
        return [budget for budget in budgets if budget <= options.seconds]
    return [4**level for level in range(10)]


def judged(truth, name, result, effort, repetition, seconds, picture):
    """A row of runs.csv, printed too."""
    row = {
        "scene": name,
        "program": result,
        "effort": effort,
        "repetition": repetition,
        "seconds": seconds,
        **{measure: getattr(truth, measure)(picture) for measure in truths.MEASURES},
        "energy": truth.energy(picture),
    }
    shown = "  ".join(f"{key} {row[key]:.4f}" for key in (*truths.MEASURES, "energy"))
    print(f"{name} {result:24} {effort:8} {seconds:8.2f} s  {shown}", flush=True)
    return row


def agree(options, name, peers, truth, folder, agreements):
    """Holds converged pictures of the peers that are given a scene as it is against our reference.
    Where the means agree they are joined with it, which makes it less noisy and nobody's own."""
    joined = truth
    for peer in peers if name in compared.WHOLE else []:
        other = truths.converged(peer, name, truth.counted, options.converged_seconds, folder)
        row = {
            "scene": name, "program": peer.name, **truth.beside(other),
            "own_error": other.own_error(), "our_own_error": truth.own_error(),
        }
        if truth.agrees(other, AGREEING):
            joined = joined.joined(other)
        agreements.append({**row, "joined_own_error": joined.own_error()})
        shown = agreements[-1].items()
        print("  ".join(f"{k} {v:.4f}" if isinstance(v, float) else v for k, v in shown), flush=True)
    return joined


def measure(options, name, scene, folder, rows, best, agreements):
    """All programs on one scene, in turn within each effort and repetition."""
    truth = truths.reference(options, name, scene, folder)
    print(f"{name}: the reference's own error is {truth.own_error():.4f}", flush=True)
    ours = [
        programs.Hemilux(options.hemilux, scene, method, SIZE, options.set)
        for method in methods_on(options, name)
    ]
    peers = [programs.Peer(peer, scene) for peer in peers_on(options, name)]
    try:
        truth = agree(options, name, peers, truth, folder, agreements)
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
                            rows.append(
                                judged(truth, name, result, effort, repetition, seconds, picture)
                            )
                            best[name, result] = (seconds, picture)
                        # The next effort is four times this one; what denoising takes stays.
                        least = min(seconds for seconds, _ in results.values())
                        if program in peers and 4 * least > options.seconds:
                            done.add(program)
    finally:
        for peer in peers:
            peer.close()
    return truth


def start_ups(options, name, scene, folder, rows):
    """Seconds of the whole program: ours with reading the scene, theirs until the first answer."""
    for method in methods_on(options, name):
        program = programs.Hemilux(options.hemilux, scene, method, SIZE, options.set)
        _, _, whole = program.run(["--seconds", "0.1"], os.path.join(folder, "start"))
        rows.append({"scene": name, "program": f"hemilux {method}", "seconds": whole - 0.1})
    for peer in peers_on(options, name):
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
    rows, best, references, starts, agreements = [], {}, {}, [], []
    for name in options.scenes:
        try:
            scene = compared.prepare(name, cache, options.exporter)
        except compared.Missing as missing:
            print(f"{name}: left out: {missing}", flush=True)
            continue
        references[name] = measure(options, name, scene, cache, rows, best, agreements)
        start_ups(options, name, scene, cache, starts)
        write(os.path.join(options.out, "runs.csv"), rows)
        if agreements:
            write(os.path.join(options.out, "agreement.csv"), agreements)
    if not rows:
        return "nothing was measured"
    write(os.path.join(options.out, "start-up.csv"), starts)
    times = [row for kind in truths.MEASURES for row in report.times(rows, TARGETS, kind)]
    write(os.path.join(options.out, "times.csv"), times)
    report.chart(rows, TARGETS, os.path.join(options.out, "chart.svg"))
    report.sheet(best, references, options.out)
    for kind in truths.MEASURES:
        chosen = [row for row in times if row["measure"] == kind]
        print(f"{kind}:\n\n{report.table(chosen, starts, TARGETS)}")


if __name__ == "__main__":
    sys.exit(main())
