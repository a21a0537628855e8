"""Chart, table and contact sheets of a comparison."""

import math

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image, ImageDraw

matplotlib.rcParams.update({"svg.hashsalt": "hemilux", "font.family": "DejaVu Sans"})


def curves(rows, measure="error"):
    """(scene, program) → efforts as (median seconds, median, least and largest error)."""
    groups = {}
    for row in rows:
        key = (row["scene"], row["program"])
        groups.setdefault(key, {}).setdefault(row["effort"], []).append(row)
    result = {}
    for key, levels in groups.items():
        points = []
        for runs in levels.values():
            errors = [abs(run[measure]) for run in runs]
            seconds = float(np.median([run["seconds"] for run in runs]))
            points.append((seconds, float(np.median(errors)), min(errors), max(errors)))
        result[key] = sorted(points)
    return result


def seconds_to(points, target):
    """Seconds at which the median error first falls to the target, between measured points by a
    straight line in the logarithms; `None` where it never does."""
    before = None
    for seconds, error, *_ in points:
        if error <= target:
            if before is None:
                return seconds
            share = math.log(before[1] / target) / math.log(before[1] / error)
            return before[0] * (seconds / before[0]) ** share
        before = (seconds, error)
    return None


def times(rows, targets, measure="error"):
    """Seconds to every target, by scene and program."""
    result = []
    for (scene, program), points in curves(rows, measure).items():
        row = {"scene": scene, "program": program, "measure": measure}
        for target in targets:
            row[f"{target:.0%}"] = seconds_to(points, target)
        row["least error"] = min(error for _, error, *_ in points)
        row["most seconds"] = points[-1][0]
        result.append(row)
    return result


def table(times, starts, targets):
    """Markdown."""
    names = [f"{target:.0%}" for target in targets]
    lines = []
    for scene in dict.fromkeys(row["scene"] for row in times):
        lines += [f"| {scene}: seconds to | {' | '.join(names)} | least error, seconds | start-up |"]
        lines += ["|---" * (len(names) + 3) + "|"]
        for row in (row for row in times if row["scene"] == scene):
            cells = ["–" if row[name] is None else f"{row[name]:.2g}" for name in names]
            started = [
                start["seconds"]
                for start in starts
                if start["scene"] == scene and start["program"] == row["program"].split("+")[0]
            ]
            least = f"{row['least error']:.2%} in {row['most seconds']:.0f}"
            start = f"{started[0]:.1f}" if started else ""
            lines.append(f"| {row['program']} | {' | '.join(cells)} | {least} | {start} |")
        lines.append("")
    return "\n".join(lines)


def chart(rows, targets, path):
    """Error against seconds, a panel a scene, both logarithmic."""
    found = curves(rows)
    scenes = list(dict.fromkeys(scene for scene, _ in found))
    figure, panels = plt.subplots(1, len(scenes), figsize=(6.2 * len(scenes), 4.8), squeeze=False)
    programs = list(dict.fromkeys(program for _, program in found))
    colors = dict(zip(programs, plt.get_cmap("tab10").colors * 2))
    for panel, scene in zip(panels[0], scenes):
        for target in targets:
            panel.axhline(target, color="0.85", linewidth=0.8, zorder=0)
        for program in programs:
            points = found.get((scene, program), [])
            if not points:
                continue
            seconds, errors, low, high = zip(*points)
            ours = program.startswith("hemilux")
            style = "-" if ours or "+" in program else "--"
            panel.plot(seconds, errors, style, color=colors[program], label=program,
                       linewidth=2.4 if ours else 1.3, marker="o", markersize=3.5)
            panel.fill_between(seconds, low, high, color=colors[program], alpha=0.15, linewidth=0)
        panel.set(xscale="log", yscale="log", title=scene, xlabel="seconds of rendering",
                  ylabel="rRMSE")
        panel.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
        panel.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        panel.set_yticks([t for t in (1, 0.3, *targets, 0.005)])
        panel.minorticks_off()
        panel.grid(axis="x", color="0.92")
    handles, labels = panels[0][-1].get_legend_handles_labels()
    figure.tight_layout()
    # Below the panels: curves may go anywhere in them.
    figure.legend(
        handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=4, frameon=False
    )
    figure.savefig(path, metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)


def encode(picture, exposure):
    """sRGB bytes."""
    linear = np.clip(picture * exposure, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (255 * encoded + 0.5).astype(np.uint8)


def exposure(truth):
    """At which a scene's pictures are shown."""
    return 0.9 / np.percentile(truth.picture()[truth.counted], 98)


def difference(picture, truth):
    """|x − ref| over the mean of the reference, black 0 to white 20 %."""
    relative = np.abs(picture - truth.picture()).mean(axis=-1) / truth.mean
    relative[~truth.counted] = 0
    return np.repeat((255 * np.clip(relative / 0.2, 0, 1)).astype(np.uint8)[..., None], 3, axis=-1)


def sheet(best, truths, out):
    """A contact sheet a scene: each program's longest picture, and its difference below; whole as
    PNG, and half as large as JPEG for a page."""
    for scene, truth in truths.items():
        pictures = {p: found for (s, p), found in best.items() if s == scene}
        height, width = truth.picture().shape[:2]
        shown_at = exposure(truth)
        page = Image.new("RGB", (width * (len(pictures) + 1), 2 * height + 24), "white")
        draw = ImageDraw.Draw(page)
        columns = [("reference", truth.picture(), None)]
        columns += [(f"{p}, {s:.1f} s", picture, True) for p, (s, picture) in pictures.items()]
        for column, (title, picture, compared) in enumerate(columns):
            draw.text((column * width + 8, 6), title, fill="black")
            page.paste(Image.fromarray(encode(picture, shown_at)), (column * width, 24))
            if compared:
                shown = Image.fromarray(difference(picture, truth))
                page.paste(shown, (column * width, 24 + height))
        page.save(f"{out}/{scene}.png")
        page.reduce(2).save(f"{out}/{scene}.jpg", quality=85)
