"""The programs that are compared, each behind the same call."""

import json
import os
import subprocess
import sys
import time

import numpy as np

import scene as scenes

HERE = os.path.dirname(os.path.abspath(__file__))


class Peer:
    """A peer in a process of its own, with the scene loaded and warm."""

    def __init__(self, name, scene):
        began = time.perf_counter()
        command = [sys.executable, os.path.join(HERE, f"peer_{name}.py"), scene]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self.name = name
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError(f"{name} could not load {scene}: run peer_{name}.py by hand")
        self.start_up = time.perf_counter() - began

    def render(self, effort, seed, out, **options):
        """Seconds and picture by result name."""
        request = {"effort": effort, "seed": seed, "out": out, **options}
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError(f"{self.name} ended at {request}")
        seconds = json.loads(answer)["seconds"]
        return {name: (spent, np.load(f"{out}-{name}.npy")) for name, spent in seconds.items()}

    def close(self):
        self.process.stdin.close()
        self.process.wait(timeout=60)


class Hemilux:
    """Our program; its effort is a time budget, seconds. A method may bring settings of its own,
    as in `stochastic,preset=paper`."""

    def __init__(self, binary, scene, method, size, settings=()):
        self.name = method
        method, *own = method.split(",")
        settings = [*settings, *own]
        self.command = [binary, "render", scene, "--method", method, "--device", "cpu"]
        self.command += ["--size", f"{size}x{size}", *scenes.load_light(scene).options()]
        for setting in settings:
            self.command += ["--set", setting]

    def run(self, arguments, out):
        """Stats, picture, and seconds with start-up."""
        files = ["-o", f"{out}-{self.name}.exr", "--stats", f"{out}-{self.name}.json"]
        began = time.perf_counter()
        subprocess.run([*self.command, *files, *arguments], check=True, capture_output=True)
        whole = time.perf_counter() - began
        with open(f"{out}-{self.name}.json") as file:
            return json.load(file), read_exr(f"{out}-{self.name}.exr"), whole

    def render(self, effort, seed, out):
        """Seconds of solving, and picture."""
        stats, picture, _ = self.run(["--seconds", str(effort), "--seed", str(seed)], out)
        return {f"hemilux {self.name}": (stats["seconds_solve"], picture)}


def read_exr(path, wanted="RGB"):
    """Rows × columns × 3, or rows × columns of the one channel that is wanted."""
    import OpenEXR

    with OpenEXR.File(path) as opened:
        channels = opened.channels()
        packed = next((name for name in ("RGB", "RGBA") if name in channels), None)
        if packed:
            pixels = channels[packed].pixels
            planes = [pixels[..., packed.index(name)] for name in wanted]
        else:
            planes = [channels[name].pixels for name in wanted]
    return np.array(planes[0] if len(wanted) == 1 else np.stack(planes, axis=-1), np.float64)
