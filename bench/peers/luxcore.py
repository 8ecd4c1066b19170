"""LuxCore as a peer: `luxcore.py path|photongi|bidirvm`, see README.md."""

import os
import sys
import time

import numpy  # before pyluxcore, which replaces malloc

import peer
import scene

# Longest path; LuxCore has no "no limit".
DEPTH = 64
# PhotonGI's lookup radius has to be chosen by hand: a fraction of the diagonal of what the lights and surfaces span.
PHOTON_RADIUS = 0.01

ENGINES = {
    "path": {"renderengine.type": "PATHCPU"},
    "photongi": {
        "renderengine.type": "PATHCPU",
        "path.photongi.caustic.enabled": True,
        "path.photongi.photon.maxdepth": DEPTH,
        "path.photongi.caustic.updatespp": 8,
    },
    "bidirvm": {"renderengine.type": "BIDIRVMCPU"},
}


def import_luxcore():
    """pyluxcore, whose messages go to stderr: stdout is for the contract."""
    contract = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    try:
        import pyluxcore
    except ImportError:
        sys.stdout = contract
        peer.skip("pyluxcore is not installed; pip install pyluxcore")
    pyluxcore.Init(lambda message: None)
    sys.stdout = contract
    return pyluxcore


def properties(pyluxcore, values):
    """A LuxCore property list of a dictionary."""
    props = pyluxcore.Properties()
    for name, value in values.items():
        props.Set(pyluxcore.Property(name, value))
    return props


def material_values(name, mesh):
    """The properties of a mesh's material, its light included."""
    prefix = f"scene.materials.{name}"
    values = mesh.material.values
    if mesh.material.kind == "diffuse":
        result = {f"{prefix}.type": "matte", f"{prefix}.kd": values["reflectance"]}
    elif mesh.material.kind == "dielectric":
        result = {
            f"{prefix}.type": "glass",
            f"{prefix}.kr": [1.0] * 3,
            f"{prefix}.kt": [1.0] * 3,
            f"{prefix}.interiorior": values["inside"],
            f"{prefix}.exteriorior": values["outside"],
        }
    elif values["eta"] == [0.0] * 3:
        result = {f"{prefix}.type": "mirror", f"{prefix}.kr": [1.0] * 3}
    else:
        texture = f"scene.textures.{name}"
        # LuxCore's smooth mirror has no Fresnel reflectance, so a smooth metal is one that is hardly rough.
        alpha = max(values["alpha"], 1e-3)
        result = {
            f"{texture}.type": "fresnelconst",
            f"{texture}.n": values["eta"],
            f"{texture}.k": values["k"],
            f"{prefix}.type": "metal2",
            f"{prefix}.fresnel": name,
            f"{prefix}.uroughness": alpha,
            f"{prefix}.vroughness": alpha,
        }
    if mesh.radiance is not None:
        result |= {
            f"{prefix}.emission": mesh.radiance,
            f"{prefix}.emission.gain": [1.0] * 3,
            # Left to itself, LuxCore does not sample lamps of many triangles.
            f"{prefix}.emission.directlightsampling.type": "ENABLED",
            f"{prefix}.emission.power": 0.0,
            f"{prefix}.emission.normalizebycolor": False,
        }
    return result


def camera_values(camera, size):
    origin, target, up, fov = camera
    # LuxCore's pictures lie a pixel too low.
    aspect, pixel = size[0] / size[1], 2 / size[0]
    return {
        "scene.camera.type": "perspective",
        "scene.camera.lookat.orig": origin,
        "scene.camera.lookat.target": target,
        "scene.camera.up": up,
        "scene.camera.fieldofview": fov,
        "scene.camera.screenwindow": [-1.0, 1.0, -1 / aspect - pixel, 1 / aspect - pixel],
        "scene.camera.autofocus.enable": False,
    }


