#!/usr/bin/env python3
"""Writes a large mesh in every format that is read, each with a scene around it, to measure loading:

    bench/load/generate.py 10000000 /tmp/load
    caustica info /tmp/load/ply.xml

The mesh is a bumpy torus with normals and texture coordinates. Needs numpy.
"""

import sys
import zlib
from pathlib import Path

import numpy as np

SCENE = """<scene version="3.0.0">
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, -9, 6" target="0, 0, 0" up="0, 0, 1"/></transform>
        <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/></film>
    </sensor>
    <emitter type="constant"/>
    <shape type="{format}"><string name="filename" value="{file}"/>{parameters}</shape>
</scene>
"""


def torus(triangles):
    """Positions, normals, texture coordinates and vertex indices of about so many triangles."""
    rows = max(3, round((triangles / 4) ** 0.5))
    columns = max(3, round(triangles / 2 / rows))
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    a, b = 2 * np.pi * u, 2 * np.pi * v
    radius = 1 + 0.05 * np.sin(40 * a) * np.sin(25 * b)
    da, db = 2 * np.cos(40 * a) * np.sin(25 * b), 1.25 * np.sin(40 * a) * np.cos(25 * b)
    ring = 3 + radius * np.cos(b)
    p = np.stack([ring * np.cos(a), ring * np.sin(a), radius * np.sin(b)], -1)
    pa = np.stack([
        da * np.cos(b) * np.cos(a) - ring * np.sin(a),
        da * np.cos(b) * np.sin(a) + ring * np.cos(a),
        da * np.sin(b),
    ], -1)
    along = db * np.cos(b) - radius * np.sin(b)
    pb = np.stack([along * np.cos(a), along * np.sin(a), db * np.sin(b) + radius * np.cos(b)], -1)
    n = np.cross(pa, pb)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).astype("<u4")
    right, up, both = corner + 1, corner + columns + 1, corner + columns + 2
    faces = np.stack([corner, right, both, corner, both, up], -1).reshape(-1, 3)
    flat = lambda x: np.ascontiguousarray(x.reshape(-1, x.shape[-1]), "<f4")
    return flat(p), flat(n), flat(np.stack([u, v], -1)), faces


def ply(path, p, n, uv, faces):
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(p)}\n"
    header += "".join(f"property float {name}\n" for name in ["x", "y", "z", "nx", "ny", "nz", "u", "v"])
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    records = np.zeros(len(faces), [("count", "u1"), ("indices", "<u4", 3)])
    records["count"], records["indices"] = 3, faces
    path.write_bytes(header.encode() + np.hstack([p, n, uv]).tobytes() + records.tobytes())


def serialized(path, p, n, uv, faces):
    flags = 0x0001 | 0x0002 | 0x1000
    content = np.array([flags], "<u4").tobytes() + b"mesh\0" + np.array([len(p), len(faces)], "<u8").tobytes()
    content += b"".join(a.tobytes() for a in (p, n, uv, faces))
    table = np.array([0], "<u8").tobytes() + np.array([1], "<u4").tobytes()
    path.write_bytes(b"\x1c\x04\x04\x00" + zlib.compress(content, 6) + table)


def obj(path, p, n, uv, faces):
    with path.open("w") as file:
        for keyword, rows in (("v", p), ("vt", uv), ("vn", n)):
            file.writelines(f"{keyword} {' '.join('%.6f' % x for x in row)}\n" for row in rows.tolist())
        file.writelines("f %d/%d/%d %d/%d/%d %d/%d/%d\n" % (a, a, a, b, b, b, c, c, c) for a, b, c in (faces + 1).tolist())


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    folder = Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    mesh = torus(int(sys.argv[1]))
    print(f"{len(mesh[0])} vertices, {len(mesh[3])} triangles")
    for write in (ply, serialized, obj):
        name = write.__name__
        write(folder / f"mesh.{name}", *mesh)
        scene = lambda parameters: SCENE.format(format=name, file=f"mesh.{name}", parameters=parameters)
        (folder / f"{name}.xml").write_text(scene(""))
        (folder / f"{name}-faceted.xml").write_text(scene('<boolean name="face_normals" value="true"/>'))


if __name__ == "__main__":
    main()
