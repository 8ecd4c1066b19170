"""Reads a Mitsuba 3 file as a `scene.Scene`: `mitsuba_scene.py FILE [NAME=VALUE ...]` pickles it to stdout.

Mitsuba itself parses the file and loads the meshes. What a scene has and this module does not know is `Unknown`, with
its name: a peer must not render something else.
"""

import os
import pickle
import sys

import mitsuba
import numpy

from scene import Material, Mesh, Scene, Unknown

# Facets of a sphere's half meridian; with interpolated normals, twice as many show no difference. A lamp's are fewer,
# since each becomes a light.
SPHERE_STEPS, LAMP_STEPS = 128, 16


def known(props, names):
    """Refuse a plugin's parameters other than these."""
    for name in props.keys():
        if name not in names and not name.startswith("_arg_"):
            raise Unknown(f"{props.plugin_name()}: {name}")


def color(value):
    """Three numbers from an RGB value or a single number."""
    if isinstance(value, (int, float)):
        return [float(value)] * 3
    if "Color" in type(value).__name__:
        return [float(x) for x in value]
    raise Unknown(f"texture or spectrum {type(value).__name__}")


class Reader:
    """Walks the nodes that Mitsuba's parser made of a file."""

    def __init__(self, path, defines):
        mitsuba.file_resolver().prepend(os.path.dirname(os.path.abspath(path)))
        config = mitsuba.parser.ParserConfig("scalar_rgb")
        config.merge_meshes = False
        config.merge_equivalent = False

        def parse():
            state = mitsuba.parser.parse_file(config, path, **defines)
            mitsuba.parser.transform_all(config, state)
            return state

        self.state = parse()
        # Making objects of nodes uses them up.
        self.shapes = iter(mitsuba.parser.instantiate(config, parse()).shapes())

    def children(self, node):
        """The nodes below one, but not textures that are named parameters: `known` and `color` refuse those."""
        values = (value for name, value in node.props.items() if name.startswith("_arg_"))
        return [self.state.nodes[value.index()] for value in values]

    def child(self, node, kind):
        """The node of a kind below one, or None."""
        return next((child for child in self.children(node) if child.type == kind), None)

    def scene(self):
        kinds = mitsuba.ObjectType
        scene = Scene(None, True, [], None)
        for node in self.children(self.state.root):
            if node.type == kinds.Sensor:
                scene.camera, scene.box_filter = self.sensor(node)
            elif node.type == kinds.Shape:
                scene.meshes.append(self.mesh(node, next(self.shapes)))
            elif node.type == kinds.Emitter:
                scene.sky = self.sky(node.props)
            elif node.type not in (kinds.Integrator, kinds.BSDF):
                raise Unknown(node.props.plugin_name())
        if scene.camera is None:
            raise Unknown("a scene without sensor")
        return scene

    def sensor(self, node):
        props = node.props
        if props.plugin_name() != "perspective":
            raise Unknown(f"sensor {props.plugin_name()}")
        known(props, ("fov", "fov_axis", "to_world", "near_clip", "far_clip"))
        if props.get("fov_axis", "x") != "x":
            raise Unknown(f"fov_axis {props['fov_axis']}")
        film = self.child(node, mitsuba.ObjectType.Film)
        if any(name.startswith("crop_") for name in film.props.keys()):
            raise Unknown("a cropped film")
        rfilter = self.child(film, mitsuba.ObjectType.ReconstructionFilter)
        matrix = numpy.array(props["to_world"].matrix)
        if numpy.linalg.det(matrix[:3, :3]) < 0:
            raise Unknown("a mirrored sensor")
        origin, forward, up = matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
        camera = (origin.tolist(), (origin + forward).tolist(), up.tolist(), float(props["fov"]))
        return camera, rfilter is not None and rfilter.props.plugin_name() == "box"

    def sky(self, props):
        if props.plugin_name() != "envmap":
            raise Unknown(f"emitter {props.plugin_name()}")
        known(props, ("filename", "to_world"))
        path = str(mitsuba.file_resolver().resolve(props["filename"]))
        matrix = numpy.array(props["to_world"].matrix) if "to_world" in props else numpy.eye(4)
        return path, matrix

    def material(self, node):
        """The material of a BSDF node; a shape without one is grey."""
        if node is None:
            return Material("diffuse", {"reflectance": [0.5] * 3})
        props = node.props
        kind = props.plugin_name()
        if kind == "twosided":
            return self.material(self.children(node)[0])
        if kind == "diffuse":
            known(props, ("reflectance",))
            return Material(kind, {"reflectance": color(props.get("reflectance", 0.5))})
        if kind == "dielectric":
            known(props, ("int_ior", "ext_ior"))
            inside, outside = props.get("int_ior", 1.5046), props.get("ext_ior", 1.000277)
            if isinstance(inside, str) or isinstance(outside, str):
                raise Unknown("a dielectric by name")
            return Material(kind, {"inside": inside, "outside": outside})
        if kind in ("conductor", "roughconductor"):
            known(props, ("material", "eta", "k", "distribution", "alpha"))
            alpha = float(props.get("alpha", 0.1)) if kind == "roughconductor" else 0.0
            if alpha > 0 and props.get("distribution", "beckmann") != "ggx":
                raise Unknown("roughconductor: distribution other than ggx")
            if props.get("material", "") == "none":
                return Material("conductor", {"eta": [0.0] * 3, "k": [1.0] * 3, "alpha": alpha})
            if "material" in props or "eta" not in props:
                raise Unknown("a conductor by name")
            return Material("conductor", {"eta": color(props["eta"]), "k": color(props["k"]), "alpha": alpha})
        raise Unknown(f"bsdf {kind}")

    def mesh(self, node, shape):
        kind = node.props.plugin_name()
        kinds = mitsuba.ObjectType
        params = mitsuba.traverse(shape)
        emitter = self.child(node, kinds.Emitter)
        if emitter is not None:
            known(emitter.props, ("radiance",))
        if kind in ("obj", "ply", "serialized"):
            vertices = numpy.array(params["vertex_positions"]).reshape(-1, 3)
            faces = numpy.array(params["faces"]).reshape(-1, 3)
            normals = (
                numpy.array(params["vertex_normals"]).reshape(-1, 3) if shape.has_vertex_normals() else None
            )
        elif kind in ("sphere", "rectangle"):
            if node.props.get("flip_normals", False):
                raise Unknown(f"{kind}: flip_normals")
            steps = SPHERE_STEPS if emitter is None else LAMP_STEPS
            vertices, faces, normals = sphere(steps) if kind == "sphere" else rectangle()
            matrix = numpy.array(params["to_world"].matrix)
            vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
            if normals is not None:
                normals = normals @ numpy.linalg.inv(matrix[:3, :3])
                normals /= numpy.linalg.norm(normals, axis=1, keepdims=True)
        else:
            raise Unknown(f"shape {kind}")
        radiance = color(emitter.props["radiance"]) if emitter is not None else None
        return Mesh(vertices, faces, normals, self.material(self.child(node, kinds.BSDF)), radiance)


