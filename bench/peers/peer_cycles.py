"""Cycles, path tracing on the processor, with and without Open Image Denoise."""

import os
import tempfile
import time

import peer  # first: it takes standard output

import bpy
import mathutils
import numpy as np
import OpenEXR

import scene as scenes


def material(mesh):
    """Diffuse reflection; emission from the front only."""
    made = bpy.data.materials.new(mesh.name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Roughness"].default_value = 0.0
    diffuse.inputs["Color"].default_value = (*mesh.color, 1.0)
    surface = diffuse.outputs[0]
    if mesh.texture is not None:
        rows, columns = mesh.texture.shape[:2]
        image = bpy.data.images.new(mesh.name, columns, rows, float_buffer=True)
        image.colorspace_settings.name = "Non-Color"
        pixels = np.ones((rows, columns, 4), np.float32)
        pixels[..., :3] = (mesh.texture * mesh.color)[::-1]
        image.pixels.foreach_set(pixels.ravel())
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        tree.links.new(node.outputs["Color"], diffuse.inputs["Color"])
    if mesh.emission.any():
        strength = mesh.emission.max()
        emission = tree.nodes.new("ShaderNodeEmission")
        emission.inputs["Color"].default_value = (*(mesh.emission / strength), 1.0)
        emission.inputs["Strength"].default_value = strength
        geometry = tree.nodes.new("ShaderNodeNewGeometry")
        sides = tree.nodes.new("ShaderNodeMixShader")
        tree.links.new(geometry.outputs["Backfacing"], sides.inputs[0])
        tree.links.new(emission.outputs[0], sides.inputs[1])
        tree.links.new(surface, sides.inputs[2])
        surface = sides.outputs[0]
    tree.links.new(surface, output.inputs["Surface"])
    return made


def make(path, size):
    meshes, cameras = scenes.load(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for mesh in meshes:
        data = bpy.data.meshes.new(mesh.name)
        data.from_pydata(mesh.positions.tolist(), [], mesh.triangles.tolist())
        data.materials.append(material(mesh))
        if mesh.uvs is not None:
            layer = data.uv_layers.new()
            corners = mesh.uvs[mesh.triangles.ravel()] * [1, -1] + [0, 1]
            layer.data.foreach_set("uv", corners.astype(np.float32).ravel())
        scene.collection.objects.link(bpy.data.objects.new(mesh.name, data))
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.angle = "VERTICAL", cameras[0].yfov
    lens.clip_start = 0.001
    view = bpy.data.objects.new("camera", lens)
    view.matrix_world = mathutils.Matrix(cameras[0].to_world.tolist())
    scene.collection.objects.link(view)
    scene.camera = view

    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.render.filter_size = 0.01
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = False
    cycles.max_bounces = cycles.diffuse_bounces = 1024
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0.0
    cycles.pixel_filter_type = "BOX"
    cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    black = bpy.data.worlds.new("black")
    black.use_nodes = True
    black.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    scene.world = black
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"

    def run(effort, seed, denoised):
        cycles.samples, cycles.seed, cycles.use_denoising = effort, seed, denoised
        began = time.perf_counter()
        bpy.ops.render.render()
        seconds = time.perf_counter() - began
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "picture.exr")
            bpy.data.images["Render Result"].save_render(file)
            with OpenEXR.File(file) as opened:
                channels = opened.channels()
                picture = channels["RGB" if "RGB" in channels else "RGBA"].pixels[..., :3].copy()
        return seconds, picture

    return lambda effort, seed: {
        "cycles": run(effort, seed, False),
        "cycles+oidn": run(effort, seed + 1_000_000, True),
    }


peer.serve(make)
