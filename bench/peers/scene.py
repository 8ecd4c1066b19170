"""A scene as plain meshes, materials, lights and a camera, for renderers that do not read Mitsuba's files."""

import os
import pickle
import subprocess
import sys
from dataclasses import dataclass

import numpy


class Unknown(Exception):
    """Something in the scene that is not converted."""


@dataclass
class Material:
    """`kind` is diffuse, dielectric or conductor; `values` the parameters of that kind."""

    kind: str
    values: dict


@dataclass
class Mesh:
    """Triangles, with normals if they are smooth; `radiance` is None unless they are a light."""

    vertices: numpy.ndarray
    faces: numpy.ndarray
    normals: numpy.ndarray | None
    material: Material
    radiance: list | None


@dataclass
class Scene:
    """`camera` is origin, target, up, and horizontal field of view; `sky` a file name and a matrix, or None."""

    camera: tuple
    box_filter: bool
    meshes: list
    sky: tuple | None


def read(path, defines):
    """The scene of a Mitsuba 3 file.

    Another process reads it, since mitsuba and pyluxcore, which replaces malloc, cannot live in one.
    """
    reader = os.path.join(os.path.dirname(os.path.abspath(__file__)), "mitsuba_scene.py")
    command = [sys.executable, reader, path] + [f"{name}={value}" for name, value in defines.items()]
    scene = pickle.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    if isinstance(scene, Unknown):
        raise scene
    return scene
