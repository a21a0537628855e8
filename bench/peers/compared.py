"""The compared scenes by name, each written as a GLB with its camera and the light beside it."""

import json
import os
import shutil
import subprocess

import numpy as np

import ggx_room
import scene as scenes

# Given to every peer, without their specular lobes.
DIFFUSE = ("cornell", "office")
# Given as they are, to peers that know the materials of glTF.
WHOLE = ("duck", "sunlit", "ggx-room")
KNOWING = ("mitsuba",)
SHARED = os.path.join(os.environ.get("HEMILUX_SHARED_DIR", "../shared"), "gltf")


class Missing(Exception):
    """A scene's files are not here."""


def prepare(name, folder, exporter):
    """The path of the scene's GLB in the folder."""
    path = os.path.join(folder, f"{name}.glb")
    if name == "duck":
        duck(path)
    elif name == "sunlit":
        sunlit(path, exporter)
    elif name == "ggx-room":
        ggx_room.write(folder, name)
    else:
        scenes.diffuse_copy(os.path.join("scenes", f"{name}.glb"), path)
    return path


def duck(path):
    """The rubber duck of the glTF sample models, in a grey studio."""
    cases = os.path.join(SHARED, "cases.json")
    if not os.path.exists(cases):
        raise Missing(f"{cases} is not there; HEMILUX_SHARED_DIR says where the sample models are")
    with open(cases) as file:
        case = json.load(file)["Duck"]
    camera = scenes.look_at(case["eye"], case["target"])
    model = os.path.join(SHARED, case["file"])
    scenes.with_camera(model, camera, float(np.radians(case["yfov_degrees"])), path)
    sky = os.path.basename(path)[: -len(".glb")] + "-sky.exr"
    shutil.copyfile(
        os.path.join(SHARED, case["environment"]), os.path.join(os.path.dirname(path), sky)
    )
    with open(scenes.light_path(path), "w") as file:
        json.dump({"sky": sky}, file)


def sunlit(path, exporter):
    """The scene `window` of our own benchmark: a room that sun and sky shine into."""
    folder = os.path.dirname(path)
    subprocess.run([exporter, "export", "window", "--out", folder], check=True, stdout=2)
    os.replace(os.path.join(folder, "window.glb"), path)
    os.replace(os.path.join(folder, "window.light.json"), scenes.light_path(path))
