"""Lumicache as a render engine of Blender: global illumination from a cache of irradiance.

The add-on hands meshes, materials, lights, world and camera to the library and gets the image and
its passes back. README.md says what of a material the add-on understands.
"""

import os
import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
# A packed add-on has the binding beside it, a checkout keeps it with the other hosts'.
sys.path[:0] = [str(HERE), str(HERE.parent.parent / "python")]
import lumicache  # noqa: E402

bl_info = {
    "name": "Lumicache",
    "description": "Global illumination by irradiance caching",
    "blender": (4, 2, 0),
    "version": (0, 1, 0),
    "category": "Render",
}

PARTS = ("diffuse_direct", "diffuse_indirect", "glossy_direct", "glossy_indirect", "emission")
VECTORS = ("albedo", "N")
DENOISE = {
    "AUTO": lumicache.RENDER_DENOISE_AUTO,
    "ON": lumicache.RENDER_DENOISE,
    "OFF": 0,
}


def library_path():
    """The library: the preference, else the variable LUMICACHE_LIBRARY, else the one packed beside
    this file, else what the system finds."""
    addon = bpy.context.preferences.addons.get(__name__)
    packed = HERE / "liblumicache.so.1"
    candidates = [
        addon.preferences.library if addon else "",
        os.environ.get("LUMICACHE_LIBRARY", ""),
        str(packed) if packed.exists() else "",
    ]
    return next((path for path in candidates if path), "liblumicache.so.1")


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __name__
    library: bpy.props.StringProperty(
        name="Library",
        subtype="FILE_PATH",
        description="liblumicache.so.1; empty: the packed or the installed one",
    )

    def draw(self, context):
        self.layout.prop(self, "library")


class Settings(bpy.types.PropertyGroup):
    samples: bpy.props.IntProperty(
        name="Samples", default=16, min=1, description="Samples per pixel"
    )
    quality: bpy.props.FloatProperty(
        name="Quality", default=1, min=0.01, max=100, description="2 costs about twice as much as 1"
    )
    path: bpy.props.BoolProperty(
        name="Path tracing", description="The reference, instead of the cache"
    )
    denoise: bpy.props.EnumProperty(
        name="Denoise",
        default="OFF",
        items=[
            ("AUTO", "Auto", "Where Open Image Denoise is installed"),
            ("ON", "On", "Always: without Open Image Denoise nothing is rendered"),
            ("OFF", "Off", "Never"),
        ],
        description="Takes the noise out of what was traced",
    )


