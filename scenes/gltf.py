"""A small glTF 2.0 writer: shapes, materials and nodes in, NAME.gltf, NAME.bin and NAME.toml out.

Standard library only. Coordinates are rounded to a micrometre before they are stored, so that the
files do not depend on the last bit of the platform's sine. Lengths are metres, +Y is up. The front of
a face is where its corners run counter-clockwise. Fronts point out of solid matter.
"""

import json
import math
import struct
import textwrap
import zlib
from pathlib import Path


def f32(x):
    """The nearest single-precision number to x rounded to 1e-6; negative zero becomes zero."""
    return struct.unpack("<f", struct.pack("<f", round(x, 6) + 0.0))[0] + 0.0


def folded(key, text):
    """A line `key = "text"` of TOML; a long text goes on over lines of at most 100 columns."""
    line = f"{key} = {json.dumps(text)}"
    if len(line) <= 100:
        return line
    lines = textwrap.wrap(json.dumps(text)[1:-1], 98, break_on_hyphens=False)
    return f'{key} = """\\\n' + " \\\n".join(lines) + '"""'


def sub(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return (a[0] / length, a[1] / length, a[2] / length)


def quaternion(x, y, z):
    """The rotation (x, y, z, w) that takes the axes to these."""
    w = math.sqrt(max(0.0, 1 + x[0] + y[1] + z[2])) / 2
    if w > 0.1:
        return ((y[2] - z[1]) / (4 * w), (z[0] - x[2]) / (4 * w), (x[1] - y[0]) / (4 * w), w)
    # Nearly half a turn: turn by half a turn around y more, and back.
    a, b, c, d = quaternion(tuple(-v for v in x), y, tuple(-v for v in z))
    return (-c, d, a, -b)


class Random:
    """A 32-bit linear congruential generator (Numerical Recipes' constants): the same numbers everywhere."""

    def __init__(self, seed):
        self.state = seed

    def __call__(self, lo=0.0, hi=1.0):
        self.state = (self.state * 1664525 + 1013904223) & 0xFFFFFFFF
        return lo + (hi - lo) * (self.state >> 8) / float(1 << 24)


class Shape:
    """Triangles. `smooth` shapes carry normals, the others are shaded flat; colours and texture coordinates are optional."""

    def __init__(self, smooth=False):
        self.smooth = smooth
        self.positions, self.normals, self.colors, self.uvs, self.indices = [], [], [], [], []

    def vertex(self, position, normal=None, color=None, uv=None):
        self.positions.append(tuple(position))
        for values, value in ((self.normals, normal), (self.colors, color), (self.uvs, uv)):
            if value is not None:
                values.append(tuple(value))
        return len(self.positions) - 1

    def triangle(self, a, b, c):
        if len({self.positions[a], self.positions[b], self.positions[c]}) == 3:
            self.indices += [a, b, c]

    def face(self, *corners, color=None, uvs=None):
        """A convex polygon, its corners counter-clockwise as seen from its front."""
        ids = [self.vertex(p, None, color, uvs[i] if uvs else None) for i, p in enumerate(corners)]
        for i in range(1, len(ids) - 1):
            self.triangle(ids[0], ids[i], ids[i + 1])
        return self

    def grid(self, rows, columns, vertex):
        """A sheet of `vertex(row, column) -> (position, normal)`; its front is where row direction x column direction points."""
        ids = [[self.vertex(*vertex(i, j)) for j in range(columns)] for i in range(rows)]
        for i in range(rows - 1):
            for j in range(columns - 1):
                a, b, c, d = ids[i][j], ids[i + 1][j], ids[i + 1][j + 1], ids[i][j + 1]
                self.triangle(a, b, c)
                self.triangle(a, c, d)
        return self

    def add(self, other):
        base = len(self.positions)
        self.positions += other.positions
        self.normals += other.normals
        self.colors += other.colors
        self.uvs += other.uvs
        self.indices += [base + i for i in other.indices]
        return self


def box(lo, hi, color=None, skip=""):
    """An axis-aligned box without the faces named in `skip` (pairs such as "-y")."""
    (x0, y0, z0), (x1, y1, z1) = lo, hi
    faces = {
        "-x": ((x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)),
        "+x": ((x1, y0, z1), (x1, y0, z0), (x1, y1, z0), (x1, y1, z1)),
        "-y": ((x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)),
        "+y": ((x0, y1, z1), (x1, y1, z1), (x1, y1, z0), (x0, y1, z0)),
        "-z": ((x1, y0, z0), (x0, y0, z0), (x0, y1, z0), (x1, y1, z0)),
        "+z": ((x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)),
    }
    shape = Shape()
    for name, corners in faces.items():
        if name not in skip:
            shape.face(*corners, color=color)
    return shape


def room(lo, hi, skip=""):
    """The inside of an axis-aligned box: the faces of `box`, turned inwards."""
    outside = box(lo, hi, skip=skip)
    outside.indices = [i for t in range(0, len(outside.indices), 3) for i in reversed(outside.indices[t : t + 3])]
    return outside


def rounded_box(lo, hi, radius, arc=2):
    """A box whose edges are rounded to `radius` with `2 * arc` segments per quarter turn."""
    center = [(a + b) / 2 for a, b in zip(lo, hi)]
    inner = [(b - a) / 2 - radius for a, b in zip(lo, hi)]
    angles = [math.tan(math.pi / 4 * i / arc) for i in range(arc + 1)]
    shape = Shape(smooth=True)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        steps = [[-inner[k] - radius * t for t in reversed(angles)] + [inner[k] + radius * t for t in angles] for k in (u, v)]
        for side in (1.0, -1.0):
            rows, columns = (steps[0], steps[1]) if side > 0 else (steps[0][::-1], steps[1])

            def vertex(i, j):
                p = [0.0, 0.0, 0.0]
                p[axis], p[u], p[v] = side * (inner[axis] + radius), rows[i], columns[j]
                core = [max(-h, min(h, x)) for h, x in zip(inner, p)]
                n = unit(sub(p, core))
                return [c + k + radius * m for c, k, m in zip(center, core, n)], n

            shape.grid(len(rows), len(columns), vertex)
    return shape


def revolve(profile, segments, crease=0.6):
    """The surface that `profile`, a list of (radius, height) with the matter on its left, sweeps around the y axis.

    The profile is broken where it turns by more than `crease` radians. Upwards along the profile the front faces outwards.
    """
    runs, run = [], [profile[0]]
    for k in range(1, len(profile)):
        run.append(profile[k])
        if k + 1 < len(profile):
            (r0, y0), (r1, y1), (r2, y2) = profile[k - 1 : k + 2]
            turn = math.atan2(y2 - y1, r2 - r1) - math.atan2(y1 - y0, r1 - r0)
            if abs(math.remainder(turn, 2 * math.pi)) > crease:
                runs.append(run)
                run = [profile[k]]
    runs.append(run)
    shape = Shape(smooth=True)
    for points in runs:
        last = len(points) - 1

        def vertex(j, i, points=points, last=last):
            (ra, ya), (rb, yb) = points[max(j - 1, 0)], points[min(j + 1, last)]
            slope = unit((yb - ya, ra - rb, 0.0))
            phi = 2 * math.pi * (i % segments) / segments
            r, y = points[j]
            # On the axis of a surface that meets it at a right angle the normal is the axis.
            nr, ny = (0.0, math.copysign(1.0, slope[1])) if r == 0 and abs(slope[1]) > 0.7 else slope[:2]
            return (r * math.cos(phi), y, r * math.sin(phi)), (nr * math.cos(phi), ny, nr * math.sin(phi))

        shape.grid(len(points), segments + 1, vertex)
    return shape


def sphere(segments=48):
    """The unit sphere, with exact normals."""
    rings = segments // 2
    shape = Shape(smooth=True)

    def vertex(j, i):
        theta, phi = math.pi * (1 - j / rings), 2 * math.pi * (i % segments) / segments
        r = math.sin(theta) if 0 < j < rings else 0.0
        p = (r * math.cos(phi), math.cos(theta), r * math.sin(phi))
        return p, p

    return shape.grid(rings + 1, segments + 1, vertex)


def disc(radius, y=0.0, segments=32):
    """A flat disc that faces up."""
    ring = [2 * math.pi * i / segments for i in range(segments)]
    return Shape().face(*[(radius * math.cos(a), y, -radius * math.sin(a)) for a in ring])


def prism(corners, y0, y1, skip_bottom=False):
    """A convex polygon, `corners` (x, z) counter-clockwise as seen from above, raised from y0 to y1."""
    shape = Shape().face(*[(x, y1, z) for x, z in corners])
    if not skip_bottom:
        shape.face(*[(x, y0, z) for x, z in reversed(corners)])
    for (xa, za), (xb, zb) in zip(corners, corners[1:] + corners[:1]):
        shape.face((xa, y0, za), (xb, y0, zb), (xb, y1, zb), (xa, y1, za))
    return shape


def png(width, height, pixels):
    """A PNG of RGBA bytes in stored (uncompressed) blocks: its bytes depend on no compressor."""
    raw = b"".join(b"\0" + pixels[4 * width * y : 4 * width * (y + 1)] for y in range(height))
    blocks = [raw[i : i + 65535] for i in range(0, len(raw), 65535)]
    stored = b"".join(struct.pack("<BHH", i == len(blocks) - 1, len(b), len(b) ^ 0xFFFF) + b for i, b in enumerate(blocks))
    data = b"\x78\x01" + stored + struct.pack(">I", zlib.adler32(raw))

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def phong(kd, ks, exponent):
    """The BRDF of Phong, for a material."""
    return {"brdf": "phong", "kd": kd, "ks": ks, "exponent": exponent}


class Scene:
    """A scene under construction; `write` makes its three files."""

    def __init__(self, name, title, size=(1280, 720), flags="", notes="", expect=""):
        self.name, self.title, self.size, self.flags, self.notes, self.expect = name, title, size, flags, notes, expect
        self.bin = bytearray()
        self.stored = []
        self.extensions = set()
        self.doc = {
            "asset": {"version": "2.0", "generator": "Lumicache scenes/make_scenes.py", "copyright": "CC0-1.0"},
            "scene": 0,
            "scenes": [{"name": title, "nodes": []}],
        }

    def append(self, key, value):
        self.doc.setdefault(key, []).append(value)
        return len(self.doc[key]) - 1

    def material(
        self, name, color=(0.8, 0.8, 0.8), rough=1.0, metal=0.0, specular=1.0, double=False, texture=None, alpha=None, **more
    ):
        """Adds a material. `more`: emission (factor, strength), clearcoat (factor, roughness), glass (ior), cutoff, native (a BRDF of
        the papers)."""
        pbr = {"baseColorFactor": [*color, 1.0 if alpha is None else alpha], "metallicFactor": metal, "roughnessFactor": rough}
        if texture is not None:
            pbr["baseColorTexture"] = {"index": texture}
        material, extensions = {"name": name, "pbrMetallicRoughness": pbr}, {}
        if double:
            material["doubleSided"] = True
        if "native" in more:
            material["extras"] = {"lumicache": more["native"]}
        if specular != 1.0:
            extensions["KHR_materials_specular"] = {"specularFactor": specular}
        if "emission" in more:
            material["emissiveFactor"], strength = list(more["emission"][0]), more["emission"][1]
            extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
        if "clearcoat" in more:
            factor, roughness = more["clearcoat"]
            extensions["KHR_materials_clearcoat"] = {"clearcoatFactor": factor, "clearcoatRoughnessFactor": roughness}
        if "glass" in more:
            extensions["KHR_materials_transmission"] = {"transmissionFactor": 1.0}
            extensions["KHR_materials_ior"] = {"ior": more["glass"]}
            extensions["KHR_materials_volume"] = {"thicknessFactor": 1.0}
        if "cutoff" in more:
            material["alphaMode"], material["alphaCutoff"] = "MASK", more["cutoff"]
        elif alpha is not None:
            material["alphaMode"] = "BLEND"
        if extensions:
            material["extensions"] = extensions
            self.extensions |= set(extensions)
        return self.append("materials", material)

    def light(self, name, color, strength, double=False):
        """A black material that emits radiance color * strength."""
        return self.material(name, (0.0, 0.0, 0.0), specular=0.0, double=double, emission=(color, strength))

    def view(self, data, target=None):
        self.bin += b"\0" * (-len(self.bin) % 4)
        view = {"buffer": 0, "byteOffset": len(self.bin), "byteLength": len(data)}
        if target:
            view["target"] = target
        self.bin += data
        return self.append("bufferViews", view)

    def accessor(self, rows, kind, bounds=False, target=34962):
        rows = [[f32(x) for x in row] for row in rows]
        data = b"".join(struct.pack(f"<{len(r)}f", *r) for r in rows)
        accessor = {"bufferView": self.view(data, target), "componentType": 5126, "count": len(rows), "type": kind}
        if bounds:
            accessor["min"], accessor["max"] = [min(c) for c in zip(*rows)], [max(c) for c in zip(*rows)]
        return self.append("accessors", accessor)

    def image_texture(self, width, height, pixels):
        image = self.append("images", {"mimeType": "image/png", "bufferView": self.view(png(width, height, pixels))})
        return self.append("textures", {"source": image, "sampler": self.append("samplers", {"wrapS": 33071, "wrapT": 33071})})

    def geometry(self, shape):
        """The accessors of a shape, as the keys of a primitive; a shape is stored once however often it is used."""
        for known, keys in self.stored:
            if known is shape:
                return keys
        attributes = {"POSITION": self.accessor(shape.positions, "VEC3", bounds=True)}
        if shape.smooth:
            attributes["NORMAL"] = self.accessor(shape.normals, "VEC3")
        if shape.uvs:
            attributes["TEXCOORD_0"] = self.accessor(shape.uvs, "VEC2")
        if shape.colors:
            data = b"".join(struct.pack("<4H", *(round(65535 * c) for c in color), 65535) for color in shape.colors)
            view = self.view(data, 34962)
            color = {"bufferView": view, "componentType": 5123, "normalized": True, "count": len(shape.colors), "type": "VEC4"}
            attributes["COLOR_0"] = self.append("accessors", color)
        count = len(shape.indices)
        view = self.view(struct.pack(f"<{count}H", *shape.indices), 34963)
        indices = self.append("accessors", {"bufferView": view, "componentType": 5123, "count": count, "type": "SCALAR"})
        keys = {"attributes": attributes, "indices": indices}
        self.stored.append((shape, keys))
        return keys

    def mesh(self, name, shape, material):
        return self.append("meshes", {"name": name, "primitives": [{**self.geometry(shape), "material": material}]})

    def node(self, name, mesh, at=None, turn=0.0, scale=None):
        """Places a mesh: scaled, turned by `turn` degrees around +Y, moved."""
        node = {"name": name, "mesh": mesh}
        if at is not None:
            node["translation"] = [f32(x) for x in at]
        if turn:
            half = math.radians(turn) / 2
            node["rotation"] = [0.0, f32(math.sin(half)), 0.0, f32(math.cos(half))]
        if scale is not None:
            node["scale"] = [f32(x) for x in scale]
        index = self.append("nodes", node)
        self.doc["scenes"][0]["nodes"].append(index)
        return index

    def add(self, name, shape, material, at=None, turn=0.0, scale=None):
        return self.node(name, self.mesh(name, shape, material), at, turn, scale)

    def profile(self, ies):
        """Adds the text of an IES file as a light profile."""
        self.extensions.add("EXT_lights_ies")
        lights = self.doc.setdefault("extensions", {}).setdefault("EXT_lights_ies", {"lights": []})["lights"]
        lights.append({"bufferView": self.view(ies.encode()), "mimeType": "application/x-ies-lm-63"})
        return len(lights) - 1

    def luminaire(self, name, profile, at, turn=0.0, **more):
        """Places a luminaire that looks straight down, the plane of horizontal angle 0 turned by `turn` degrees around +Y from +X. `more`: multiplier, color."""
        # A quarter turn around -X takes -Z down; the turn around +Y comes after it.
        half, quarter = math.radians(turn) / 2, math.sqrt(0.5)
        rotation = [f32(quarter * x) for x in (-math.cos(half), math.sin(half), math.sin(half), math.cos(half))]
        extension = {"EXT_lights_ies": {"light": profile, **more}}
        node = {"name": name, "translation": [f32(x) for x in at], "rotation": rotation, "extensions": extension}
        self.doc["scenes"][0]["nodes"].append(self.append("nodes", node))

    def point_light(self, name, at, color, candela):
        """Places a point light."""
        self.extensions.add("KHR_lights_punctual")
        lights = self.doc.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append({"name": name, "type": "point", "color": list(color), "intensity": candela})
        extension = {"KHR_lights_punctual": {"light": len(lights) - 1}}
        node = {"name": name, "translation": [f32(x) for x in at], "extensions": extension}
        self.doc["scenes"][0]["nodes"].append(self.append("nodes", node))

    def camera(self, eye, target, yfov_degrees, name="camera"):
        back = unit(sub(eye, target))
        right = unit(cross((0.0, 1.0, 0.0), back))
        matrix = [f32(x) for row in (right, cross(back, right), back, eye) for x in (*row, row is eye)]
        aspect = f32(self.size[0] / self.size[1])
        perspective = {"yfov": f32(math.radians(yfov_degrees)), "aspectRatio": aspect, "znear": 0.01}
        camera = self.append("cameras", {"name": name, "type": "perspective", "perspective": perspective})
        self.doc["scenes"][0]["nodes"].append(self.append("nodes", {"name": name, "camera": camera, "matrix": matrix}))

    def walk(self, views, seconds, yfov_degrees, name="camera"):
        """A camera that goes from view to view, (eye, target) each, in so many seconds, turning evenly between them."""
        places, turns = [], []
        for eye, target in views:
            back = unit(sub(eye, target))
            right = unit(cross((0.0, 1.0, 0.0), back))
            turn = quaternion(right, cross(back, right), back)
            if turns and sum(a * b for a, b in zip(turn, turns[-1])) < 0.0:
                turn = tuple(-x for x in turn)
            places.append(eye)
            turns.append(turn)
        perspective = {"yfov": f32(math.radians(yfov_degrees)), "aspectRatio": f32(self.size[0] / self.size[1]), "znear": 0.01}
        camera = self.append("cameras", {"name": name, "type": "perspective", "perspective": perspective})
        start = {"translation": [f32(x) for x in places[0]], "rotation": [f32(x) for x in turns[0]]}
        node = self.append("nodes", {"name": name, "camera": camera, **start})
        self.doc["scenes"][0]["nodes"].append(node)
        times = self.accessor([(seconds * k / (len(views) - 1),) for k in range(len(views))], "SCALAR", bounds=True, target=None)
        paths = (("translation", self.accessor(places, "VEC3", target=None)), ("rotation", self.accessor(turns, "VEC4", target=None)))
        samplers = [{"input": times, "output": output} for _, output in paths]
        channels = [{"sampler": k, "target": {"node": node, "path": path}} for k, (path, _) in enumerate(paths)]
        self.append("animations", {"name": name, "samplers": samplers, "channels": channels})

    def write(self, folder):
        self.doc["buffers"] = [{"uri": f"{self.name}.bin", "byteLength": len(self.bin)}]
        if self.extensions:
            self.doc["extensionsUsed"] = sorted(self.extensions)
        folder = Path(folder)
        (folder / f"{self.name}.bin").write_bytes(self.bin)
        (folder / f"{self.name}.gltf").write_bytes((json.dumps(self.doc, separators=(",", ":")) + "\n").encode())
        lines = [f"title = {json.dumps(self.title)}", 'licence = "CC0-1.0"', f"size = [{self.size[0]}, {self.size[1]}]"]
        lines += [
            f'camera = "{self.doc["cameras"][0]["name"]}"',
            f"flags = {json.dumps(self.flags)}",
            folded("notes", self.notes),
        ]
        if self.expect:
            lines.append(folded("expect", self.expect))
        (folder / f"{self.name}.toml").write_bytes(("\n".join(lines) + "\n").encode())
