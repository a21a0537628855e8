"""LuxCore, path tracing on the processor, with and without Open Image Denoise."""

import time

import peer  # first: it takes standard output

import numpy as np
import pyluxcore

import scene as scenes


def make(path, size):
    pyluxcore.Init()
    meshes, cameras = scenes.load(path)
    scene = pyluxcore.Scene()
    world = cameras[0].to_world
    eye, forward, up = world[:3, 3], -world[:3, 2], world[:3, 1]
    view = pyluxcore.Properties()
    view.Set(pyluxcore.Property("scene.camera.type", "perspective"))
    view.Set(pyluxcore.Property("scene.camera.lookat.orig", eye.tolist()))
    view.Set(pyluxcore.Property("scene.camera.lookat.target", (eye + forward).tolist()))
    view.Set(pyluxcore.Property("scene.camera.up", up.tolist()))
    view.Set(pyluxcore.Property("scene.camera.fieldofview", float(np.degrees(cameras[0].yfov))))
    view.Set(pyluxcore.Property("scene.camera.cliphither", 0.001))
    view.Set(pyluxcore.Property("scene.camera.autovolume.enable", False))
    scene.Parse(view)
    for index, mesh in enumerate(meshes):
        described = pyluxcore.Properties()
        color = mesh.color.tolist()
        if mesh.texture is not None:
            rows, columns = mesh.texture.shape[:2]
            pixels = np.ascontiguousarray(mesh.texture * mesh.color, np.float32)
            scene.DefineImageMap(f"image{index}", pixels.tobytes(), 1.0, 3, columns, rows)
            described.Set(pyluxcore.Property(f"scene.textures.t{index}.type", "imagemap"))
            described.Set(pyluxcore.Property(f"scene.textures.t{index}.file", f"image{index}"))
            described.Set(pyluxcore.Property(f"scene.textures.t{index}.gamma", 1.0))
            described.Set(pyluxcore.Property(f"scene.textures.t{index}.mapping.type", "uvmapping2d"))
            color = f"t{index}"
        material = f"scene.materials.m{index}"
        described.Set(pyluxcore.Property(f"{material}.type", "matte"))
        described.Set(pyluxcore.Property(f"{material}.kd", color))
        if mesh.emission.any():
            described.Set(pyluxcore.Property(f"{material}.emission", mesh.emission.tolist()))
            described.Set(pyluxcore.Property(f"{material}.emission.gain", [1.0] * 3))
            described.Set(pyluxcore.Property(f"{material}.emission.power", 0.0))
            described.Set(pyluxcore.Property(f"{material}.emission.normalizebycolor", False))
        scene.Parse(described)
        uvs = None if mesh.uvs is None else [tuple(map(float, uv)) for uv in mesh.uvs]
        points = [tuple(map(float, point)) for point in mesh.positions]
        faces = [tuple(map(int, face)) for face in mesh.triangles]
        scene.DefineMesh(f"shape{index}", points, faces, None, uvs, None, None)
        placed = pyluxcore.Properties()
        placed.Set(pyluxcore.Property(f"scene.objects.o{index}.shape", f"shape{index}"))
        placed.Set(pyluxcore.Property(f"scene.objects.o{index}.material", f"m{index}"))
        scene.Parse(placed)

    def run(effort, seed, denoised):
        settings = pyluxcore.Properties()

        def put(name, value):
            settings.Set(pyluxcore.Property(name, value))

        put("renderengine.type", "PATHCPU")
        put("renderengine.seed", seed + 1)
        put("sampler.type", "SOBOL")
        put("film.width", size)
        put("film.height", size)
        put("film.filter.type", "NONE")
        put("path.pathdepth.total", 64)
        for bounce in ("diffuse", "glossy", "specular"):
            put(f"path.pathdepth.{bounce}", 64)
        put("path.clamping.variance.maxvalue", 0.0)
        put("batch.haltspp", [effort, 0])
        put("film.imagepipelines.0.0.type", "NOP")
        if denoised:
            put("film.imagepipelines.0.0.type", "INTEL_OIDN")
            put("film.imagepipelines.0.0.prefilter.enable", False)
            put("film.imagepipelines.0.1.type", "NOP")
        config = pyluxcore.RenderConfig(settings, scene)
        session = pyluxcore.RenderSession(config)
        began = time.perf_counter()
        session.Start()
        while not session.HasDone():
            time.sleep(0.005)
            session.UpdateStats()
        film = session.GetFilm()
        picture = np.zeros((size, size, 3), np.float32)
        film.GetOutputFloat(pyluxcore.FilmOutputType.RGB_IMAGEPIPELINE, picture, 0, True)
        seconds = time.perf_counter() - began
        session.Stop()
        # Rows come from the bottom up, one row lower than everyone else's.
        rows = picture[::-1]
        return seconds, np.concatenate([rows[1:], rows[-1:]])

    return lambda effort, seed: {
        "luxcore": run(effort, seed, False),
        "luxcore+oidn": run(effort, seed + 1_000_000, True),
    }


peer.serve(make)
