"""Lumicache for Python hosts: the C library by ctypes, arrays by numpy. docs/CAPI.md describes the
functions.

    import lumicache
    library = lumicache.Library("/usr/local/lib/liblumicache.so.1")
    scene = library.scene(); ...; scene.commit()
    cache = scene.cache("auto"); cache.build(positions, normals)
    irradiance, status = cache.query(positions, normals)

Objects release their handles when they go. Arrays are float32, one row per point.
"""

import ctypes as c

import numpy as np

ABI = 0x00010000
FORMATS = {("f4", 2): 2, ("f4", 3): 3, ("f4", 4): 4, ("u4", 1): 17, ("u4", 3): 19}
HOST_CONCURRENT, HOST_FULL, HOST_ENV_IN_MISS = 1, 2, 4
QUERY_FILL = 1
INTERPOLATED, COMPUTED, MISSING, REJECTED = range(4)
RENDER_PATH, RENDER_ORTHOGRAPHIC, RENDER_DENOISE, RENDER_DENOISE_AUTO = 1, 2, 4, 8


class Error(RuntimeError):
    """A call that failed; `code` is LUMI_ERROR_*."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


class View(c.Structure):
    _fields_ = [
        ("data", c.c_void_p),
        ("count", c.c_size_t),
        ("stride", c.c_size_t),
        ("format", c.c_uint32),
        ("flags", c.c_uint32),
    ]


class MeshDesc(c.Structure):
    _fields_ = (
        [("struct_size", c.c_uint32), ("flags", c.c_uint32)]
        + [
            (name, View)
            for name in ("positions", "indices", "normals", "uv0", "colors", "triangle_materials")
        ]
        + [("material", c.c_uint32), ("reserved", c.c_uint32)]
    )


class MaterialDesc(c.Structure):
    _fields_ = [
        ("struct_size", c.c_uint32), ("flags", c.c_uint32), ("base_color", c.c_float * 3),
        ("alpha", c.c_float),
        ("alpha_mode", c.c_uint32), ("alpha_cutoff", c.c_float), ("metallic", c.c_float),
        ("roughness", c.c_float), ("ior", c.c_float),
        ("specular", c.c_float), ("transmission", c.c_float), ("emission", c.c_float * 3),
        ("base_color_texture", c.c_int32),
        ("metallic_roughness_texture", c.c_int32), ("emission_texture", c.c_int32),
        ("normal_texture", c.c_int32),
    ]  # fmt: skip


class TextureDesc(c.Structure):
    _fields_ = [
        (name, c.c_uint32)
        for name in ("struct_size", "width", "height", "wrap_u", "wrap_v", "nearest")
    ] + [("pixels", c.c_void_p)]


class LightDesc(c.Structure):
    _fields_ = [
        ("struct_size", c.c_uint32), ("kind", c.c_uint32), ("position", c.c_float * 3),
        ("direction", c.c_float * 3),
        ("intensity", c.c_float * 3), ("range", c.c_float), ("cos_inner", c.c_float),
        ("cos_outer", c.c_float),
    ]  # fmt: skip


class RayBatch(c.Structure):
    _fields_ = [("struct_size", c.c_uint32), ("n", c.c_uint32)] + [
        ("origin", c.POINTER(c.c_float)), ("dir", c.POINTER(c.c_float)),
        ("bounce", c.POINTER(c.c_uint32)), ("seed", c.POINTER(c.c_uint32)),
        ("radiance", c.POINTER(c.c_float)), ("distance", c.POINTER(c.c_float)),
        ("normal", c.POINTER(c.c_float)), ("albedo", c.POINTER(c.c_float)),
    ]  # fmt: skip


TRACE = c.CFUNCTYPE(c.c_int32, c.c_void_p, c.POINTER(RayBatch))
PROGRESS = c.CFUNCTYPE(c.c_int32, c.c_void_p, c.c_double, c.c_char_p)
LOG = c.CFUNCTYPE(None, c.c_void_p, c.c_int32, c.c_int32, c.c_char_p)


class HostDesc(c.Structure):
    _fields_ = [
        ("struct_size", c.c_uint32), ("flags", c.c_uint32), ("preferred_batch", c.c_uint32),
        ("max_batch", c.c_uint32),
        ("bounds_min", c.c_float * 3), ("bounds_max", c.c_float * 3), ("scene_hash", c.c_uint64),
        ("trace", TRACE), ("user", c.c_void_p),
    ]  # fmt: skip


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


class Stats(c.Structure):
    _fields_ = (
        [("struct_size", c.c_uint32), ("frozen", c.c_uint32)]
        + [
            (name, c.c_uint64)
            for name in (
                "records",
                "bytes",
                "rays",
                "queries",
                "hits",
                "misses",
                "host_calls",
                "host_rays",
            )
        ]
        + [(name, c.c_double) for name in ("build_seconds", "mean_radius", "max_radius")]
        + [("radiance_records", c.c_uint64)]
    )


class RenderDesc(c.Structure):
    _fields_ = [
        (name, c.c_uint32)
        for name in ("struct_size", "flags", "width", "height", "samples", "reserved")
    ] + [
        ("camera", c.c_float * 12),
        ("yfov", c.c_float),
        ("aspect", c.c_float),
        ("near_plane", c.c_float),
        ("far_plane", c.c_float),
    ]


class Layer(c.Structure):
    _fields_ = [
        ("name", c.c_char_p),
        ("data", c.c_void_p),
        ("channels", c.c_uint32),
        ("reserved", c.c_uint32),
    ]


def _sized(kind, **fields):
    return kind(struct_size=c.sizeof(kind), **fields)


def _floats(rows, width=3):
    rows = np.ascontiguousarray(rows, np.float32)
    assert rows.ndim == 2 and rows.shape[1] == width, (
        f"expected rows of {width} floats, not {rows.shape}"
    )
    return rows


def _columns(matrix):
    """A 4 x 4 matrix (rows of a mathematical one) as the 12 floats of the library."""
    return (c.c_float * 12)(*np.asarray(matrix, np.float32)[:3, :4].T.ravel())


class Library:
    """The shared library and a device. `log(severity, message)` hears of warnings and failures."""

    def __init__(self, path="liblumicache.so.1", config="", log=None):
        self.c = c.CDLL(path)
        self.c.lumi_get_version_string.restype = c.c_char_p
        self.handle = c.c_void_p()
        self.call("lumi_device_new", c.c_uint32(ABI), config.encode(), c.byref(self.handle))
        self._log = (
            LOG(lambda user, severity, code, message: log(severity, message.decode()))
            if log
            else LOG()
        )
        self.call("lumi_device_set_log", self.handle, self._log, None)

    def call(self, name, *arguments):
        code = getattr(self.c, name)(*arguments)
        if code != 0:
            message = c.c_char_p()
            self.c.lumi_get_last_error(c.byref(message))
            raise Error(code, message.value.decode())

    @property
    def version(self):
        return self.c.lumi_get_version_string().decode()

    @property
    def backend(self):
        text = c.create_string_buffer(64)
        self.call("lumi_device_get_backend", self.handle, text, c.c_size_t(64))
        return text.value.decode()

    def scene(self):
        return Scene(self)

    def __del__(self):
        if getattr(self, "handle", None):
            self.c.lumi_device_release(self.handle)


class Scene:
    """A scene: describe it, then commit it; or say which function traces, then commit it."""

    def __init__(self, library):
        self.library, self.handle = library, c.c_void_p()
        library.call("lumi_scene_new", library.handle, c.byref(self.handle))

    def load_gltf(self, path):
        self.library.call("lumi_scene_load_gltf", self.handle, str(path).encode())

    def add_texture(self, pixels):
        """`pixels`: rows x columns x 4 bytes, first row on top."""
        pixels = np.ascontiguousarray(pixels, np.uint8)
        height, width, _ = pixels.shape
        return self._add(
            "texture", _sized(TextureDesc, width=width, height=height, pixels=pixels.ctypes.data)
        )

    def add_material(self, **fields):
        material = MaterialDesc()
        self.library.call("lumi_material_init", c.byref(material))
        for name, value in fields.items():
            setattr(material, name, tuple(value) if name in ("base_color", "emission") else value)
        return self._add("material", material)

    def add_mesh(
        self,
        positions,
        indices,
        normals=None,
        uv0=None,
        colors=None,
        triangle_materials=None,
        material=0,
    ):
        kept = []

        def view(array, kind, width):
            if array is None:
                return View()
            array = np.ascontiguousarray(array, kind).reshape(-1, width)
            kept.append(array)
            return View(array.ctypes.data, len(array), 0, FORMATS[(kind, width)], 0)

        return self._add(
            "mesh",
            _sized(
                MeshDesc, positions=view(positions, "f4", 3), indices=view(indices, "u4", 3),
                normals=view(normals, "f4", 3),
                uv0=view(uv0, "f4", 2), colors=view(colors, "f4", 4),
                triangle_materials=view(triangle_materials, "u4", 1), material=material,
            ),
        )  # fmt: skip

    def _add(self, what, desc):
        number = c.c_uint32()
        self.library.call(f"lumi_scene_add_{what}", self.handle, c.byref(desc), c.byref(number))
        return number.value

    def add_instance(self, mesh, to_world=None):
        self.library.call(
            "lumi_scene_add_instance",
            self.handle,
            c.c_uint32(mesh),
            None if to_world is None else _columns(to_world),
        )

    def add_light(
        self,
        kind,
        intensity,
        position=(0, 0, 0),
        direction=(0, 0, -1),
        range=0,
        cos_inner=1,
        cos_outer=0,
    ):
        kinds = {"point": 0, "spot": 1, "directional": 2}
        light = _sized(
            LightDesc, kind=kinds[kind], intensity=tuple(intensity), position=tuple(position),
            direction=tuple(direction), range=range,
            cos_inner=cos_inner, cos_outer=cos_outer,
        )  # fmt: skip
        self.library.call("lumi_scene_add_light", self.handle, c.byref(light))

    def set_environment(self, rgb, to_map=None):
        """`rgb`: rows x columns x 3, from the zenith (+y); `to_map`: 3 x 3 rotation from the world
        to the map."""
        rgb = np.ascontiguousarray(rgb, np.float32)
        rotation = (
            None if to_map is None else (c.c_float * 9)(*np.asarray(to_map, np.float32).T.ravel())
        )
        height, width, _ = rgb.shape
        self.library.call(
            "lumi_scene_set_environment",
            self.handle,
            c.c_void_p(rgb.ctypes.data),
            c.c_uint32(width),
            c.c_uint32(height),
            rotation,
        )

    def set_host(self, trace, bounds, flags=0, preferred_batch=0, max_batch=0, scene_hash=0):
        """`trace(rays)` fills the arrays of `rays`: see `Rays`. An exception in `trace` ends the
        call of the library, which raises it again."""

        def callback(_, batch):
            try:
                trace(Rays(batch.contents))
                return 0
            except BaseException as error:  # must not reach the C code
                self.failure = error
                return 1

        self.failure = None
        self._trace = TRACE(callback)
        host = _sized(
            HostDesc, flags=flags, preferred_batch=preferred_batch, max_batch=max_batch,
            bounds_min=tuple(bounds[0]),
            bounds_max=tuple(bounds[1]), scene_hash=scene_hash, trace=self._trace,
        )  # fmt: skip
        self.library.call("lumi_scene_set_host", self.handle, c.byref(host))

    def commit(self):
        self.library.call("lumi_scene_commit", self.handle)

    def cache(self, preset="auto"):
        return Cache(self, preset)

    def __del__(self):
        if getattr(self, "handle", None):
            self.library.c.lumi_scene_release(self.handle)


class Rays:
    """A batch of rays as numpy arrays in the library's memory: origin, dir, bounce, seed to read;
    radiance, distance, normal and albedo to fill."""

    def __init__(self, batch):
        self.n = batch.n
        for name, width in [
            ("origin", 3),
            ("dir", 3),
            ("bounce", 0),
            ("seed", 0),
            ("radiance", 3),
            ("distance", 0),
            ("normal", 3),
            ("albedo", 3),
        ]:
            setattr(
                self,
                name,
                np.ctypeslib.as_array(
                    getattr(batch, name), (batch.n, width) if width else (batch.n,)
                ),
            )


class Cache:
    """A cache of a committed scene."""

    def __init__(self, scene, preset):
        self.scene, self.library, self.handle = scene, scene.library, c.c_void_p()
        self.call("lumi_cache_new", scene.handle, preset.encode(), c.byref(self.handle))

    def call(self, name, *arguments):
        self.scene.failure = None
        try:
            self.library.call(name, *arguments)
        except Error as error:
            if getattr(self.scene, "failure", None) is not None:
                raise self.scene.failure from error
            raise

    def set(self, **settings):
        """`set(quality=2.0, **{"gather.rays": 64})`."""
        for name, value in settings.items():
            if isinstance(value, bool) or isinstance(value, str):
                self.call(
                    "lumi_cache_set_str",
                    self.handle,
                    name.encode(),
                    str(value).lower().encode() if isinstance(value, bool) else value.encode(),
                )
            elif isinstance(value, int):
                self.call("lumi_cache_set_i32", self.handle, name.encode(), c.c_int32(value))
            else:
                self.call("lumi_cache_set_f32", self.handle, name.encode(), c.c_float(value))

    def watch(self, progress):
        """`progress(fraction)` returns true to cancel; None: nobody watches."""
        self._progress = (
            PROGRESS(lambda user, fraction, phase: 1 if progress(fraction) else 0)
            if progress
            else PROGRESS()
        )
        self.call("lumi_cache_set_progress", self.handle, self._progress, None)

    def _query(self, positions, normals, footprints):
        arrays = [_floats(positions), _floats(normals)]
        query = _sized(
            Query, n=len(arrays[0]), position=arrays[0].ctypes.data, normal=arrays[1].ctypes.data
        )
        if footprints is not None:
            arrays.append(np.ascontiguousarray(footprints, np.float32))
            query.footprint = arrays[2].ctypes.data
        return query, arrays

    def build(self, positions, normals, footprints=None):
        query, kept = self._query(positions, normals, footprints)
        self.call("lumi_cache_build", self.handle, c.byref(query))

    def query(self, positions, normals, footprints=None, fill=False):
        """Irradiance and status of each point."""
        query, kept = self._query(positions, normals, footprints)
        irradiance, status = np.zeros((query.n, 3), np.float32), np.zeros(query.n, np.uint8)
        query.flags = QUERY_FILL if fill else 0
        query.irradiance, query.status = irradiance.ctypes.data, status.ctypes.data
        self.call("lumi_cache_query", self.handle, c.byref(query))
        return irradiance, status

    def render(self, width, height, camera, yfov, samples=16, layers=("",), flags=0):
        """The layers, each rows x columns x channels, first row on top. `camera`: 4 x 4, camera to
        world."""
        channels = {"": 4, "Z": 1, "gi.records": 1, "gi.status": 1, "gi.error": 1}
        rooms = {
            name: np.zeros((height, width, channels.get(name, 3)), np.float32) for name in layers
        }
        described = (Layer * len(rooms))(
            *[Layer(n.encode(), r.ctypes.data, r.shape[2]) for n, r in rooms.items()]
        )
        desc = _sized(
            RenderDesc,
            flags=flags,
            width=width,
            height=height,
            samples=samples,
            camera=_columns(camera),
            yfov=yfov,
        )
        self.call(
            "lumi_cache_render", self.handle, c.byref(desc), described, c.c_size_t(len(rooms))
        )
        return rooms

    def freeze(self):
        self.call("lumi_cache_freeze", self.handle)

    def save(self, path):
        self.call("lumi_cache_save", self.handle, str(path).encode())

    def load(self, path, reuse=False):
        self.call("lumi_cache_load", self.handle, str(path).encode(), c.c_uint32(reuse))

    @property
    def stats(self):
        stats = _sized(Stats)
        self.call("lumi_cache_get_stats", self.handle, c.byref(stats))
        return stats

    def __del__(self):
        if getattr(self, "handle", None):
            self.library.c.lumi_cache_release(self.handle)
