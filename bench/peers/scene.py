"""Reads glTF binaries into plain arrays that any renderer can be given, and the light beside them.

Only what the compared scenes use: triangles with transforms and normals, base colour, roughness and
metallic (factors and PNG textures), a dielectric's reflectance, emission, perspective cameras. For
peers that are given Lambert's materials alone, `diffuse_copy` leaves the specular lobes out, for
the engine too. The light of SCENE.glb that is no surface stands in SCENE.light.json.
"""

import dataclasses
import io
import json
import os
import struct

import numpy as np
from PIL import Image

TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclasses.dataclass
class Mesh:
    """Triangles of one material in world space."""

    name: str
    material: int  # index in the file
    positions: np.ndarray  # vertices × 3, metres
    normals: np.ndarray | None  # vertices × 3, unit; None where the triangles are flat
    uvs: np.ndarray | None  # vertices × 2, v downwards as in glTF
    triangles: np.ndarray  # triangles × 3
    color: np.ndarray  # linear reflectance
    texture: np.ndarray | None  # rows × columns × 3, linear
    roughness: float
    metallic: float
    surface: np.ndarray | None  # rows × columns × 3: –, factors of roughness and of metallic
    f0: np.ndarray  # a dielectric's reflectance, head on
    f90: float  # and at grazing angles
    emission: np.ndarray  # radiance
    two_sided: bool

    def lambert(self):
        """Whether the material has no lobe beside Lambert's."""
        return not (self.metallic or self.f90 or self.f0.any())


@dataclasses.dataclass
class Camera:
    """Looks along its −Z, +Y up."""

    to_world: np.ndarray  # 4 × 4
    yfov: float  # radians


@dataclasses.dataclass
class Light:
    """What shines into a scene from far away."""

    sky: str | None  # path of an equirectangular map, laid out as glTF viewers and Hemilux have it
    sun: dict | None  # direction (towards it), irradiance (of a plane that faces it), angular_radius

    def options(self):
        """As Hemilux is told."""
        result = ["--sky", self.sky] if self.sky else []
        if self.sun:
            parts = (",".join(map(repr, self.sun[key])) for key in ("direction", "irradiance"))
            result += ["--sun=" + ":".join(parts)]
        return result


def light_path(path):
    return os.path.splitext(path)[0] + ".light.json"


def load_light(path):
    """The light beside a GLB."""
    if not os.path.exists(light_path(path)):
        return Light(None, None)
    with open(light_path(path)) as file:
        described = json.load(file)
    sky = described.get("sky")
    folder = os.path.dirname(path)
    return Light(sky and os.path.join(folder, sky), described.get("sun"))


def split(path):
    """JSON part and binary part of a GLB."""
    with open(path, "rb") as file:
        data = file.read()
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def join(document, binary, path):
    """Writes a GLB."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    parts = struct.pack("<II", len(text), 0x4E4F534A) + text
    parts += struct.pack("<II", len(binary), 0x004E4942) + binary
    with open(path, "wb") as file:
        file.write(struct.pack("<III", 0x46546C67, 2, 12 + len(parts)) + parts)


def diffuse_copy(path, out):
    """The scene without specular lobes: reflectance is exactly the base colour."""
    document, binary = split(path)
    for material in document["materials"]:
        extensions = material.setdefault("extensions", {})
        extensions.pop("KHR_materials_ior", None)
        extensions["KHR_materials_specular"] = {"specularFactor": 0.0}
        material.setdefault("pbrMetallicRoughness", {})["metallicFactor"] = 0.0
    used = {name for material in document["materials"] for name in material["extensions"]}
    document["extensionsUsed"] = sorted(used)
    join(document, binary, out)


def look_at(eye, target):
    """A camera's place, +Y up."""
    back = np.subtract(eye, target)
    back = back / np.linalg.norm(back)
    right = np.cross([0, 1, 0], back)
    right = right / np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return matrix


