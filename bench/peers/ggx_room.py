"""A furnished room under a sky whose every surface has a GGX lobe: glTF binary and sky map.

Metals and dielectrics of roughness .2 to .8, one window without glass, one lamp. Everything is a
closed body, so that no program's way with the backs of surfaces matters. The seed moves the chairs,
and the books and balls on the table and shelves.
"""

import json
import os

import numpy as np

import scene as scenes

WIDTH, HEIGHT, DEPTH = 5.0, 2.8, 4.0  # metres, inside
THICK = 0.2
WINDOW = ((0.9, 2.2), (0.9, 3.1))  # heights and depths of the opening in the wall at x = 0
EYE, TARGET, YFOV = (4.7, 1.5, 3.75), (2.3, 0.7, 0.8), 0.95

# Name: base colour, roughness, metallic.
MATERIALS = {
    "plaster": ((0.74, 0.72, 0.68), 0.8, 0),
    "parquet": ((0.42, 0.27, 0.16), 0.4, 0),
    "oak": ((0.55, 0.38, 0.22), 0.5, 0),
    "lacquer": ((0.12, 0.22, 0.38), 0.3, 0),
    "fabric": ((0.5, 0.16, 0.13), 0.8, 0),
    "china": ((0.8, 0.8, 0.77), 0.2, 0),
    "gold": ((0.95, 0.72, 0.36), 0.25, 1),
    "copper": ((0.9, 0.58, 0.46), 0.45, 1),
    "steel": ((0.62, 0.61, 0.6), 0.35, 1),
}


