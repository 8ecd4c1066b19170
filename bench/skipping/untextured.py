#!/usr/bin/env python3
"""Writes untextured.xml and its mesh: 600 000 triangles with texture coordinates that no texture uses, and spheres.

    python3 bench/skipping/untextured.py FOLDER
"""

import math
import pathlib
import struct
import sys

N = 550  # quads along each side

SCENE = """<scene version="3.0.0">
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world"><lookat origin="0, 2.2, 3" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm">
            <integer name="width" value="256"/><integer name="height" value="256"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <bsdf type="diffuse" id="grey"/>
    <shape type="ply"><string name="filename" value="waves.ply"/><ref id="grey"/></shape>
    <shape type="sphere"><point name="center" value="-0.5, 0.5, 0"/><float name="radius" value="0.4"/><ref id="grey"/></shape>
    <shape type="sphere"><point name="center" value="0.5, 0.5, 0.3"/><float name="radius" value="0.4"/><bsdf type="dielectric"/></shape>
    <shape type="sphere">
        <point name="center" value="1, 2.5, -0.5"/><float name="radius" value="0.3"/>
        <emitter type="area"><rgb name="radiance" value="20"/></emitter>
    </shape>
</scene>
"""


def main() -> None:
    folder = pathlib.Path(sys.argv[1])
    (folder / "untextured.xml").write_text(SCENE)
    vertices, faces = bytearray(), bytearray()
    for j in range(N + 1):
        for i in range(N + 1):
            x, z = 4 * i / N - 2, 4 * j / N - 2
            y = 0.05 * math.sin(9 * x) * math.sin(11 * z)
            slope_x = 0.45 * math.cos(9 * x) * math.sin(11 * z)
            slope_z = 0.55 * math.sin(9 * x) * math.cos(11 * z)
            n = 1 / math.sqrt(1 + slope_x**2 + slope_z**2)
            vertices += struct.pack("<8f", x, y, z, -slope_x * n, n, -slope_z * n, i / N, j / N)
    for j in range(N):
        for i in range(N):
            a = j * (N + 1) + i
            b, c, d = a + 1, a + N + 1, a + N + 2
            faces += struct.pack("<B3iB3i", 3, a, c, b, 3, b, c, d)
    names = "\n".join(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v"))
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {(N + 1) ** 2}\n{names}\n"
        f"element face {2 * N * N}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (folder / "waves.ply").write_bytes(header.encode() + vertices + faces)


main()