class Export:
    """A depsgraph as a scene of the library."""

    def __init__(self, library, depsgraph):
        self.scene, self.depsgraph = library.scene(), depsgraph
        self.materials, self.textures, self.meshes, self.warnings = {}, {}, {}, []
        for instance in depsgraph.object_instances:
            if instance.show_self:
                self.add(instance.object, np.array(instance.matrix_world))
        self.add_world(depsgraph.scene.world)
        self.scene.commit()

    def add(self, thing, matrix):
        if thing.type == "LIGHT":
            return self.add_light(thing.data, matrix)
        if thing.type not in {"MESH", "CURVE", "SURFACE", "FONT", "META"}:
            return None
        key = (
            thing.original.data.name_full,
            tuple(s.material.name_full if s.material else "" for s in thing.material_slots),
        )
        if thing.original.modifiers or key not in self.meshes:
            self.meshes[key] = self.add_mesh(thing)
        if self.meshes[key] is not None:
            self.scene.add_instance(self.meshes[key], matrix)

    def add_mesh(self, thing):
        mesh = thing.to_mesh()
        try:
            mesh.calc_loop_triangles()
            count = len(mesh.loop_triangles)
            if count == 0:
                return None

            def read(collection, name, width, kind):
                out = np.empty(len(collection) * width, kind)
                collection.foreach_get(name, out)
                return out.reshape(-1, width) if width > 1 else out

            corners = read(mesh.loop_triangles, "loops", 3, np.int32).ravel()
            vertices = read(mesh.loop_triangles, "vertices", 3, np.int32).ravel()
            slots = read(mesh.loop_triangles, "material_index", 1, np.int32)
            uv = (
                read(mesh.uv_layers.active.uv, "vector", 2, np.float32)[corners]
                if mesh.uv_layers.active
                else None
            )
            if uv is not None:
                uv[:, 1] = 1 - uv[:, 1]  # the first row of a texture is on top
            numbers = [self.material(slot.material) for slot in thing.material_slots] or [
                self.material(None)
            ]
            return self.scene.add_mesh(
                read(mesh.vertices, "co", 3, np.float32)[vertices],
                np.arange(3 * count, dtype=np.uint32),
                normals=read(mesh.corner_normals, "vector", 3, np.float32)[corners],
                uv0=uv,
                triangle_materials=np.array(numbers, np.uint32)[
                    np.clip(slots, 0, len(numbers) - 1)
                ],
            )
        finally:
            thing.to_mesh_clear()

    def material(self, material):
        key = material.name_full if material else ""
        if key not in self.materials:
            self.materials[key] = self.scene.add_material(**self.describe(material))
        return self.materials[key]

    def describe(self, material):
        """The fields of a library material: those of the Principled BSDF or the Emission that the
        output shows."""
        flags = {"flags": 1}  # Blender's surfaces emit from both sides
        tree = material.node_tree if material else None
        if tree is None:
            return {
                **flags,
                "base_color": material.diffuse_color[:3] if material else (0.8, 0.8, 0.8),
                "specular": 0,
            }
        nodes = {node.type: node for node in tree.nodes}
        if "BSDF_PRINCIPLED" in nodes:
            node = nodes["BSDF_PRINCIPLED"]

            def value(name):
                return node.inputs[name].default_value

            strength = value("Emission Strength")
            texture = self.texture(node.inputs["Base Color"], material)
            return {
                **flags,
                # The library multiplies both; in Blender a linked socket has no own colour.
                "base_color": np.clip(value("Base Color")[:3], 0, 1) if texture < 0 else (1, 1, 1),
                "alpha": value("Alpha"),
                "alpha_mode": 2 if value("Alpha") < 1 else 0,
                "metallic": value("Metallic"),
                "roughness": value("Roughness"),
                "ior": max(value("IOR"), 1),
                "specular": min(2 * value("Specular IOR Level"), 1),
                "transmission": value("Transmission Weight"),
                "emission": [c * strength for c in value("Emission Color")[:3]],
                "base_color_texture": texture,
            }
        if "EMISSION" in nodes:
            node = nodes["EMISSION"]
            strength = node.inputs["Strength"].default_value
            return {
                **flags,
                "base_color": (0, 0, 0),
                "specular": 0,
                "emission": [c * strength for c in node.inputs["Color"].default_value[:3]],
            }
        if "BSDF_DIFFUSE" in nodes:
            return {
                **flags,
                "base_color": np.clip(
                    nodes["BSDF_DIFFUSE"].inputs["Color"].default_value[:3], 0, 1
                ),
                "specular": 0,
            }
        self.warnings.append(
            f"material {material.name}: no Principled, Diffuse or Emission node; shown grey"
        )
        return flags

    def texture(self, socket, material):
        """The number of the image that is linked to `socket`; -1 without one."""
        if not socket.is_linked:
            return -1
        image = getattr(socket.links[0].from_node, "image", None)
        if image is None or not image.has_data and not image.size[0]:
            self.warnings.append(f"material {material.name}: only images are read as base colour")
            return -1
        if image.name_full not in self.textures:
            pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
            image.pixels.foreach_get(pixels)
            rows = (
                (np.clip(pixels, 0, 1) * 255 + 0.5)
                .astype(np.uint8)
                .reshape(image.size[1], image.size[0], 4)
            )
            self.textures[image.name_full] = self.scene.add_texture(rows[::-1])
        return self.textures[image.name_full]

    def add_light(self, light, matrix):
        color = np.array(light.color) * light.energy
        place, down = matrix[:3, 3], -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        if light.type == "SUN":
            self.scene.add_light("directional", color, direction=down)
        elif light.type == "AREA":
            self.add_area(light, matrix, color)
        else:
            intensity = color / (4 * np.pi)
            if light.type == "SPOT":
                outer = np.cos(light.spot_size / 2)
                inner = outer + (1 - outer) * (1 - light.spot_blend)
                self.scene.add_light(
                    "spot", intensity, place, down, cos_inner=float(inner), cos_outer=float(outer)
                )
            else:
                self.scene.add_light("point", intensity, place)

    def add_area(self, light, matrix, power):
        """A rectangle, or a disk of 32 corners, that shines along its -z."""
        sx, sy = light.size, light.size_y if light.shape in {"RECTANGLE", "ELLIPSE"} else light.size
        if light.shape in {"DISK", "ELLIPSE"}:
            angles = -np.arange(32) * (2 * np.pi / 32)
            outline = np.stack([0.5 * np.cos(angles), 0.5 * np.sin(angles)], 1)
        else:
            outline = np.array([(-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5)])
        points = np.concatenate([outline * (sx, sy), np.zeros((len(outline), 1))], 1).astype(
            np.float32
        )
        fan = [(0, k, k + 1) for k in range(1, len(points) - 1)]
        corners = points @ matrix[:3, :3].T
        area = sum(
            0.5 * np.linalg.norm(np.cross(corners[b] - corners[a], corners[c] - corners[a]))
            for a, b, c in fan
        )
        emission = power / (np.pi * max(area, 1e-12))
        material = self.scene.add_material(base_color=(0, 0, 0), specular=0, emission=emission)
        self.scene.add_instance(
            self.scene.add_mesh(points, np.array(fan), material=material), matrix
        )

    def add_world(self, world):
        if world is None or world.node_tree is None:
            return
        node = next((n for n in world.node_tree.nodes if n.type == "BACKGROUND"), None)
        if node is None:
            return
        if node.inputs["Color"].is_linked:
            self.warnings.append("the world's texture is not read: its colour is used")
        color = (
            np.array(node.inputs["Color"].default_value[:3]) * node.inputs["Strength"].default_value
        )
        # A black world is a light, too, though it does not show: without it the library would light
        # an otherwise dark scene by a dome.
        self.scene.set_environment(color.reshape(1, 1, 3))


