"""Mitsuba 3, path tracing in its LLVM mode, with and without Open Image Denoise."""

import time

import peer  # first: it takes standard output

import drjit as dr
import mitsuba as mi
import numpy as np

import denoise
import scene as scenes

mi.set_variant("llvm_ad_rgb")

from gltf_bsdf import GltfSurface  # needs the variant

SKY_TURN = 90.0  # degrees about +Y
GUIDE_SAMPLES = 16  # a pixel, for albedo and normals: a tenth of a second

SUN_DISTANCE = 1e5  # metres: what turns the sun's direction across a room is a thousandth of its radius


def texture(pixels):
    pixels = mi.Bitmap(np.ascontiguousarray(pixels, np.float32))
    return {"type": "bitmap", "bitmap": pixels, "raw": True, "filter_type": "bilinear"}


def material(mesh):
    """Mitsuba's own diffuse where the material has no lobe: it is the faster one."""
    if mesh.texture is None:
        reflectance = {"type": "rgb", "value": mesh.color.tolist()}
    else:
        reflectance = texture(mesh.texture * mesh.color)
    if mesh.lambert():
        bsdf = mi.load_dict({"type": "diffuse", "reflectance": reflectance})
    else:
        factors = np.array([0, mesh.roughness, mesh.metallic])
        surface = texture(mesh.surface * factors) if mesh.surface is not None else None
        if surface is None:
            surface = {"type": "rgb", "value": factors.tolist()}
        color, surface = mi.load_dict(reflectance), mi.load_dict(surface)
        bsdf = GltfSurface(color, surface, mesh.f0, mesh.f90)
    return mi.load_dict({"type": "twosided", "bsdf": bsdf}) if mesh.two_sided else bsdf


def shape(mesh, bsdf):
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    if mesh.emission.any():
        radiance = {"type": "rgb", "value": mesh.emission.tolist()}
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    made = mi.Mesh(
        mesh.name,
        len(mesh.positions),
        len(mesh.triangles),
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uvs is not None,
        props=properties,
    )
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mesh.positions.ravel()
    parameters["faces"] = mesh.triangles.ravel()
    if mesh.normals is not None:
        parameters["vertex_normals"] = mesh.normals.ravel()
    if mesh.uvs is not None:
        parameters["vertex_texcoords"] = mesh.uvs.ravel()
    parameters.update()
    return made


def sky(path):
    """Rows and columns stand as ours, but the middle of Mitsuba's map looks along another axis."""
    turned = mi.ScalarTransform4f().rotate([0, 1, 0], SKY_TURN)
    return {"type": "envmap", "filename": path, "to_world": turned}


def sun(described):
    """A disc so far away that its light is as good as parallel."""
    towards = np.array(described["direction"])
    sine = np.sin(described["angular_radius"])
    radiance = np.array(described["irradiance"]) / (np.pi * sine**2)
    centre = towards * SUN_DISTANCE
    above = [0, 1, 0] if abs(towards[1]) < 0.9 else [1, 0, 0]
    to_world = mi.ScalarTransform4f().look_at(centre.tolist(), [0, 0, 0], above)
    to_world = to_world.scale(SUN_DISTANCE * float(np.tan(described["angular_radius"])))
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}}
    return {"type": "disk", "to_world": to_world, "emitter": emitter}


def sensor(camera, size):
    # Mitsuba looks along +Z with +X to the left.
    to_world = camera.to_world @ np.diag([-1.0, 1.0, -1.0, 1.0])
    film = {
        "type": "hdrfilm",
        "width": size,
        "height": size,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
        "component_format": "float32",
    }
    return {
        "type": "perspective",
        "fov": float(np.degrees(camera.yfov)),
        "fov_axis": "y",
        "near_clip": 0.001,
        "far_clip": 1e6,
        "to_world": mi.ScalarTransform4f(to_world),
        "film": film,
    }


def load(path, size):
    meshes, cameras = scenes.load(path)
    description = {"type": "scene", "sensor": sensor(cameras[0], size)}
    bsdfs = {}
    for index, mesh in enumerate(meshes):
        if mesh.material not in bsdfs:
            bsdfs[mesh.material] = material(mesh)
        description[f"shape_{index}"] = shape(mesh, bsdfs[mesh.material])
    light = scenes.load_light(path)
    if light.sky:
        description["sky"] = sky(light.sky)
    if light.sun:
        description["sun"] = sun(light.sun)
    return mi.load_dict(description)


def make(path, size):
    scene = load(path, size)
    paths = mi.load_dict({"type": "path", "max_depth": -1})
    # For itself: around the path tracer, this integrator takes its paths twice.
    guides = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})

    def run(integrator, effort, seed):
        image = mi.render(scene, integrator=integrator, spp=effort, seed=seed)
        dr.eval(image)
        return np.array(image)

    def render(effort, seed, denoised=True):
        began = time.perf_counter()
        picture = run(paths, effort, seed)[..., :3]
        seconds = time.perf_counter() - began
        if not denoised:
            return {"mitsuba": (seconds, picture)}
        layers = run(guides, GUIDE_SAMPLES, seed + 1_000_000)
        smooth = denoise.denoise(picture, layers[..., :3], layers[..., 3:6])
        whole = time.perf_counter() - began
        return {"mitsuba": (seconds, picture), "mitsuba+oidn": (whole, smooth)}

    return render


if __name__ == "__main__":
    peer.serve(make)
