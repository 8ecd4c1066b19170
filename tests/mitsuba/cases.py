"""The scenes of compare.py."""

import mitsuba as mi
import numpy as np

SIZE = 48

FILM = f"""<film type="hdrfilm"><integer name="width" value="{SIZE}"/><integer name="height" value="{SIZE}"/>
  <rfilter type="box"/></film><sampler type="independent"/>"""
VIEW = f"""<sensor type="perspective"><float name="fov" value="32"/><transform name="to_world">
  <lookat origin="0.8,-4,1.2" target="0,0,0" up="0,0,1"/></transform>{FILM}</sensor>"""
CONSTANT = '<emitter type="constant"><rgb name="radiance" value="0.8,0.9,1"/></emitter>'
POINT = (
    '<emitter type="point"><point name="position" value="2,-3,3"/><rgb name="intensity" value="20,19,18"/></emitter>'
)
SKY = '<emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>'
RAMP = '<texture name="{0}" type="bitmap"><string name="filename" value="ramp.exr"/><boolean name="raw" value="true"/></texture>'
COLOURS = '<texture name="{0}" type="bitmap"><string name="filename" value="colours.png"/></texture>'
FLOOR = """<shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-1"/></transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="0.5,0.4,0.3"/></bsdf></shape>"""


def rgb(name, r, g=None, b=None):
    return f'<rgb name="{name}" value="{r},{r if g is None else g},{r if b is None else b}"/>'


def floats(**values):
    return "".join(f'<float name="{name}" value="{value}"/>' for name, value in values.items())


def bsdf(plugin, *inside, name=""):
    return f'<bsdf type="{plugin}">{"".join(inside)}</bsdf>'


def string(name, value):
    return f'<string name="{name}" value="{value}"/>'


GGX = string("distribution", "ggx")
NORMALS = """<texture name="normalmap" type="bitmap"><string name="filename" value="normals.exr"/>
  <boolean name="raw" value="true"/></texture>"""
BUMPS = """<texture name="bumps" type="bitmap"><string name="filename" value="bumps.exr"/>
  <boolean name="raw" value="true"/></texture>"""

BSDFS = {
    "diffuse": bsdf("diffuse", rgb("reflectance", 0.5, 0.2, 0.1)),
    "diffuse textured": bsdf("diffuse", COLOURS.format("reflectance")),
    "dielectric": bsdf("dielectric"),
    "dielectric tinted": bsdf("dielectric", rgb("specular_transmittance", 0.9, 0.5, 0.3), floats(int_ior=1.8)),
    "thindielectric": bsdf("thindielectric"),
    "roughdielectric": bsdf("roughdielectric", floats(alpha=0.2), GGX),
    "roughdielectric textured": bsdf("roughdielectric", RAMP.format("alpha")),
    "conductor": bsdf("conductor", string("material", "Au")),
    "roughconductor": bsdf("roughconductor", string("material", "Cu"), floats(alpha_u=0.3, alpha_v=0.1), GGX),
    "roughconductor textured": bsdf("roughconductor", string("material", "Al"), RAMP.format("alpha")),
    "plastic": bsdf("plastic", rgb("diffuse_reflectance", 0.1, 0.3, 0.6)),
    "plastic nonlinear": bsdf(
        "plastic", COLOURS.format("diffuse_reflectance"), '<boolean name="nonlinear" value="true"/>'
    ),
    "roughplastic": bsdf("roughplastic", rgb("diffuse_reflectance", 0.1, 0.3, 0.6), floats(alpha=0.2)),
    "blendbsdf": bsdf(
        "blendbsdf", floats(weight=0.3), bsdf("roughconductor", string("material", "Au")), bsdf("diffuse")
    ),
    # Not of `dielectric`: Mitsuba 3.9.1 weights delta lobes inside of a blend by the pdf of the other side, up to 2 % off.
    "blendbsdf textured": bsdf(
        "blendbsdf", RAMP.format("weight"), bsdf("roughdielectric"), bsdf("diffuse", rgb("reflectance", 0.7, 0.2, 0.1))
    ),
    "mask": bsdf("mask", RAMP.format("opacity"), bsdf("diffuse")),
    "mask twosided": bsdf("mask", floats(opacity=0.4), bsdf("twosided", bsdf("plastic"))),
    "normalmap": bsdf("normalmap", NORMALS, bsdf("roughplastic", floats(alpha=0.15))),
    "normalmap plain": bsdf(
        "normalmap",
        NORMALS,
        '<boolean name="flip_invalid_normals" value="false"/><boolean name="use_shadowing_function" value="false"/>',
        bsdf("diffuse"),
    ),
    "normalmap conductor": bsdf("normalmap", NORMALS, bsdf("conductor", string("material", "Ag"))),
    "normalmap glass": bsdf("normalmap", NORMALS, bsdf("roughdielectric", floats(alpha=0.3))),
    "bumpmap": bsdf("bumpmap", BUMPS, floats(scale=0.4), bsdf("diffuse")),
    "bumpmap twosided": bsdf("twosided", bsdf("bumpmap", BUMPS, floats(scale=-0.7), bsdf("roughplastic"))),
    "null": bsdf("null"),
    "twosided": bsdf("twosided", bsdf("diffuse"), bsdf("roughconductor")),
    "principled default": bsdf("principled"),
    "principled metal": bsdf(
        "principled", rgb("base_color", 0.9, 0.6, 0.2), floats(metallic=1.0, roughness=0.3, anisotropic=0.7)
    ),
    "principled glass": bsdf(
        "principled", rgb("base_color", 0.8, 0.9, 1.0), floats(spec_trans=1.0, roughness=0.3, eta=1.5)
    ),
    "principled coat": bsdf(
        "principled",
        rgb("base_color", 0.6, 0.1, 0.1),
        floats(
            roughness=0.6, clearcoat=1.0, clearcoat_gloss=0.8, sheen=0.8, sheen_tint=0.5, spec_tint=0.6, flatness=0.4
        ),
    ),
    "principled everything": bsdf(
        "principled",
        COLOURS.format("base_color"),
        RAMP.format("roughness"),
        floats(metallic=0.3, anisotropic=0.4, spec_trans=0.4, specular=0.6, spec_tint=0.3, clearcoat=0.5, sheen=0.5),
    ),
    "principledthin default": bsdf("principledthin"),
    "principledthin everything": bsdf(
        "principledthin",
        COLOURS.format("base_color"),
        floats(roughness=0.3, anisotropic=0.3, spec_trans=0.4, eta=1.4, spec_tint=0.5, sheen=0.6, sheen_tint=0.4),
        floats(flatness=0.5, diff_trans=0.8),
    ),
}


