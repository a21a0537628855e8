"""What pictures are judged by: references in two halves, which pixels count, three measures."""

import math
import os
import subprocess
import time

import numpy as np

import programs
import report
import scene as scenes

SIZE = 500
BLOCK = 16  # pixels, of the comparison of references
BLUR = 6.0  # pixels, standard deviation
MEASURES = ("error", "blurred", "flip")


class Reference:
    """Two independent halves; errors are free of the reference's own noise."""

    def __init__(self, halves, counted):
        self.halves, self.counted = halves, counted
        self.mean = np.mean([half[counted].mean() for half in halves])

    def error(self, picture):
        """rRMSE; negative where the estimate of its square is."""
        a, b = (picture[self.counted] - half[self.counted] for half in self.halves)
        return rooted((a * b).mean()) / self.mean

    def blurred(self, picture):
        """The same after a Gaussian over the pixels that count: what is left of noise from afar."""
        a, b = (blur(picture - half, self.counted)[self.counted] for half in self.halves)
        return rooted((a * b).mean()) / self.mean

    def flip(self, picture):
        """Mean LDR-FLIP at the exposure of the contact sheets; the reference's noise is in it."""
        import flip_evaluator

        exposure = report.exposure(self)
        encoded = [
            np.where(self.counted[..., None], report.encode(x, exposure), 0).astype(np.float32) / 255
            for x in (self.picture(), picture)
        ]
        found, _, _ = flip_evaluator.evaluate(
            *encoded, "LDR", applyMagma=False, computeMeanError=False
        )
        return float(np.asarray(found).reshape(self.counted.shape)[self.counted].mean())

    def energy(self, picture):
        """Mean radiance over the reference's."""
        return picture[self.counted].mean() / self.mean

    def own_error(self):
        """rRMSE of the mean of both halves."""
        difference = self.halves[0][self.counted] - self.halves[1][self.counted]
        return math.sqrt((difference**2).mean() / 4) / self.mean

    def picture(self):
        return (self.halves[0] + self.halves[1]) / 2

    def joined(self, other):
        """One reference of both, each half the mean of a half of either, by their precision."""
        ours, theirs = (1 / max(x.own_error() * x.mean, 1e-12) ** 2 for x in (self, other))
        pairs = zip(self.halves, other.halves)
        halves = [(ours * a + theirs * b) / (ours + theirs) for a, b in pairs]
        return Reference(halves, self.counted)

    def agrees(self, other, share):
        """Whether the means differ by less than a share and three deviations of their noise."""
        noise = math.hypot(self.own_error(), other.own_error()) / math.sqrt(self.counted.sum())
        return abs(other.mean / self.mean - 1) < share + 3 * noise

    def beside(self, other):
        """How another program's converged picture lies to ours: ratios of the means, and the root
        mean square difference of blocks over our mean, free of the noise of both."""
        ours, theirs = (x.picture()[self.counted].mean(axis=0) for x in (self, other))
        a, b = (
            blocks(their - our, self.counted) for their, our in zip(other.halves, self.halves)
        )
        channels = dict(zip(("red", "green", "blue"), theirs / ours))
        rms = rooted((a * b).mean()) / self.mean
        return {**channels, "mean": theirs.mean() / ours.mean(), "block_rms": rms}


def rooted(square):
    """The root, with the sign of what may be an estimate below zero."""
    return math.copysign(math.sqrt(abs(square)), square)


