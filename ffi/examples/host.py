"""host.py - the library from Python by ctypes. Loads a glTF scene, builds a cache where rays meet
the scene, and prints the mean irradiance.

   python3 host.py liblumicache.so scene.gltf
"""

import ctypes as c
import sys


class Library:
    """The functions that this example uses; a failing one raises."""

    def __init__(self, path):
        self.lib = c.CDLL(path)

    def __getattr__(self, name):
        function = getattr(self.lib, name)

        def call(*arguments):
            if function(*arguments) != 0:
                message = c.c_char_p()
                self.lib.lumi_get_last_error(c.byref(message))
                raise RuntimeError(message.value.decode())

        return call


class SceneInfo(c.Structure):
    _fields_ = [
        ("struct_size", c.c_uint32), ("reserved", c.c_uint32), ("bounds_min", c.c_float * 3),
        ("bounds_max", c.c_float * 3),
        ("triangles", c.c_uint64), ("cameras", c.c_uint64), ("hash", c.c_char * 72),
        ("backend", c.c_char * 64),
    ]  # fmt: skip


class Trace(c.Structure):
    _fields_ = [("struct_size", c.c_uint32), ("flags", c.c_uint32), ("n", c.c_size_t)] + [
        (name, c.c_void_p)
        for name in ("origin", "dir", "distance", "position", "normal", "geo_normal", "albedo")
    ]


class Query(c.Structure):
    _fields_ = [
        ("struct_size", c.c_uint32), ("flags", c.c_uint32), ("n", c.c_size_t),
        ("position", c.c_void_p), ("position_stride", c.c_size_t), ("normal", c.c_void_p),
        ("normal_stride", c.c_size_t),
        ("geo_normal", c.c_void_p), ("geo_normal_stride", c.c_size_t), ("wo", c.c_void_p),
        ("wo_stride", c.c_size_t),
        ("footprint", c.c_void_p), ("irradiance", c.c_void_p), ("irradiance_stride", c.c_size_t),
        ("radiance", c.c_void_p), ("radiance_stride", c.c_size_t), ("error", c.c_void_p),
        ("status", c.c_void_p),
        ("glossy_samples", c.c_uint32), ("reserved", c.c_uint32),
    ]  # fmt: skip


def floats(count):
    return (c.c_float * count)()


def main(library, scene_file):
    lumi = Library(library)
    abi = lumi.lib.lumi_get_abi_version
    abi.restype = c.c_uint32
    device, scene, cache = c.c_void_p(), c.c_void_p(), c.c_void_p()
    lumi.lumi_device_new(abi(), None, c.byref(device))
    lumi.lumi_scene_new(device, c.byref(scene))
    lumi.lumi_scene_load_gltf(scene, scene_file.encode())
    lumi.lumi_scene_commit(scene)
    info = SceneInfo(struct_size=c.sizeof(SceneInfo))
    lumi.lumi_scene_get_info(scene, c.byref(info))

    # Rays from the middle of the scene, over a spiral of directions.
    n = 2000
    origin, dirs, position, normal, distance = (
        floats(3 * n),
        floats(3 * n),
        floats(3 * n),
        floats(3 * n),
        floats(n),
    )
    for i in range(n):
        z = 1 - 2 * (i + 0.5) / n
        xy = (1 - z * z) ** 0.5 * complex(0.7373688, -0.6754903) ** i  # the golden angle
        dirs[3 * i : 3 * i + 3] = [xy.real, xy.imag, z]
        origin[3 * i : 3 * i + 3] = [
            0.5 * (a + b) for a, b in zip(info.bounds_min, info.bounds_max)
        ]
    address = c.addressof
    trace = Trace(
        c.sizeof(Trace),
        0,
        n,
        address(origin),
        address(dirs),
        address(distance),
        address(position),
        address(normal),
    )
    lumi.lumi_scene_trace(scene, c.byref(trace))
    hits = [i for i in range(n) if distance[i] != float("inf")]
    seen_at, normals = floats(3 * len(hits)), floats(3 * len(hits))
    for k, i in enumerate(hits):
        seen_at[3 * k : 3 * k + 3] = position[3 * i : 3 * i + 3]
        normals[3 * k : 3 * k + 3] = normal[3 * i : 3 * i + 3]

    lumi.lumi_cache_new(scene, b"auto", c.byref(cache))
    lumi.lumi_cache_set_i32(cache, b"gather.rays", 64)
    lumi.lumi_cache_set_i32(cache, b"levels", 1)
    irradiance, status = floats(3 * len(hits)), (c.c_uint8 * len(hits))()
    query = Query(
        struct_size=c.sizeof(Query), n=len(hits), position=address(seen_at), normal=address(normals)
    )
    lumi.lumi_cache_build(cache, c.byref(query))
    query.irradiance, query.status = address(irradiance), address(status)
    lumi.lumi_cache_query(cache, c.byref(query))
    missing = sum(s != 0 for s in status)
    mean = sum(irradiance[1::3]) / len(hits)
    print(
        f"{info.backend.decode()}: {len(hits)} points, {missing} missing, "
        f"mean irradiance {mean:.4f}"
    )
    for handle, release in ((cache, "cache"), (scene, "scene"), (device, "device")):
        getattr(lumi.lib, f"lumi_{release}_release")(handle)
    return 0 if mean > 0 and missing < 0.01 * len(hits) else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