def sphere(material, light):
    return scene(f'<shape type="sphere">{material}</shape>', light)


def scene(*inside, view=VIEW):
    return f'<scene version="3.0.0">{view}{"".join(inside)}</scene>'


def area(*inside, plugin="area"):
    return f"""<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><scale value="0.7"/>
  <translate z="2"/></transform><emitter type="{plugin}">{"".join(inside)}</emitter></shape>"""


BALL = f'<shape type="sphere"><float name="radius" value="0.6"/>{bsdf("roughplastic", floats(alpha=0.2))}</shape>'
AIM = '<transform name="to_world"><lookat origin="1.5,-1,3" target="0,0,0" up="0,0,1"/></transform>'

SCENES = {
    "area textured": scene(BALL, FLOOR, area(COLOURS.format("radiance"))),
    "spot": scene(BALL, FLOOR, f'<emitter type="spot">{AIM}{rgb("intensity", 40)}{floats(cutoff_angle=25)}</emitter>'),
    "spot textured": scene(
        BALL, FLOOR, f'<emitter type="spot">{AIM}{rgb("intensity", 40)}{COLOURS.format("texture")}</emitter>'
    ),
    "directional": scene(
        BALL,
        FLOOR,
        f'<emitter type="directional"><vector name="direction" value="-1,1,-2"/>{rgb("irradiance", 3, 2, 1)}</emitter>',
    ),
    "projector": scene(
        BALL,
        FLOOR,
        SKY,
        f'<emitter type="projector">{AIM}{COLOURS.format("irradiance")}{floats(scale=9, fov=35)}</emitter>',
    ),
    "sunsky": scene(
        BALL, FLOOR, '<emitter type="sunsky"><vector name="sun_direction" value="0.5,-0.4,0.6"/></emitter>'
    ),
    "sunsky hazy low": scene(
        BALL,
        FLOOR,
        f'<emitter type="sunsky"><vector name="sun_direction" value="-0.8,-0.4,0.2"/>{floats(turbidity=6, albedo=0.4)}</emitter>',
    ),
    "sky alone": scene(
        BALL,
        FLOOR,
        f'<emitter type="sunsky"><vector name="sun_direction" value="0.3,0,0.9"/>{floats(sun_scale=0)}</emitter>',
    ),
    "envmap": scene(
        BALL, FLOOR, f'<emitter type="envmap">{string("filename", "colours.png")}{floats(scale=2)}</emitter>'
    ),
    "orthographic": scene(
        BALL,
        FLOOR,
        CONSTANT,
        POINT,
        view=f"""<sensor type="orthographic"><transform name="to_world"><lookat origin="0.8,-4,1.2" target="0,0,0" up="0,0,1"/>
        <scale x="1.4" y="1.2"/></transform>{FILM}</sensor>""",
    ),
    "thinlens": scene(
        BALL,
        FLOOR,
        CONSTANT,
        view=f"""<sensor type="thinlens"><float name="fov" value="32"/>{floats(aperture_radius=0.2, focus_distance=3.2)}
        <transform name="to_world"><lookat origin="0.8,-4,1.2" target="0,0,0" up="0,0,1"/></transform>{FILM}</sensor>""",
    ),
    "ply with normals and a normal map": scene(
        f'<shape type="ply">{string("filename", "hill.ply")}{BSDFS["normalmap"]}</shape>', SKY, POINT
    ),
    "ply with a bump map": scene(
        f'<shape type="ply">{string("filename", "hill.ply")}{BSDFS["bumpmap"]}</shape>', SKY, POINT
    ),
    "ply mirrored with a normal map": scene(
        f"""<shape type="ply">{string("filename", "mirrored.ply")}{BSDFS["normalmap"]}</shape>""", SKY, POINT
    ),
    "mesh_attribute at vertices": scene(
        f"""<shape type="ply">{string("filename", "hill.ply")}<bsdf type="diffuse"><texture name="reflectance"
        type="mesh_attribute">{string("name", "vertex_color")}</texture></bsdf></shape>""",
        CONSTANT,
    ),
    "mesh_attribute at faces": scene(
        f"""<shape type="ply">{string("filename", "hill.ply")}<bsdf type="diffuse"><texture name="reflectance"
        type="mesh_attribute">{string("name", "face_color")}</texture></bsdf></shape>""",
        CONSTANT,
    ),
    "instances": scene(
        f'<shape type="shapegroup" id="group">{BALL}</shape>',
        *(
            f"""<shape type="instance"><ref id="group"/><transform name="to_world"><scale value="0.4"/>
            <rotate z="1" angle="{60 * i}"/><translate x="{0.8 * i - 0.8}" y="{0.3 * i}"/></transform></shape>"""
            for i in range(3)
        ),
        FLOOR,
        CONSTANT,
        POINT,
    ),
    "texture wrap and transform": scene(
        """<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="60"/></transform><bsdf type="diffuse">
        <texture name="reflectance" type="bitmap"><string name="filename" value="colours.png"/>
        <string name="wrap_mode" value="mirror"/><string name="filter_type" value="nearest"/><transform name="to_uv">
        <scale x="3" y="2"/><rotate z="1" angle="20"/></transform></texture></bsdf></shape>""",
        CONSTANT,
    ),
    "checkerboard": scene(
        """<shape type="rectangle"><bsdf type="twosided"><bsdf type="diffuse"><texture name="reflectance" type="checkerboard">
        <transform name="to_uv"><scale value="4"/></transform></texture></bsdf></bsdf></shape>""",
        CONSTANT,
    ),
}


