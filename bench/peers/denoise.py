"""Open Image Denoise, with albedo and normals."""

import numpy as np
import pyoidn


def denoise(color, albedo, normal):
    """Rows × columns × 3 each, linear and unbounded; on the processor."""
    arrays = [np.ascontiguousarray(layer, np.float32) for layer in (color, albedo, normal)]
    return pyoidn.denoise(arrays[0], albedo=arrays[1], normal=arrays[2], hdr=True)
