"""An integrator for Mitsuba 3 in which Mitsuba keeps its scene. A callback lends Lumicache rays and
direct light; Lumicache answers with indirect light.

Everything works that Mitsuba can intersect and shade, textures and all lights included. For
vectorised variants (llvm_ad_rgb); see README.md.

    import lumicache_integrator
    lumicache_integrator.register("/usr/local/lib/liblumicache.so.1")
    scene = mi.load_dict({..., "integrator": {"type": "lumicache_host"}})
"""

import sys
import threading
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "python"))
import lumicache  # noqa: E402


def rows(vector):
    return np.ascontiguousarray(np.array(vector, dtype=np.float32).T)


def vector(kind, array):
    return kind(*[mi.Float(np.ascontiguousarray(array[:, k])) for k in range(3)])


def facing(si, direction):
    """The shading normal on the side of the viewer."""
    n = si.sh_frame.n
    return dr.select(dr.dot(n, direction) > 0, -n, n)


def direct(scene, si, bsdf, sample, active):
    """Reflected light of one emitter sample."""
    ds, weight = scene.sample_emitter_direction(si, sample, True, active)
    return dr.select(
        active & (ds.pdf > 0),
        bsdf.eval(mi.BSDFContext(), si, si.to_local(ds.d), active) * weight,
        0,
    )


class HostIntegrator(mi.SamplingIntegrator):
    def __init__(self, props, path):
        super().__init__(props)
        names = {"rays": "gather.rays", "error": "validity.error"}
        self.settings = {
            names.get(name, name): props.get(name)
            for name in ("quality", "rays", "error", "max_bounces")
            if props.has_property(name)
        }
        self.preset = props.get("preset", "auto")
        self.flags = lumicache.HOST_CONCURRENT if props.get("concurrent", False) else 0
        levels = (mi.LogLevel.Info, mi.LogLevel.Warn)
        self.library = lumicache.Library(
            path, log=lambda severity, text: mi.Log(levels[severity > 0], text)
        )
        self.cache, self.prepared = None, None
        # Dr.Jit is used by one thread at a time, whichever that is.
        self.turn = threading.Lock()

    def trace(self, scene, rays):
        """The answers of the callback: nearest hits, normals, albedos, reflected direct light."""
        ray = mi.Ray3f(vector(mi.Point3f, rays.origin), vector(mi.Vector3f, rays.dir))
        si = scene.ray_intersect(ray)
        hit = si.is_valid()
        bsdf = si.bsdf(ray)
        # Streams that depend on the seeds alone, not on the place in the batch.
        random = mi.PCG32(initstate=mi.UInt64(rays.seed.astype(np.uint64)))
        sample = mi.Point2f(random.next_float32(), random.next_float32())
        radiance = direct(scene, si, bsdf, sample, hit)
        albedo = dr.select(hit, bsdf.eval_diffuse_reflectance(si, hit), 0)
        normal = facing(si, ray.d)
        dr.eval(radiance, albedo, normal, si.t)
        rays.distance[:] = np.array(si.t)
        rays.radiance[:] = np.maximum(rows(radiance), 0)
        rays.normal[:] = rows(normal)
        rays.albedo[:] = np.clip(rows(albedo), 0, 1)

    def locked_trace(self, scene, rays):
        with self.turn:
            self.trace(scene, rays)

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        if self.prepared is not scene:
            self.prepare(scene, scene.sensors()[sensor] if isinstance(sensor, int) else sensor)
        return super().render(scene, sensor, seed, spp, develop, evaluate)

    def prepare(self, scene, sensor):
        """Makes records at the points that the camera sees, one for each pixel."""
        world = self.library.scene()
        box = scene.bbox()
        world.set_host(
            lambda rays: self.locked_trace(scene, rays),
            (tuple(box.min), tuple(box.max)),
            self.flags,
        )
        world.commit()
        self.cache = world.cache(self.preset)
        self.cache.set(**self.settings)
        width, height = sensor.film().crop_size()
        x, y = dr.meshgrid(dr.arange(mi.Float, width), dr.arange(mi.Float, height))
        at = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
        ray, _ = sensor.sample_ray_differential(0, 0.5, at, mi.Point2f(0.5))
        si = scene.ray_intersect(ray)
        seen = np.flatnonzero(np.array(si.is_valid()))
        normal = facing(si, ray.d)
        cosine = dr.maximum(dr.abs(dr.dot(normal, ray.d)), 0.1)
        footprint = np.array(si.t * dr.norm(ray.d_x - ray.d) / dr.sqrt(cosine))
        self.cache.build(rows(si.p)[seen], rows(normal)[seen], footprint[seen])
        self.cache.freeze()
        self.prepared = scene

    def sample(self, scene, sampler, ray, medium=None, active=True):
        si = scene.ray_intersect(ray, active)
        hit = active & si.is_valid()
        bsdf = si.bsdf(ray)
        emitted = si.emitter(scene, active).eval(si, active)
        lit = direct(scene, si, bsdf, sampler.next_2d(active), hit)
        irradiance, _ = self.cache.query(rows(si.p), rows(facing(si, ray.d)))
        indirect = (
            bsdf.eval_diffuse_reflectance(si, hit) * vector(mi.Color3f, irradiance) * dr.inv_pi
        )
        return emitted + dr.select(hit, lit + indirect, 0), hit, []

    def aov_names(self):
        return []


def register(library="liblumicache.so.1"):
    """Makes the integrator known as "lumicache_host"."""
    mi.register_integrator("lumicache_host", lambda props: HostIntegrator(props, library))
