"""Builds the scene of this folder in Blender and exports it with mitsuba-blender.

    python make.py FOLDER-OF-MITSUBA-BLENDER OUTPUT.xml

needs a Python with the packages `bpy` (made with 5.0.1) and `mitsuba` (3.6.4; later ones lack the writer that the add-on uses);
the first argument is the folder `mitsuba-blender` of a checkout of
https://github.com/mitsuba-renderer/mitsuba-blender. Nothing of what it writes is changed afterwards.
"""

import importlib
import math
import os
import sys
import types

import bpy
import mitsuba
from bpy_extras.io_utils import axis_conversion

mitsuba.set_variant("scalar_rgb")


def principled(name, **inputs):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    node = material.node_tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        node.inputs[key.replace("_", " ")].default_value = value
    return material


def add(material, smooth=True):
    """Gives the object that was made last its material."""
    mesh = bpy.context.object.data
    mesh.materials.append(material)
    for polygon in mesh.polygons:
        polygon.use_smooth = smooth
    return bpy.context.object


def image(name, width, height, pixel, **settings):
    picture = bpy.data.images.new(name, width, height, float_buffer=settings.pop("float_buffer", False))
    for key, value in settings.items():
        setattr(picture, key, value)
    picture.pixels = [c for y in range(height) for x in range(width) for c in (*pixel(x, y), 1.0)]
    return picture


def tiles(x, y):
    """A floor that looks different on every side."""
    if x // 8 % 2 == y // 8 % 2:
        return (0.75, 0.72, 0.66)
    return (0.25 + 0.4 * x / 64, 0.3, 0.25 + 0.4 * y / 64)


def sky(x, y):
    """Dim below, blue above, brighter in one direction."""
    up = max(0.0, (y + 0.5) / 16 - 0.5)
    glow = math.exp(-0.08 * ((x - 8) ** 2 + (y - 11) ** 2))
    return (0.05 + 0.1 * up + 0.8 * glow, 0.05 + 0.3 * up + 0.6 * glow, 0.06 + 0.6 * up + 0.3 * glow)


def lamp(kind, location, rotation, energy, color, **settings):
    data = bpy.data.lights.new(kind.lower(), kind)
    data.energy, data.color = energy, color
    for key, value in settings.items():
        setattr(data, key, value)
    thing = bpy.data.objects.new(kind.lower(), data)
    thing.location, thing.rotation_euler = location, [math.radians(a) for a in rotation]
    bpy.context.collection.objects.link(thing)


def build():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.max_bounces = 64, 12
    scene.render.resolution_x = scene.render.resolution_y = 128
    scene.render.resolution_percentage = 100

    floor = principled("floor", Roughness=0.8)
    texture = floor.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image("tiles", 64, 64, tiles, file_format="PNG")
    floor.node_tree.links.new(
        texture.outputs["Color"], floor.node_tree.nodes["Principled BSDF"].inputs["Base Color"]
    )
    bpy.ops.mesh.primitive_plane_add(size=8)
    add(floor, smooth=False)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=0.8, location=(-0.9, -0.4, 0.8))
    glass = principled("glass", Base_Color=(0.95, 0.98, 1, 1), Transmission_Weight=1.0, Roughness=0.5, IOR=1.5)
    add(glass)
    bpy.ops.mesh.primitive_torus_add(
        major_segments=32, minor_segments=12, major_radius=0.7, minor_radius=0.2, location=(1.0, -0.6, 0.2)
    )
    add(principled("gold", Base_Color=(1.0, 0.72, 0.3, 1), Metallic=1.0, Roughness=0.5))
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0.4, 1.2, 0.5), rotation=(0, 0, 0.5))
    add(principled("red", Base_Color=(0.7, 0.1, 0.08, 1), Coat_Weight=0.5, Coat_Roughness=0.2), smooth=False)
    # Without a material.
    bpy.ops.mesh.primitive_cone_add(vertices=24, radius1=0.4, depth=0.9, location=(-1.2, 1.4, 0.45))

    lamp("AREA", (-2, -1, 4), (25, -25, 0), 250, (1, 0.9, 0.8), shape="RECTANGLE", size=1.0, size_y=0.5)
    lamp("POINT", (2.2, 1.5, 1.5), (0, 0, 0), 30, (1, 0.5, 0.3), shadow_soft_size=0)
    spot = {"spot_size": math.radians(50), "spot_blend": 0.3, "shadow_soft_size": 0}
    lamp("SPOT", (3, -2, 3), (50, 0, 60), 300, (0.4, 0.6, 1), **spot)
    lamp("SUN", (0, 0, 5), (-40, 20, 0), 0.6, (1, 1, 0.9))

    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    environment = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    environment.image = image("sky", 32, 16, sky, float_buffer=True, file_format="OPEN_EXR")
    world.node_tree.links.new(environment.outputs["Color"], world.node_tree.nodes["Background"].inputs["Color"])
    scene.world = world

    camera = bpy.data.cameras.new("camera")
    camera.angle = math.radians(40)
    camera.dof.use_dof, camera.dof.focus_distance, camera.dof.aperture_fstop = True, 7, 1.4
    thing = bpy.data.objects.new("camera", camera)
    thing.location, thing.rotation_euler = (0.5, -6.5, 3.2), [math.radians(a) for a in (66, 0, 4)]
    bpy.context.collection.objects.link(thing)
    scene.camera = thing


def export(addon, output):
    """What File > Export > Mitsuba does with its own defaults."""
    folder, name = os.path.split(os.path.abspath(addon.rstrip("/")))
    # The exporter alone: the rest of the add-on wants Blender's windows.
    package = types.ModuleType("mitsuba_blender_io")
    package.__path__ = [os.path.join(folder, name, "io")]
    sys.modules["mitsuba_blender_io"] = package
    exporter = importlib.import_module("mitsuba_blender_io.exporter")
    converter = exporter.SceneConverter()
    converter.export_ctx.axis_mat = axis_conversion(to_forward="-Z", to_up="Y").to_4x4()
    converter.set_path(os.path.abspath(output))
    quiet = types.SimpleNamespace(progress_update=lambda count: None)
    converter.scene_to_dict(bpy.context.evaluated_depsgraph_get(), quiet)
    converter.dict_to_xml()


if __name__ == "__main__":
    build()
    export(*sys.argv[1:3])