def box(low, high):
    """Vertices and triangles, outside to the front."""
    corners = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
    positions = np.where(corners, high, low).astype(float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return positions, np.array(triangles), None


def turned(body, angle, place):
    """About +Y, then moved."""
    positions, triangles, normals = body
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return positions @ matrix.T + place, triangles, normals if normals is None else normals @ matrix.T


def revolved(profile, centre, steps=64):
    """A body of revolution from (radius, height) pairs from below to above, smooth; its ends meet
    the axis."""
    profile = np.array(profile, float)
    slope = np.gradient(profile, axis=0)
    outward = np.stack([slope[:, 1], -slope[:, 0]], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    angles = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def around(pairs):
        flat = pairs[:, None, 0, None] * circle[None]
        tall = np.broadcast_to(pairs[:, None, 1], flat.shape[:2])
        return np.stack([flat[..., 0], tall, flat[..., 1]], axis=-1).reshape(-1, 3)

    triangles = []
    for row in range(len(profile) - 1):
        for column in range(steps):
            a, b = row * steps + column, row * steps + (column + 1) % steps
            c, d = a + steps, b + steps
            if profile[row + 1, 0] > 0:
                triangles.append((a, c, d))
            if profile[row, 0] > 0:
                triangles.append((a, d, b))
    return around(profile) + centre, np.array(triangles), around(outward)


def ball(centre, radius):
    angles = np.linspace(-np.pi / 2, np.pi / 2, 33)
    profile = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    profile[[0, -1], 0] = 0
    return revolved(profile, centre)


def vase(place):
    profile = [(0, 0), (0.05, 0.0), (0.07, 0.01), (0.11, 0.09), (0.12, 0.16), (0.09, 0.25)]
    profile += [(0.05, 0.31), (0.045, 0.35), (0.06, 0.38), (0.05, 0.385), (0, 0.37)]
    return revolved(profile, place)


def shell():
    """Floor, ceiling and walls, as bodies of plaster and parquet."""
    (low, high), (near, far) = WINDOW
    w, h, d, t = WIDTH, HEIGHT, DEPTH, THICK
    yield "parquet", box((-t, -t, -t), (w + t, 0, d + t))
    yield "plaster", box((-t, h, -t), (w + t, h + t, d + t))
    yield "plaster", box((w, 0, -t), (w + t, h, d + t))
    yield "plaster", box((0, 0, -t), (w, h, 0))
    yield "plaster", box((0, 0, d), (w, h, d + t))
    yield "plaster", box((-t, 0, -t), (0, low, d + t))
    yield "plaster", box((-t, high, -t), (0, h, d + t))
    yield "plaster", box((-t, low, -t), (0, high, near))
    yield "plaster", box((-t, low, far), (0, high, d + t))


def table(place):
    x, z = place
    yield "oak", box((x - 0.7, 0.71, z - 0.4), (x + 0.7, 0.75, z + 0.4))
    for dx in (-0.64, 0.6):
        for dz in (-0.34, 0.3):
            yield "steel", box((x + dx, 0, z + dz), (x + dx + 0.04, 0.71, z + dz + 0.04))


def chair(place, angle):
    at = (place[0], 0, place[1])
    parts = [("fabric", box((-0.21, 0.43, -0.21), (0.21, 0.48, 0.21)))]
    parts += [("oak", box((-0.21, 0.55, -0.24), (0.21, 0.92, -0.21)))]
    for x in (-0.21, 0.18):
        parts += [("steel", box((x, 0, -0.24), (x + 0.03, 0.9, -0.211)))]
        parts += [("steel", box((x, 0, 0.17), (x + 0.03, 0.43, 0.2)))]
    for name, body in parts:
        yield name, turned(body, angle, at)


def things(random):
    """What stands about."""
    yield from table((2.1, 1.9))
    jitter = random.uniform(-0.25, 0.25, 3)
    yield from chair((1.75, 1.35), 0.0 + jitter[0])
    yield from chair((2.5, 1.3), 0.0 + jitter[1])
    yield from chair((2.2, 2.65), np.pi + jitter[2])
    yield "lacquer", box((2.6, 0, 0.02), (4.2, 0.8, 0.47))
    yield "china", vase((2.9, 0.8, 0.25))
    yield "gold", ball((3.4, 0.95, 0.25), 0.15)
    yield "copper", ball((3.65, 0.28, 1.75), 0.28)
    yield "steel", ball((1.55, 0.87, 1.85), 0.12)
    yield "gold", vase((2.15, 0.75, 1.75))
    yield "china", ball((2.5, 0.85, 2.05), 0.1)
    height = 0.75
    for name in ("lacquer", "fabric", "oak"):
        turn = random.uniform(-0.4, 0.4)
        book = box((-0.11, height, -0.15), (0.11, height + 0.035, 0.15))
        yield name, turned(book, turn, (1.75, 0, 2.1))
        height += 0.035
    for x in np.arange(3.75, 4.05, 0.055):
        tall = random.uniform(0.18, 0.28)
        name = ("fabric", "lacquer", "oak", "copper")[random.integers(4)]
        yield name, box((x, 0.8, 0.06), (x + 0.045, 0.8 + tall, 0.26))


def lamp():
    """A panel below the ceiling; it shines downwards from its lower side."""
    x, z = (2.4, 3.0), (2.6, 3.2)
    y = HEIGHT - 0.02
    positions = np.array([[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]])
    return positions, np.array([[0, 1, 2], [0, 2, 3]]), None


def sky():
    """Blue above, bright at the horizon, dark below, with a wide bright patch before the window."""
    rows, columns = 128, 256
    v, u = np.arange(rows) / (rows - 1), (np.arange(columns) + 0.5) / columns
    polar, azimuth = np.meshgrid(np.pi * v, 2 * np.pi * (u - 0.5), indexing="ij")
    x = np.sin(polar) * np.cos(azimuth)
    y, z = np.cos(polar), np.sin(polar) * np.sin(azimuth)
    up = np.clip(y, 0, 1)[..., None]
    above = np.array([0.9, 1.0, 1.1]) * (1 - up) + np.array([0.25, 0.45, 0.95]) * up
    patch = np.array([-0.8, 0.55, 0.25]) / np.linalg.norm([-0.8, 0.55, 0.25])
    glow = np.exp(60 * (np.stack([x, y, z], axis=-1) @ patch - 1))[..., None]
    radiance = 6 * above + 90 * glow * np.array([1.0, 0.85, 0.65])
    return np.where(y[..., None] >= 0, radiance, np.array([0.9, 0.85, 0.75])).astype(np.float32)


def bodies(seed):
    """Material name → one mesh of all bodies of it; flat bodies have their vertices split."""
    found = {}
    everything = [*shell(), *things(np.random.default_rng(seed)), ("lamp", lamp())]
    for name, (positions, triangles, normals) in everything:
        if normals is None:
            corners = positions[triangles]
            flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            positions, normals = corners.reshape(-1, 3), np.repeat(flat, 3, axis=0)
            triangles = np.arange(len(positions)).reshape(-1, 3)
        held = found.setdefault(name, ([], [], []))
        count = sum(map(len, held[0]))
        for part, values in zip(held, (positions, triangles + count, normals)):
            part.append(values)
    return {name: [np.concatenate(part) for part in held] for name, held in found.items()}


def write(folder, name, seed=1):
    """NAME.glb, NAME.light.json and NAME-sky.exr."""
    import OpenEXR

    made = bodies(seed)
    binary, views, accessors, meshes, materials = b"", [], [], [], []

    def add(values, kind, component):
        nonlocal binary
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": component,
                          "count": len(values), "type": kind})
        if kind == "VEC3":
            accessors[-1].update(min=values.min(axis=0).tolist(), max=values.max(axis=0).tolist())
        binary += values.tobytes()
        return len(accessors) - 1

    for material, (positions, triangles, normals) in made.items():
        attributes = {
            "POSITION": add(positions.astype(np.float32), "VEC3", 5126),
            "NORMAL": add(normals.astype(np.float32), "VEC3", 5126),
        }
        indices = add(triangles.astype(np.uint32).ravel(), "SCALAR", 5125)
        primitive = {"attributes": attributes, "indices": indices, "material": len(materials)}
        meshes.append({"name": material, "primitives": [primitive]})
        materials.append(described(material))
    nodes = [{"mesh": index, "name": mesh["name"]} for index, mesh in enumerate(meshes)]
    camera = scenes.look_at(EYE, TARGET)
    nodes.append({"camera": 0, "matrix": camera.T.ravel().tolist()})
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes, "meshes": meshes, "materials": materials,
        "cameras": [{"type": "perspective", "perspective": {"yfov": YFOV, "znear": 0.01}}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
        "extensionsUsed": ["KHR_materials_emissive_strength", "KHR_materials_specular"],
    }
    path = os.path.join(folder, f"{name}.glb")
    scenes.join(document, binary, path)
    channels = {"RGB": sky()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(os.path.join(folder, f"{name}-sky.exr"))
    with open(scenes.light_path(path), "w") as file:
        json.dump({"sky": f"{name}-sky.exr"}, file)
    return path


def described(name):
    """A material of the file."""
    if name == "lamp":
        return {
            "name": name,
            "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0},
            "emissiveFactor": [1.0, 0.85, 0.7],
            "extensions": {
                "KHR_materials_emissive_strength": {"emissiveStrength": 25.0},
                "KHR_materials_specular": {"specularFactor": 0.0},
            },
        }
    color, roughness, metallic = MATERIALS[name]
    factors = {"roughnessFactor": roughness, "metallicFactor": metallic}
    return {"name": name, "pbrMetallicRoughness": {"baseColorFactor": [*color, 1], **factors}}
