"""Plain glTF scenes (meshes, diffuse colours, emission, a camera) as Mitsuba scenes, for tests."""

import json
import struct
from pathlib import Path

import numpy as np

COMPONENTS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def accessor(gltf, folder, number):
    a = gltf["accessors"][number]
    view = gltf["bufferViews"][a["bufferView"]]
    data = (folder / gltf["buffers"][view["buffer"]]["uri"]).read_bytes()
    kind, width = COMPONENTS[a["componentType"]], WIDTHS[a["type"]]
    start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
    stride = view.get("byteStride", width * np.dtype(kind).itemsize)
    rows = [np.frombuffer(data, kind, width, start + i * stride) for i in range(a["count"])]
    return np.array(rows).reshape(a["count"], width)


def matrix(node):
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    m = np.eye(4)
    m[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    m[:3, :3] = m[:3, :3] @ np.diag(node.get("scale", (1, 1, 1)))
    m[:3, 3] = node.get("translation", (0, 0, 0))
    return m


def write_ply(path, positions, triangles):
    with open(path, "wb") as out:
        out.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(positions)}\n"
            "property float x\nproperty float y\nproperty float z\n"
            f"element face {len(triangles)}\nproperty list uchar int vertex_indices\n"
            "end_header\n".encode()
        )
        out.write(np.asarray(positions, "<f4").tobytes())
        for t in triangles:
            out.write(struct.pack("<Biii", 3, *map(int, t)))


def load(mi, path, folder, size, spp, integrator):
    """The glTF file `path` as a dictionary for `mi.load_dict`; meshes go to `folder`."""
    path = Path(path)
    gltf = json.loads(path.read_text())
    scene = {"type": "scene", "integrator": integrator}
    nodes = [(n, np.eye(4)) for n in gltf["scenes"][gltf.get("scene", 0)]["nodes"]]
    while nodes:
        number, parent = nodes.pop()
        node = gltf["nodes"][number]
        world = parent @ matrix(node)
        nodes += [(child, world) for child in node.get("children", [])]
        if "camera" in node and "sensor" not in scene:
            camera = gltf["cameras"][node["camera"]]["perspective"]
            # Mitsuba's cameras look along +z with x to the left.
            to_world = world @ np.diag([-1, 1, -1, 1])
            scene["sensor"] = {
                "type": "perspective",
                "fov": float(np.degrees(camera["yfov"])),
                "fov_axis": "y",
                "to_world": mi.ScalarTransform4f(to_world),
                "film": {
                    "type": "hdrfilm",
                    "width": size,
                    "height": size,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
                "sampler": {"type": "independent", "sample_count": spp},
            }
        for k, primitive in enumerate(
            gltf["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []
        ):
            positions = accessor(gltf, path.parent, primitive["attributes"]["POSITION"])
            indices = accessor(gltf, path.parent, primitive["indices"]).reshape(-1, 3)
            positions = positions @ world[:3, :3].T + world[:3, 3]
            name = f"mesh-{number}-{k}"
            write_ply(Path(folder) / f"{name}.ply", positions, indices)
            material = gltf["materials"][primitive["material"]]
            color = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1, 1])[
                :3
            ]
            strength = (
                material.get("extensions", {})
                .get("KHR_materials_emissive_strength", {})
                .get("emissiveStrength", 1)
            )
            emission = [c * strength for c in material.get("emissiveFactor", [0, 0, 0])]
            diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}
            shape = {
                "type": "ply",
                "filename": str(Path(folder) / f"{name}.ply"),
                "face_normals": True,
                "bsdf": {"type": "twosided", "a": diffuse},
            }
            if any(emission):
                shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": emission}}
            scene[name] = shape
    return scene