def sky_values(sky):
    path, matrix = sky
    # LuxCore's sky has z up and turns the other way round.
    axes = numpy.array([[0, 1, 0, 0], [0, 0, 1, 0], [-1, 0, 0, 0], [0, 0, 0, 1]], dtype=float)
    return {
        "scene.lights.sky.type": "infinite",
        "scene.lights.sky.file": path,
        "scene.lights.sky.gamma": 1.0,
        "scene.lights.sky.transformation": (matrix @ axes).T.flatten().tolist(),
    }


def build(pyluxcore, source, size):
    """The LuxCore scene."""
    built = pyluxcore.Scene()
    values = camera_values(source.camera, size)
    if source.sky:
        values |= sky_values(source.sky)
    for index, mesh in enumerate(source.meshes):
        name = f"mesh{index}"
        normals = None if mesh.normals is None else list(map(tuple, mesh.normals.tolist()))
        vertices, faces = list(map(tuple, mesh.vertices.tolist())), list(map(tuple, mesh.faces.tolist()))
        built.DefineMesh(name, vertices, faces, normals, None, None, None)
        values |= material_values(name, mesh)
        values |= {f"scene.objects.{name}.shape": name, f"scene.objects.{name}.material": name}
    built.Parse(properties(pyluxcore, values))
    return built


def settings(method, arguments, radius):
    """The properties of the renderer and the film."""
    width, height = arguments.size
    values = ENGINES[method] | {
        "native.threads.count": arguments.threads,
        "renderengine.seed": arguments.seed + 1,
        "sampler.type": "SOBOL",
        "film.width": width,
        "film.height": height,
        "film.filter.type": "BOX",
        "film.filter.width": 0.5,
        "film.imagepipelines.0.0.type": "NOP",
        "film.outputs.0.type": "RGB",
        "film.outputs.0.filename": "unused.exr",
        "path.pathdepth.total": DEPTH,
        "path.pathdepth.diffuse": DEPTH,
        "path.pathdepth.glossy": DEPTH,
        "path.pathdepth.specular": DEPTH,
        "path.maxdepth": DEPTH,
        "light.maxdepth": DEPTH,
    }
    if method == "photongi":
        values["path.photongi.caustic.lookup.radius"] = radius
    return values


def main():
    arguments = peer.parse_arguments()
    if len(arguments.words) != 1 or arguments.words[0] not in ENGINES:
        raise SystemExit(f"usage: luxcore.py {'|'.join(ENGINES)} SCENE OUTDIR --budgets ...")
    (method,) = arguments.words
    try:
        source = scene.read(arguments.scene, arguments.defines)
    except scene.Unknown as unknown:
        peer.skip(f"not converted for LuxCore: {unknown}")
    if not source.box_filter:
        peer.skip("not converted for LuxCore: reconstruction filter other than box")
    corners = numpy.concatenate([mesh.vertices for mesh in source.meshes])
    radius = PHOTON_RADIUS * float(numpy.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))

    pyluxcore = import_luxcore()
    peer.say(renderer=f"luxcore {pyluxcore.Version()}", method=method, backend="cpu")
    clock = peer.Clock(arguments)
    converted = build(pyluxcore, source, arguments.size)
    config = pyluxcore.RenderConfig(properties(pyluxcore, settings(method, arguments, radius)), converted)
    session = pyluxcore.RenderSession(config)
    session.Start()
    clock.loaded()

    def write(path, _):
        session.GetFilm().SaveOutput(path, pyluxcore.FilmOutputType.RGB, pyluxcore.Properties())

    def passes():
        session.UpdateStats()
        return session.GetStats().Get("stats.renderengine.pass").GetInt()

    while clock.running():
        time.sleep(max(clock.remaining(), 0.01))
        done = passes()
        if done > 0 and clock.remaining() <= 0:
            session.Pause()
            clock.picture(done, write)
            session.Resume()
    session.Stop()
    sys.stdout.flush()
    # pyluxcore's own end is a crash: it lets go of Python objects after Python has ended.
    os._exit(0)


if __name__ == "__main__":
    main()
