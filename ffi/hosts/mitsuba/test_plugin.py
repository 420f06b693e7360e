"""Renders a scene with the plugin and with Mitsuba's own path tracer, and compares both with the
reference or with one another.

   python test_plugin.py SCENE.gltf [REFERENCE.exr]
"""

import sys
import tempfile
import time

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
import scenes  # noqa: E402  (needs the variant)

SIZE = 256


def relmse(image, reference, mask):
    return float(np.mean(((image - reference) ** 2 / (reference**2 + 0.01))[mask]))


def render(scene_file, integrator, spp, folder):
    scene = mi.load_dict(scenes.load(mi, scene_file, folder, SIZE, spp, integrator))
    started, wall = time.process_time(), time.time()
    image = np.array(mi.render(scene))[:, :, :3]
    return image, time.process_time() - started, time.time() - wall


def main(scene_file, reference_file=None):
    with tempfile.TemporaryDirectory() as folder:
        plugin = {"type": "lumicache", "direct_samples": 4}
        cached, cached_cpu, cached_wall = render(scene_file, plugin, 16, folder)
        # The path tracer with as many samples as take about the same CPU time, and with many.
        _, cpu, _ = render(scene_file, {"type": "path", "max_depth": -1, "rr_depth": 12}, 4, folder)
        equal = max(1, round(4 * cached_cpu / cpu))
        path, path_cpu, _ = render(
            scene_file, {"type": "path", "max_depth": -1, "rr_depth": 12}, equal, folder
        )
        many, _, _ = render(
            scene_file, {"type": "path", "max_depth": -1, "rr_depth": 12}, 256, folder
        )
    if reference_file:
        full = np.array(mi.Bitmap(reference_file), dtype=np.float32)
        full = full.reshape(
            SIZE, full.shape[0] // SIZE, SIZE, full.shape[1] // SIZE, full.shape[2]
        ).mean((1, 3))
        reference, mask = full[:, :, :3], full[:, :, 3] > 0.999
    else:
        # Pixels that see the lamp say nothing of indirect light.
        reference, mask = many, many.max(2) < 5
    ratio = float(cached[mask].mean() / many[mask].mean())
    e_cached, e_path = relmse(cached, reference, mask), relmse(path, reference, mask)
    print(f"mean over that of the path tracer {ratio:.4f}")
    print(f"plugin       {cached_cpu:6.2f} CPU s ({cached_wall:.2f} s)  relmse {e_cached:.3e}")
    print(f"path tracer  {path_cpu:6.2f} CPU s, {equal} samples  relmse {e_path:.3e}")
    assert abs(ratio - 1) < 0.01, "the mean is off by more than 1 %"
    assert e_cached < e_path, "the path tracer is better in the same time"


if __name__ == "__main__":
    main(*sys.argv[1:])
