"""Renders a room with the add-on to a multi-layer EXR, and with Cycles, and compares.

LUMICACHE_LIBRARY=.../liblumicache.so.1 python test_blender.py OUT-FOLDER
"""

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import lumicache_blender  # noqa: E402

WIDTH, HEIGHT = 160, 120


def material(name, color):
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    inputs = m.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*color, 1)
    inputs["Specular IOR Level"].default_value = 0
    inputs["Roughness"].default_value = 1
    return m


def plane(name, location, rotation, color):
    bpy.ops.mesh.primitive_plane_add(size=2, location=location, rotation=rotation)
    bpy.context.object.name = name
    bpy.context.object.data.materials.append(material(name, color))


def room():
    """A box without its front, 2 wide, with a cube, an instance of a sphere, a chequered floor and
    an area light below the ceiling."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    half = np.pi / 2
    plane("floor", (0, 0, 0), (0, 0, 0), (0.7, 0.7, 0.7))
    plane("ceiling", (0, 0, 2), (np.pi, 0, 0), (0.7, 0.7, 0.7))
    plane("back", (0, 1, 1), (half, 0, 0), (0.7, 0.7, 0.7))
    plane("left", (-1, 0, 1), (0, half, 0), (0.7, 0.1, 0.1))
    plane("right", (1, 0, 1), (0, -half, 0), (0.1, 0.6, 0.1))
    image = bpy.data.images.new("chequers", 8, 8)
    tile = np.indices((8, 8)).sum(0) % 2
    image.pixels.foreach_set(
        np.stack([0.4 + 0.4 * tile] * 3 + [np.ones((8, 8))], 2).astype(np.float32).ravel()
    )
    tree = bpy.data.materials["floor"].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image, node.interpolation = image, "Closest"
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    bpy.ops.mesh.primitive_cube_add(size=0.6, location=(-0.35, 0.3, 0.3), rotation=(0, 0, 0.3))
    bpy.context.object.data.materials.append(material("cube", (0.8, 0.8, 0.8)))
    bpy.ops.mesh.primitive_uv_sphere_add(
        radius=0.3, location=(0.4, -0.1, 0.3), segments=32, ring_count=16
    )
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(material("sphere", (0.3, 0.4, 0.8)))
    bpy.ops.object.light_add(type="AREA", location=(0, 0, 1.99))
    light = bpy.context.object.data
    light.energy, light.size = 30, 0.2  # small: ours blocks light, that of Cycles does not
    bpy.ops.object.camera_add(location=(0, -3.4, 1), rotation=(half, 0, 0))
    scene = bpy.context.scene
    scene.camera = bpy.context.object
    scene.world = bpy.data.worlds.new("black")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = (
        WIDTH,
        HEIGHT,
        100,
    )
    scene.view_settings.view_transform = "Standard"
    return scene


def render(scene, engine, path, file_format, media="IMAGE"):
    scene.render.engine = engine
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = media
    settings.file_format = file_format
    if file_format.startswith("OPEN_EXR"):
        settings.color_depth = "32"
    scene.render.filepath = str(path)
    assert bpy.ops.render.render(write_still=True) == {"FINISHED"}


def pixels(path):
    image = bpy.data.images.load(str(path))
    out = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(out)
    return out.reshape(image.size[1], image.size[0], 4)[:, :, :3]


def main(folder):
    folder = Path(folder)
    lumicache_blender.register()
    scene = room()
    scene.lumicache.samples = 16
    render(scene, "LUMICACHE", folder / "layers.exr", "OPEN_EXR_MULTILAYER", "MULTI_LAYER_IMAGE")
    header = (folder / "layers.exr").read_bytes()[:65536]
    for name in lumicache_blender.PARTS + lumicache_blender.VECTORS:
        assert name.encode() in header, f"the file has no pass {name}"
    render(scene, "LUMICACHE", folder / "lumicache.png", "PNG")
    render(scene, "LUMICACHE", folder / "lumicache.exr", "OPEN_EXR")
    scene.cycles.device, scene.cycles.samples, scene.cycles.max_bounces = "CPU", 128, 64
    scene.cycles.diffuse_bounces, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = (
        64,
        False,
        False,
    )
    render(scene, "CYCLES", folder / "cycles.exr", "OPEN_EXR")
    ours, cycles = pixels(folder / "lumicache.exr"), pixels(folder / "cycles.exr")
    # Blender holds a denoiser of its own, of another version than ours.
    scene.lumicache.path, scene.lumicache.denoise = True, "AUTO"
    render(scene, "LUMICACHE", folder / "denoised.exr", "OPEN_EXR")
    denoised = pixels(folder / "denoised.exr")
    assert abs(denoised.mean() / ours.mean() - 1) < 0.05, "denoising loses light"
    # Not the lamp, which Cycles hides from the camera.
    dim = np.maximum(ours, cycles).max(2, keepdims=True) < 3
    ours, cycles = ours * dim, cycles * dim
    ratio = float(ours.mean() / cycles.mean())
    blocks = [
        image.reshape(HEIGHT // 20, 20, WIDTH // 20, 20, 3).mean((1, 3)) for image in (ours, cycles)
    ]
    worst = float(np.abs(blocks[0] - blocks[1]).max() / blocks[1].mean())
    print(
        f"Blender {bpy.app.version_string}: mean over that of Cycles {ratio:.4f}, "
        f"blocks of 20 x 20 pixels differ by {worst:.3f} of the mean at most"
    )
    assert abs(ratio - 1) < 0.02 and worst < 0.2, "the picture is not that of Cycles"


if __name__ == "__main__":
    main(sys.argv[1])
