"""Scenes of glossy Phong surfaces: two planes at a right angle. Used by make_scenes.py."""

from gltf import Scene, Shape, phong


def two_glossy_planes():
    """Only the floor is seen; what it shows is the wall, which is lit by one point light and as glossy."""
    s = Scene(
        "two-glossy-planes",
        "Two glossy planes",
        (480, 360),
        notes="A Phong floor mirrors a Phong wall outside the picture. The radiance from the wall "
        "changes with the point that sees the wall.",
    )
    floor = s.material("floor", (0.1, 0.1, 0.1), native=phong(0.1, 0.6, 5.0), double=True)
    wall = s.material("wall", (0.1, 0.1, 0.1), native=phong(0.1, 0.6, 24.0), double=True)
    s.add("floor", Shape().face((0, 0, 1.5), (2.5, 0, 1.5), (2.5, 0, -1.5), (0, 0, -1.5)), floor)
    s.add("wall", Shape().face((0, 0, 1.5), (0, 0, -1.5), (0, 1.6, -1.5), (0, 1.6, 1.5)), wall)
    s.point_light("light", (0.9, 1.1, 0.25), (1.0, 0.95, 0.85), 12.0)
    s.camera((3.2, 2.2, 0.0), (1.06, 0.0, 0.0), 22.5)
    return s