def rectangle():
    """Mitsuba's rectangle: the square from −1 to 1 that looks along z."""
    vertices = numpy.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
    return vertices, numpy.array([[0, 1, 2], [0, 2, 3]]), None


def sphere(steps):
    """The unit sphere between meridians and parallels, facing outwards, with its normals.

    The facets lie a little outside, such that they have its area: a lamp keeps its power.
    """
    theta, phi = numpy.meshgrid(
        numpy.linspace(0, numpy.pi, steps + 1),
        numpy.linspace(0, 2 * numpy.pi, 2 * steps, endpoint=False),
        indexing="ij",
    )
    sides = [numpy.sin(theta) * numpy.cos(phi), numpy.sin(theta) * numpy.sin(phi), numpy.cos(theta)]
    vertices = numpy.stack(sides, axis=-1).reshape(-1, 3)
    index = numpy.arange(len(vertices)).reshape(theta.shape)
    a, b = index[:-1], index[1:]
    c, d = numpy.roll(b, -1, axis=1), numpy.roll(a, -1, axis=1)
    # At the poles one triangle of each square has no area.
    lower = numpy.stack([a, b, c], axis=-1)[:-1].reshape(-1, 3)
    upper = numpy.stack([a, c, d], axis=-1)[1:].reshape(-1, 3)
    faces = numpy.concatenate([lower, upper])
    corner, side, other = (vertices[faces[:, i]] for i in range(3))
    area = numpy.linalg.norm(numpy.cross(side - corner, other - corner), axis=1).sum() / 2
    return vertices * numpy.sqrt(4 * numpy.pi / area), faces, vertices


def main():
    path, *defines = sys.argv[1:]
    mitsuba.set_variant("scalar_rgb")
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    try:
        result = Reader(path, dict(define.split("=", 1) for define in defines)).scene()
    except Unknown as unknown:
        result = unknown
    except RuntimeError as error:
        # Mitsuba's own: a plugin that it lacks, or a scene of another version.
        result = Unknown(" ".join(str(error).split()))
    sys.stdout.buffer.write(pickle.dumps(result))


if __name__ == "__main__":
    main()