def with_camera(path, to_world, yfov, out):
    """The scene with this camera in place of its own."""
    document, binary = split(path)
    for node in document["nodes"]:
        node.pop("camera", None)
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": yfov, "znear": 0.01}}]
    document["nodes"].append({"camera": 0, "matrix": to_world.T.ravel().tolist()})
    document["scenes"][document.get("scene", 0)]["nodes"].append(len(document["nodes"]) - 1)
    join(document, binary, out)


def reflectance(material):
    """F0 and F90 of its dielectric part."""
    extensions = material.get("extensions", {})
    ior = extensions.get("KHR_materials_ior", {}).get("ior", 1.5)
    specular = extensions.get("KHR_materials_specular", {})
    assert "specularTexture" not in specular and "specularColorTexture" not in specular
    factor = specular.get("specularFactor", 1.0)
    color = np.array(specular.get("specularColorFactor", [1, 1, 1]), float)
    return np.minimum(((ior - 1) / (ior + 1)) ** 2 * color, 1) * factor, factor


def linear(encoded):
    """Of sRGB."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def load(path):
    """Meshes and cameras of a GLB."""
    document, binary = split(path)

    def accessor(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = TYPES[accessor["componentType"]]
        width = WIDTHS[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        assert view.get("byteStride", 0) in (0, np.dtype(kind).itemsize * width)
        values = np.frombuffer(binary, kind, accessor["count"] * width, start)
        return values.reshape(-1, width) if width > 1 else values

    def texture(reference, decode):
        if reference is None:
            return None
        assert "texCoord" not in reference or reference["texCoord"] == 0
        image = document["images"][document["textures"][reference["index"]]["source"]]
        view = document["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        picture = Image.open(io.BytesIO(binary[start : start + view["byteLength"]]))
        encoded = np.asarray(picture.convert("RGB"), np.float32) / 255
        return decode(encoded)

    meshes, cameras = [], []

    def visit(index, parent):
        node = document["nodes"][index]
        world = parent @ local(node)
        if "camera" in node:
            perspective = document["cameras"][node["camera"]]["perspective"]
            cameras.append(Camera(world, perspective["yfov"]))
        if "mesh" in node:
            for primitive in document["meshes"][node["mesh"]]["primitives"]:
                meshes.append(mesh(node, primitive, world))
        for child in node.get("children", []):
            visit(child, world)

    def mesh(node, primitive, world):
        material = document["materials"][primitive["material"]]
        assert "normalTexture" not in material and "emissiveTexture" not in material
        surface = material.get("pbrMetallicRoughness", {})
        attributes = primitive["attributes"]
        positions = accessor(attributes["POSITION"]) @ world[:3, :3].T + world[:3, 3]
        triangles = accessor(primitive["indices"]).reshape(-1, 3).astype(np.uint32)
        if np.linalg.det(world[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
        uvs = accessor(attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None
        strength = material.get("extensions", {}).get("KHR_materials_emissive_strength", {})
        emission = np.array(material.get("emissiveFactor", [0, 0, 0]), float)
        normals = None
        if "NORMAL" in attributes:
            normals = accessor(attributes["NORMAL"]) @ np.linalg.inv(world[:3, :3])
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            normals = normals.astype(np.float32)
        f0, f90 = reflectance(material)
        return Mesh(
            name=node.get("name", "mesh"),
            material=primitive["material"],
            positions=positions.astype(np.float32),
            normals=normals,
            uvs=uvs,
            triangles=triangles,
            color=np.array(surface.get("baseColorFactor", [1, 1, 1, 1])[:3], float),
            texture=texture(surface.get("baseColorTexture"), linear),
            roughness=surface.get("roughnessFactor", 1.0),
            metallic=surface.get("metallicFactor", 1.0),
            surface=texture(surface.get("metallicRoughnessTexture"), np.asarray),
            f0=f0,
            f90=f90,
            emission=emission * strength.get("emissiveStrength", 1.0),
            two_sided=material.get("doubleSided", False),
        )

    for root in document["scenes"][document.get("scene", 0)]["nodes"]:
        visit(root, np.eye(4))
    return meshes, cameras


def local(node):
    """A node's own transform."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", [1, 1, 1]), float)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix
