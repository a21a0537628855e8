"""Mitsuba 3, path tracing in its LLVM mode, with and without Open Image Denoise."""

import time

import peer  # first: it takes standard output

import drjit as dr
import mitsuba as mi
import numpy as np

import denoise
import scene as scenes

mi.set_variant("llvm_ad_rgb")


def material(mesh):
    if mesh.texture is None:
        reflectance = {"type": "rgb", "value": mesh.color.tolist()}
    else:
        pixels = (mesh.texture * mesh.color).astype(np.float32)
        bitmap = mi.Bitmap(pixels)
        reflectance = {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear"}
    diffuse = {"type": "diffuse", "reflectance": reflectance}
    return {"type": "twosided", "bsdf": diffuse} if mesh.two_sided else diffuse


def shape(mesh):
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(material(mesh))
    if mesh.emission.any():
        radiance = {"type": "rgb", "value": mesh.emission.tolist()}
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    made = mi.Mesh(
        mesh.name,
        len(mesh.positions),
        len(mesh.triangles),
        has_vertex_texcoords=mesh.uvs is not None,
        props=properties,
    )
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mesh.positions.ravel()
    parameters["faces"] = mesh.triangles.ravel()
    if mesh.uvs is not None:
        parameters["vertex_texcoords"] = mesh.uvs.ravel()
    parameters.update()
    return made


def make(path, size):
    meshes, cameras = scenes.load(path)
    camera = cameras[0]
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
    description = {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(camera.yfov)),
            "fov_axis": "y",
            "near_clip": 0.001,
            "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f(to_world),
            "film": film,
        },
    }
    for index, mesh in enumerate(meshes):
        description[f"shape_{index}"] = shape(mesh)
    scene = mi.load_dict(description)
    path_tracer = {"type": "path", "max_depth": -1}
    plain = mi.load_dict(path_tracer)
    guided = mi.load_dict(
        {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "inner": path_tracer}
    )

    def run(integrator, effort, seed):
        began = time.perf_counter()
        image = mi.render(scene, integrator=integrator, spp=effort, seed=seed)
        dr.eval(image)
        picture = np.array(image)
        return time.perf_counter() - began, picture

    def render(effort, seed):
        seconds, picture = run(plain, effort, seed)
        guided_seconds, layers = run(guided, effort, seed + 1_000_000)
        began = time.perf_counter()
        smooth = denoise.denoise(layers[..., :3], layers[..., 3:6], layers[..., 6:9])
        denoised = guided_seconds + time.perf_counter() - began
        return {"mitsuba": (seconds, picture[..., :3]), "mitsuba+oidn": (denoised, smooth)}

    return render


peer.serve(make)
