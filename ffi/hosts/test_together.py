"""Lumicache beside other libraries in one process: answers and version of Embree stay the same.

   python test_together.py LIBRARY SCENE.gltf EXPECTED-EMBREE [STEP...]

Steps, done in order: `lumicache` (load it and ask), a Python module to import, or the path of a
library that is loaded into the global symbol scope. Prints a hash of the answers; the caller
compares the hashes of different orders.
"""

import ctypes
import hashlib
import importlib
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent / "python"))
import lumicache  # noqa: E402


def ask(path, scene_file, expected):
    library = lumicache.Library(path, "backend=embree")
    assert library.backend == expected, f"runs on {library.backend}, not {expected}"
    scene = library.scene()
    scene.load_gltf(scene_file)
    scene.commit()
    cache = scene.cache("auto")
    cache.set(deeper_points=500, **{"gather.rays": 64})
    x, z = np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40))
    positions = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], 1)
    normals = np.tile(np.float32([0, 1, 0]), (len(positions), 1))
    cache.build(positions, normals)
    irradiance, status = cache.query(positions, normals)
    assert (status == 0).mean() > 0.95 and irradiance.max() > 0
    return hashlib.sha256(irradiance.tobytes()).hexdigest()


def main(path, scene_file, expected, *steps):
    answers = set()
    for step in steps:
        if step == "lumicache":
            answers.add(ask(path, scene_file, expected))
        elif "/" in step:
            ctypes.CDLL(step, ctypes.RTLD_GLOBAL)
        else:
            module = importlib.import_module(step)
            if step == "mitsuba":
                module.set_variant("scalar_rgb")
                # Its own Embree is used too.
                module.render(module.load_dict(module.cornell_box()), spp=1)
    answers.add(ask(path, scene_file, expected))
    assert len(answers) == 1, "the answers changed"
    print(answers.pop())


if __name__ == "__main__":
    main(*sys.argv[1:])
