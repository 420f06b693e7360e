#!/usr/bin/env python3
"""Writes glTF files for the fuzzer to begin with: `gltf_seeds.py FOLDER`.

The small scenes of scenes/ as binary files without others beside them, and a file of everything that
is read, as text and binary. Standard library only.
"""

import base64
import json
import struct
import sys
import zlib
from pathlib import Path

# Longer ones are cut by the fuzzer.
LONGEST = 1 << 16
BYTE, SHORT, INT, FLOAT = 5121, 5123, 5125, 5126
CODES = {5120: "b", BYTE: "B", 5122: "h", SHORT: "H", INT: "I", FLOAT: "f"}


def glb(document, buffer):
    """A binary file."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    buffer += b"\0" * (-len(buffer) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text
    if buffer:
        chunks += struct.pack("<I", len(buffer)) + b"BIN\0" + buffer
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def png(pixels, width, kind):
    """A PNG of rows of bytes; `kind` is its colour type."""
    chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    samples = {0: 1, 2: 3, 6: 4}[kind]
    rows = [b"\0" + bytes(pixels[i : i + width * samples]) for i in range(0, len(pixels), width * samples)]
    header = struct.pack(">IIBBBBB", width, len(rows), 8, kind, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"".join(rows))) + chunk(b"IEND", b"")


class Everything:
    """A document with one buffer."""

    def __init__(self):
        self.bytes = b""
        self.json = {"asset": {"version": "2.0"}}

    def add(self, array, value):
        self.json.setdefault(array, []).append(value)
        return len(self.json[array]) - 1

    def view(self, data, **more):
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data), **more}
        self.bytes += data
        return self.add("bufferViews", view)

    def accessor(self, values, shape, code=FLOAT, bounds=False, **more):
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[shape]
        data = struct.pack(f"<{len(values)}{CODES[code]}", *values)
        accessor = {"bufferView": self.view(data), "componentType": code, "type": shape, "count": len(values) // width}
        if bounds:
            accessor["min"] = [min(values[i::width]) for i in range(width)]
            accessor["max"] = [max(values[i::width]) for i in range(width)]
        return self.add("accessors", {**accessor, **more})

    def build(self):
        square = [-1.0, 0.0, -1.0, 1.0, 0.0, -1.0, 1.0, 0.0, 1.0, -1.0, 0.0, 1.0]
        attributes = {
            "POSITION": self.accessor(square, "VEC3", bounds=True),
            "NORMAL": self.accessor([0.0, 1.0, 0.0] * 4, "VEC3"),
            "TANGENT": self.accessor([1.0, 0.0, 0.0, 1.0] * 4, "VEC4"),
            "TEXCOORD_0": self.accessor([0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0], "VEC2"),
            "TEXCOORD_1": self.accessor([0, 0, 255, 0, 255, 255, 0, 255], "VEC2", BYTE, normalized=True),
            "COLOR_0": self.accessor([65535] * 16, "VEC4", SHORT, normalized=True),
        }
        skinned = {
            **attributes,
            "JOINTS_0": self.accessor([0, 1, 0, 0] * 4, "VEC4", BYTE),
            "WEIGHTS_0": self.accessor([0.5, 0.5, 0.0, 0.0] * 4, "VEC4"),
        }
        indices = [self.accessor([0, 2, 1, 0, 3, 2], "SCALAR", code) for code in (BYTE, SHORT, INT)]
        morphed = {"POSITION": self.accessor([0.0, 0.25, 0.0] * 4, "VEC3", bounds=True)}
        quantised = self.accessor([-9, 0, -9, 9, 0, -9, 9, 0, 9], "VEC3", 5122, bounds=True)
        at = self.view(struct.pack("<2H", 1, 2))
        by = self.view(struct.pack("<6f", 1, 2, 3, 4, 5, 6))
        sparse = self.add("accessors", {
            "componentType": FLOAT, "type": "VEC3", "count": 4, "min": [0, 0, 0], "max": [4, 5, 6],
            "sparse": {"count": 2, "indices": {"bufferView": at, "componentType": SHORT}, "values": {"bufferView": by}},
        })
        images = [
            self.add("images", {"bufferView": self.view(data), "mimeType": "image/png"})
            for data in (png([255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 9, 9], 2, 2), png([90, 200], 1, 0), png([255] * 12 + [9] * 4, 2, 6))
        ]
        self.add("samplers", {"wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9987})
        textures = [self.add("textures", {"source": image, "sampler": 0}) for image in images]
        place = {"KHR_texture_transform": {"offset": [0.5, 0.1], "rotation": 0.3, "scale": [2, 3], "texCoord": 1}}
        info = lambda k, **more: {"index": textures[k], "texCoord": k % 2, "extensions": place, **more}
        self.add("materials", {
            "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.6, 0.7, 0.8], "baseColorTexture": info(0),
                "metallicFactor": 0.5, "roughnessFactor": 0.3, "metallicRoughnessTexture": info(1)},
            "normalTexture": info(0, scale=0.5), "occlusionTexture": info(1, strength=0.5),
            "emissiveFactor": [1, 0.5, 0.2], "emissiveTexture": info(0), "alphaMode": "MASK", "alphaCutoff": 0.4,
            "doubleSided": True,
            "extensions": {
                "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": info(1), "clearcoatRoughnessFactor": 0.1},
                "KHR_materials_emissive_strength": {"emissiveStrength": 8},
                "KHR_materials_ior": {"ior": 1.4},
                "KHR_materials_specular": {"specularFactor": 0.5, "specularTexture": info(2), "specularColorFactor": [1, 0.9, 0.8]},
                "KHR_materials_transmission": {"transmissionFactor": 0.5, "transmissionTexture": info(1)},
                "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationColor": [0.9, 0.5, 0.5], "attenuationDistance": 2},
            },
        })
        self.add("materials", {"extensions": {"KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0.2, 0.2, 0.2], "glossinessFactor": 0.7, "diffuseTexture": info(0)}}})
        self.add("materials", {"alphaMode": "BLEND", "extensions": {"KHR_materials_unlit": {}}})
        for brdf in (
            {"brdf": "phong", "kd": [0.2, 0.2, 0.3], "ks": 0.5, "exponent": 50},
            {"brdf": "ward", "kd": 0.1, "ks": 0.4, "alpha_x": 0.05, "alpha_y": 0.2},
            {"brdf": "lafortune", "kd": 0.3, "lobes": [{"cx": -0.9, "cy": -0.9, "cz": [0.9, 0.8, 0.7], "exponent": 20}]},
        ):
            self.add("materials", {"extras": {"lumicache": brdf}})
        shapes = [
            {"attributes": attributes, "indices": indices[k % 3], "material": k} for k in range(6)
        ] + [{"attributes": {"POSITION": attributes["POSITION"]}, "mode": mode} for mode in range(7)]
        plain = self.add("meshes", {"primitives": shapes})
        soft = self.add("meshes", {"weights": [0.5], "primitives": [{"attributes": skinned, "indices": indices[0], "targets": [morphed]}]})
        odd = self.add("meshes", {"primitives": [{"attributes": {"POSITION": quantised}}, {"attributes": {"POSITION": sparse}}]})
        binds = self.accessor([1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] * 2, "MAT4")
        self.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.9, "znear": 0.1, "zfar": 99, "aspectRatio": 1.5}})
        self.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 2, "znear": 0, "zfar": 50}})
        lamp = b"IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n9 5 1\n"
        self.json["extensions"] = {
            "KHR_lights_punctual": {"lights": [
                {"type": "point", "color": [1, 0.9, 0.8], "intensity": 10, "range": 20},
                {"type": "spot", "intensity": 30, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}},
                {"type": "directional", "intensity": 2},
            ]},
            "EXT_lights_ies": {"lights": [{"bufferView": self.view(lamp), "mimeType": "application/x-ies-lm-63"}]},
        }
        light = lambda k: {"extensions": {"KHR_lights_punctual": {"light": k}}}
        # Nodes 0 and 1 are the joints.
        nodes = [
            {"name": "root", "children": [1], "translation": [0, 0.1, 0]},
            {"name": "joint", "rotation": [0, 0.7071068, 0, 0.7071068]},
            {"mesh": plain, "translation": [0, -1, 0], "scale": [3, 3, 3]},
            {"mesh": soft, "skin": 0, "weights": [0.7]},
            {"mesh": odd, "matrix": [0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 1]},
            {"camera": 0, "translation": [0, 1, 6]},
            {"camera": 1, "translation": [0, 2, 5]},
            {"translation": [0, 3, 0], "children": [8, 9, 10], **light(0)},
            {"rotation": [-0.7071068, 0, 0, 0.7071068], **light(1)},
            light(2),
            {"extensions": {"EXT_lights_ies": {"light": 0, "multiplier": 2, "color": [1, 1, 0.5]}}},
            {"mesh": odd, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {
                "TRANSLATION": self.accessor([0.0, 1, 0, 2, 1, 0], "VEC3"),
                "ROTATION": self.accessor([0.0, 0, 0, 1] * 2, "VEC4"),
                "SCALE": self.accessor([0.1] * 6, "VEC3")}}}},
        ]
        for node in nodes:
            self.add("nodes", node)
        self.add("skins", {"joints": [0, 1], "inverseBindMatrices": binds, "skeleton": 0})
        times = self.accessor([0.0, 1.0], "SCALAR", bounds=True)
        moves = self.accessor([0.0, 1, 6, 0, 2, 6], "VEC3")
        turns = self.accessor([0.0, 0, 0, 1] * 6, "VEC4")
        self.add("animations", {
            "samplers": [{"input": times, "output": moves}, {"input": times, "output": turns, "interpolation": "CUBICSPLINE"}],
            "channels": [{"sampler": 0, "target": {"node": 5, "path": "translation"}},
                {"sampler": 1, "target": {"node": 5, "path": "rotation"}}],
        })
        self.add("scenes", {"nodes": [0, 2, 3, 4, 5, 6, 7, 11]})
        self.json["scene"] = 0
        self.json["extensionsUsed"] = sorted(named(self.json))
        self.json["extensionsRequired"] = ["KHR_mesh_quantization"]
        self.json["buffers"] = [{"byteLength": len(self.bytes)}]
        return self


def named(value):
    """The extensions of a document."""
    if isinstance(value, dict):
        inner = set().union(*map(named, value.values()), {"KHR_mesh_quantization"})
        return inner | set(value.get("extensions", {}))
    return set().union(*map(named, value)) if isinstance(value, list) else set()


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for scene in sorted(Path(__file__).parents[1].glob("scenes/*.gltf")):
        document = json.loads(scene.read_text())
        buffer = scene.with_suffix(".bin").read_bytes()
        del document["buffers"][0]["uri"]
        file = glb(document, buffer)
        if len(file) <= LONGEST:
            (folder / f"{scene.stem}.glb").write_bytes(file)
    everything = Everything().build()
    (folder / "everything.glb").write_bytes(glb(everything.json, everything.bytes))
    data = base64.b64encode(everything.bytes).decode()
    everything.json["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
    (folder / "everything.gltf").write_text(json.dumps(everything.json))


main()