# A point light behind something that paths from the eye meet only by chance, and the light not at all.
HIDDEN_FROM_PATHS = {"mask twosided point"}


def scenes():
    """Name and text of each."""
    for name, material in BSDFS.items():
        for light, text in (("constant", CONSTANT), ("point", SKY + POINT)):
            yield f"{name} {light}", sphere(material, text)
    yield from SCENES.items()


def hill(path, mirrored=False):
    """A bumpy square with normals, texture coordinates, and colours of vertices and of faces."""
    n = 24
    x = np.linspace(-1, 1, n)
    u, v = np.meshgrid(x, x)
    z = 0.3 * np.cos(2.5 * u) * np.cos(2 * v) - 0.2
    p = np.stack([u, v, z], -1).reshape(-1, 3).astype("f4")
    du = -0.75 * np.sin(2.5 * u) * np.cos(2 * v)
    dv = -0.6 * np.cos(2.5 * u) * np.sin(2 * v)
    normal = np.stack([-du, -dv, np.ones_like(u)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    mesh = mi.Mesh("hill", n * n, len(faces), has_vertex_normals=True, has_vertex_texcoords=True)
    mesh.add_attribute("vertex_color", 3, (0.5 + 0.4 * np.sin(3 * p)).ravel().tolist())
    colours = np.random.default_rng(1).uniform(0.1, 0.9, (len(faces), 3))
    mesh.add_attribute("face_color", 3, colours.ravel().tolist())
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = p.ravel()
    parameters["vertex_normals"] = normal.astype("f4").ravel()
    uv = np.stack([(1 - u if mirrored else 1 + u) / 2, (1 + v) / 2], -1)
    parameters["vertex_texcoords"] = uv.astype("f4").ravel()
    parameters["faces"] = faces.astype("u4").ravel()
    parameters.update()
    mesh.write_ply(str(path))


def write_files(folder):
    """Everything that the scenes name."""
    rng = np.random.default_rng(7)
    colours = rng.uniform(0.05, 0.95, (8, 12, 3))
    mi.Bitmap((colours * 255).astype("u1")).write(str(folder / "colours.png"))
    ramp = np.repeat(np.linspace(0.1, 0.6, 16)[None, :, None], 16, 0).repeat(3, 2)
    mi.Bitmap(ramp.astype("f4")).write(str(folder / "ramp.exr"))
    bumps = rng.uniform(0, 0.3, (16, 32, 1)).repeat(3, 2)
    mi.Bitmap(bumps.astype("f4")).write(str(folder / "bumps.exr"))
    tilt = rng.normal(0, 0.35, (16, 32, 2))
    normals = np.concatenate([tilt, np.ones((16, 32, 1))], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    mi.Bitmap(((normals + 1) / 2).astype("f4")).write(str(folder / "normals.exr"))
    hill(folder / "hill.ply")
    hill(folder / "mirrored.ply", mirrored=True)