class LumicacheEngine(bpy.types.RenderEngine):
    bl_idname = "LUMICACHE"
    bl_label = "Lumicache"
    bl_use_preview = False

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)

    def update_render_passes(self, scene=None, renderlayer=None):
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for name in PARTS:
            self.register_pass(scene, renderlayer, name, 3, "RGB", "COLOR")
        self.register_pass(scene, renderlayer, "albedo", 3, "RGB", "COLOR")
        self.register_pass(scene, renderlayer, "N", 3, "XYZ", "VECTOR")

    def render(self, depsgraph):
        scene = depsgraph.scene
        scale = scene.render.resolution_percentage / 100
        width, height = (
            int(scene.render.resolution_x * scale),
            int(scene.render.resolution_y * scale),
        )
        settings = scene.lumicache
        library = lumicache.Library(
            library_path(), log=lambda severity, text: severity and self.report({"WARNING"}, text)
        )
        self.update_stats("Lumicache", "exporting")
        export = Export(library, depsgraph)
        for text in export.warnings:
            self.report({"WARNING"}, text)

        cache = export.scene.cache("auto")
        cache.set(quality=settings.quality)

        def progress(fraction):
            self.update_progress(fraction)
            return self.test_break()

        cache.watch(progress)
        self.update_stats("Lumicache", f"rendering by {library.backend}")
        camera = scene.camera.evaluated_get(depsgraph)
        projection = camera.calc_matrix_camera(depsgraph, x=width, y=height)
        flat = camera.data.type == "ORTHO"
        reach = 1 / projection[1][1]
        flags = DENOISE[settings.denoise]
        flags |= lumicache.RENDER_PATH if settings.path else 0
        flags |= lumicache.RENDER_ORTHOGRAPHIC if flat else 0
        layers = ("",) + PARTS + VECTORS
        try:
            pictures = cache.render(
                width,
                height,
                camera.matrix_world.normalized(),
                float(reach if flat else 2 * np.arctan(reach)),
                settings.samples,
                layers,
                flags,
            )
        except lumicache.Error as error:
            if error.code == 6:  # cancelled
                return
            raise
        for name in PARTS + ("albedo",):
            self.add_pass(name, 3, "RGB")
        self.add_pass("N", 3, "XYZ")
        result = self.begin_result(0, 0, width, height)
        passes = result.layers[0].passes
        for name, picture in pictures.items():
            # Blender counts rows from the bottom.
            passes[name or "Combined"].rect.foreach_set(np.ascontiguousarray(picture[::-1]).ravel())
        self.end_result(result)


class LUMICACHE_PT_sampling(bpy.types.Panel):
    bl_label = "Sampling"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {"LUMICACHE"}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        for name in ("samples", "quality", "denoise", "path"):
            self.layout.prop(context.scene.lumicache, name)


CLASSES = (Preferences, Settings, LumicacheEngine, LUMICACHE_PT_sampling)


def compatible_panels():
    """Blender's own panels that make sense with any engine."""
    left_out = {"VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes"}
    return [
        p
        for p in bpy.types.Panel.__subclasses__()
        if "BLENDER_RENDER" in getattr(p, "COMPAT_ENGINES", ()) and p.__name__ not in left_out
    ]


def register():
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Scene.lumicache = bpy.props.PointerProperty(type=Settings)
    for panel in compatible_panels():
        panel.COMPAT_ENGINES.add("LUMICACHE")


def unregister():
    for panel in compatible_panels():
        panel.COMPAT_ENGINES.discard("LUMICACHE")
    del bpy.types.Scene.lumicache
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
