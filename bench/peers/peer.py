"""What the peers' processes share: requests as JSON lines in, figures and pictures out.

Every peer loads a scene once, renders it once to warm up (kernels, hierarchies), and then answers

    {"effort": samples a pixel, "seed": …, "out": path without ending}

(with "denoised": false for the plain picture alone, where the peer knows that), with seconds by
result name; each result is a picture PATH-NAME.npy, rows × columns × 3, linear.
"""

import json
import os
import sys
import time

import numpy as np

SIZE = 500

# Programs print to standard output, some when they are imported; the answers need it alone.
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)


def serve(make):
    """`make(scene path, size)` gives a function (effort, seed) → {name: (seconds, picture)}."""
    began = time.perf_counter()
    render = make(sys.argv[1], SIZE)
    render(1, 0)
    print(json.dumps({"ready": time.perf_counter() - began}), file=answers, flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        out = asked.pop("out")
        results = render(**asked)
        seconds = {}
        for name, (spent, picture) in results.items():
            seconds[name] = spent
            np.save(f"{out}-{name}.npy", np.asarray(picture, np.float32))
        print(json.dumps({"seconds": seconds}), file=answers, flush=True)