def blur(picture, counted):
    """Gaussian of the pixels that count, over the weight that they have there."""
    reach = np.arange(-int(3 * BLUR), int(3 * BLUR) + 1)
    kernel = np.exp(-0.5 * (reach / BLUR) ** 2)
    stack = np.concatenate([picture * counted[..., None], counted[..., None]], axis=-1)
    for axis in (0, 1):
        margin = [(0, 0)] * 3
        margin[axis] = (len(reach) // 2,) * 2
        padded = np.pad(stack, margin)
        length = stack.shape[axis]
        stack = sum(
            weight * padded.take(range(shift, shift + length), axis=axis)
            for shift, weight in enumerate(kernel)
        )
    return stack[..., :3] / np.maximum(stack[..., 3:], 1e-12)


def blocks(picture, counted):
    """Means of whole blocks over their pixels that count; blocks with less than half are left out."""
    height, width = (BLOCK * (length // BLOCK) for length in counted.shape)

    def sums(values):
        cut = values[:height, :width]
        cut = cut.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, -1)
        return cut.sum(axis=(1, 3))

    weights = sums(counted.astype(float))
    full = weights[..., 0] >= BLOCK**2 / 2
    return (sums(picture * counted[..., None]) / np.maximum(weights, 1))[full]


def near(mask):
    """The mask and its neighbouring pixels."""
    grown = mask.copy()
    for axis in (0, 1):
        for shift in (-1, 1):
            grown |= np.roll(mask, shift, axis)
    return grown


def helper(options, scene, path, light, *more):
    """A second of our path tracer, for a mask."""
    command = [options.hemilux, "render", scene, "--method", "ray-traced", "-o", path]
    command += ["--size", f"{SIZE}x{SIZE}", "--seconds", "1", "--device", "cpu"]
    subprocess.run([*command, *light.options(), *more], check=True, stderr=subprocess.DEVNULL)


def hidden(options, scene, folder):
    """Pixels that see the sky, if only in part, or that the sun itself shines on: a patch of sun in
    a room is hundreds of times as bright as the rest, and its outline would be all of the error."""
    path, light = os.path.join(folder, "mask.exr"), scenes.load_light(scene)
    helper(options, scene, path, light, "--background", "transparent")
    outside = near(programs.read_exr(path, "A") < 0.9999)
    if light.sun:
        sun = scenes.Light(None, light.sun)
        helper(options, scene, path, sun, "--sky", "none", "--set", "ray_depth=1")
        outside |= near(near(programs.read_exr(path).max(axis=-1) > 0))
    return outside


def shining(halves, scene):
    """Pixels that see an emitter: what it touches is far brighter than what anything reflects, and
    alike in both halves."""
    meshes, _ = scenes.load(scene)
    dimmest = min(mesh.emission.max() for mesh in meshes if mesh.emission.any())
    bright = ((halves[0] + halves[1]) / 2).max(axis=-1) > 0.02 * dimmest
    return near(near(bright & (np.minimum(*halves).max(axis=-1) > 0.9 * dimmest)) & bright)


def reference(options, name, scene, folder):
    """Given halves, or our unbiased path tracer run long, kept for the next time."""
    halves = []
    light = scenes.load_light(scene)
    for seed, half in enumerate("ab"):
        path = os.path.join(folder, f"{name}-half-{half}.exr")
        given = os.path.join(options.reference or "", f"{name}-half-{half}.exr")
        if options.reference and os.path.exists(given):
            path = given
        elif not os.path.exists(path):
            print(f"{name}: reference, half {half}", flush=True)
            command = [options.hemilux, "render", scene, "--method", "ray-traced", "-o", path]
            command += ["--size", f"{SIZE}x{SIZE}", "--seconds", str(options.reference_seconds)]
            command += ["--seed", str(900_001 + seed), "--device", "cpu", *light.options()]
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        halves.append(programs.read_exr(path))
    # Under a sky the camera sees no lamp in our scenes, and glints may be as bright as one.
    outside = hidden(options, scene, folder) if light.sky else shining(halves, scene)
    return Reference(halves, ~outside)


def converged(peer, name, counted, seconds, folder):
    """A peer's own mean of many pictures, in two halves, kept for the next time."""
    halves = []
    for seed, half in enumerate("ab"):
        path = os.path.join(folder, f"{name}-{peer.name}-half-{half}.npy")
        if not os.path.exists(path):
            print(f"{name}: {peer.name} converging, half {half}", flush=True)
            total, count, began = 0.0, 0, time.perf_counter()
            while count == 0 or time.perf_counter() - began < seconds:
                at = os.path.join(folder, "converging")
                seed_of_this = 10_000_000 * (seed + 1) + count
                found = peer.render(64, seed_of_this, at, denoised=False)
                total = total + found[peer.name][1].astype(np.float64)
                count += 1
            np.save(path, total / count)
        halves.append(np.load(path))
    return Reference(halves, counted)
