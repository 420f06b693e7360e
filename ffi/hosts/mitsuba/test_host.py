"""Renders a scene through the callback and with Mitsuba's own path tracer, and compares the means.

python test_host.py LIBRARY SCENE.gltf
"""

import sys
import tempfile

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import lumicache_integrator  # noqa: E402
import scenes  # noqa: E402

SIZE = 128


def main(library, scene_file):
    lumicache_integrator.register(library)
    with tempfile.TemporaryDirectory() as folder:

        def render(integrator, spp):
            scene = mi.load_dict(scenes.load(mi, scene_file, folder, SIZE, spp, integrator))
            return np.array(mi.render(scene, spp=spp))[:, :, :3], scene

        path, _ = render({"type": "path", "max_depth": -1, "rr_depth": 12}, 256)
        mask = path.max(2) < 5
        images = []
        for concurrent in (False, True):
            image, scene = render(
                {"type": "lumicache_host", "rays": 256, "concurrent": concurrent}, 32
            )
            stats = scene.integrator().cache.stats
            ratio = float(image[mask].mean() / path[mask].mean())
            print(
                f"callback on {'any' if concurrent else 'the caller'}: "
                f"mean over that of the path tracer {ratio:.4f}; "
                f"{stats.records} records, "
                f"{stats.host_rays} rays in {stats.host_calls} calls, {stats.build_seconds:.1f} s"
            )
            assert abs(ratio - 1) < 0.01, "the mean is off by more than 1 %"
            images.append(image)
        assert np.abs(images[0] - images[1]).max() < 1e-4, (
            "the threads of the callback change the picture"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
