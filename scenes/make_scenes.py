#!/usr/bin/env python3
"""Writes the scenes of this folder, NAME.gltf, NAME.bin and NAME.toml each: `make_scenes.py [FOLDER]`. The same bytes on every run.

The scenes are original work, dedicated to the public domain (CC0-1.0). The Cornell box uses the measurements that Cornell
University's Program of Computer Graphics published.
"""

import math
import sys
from pathlib import Path

from dim_rooms import slit_light, staircase_room
from glossy_planes import two_glossy_planes
from gltf import Random, Scene, Shape, box, disc, phong, prism, revolve, room, rounded_box, sphere
from glossy_scenes import glossy_scenes
from ies_hall import ies_hall
from indirect_room import indirect_room

WHITE = (0.725, 0.71, 0.68)
RED = (0.63, 0.065, 0.05)
GREEN = (0.14, 0.45, 0.091)


def cornell_box(name, title, floor, notes, back=None):
    """The measured box, its numbers read as centimetres; `floor` is (color, roughness, metallic, specular), `back` the Phong lobe of the back wall if it has one."""
    s = Scene(name, title, (512, 512), notes=notes)
    white = s.material("white", WHITE, specular=0.0, double=True)
    blocks = s.material("blocks", WHITE, specular=0.0)
    color, rough, metal, specular = floor
    # (x, y, z) in centimetres; x runs to the left as the camera sees it, so the coordinates are right-handed as published.
    flat = {
        "floor": [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)],
        "back wall": [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556.0, 548.8, 559.2)],
        "right wall": [(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)],
        "left wall": [(552.8, 0, 0), (549.6, 0, 559.2), (556.0, 548.8, 559.2), (556.0, 548.8, 0)],
    }
    material = {
        "floor": s.material("floor", color, rough, metal, specular, double=True),
        "back wall": white if back is None else s.material("back wall", WHITE, native=phong(*back), double=True),
        "right wall": s.material("green", GREEN, specular=0.0, double=True),
        "left wall": s.material("red", RED, specular=0.0, double=True),
    }
    metres = lambda corners: [tuple(c / 100 for c in p) for p in corners]
    for part, corners in flat.items():
        s.add(part, Shape().face(*metres(corners)), material[part])
    # The light fills a hole in the ceiling, which is therefore four pieces around it.
    outer = [(556.0, 548.8, 0), (556.0, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)]
    inner = [(343.0, 548.8, 227.0), (343.0, 548.8, 332.0), (213.0, 548.8, 332.0), (213.0, 548.8, 227.0)]
    ceiling = Shape()
    for k in range(4):
        ceiling.face(*metres([outer[k], outer[(k + 1) % 4], inner[(k + 1) % 4], inner[k]]))
    s.add("ceiling", ceiling, white)
    s.add("light", Shape().face(*metres(inner)), s.light("light", (1.0, 12 / 17, 4 / 17), 17.0))
    short = [(130.0, 65.0), (82.0, 225.0), (240.0, 272.0), (290.0, 114.0)]
    tall = [(423.0, 247.0), (265.0, 296.0), (314.0, 456.0), (472.0, 406.0)]
    for part, height, corners in (("short block", 165.0, short), ("tall block", 330.0, tall)):
        corners = [(x / 100, z / 100) for x, z in corners]
        s.add(part, prism(corners, 0.0, height / 100, skip_bottom=True), blocks)
    s.camera((2.78, 2.73, -8.0), (2.78, 2.73, 0.0), math.degrees(2 * math.atan(0.0125 / 0.035)))
    return s


def glossy_still_life():
    s = Scene(
        "glossy-still-life",
        "Glossy still life",
        (960, 640),
        notes="Rough metals, clearcoat, glass and ceramics between three panels.",
    )
    oak, rng = s.material("table", (1.0, 1.0, 1.0), rough=0.42), Random(7)
    table = Shape()
    for k in range(9):
        z0, z1, tint = -0.72 + 0.16 * k, -0.72 + 0.16 * (k + 1), rng(0.75, 1.05)
        board = tuple(tint * c for c in (0.30, 0.165, 0.082))
        table.add(box((-1.3, -0.045, z0 + 0.0015), (1.3, 0.0, z1 - 0.0015), board))
    s.add("table", table, oak)
    curve = [(-0.9 + 0.9 * (1 - math.cos(a)), -1.4 - 0.9 * math.sin(a)) for a in [math.pi / 2 * i / 12 for i in range(1, 13)]]
    profile = [(-0.9, 2.6), (-0.9, -1.4)] + curve + [(3.2, -2.3)]
    backdrop = Shape(smooth=True)

    def sweep_vertex(i, j):
        a, b = profile[max(i - 1, 0)], profile[min(i + 1, len(profile) - 1)]
        dy, dz = b[0] - a[0], b[1] - a[1]
        length = math.hypot(dy, dz)
        return ((-4.0, 4.0)[j], *profile[i]), (0.0, -dz / length, dy / length)

    s.add(
        "backdrop",
        backdrop.grid(len(profile), 2, lambda i, j: sweep_vertex(i, 1 - j)),
        s.material("paper", (0.55, 0.57, 0.60), specular=0.0, double=True),
    )
    globe = sphere(64)
    ball = s.mesh("ball", globe, s.material("gold", (1.0, 0.71, 0.29), rough=0.28, metal=1.0))
    s.node("gold ball", ball, (0.62, 0.20, 0.16), scale=(0.20, 0.20, 0.20))
    paint = s.material("red lacquer", (0.45, 0.02, 0.015), rough=0.5, clearcoat=(1.0, 0.03))
    s.add("lacquered ball", globe, paint, (-0.78, 0.17, 0.22), scale=(0.17, 0.17, 0.17))
    s.add(
        "glass ball",
        globe,
        s.material("glass", (1.0, 1.0, 1.0), rough=0.0, glass=1.5),
        (0.18, 0.135, 0.42),
        scale=(0.135, 0.135, 0.135),
    )
    lemon = s.mesh("lemon", globe, s.material("lemon", (0.78, 0.52, 0.03), rough=0.55))
    s.node("lemon 1", lemon, (-0.42, 0.062, 0.48), 25.0, (0.085, 0.062, 0.062))
    s.node("lemon 2", lemon, (-0.27, 0.060, 0.54), -50.0, (0.082, 0.060, 0.060))

    pot = [(0.0, 0.0), (0.17, 0.0), (0.185, 0.012)]
    pot += [(0.17 + 0.11 * math.sin(math.pi * t), 0.02 + 0.34 * t) for t in [i / 16 for i in range(1, 16)]]
    pot += [(0.155, 0.365), (0.165, 0.38), (0.16, 0.39), (0.14, 0.40)]
    lid = [(0.14, 0.40), (0.135, 0.415), (0.10, 0.445), (0.05, 0.462), (0.022, 0.47), (0.02, 0.485)]
    knob = [(0.035 * math.sin(math.pi * t), 0.515 - 0.035 * math.cos(math.pi * t)) for t in [0.2 + 0.1 * i for i in range(8)]]
    copper = s.material("copper", (0.955, 0.60, 0.50), rough=0.34, metal=1.0)
    s.add("copper pot", revolve(pot + lid[1:] + knob + [(0.0, 0.55)], 64), copper, (-0.05, 0.0, -0.18))
    handle = Shape(smooth=True)

    def handle_vertex(i, j):
        a, b = math.pi * (i / 20 - 0.5), 2 * math.pi * (j % 12) / 12
        out, r = (math.cos(a), math.sin(a)), 0.017
        center = (0.12 * out[0], 0.14 * out[1])
        n = (math.cos(b) * out[0], math.cos(b) * out[1], math.sin(b))
        return (center[0] + r * n[0], center[1] + r * n[1], r * n[2]), n

    s.add("handle", handle.grid(21, 13, handle_vertex), copper, (0.19, 0.21, -0.10), -20.0)
    vase = [(0.0, 0.0), (0.09, 0.0), (0.10, 0.01)]
    vase += [(0.10 + 0.085 * math.sin(math.pi * t) ** 2 - 0.05 * t, 0.01 + 0.55 * t) for t in [i / 24 for i in range(1, 25)]]
    vase += [(0.065, 0.60), (0.082, 0.63), (0.078, 0.635), (0.058, 0.60), (0.045, 0.55), (0.05, 0.30), (0.0, 0.28)]
    s.add("ceramic vase", revolve(vase, 64), s.material("ceramic", (0.55, 0.70, 0.74), rough=0.12), (-0.55, 0.0, -0.28))
    steel = s.material("brushed steel", (0.56, 0.57, 0.58), rough=0.45, metal=1.0)
    can = [
        (0.0, 0.0),
        (0.125, 0.0),
        (0.13, 0.005),
        (0.13, 0.335),
        (0.125, 0.34),
        (0.118, 0.34),
        (0.113, 0.335),
        (0.113, 0.03),
        (0.0, 0.03),
    ]
    s.add("steel cup", revolve(can, 64), steel, (0.38, 0.0, -0.36))
    s.add(
        "marble block",
        rounded_box((-0.14, 0.0, -0.14), (0.14, 0.28, 0.14), 0.012),
        s.material("plaster", (0.78, 0.76, 0.72), specular=0.0),
        (0.86, 0.0, -0.30),
        28.0,
    )

    def panel(name, center, facing, width, height, color, strength):
        u, v = facing
        corner = lambda a, b: tuple(c + a * width / 2 * x + b * height / 2 * y for c, x, y in zip(center, u, v))
        s.add(name, Shape().face(corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)), s.light(name, color, strength))

    # A panel's front is where (first axis) x (second axis) points.
    panel("soft box", (-1.7, 2.1, 0.5), ((0.0, 0.0, 1.0), (-0.65, -0.76, 0.0)), 1.5, 1.2, (1.0, 0.90, 0.78), 12.0)
    panel("strip", (2.3, 1.1, 0.2), ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)), 2.0, 0.35, (0.72, 0.85, 1.0), 6.0)
    panel("dome", (0.0, 3.6, 0.4), ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), 4.0, 3.2, (0.85, 0.92, 1.0), 1.2)
    s.camera((0.10, 0.92, 2.45), (0.01, 0.20, -0.08), 32.5)
    return s


def many_light_hall():
    s = Scene(
        "many-light-hall",
        "Many-light hall",
        (1280, 640),
        notes="432 small emitters in the ceiling of a colonnaded hall. Instances share their "
        "meshes.",
    )
    stone = s.material("stone", (0.62, 0.57, 0.50), specular=0.0)
    wall = s.material("plaster", (0.70, 0.67, 0.62), specular=0.0, double=True)
    s.add("shell", room((-7.0, 0.0, -36.0), (7.0, 7.0, 0.0), skip="-y"), wall)
    tiles = Shape()
    for i in range(14):
        for k in range(36):
            x, z = -7.0 + i, -float(k)
            tiles.face(
                (x, 0, z),
                (x + 1, 0, z),
                (x + 1, 0, z - 1),
                (x, 0, z - 1),
                color=((0.50, 0.42, 0.34), (0.20, 0.10, 0.075))[(i + k) % 2],
            )
    s.add("floor", tiles, s.material("tiles", (1.0, 1.0, 1.0), specular=0.0, double=True))
    shaft = [(0.0, 0.0), (0.42, 0.0), (0.42, 0.18), (0.36, 0.24), (0.36, 0.30)]
    shaft += [(0.29 - 0.04 * t, 0.34 + 3.26 * t) for t in (0.0, 0.5, 1.0)] + [
        (0.32, 3.68),
        (0.40, 3.80),
        (0.44, 3.80),
        (0.44, 4.0),
        (0.0, 4.0),
    ]
    column = s.mesh("column", revolve(shaft, 28), stone)
    # One bay: the wall above a round arch of radius 1.6 from z = -2 to z = 2, sixteen segments, both faces and the soffit.
    arch, soffit, half, radius, spring, top = Shape(), Shape(smooth=True), 0.36, 1.6, 4.0, 7.0
    edge = [(radius * math.cos(math.pi * k / 16), spring + radius * math.sin(math.pi * k / 16)) for k in range(17)]
    for side in (1.0, -1.0):
        x = side * half
        quads = [[(edge[k], edge[k + 1], (edge[k + 1][0], top), (edge[k][0], top))] for k in range(16)]
        quads += [
            [
                ((2.0, spring), (radius, spring), (radius, top), (2.0, top)),
                ((-radius, spring), (-2.0, spring), (-2.0, top), (-radius, top)),
            ]
        ]
        for quad in (q for group in quads for q in group):
            corners = [(x, y, z) for z, y in quad]
            arch.face(*(corners if side > 0 else corners[::-1]))
    for z0, z1 in ((-2.0, -radius), (radius, 2.0)):
        arch.face((-half, spring, z0), (half, spring, z0), (half, spring, z1), (-half, spring, z1))
    soffit.grid(
        17,
        2,
        lambda k, j: (
            (half * (2 * j - 1), edge[k][1], edge[k][0]),
            (0.0, -math.sin(math.pi * k / 16), -math.cos(math.pi * k / 16)),
        ),
    )
    bay, under = s.mesh("arch", arch, stone), s.mesh("soffit", soffit, stone)
    for side in (-4.2, 4.2):
        for k in range(9):
            z = -2.0 - 4.0 * k
            s.node(f"arch {side:+} {k}", bay, (side, 0.0, z))
            s.node(f"soffit {side:+} {k}", under, (side, 0.0, z))
            if k < 8:
                s.node(f"column {side:+} {k}", column, (side, 0.0, z - 2.0))
    lamp = Shape().face((-0.06, 0.0, -0.06), (0.06, 0.0, -0.06), (0.06, 0.0, 0.06), (-0.06, 0.0, 0.06))
    tones = [(1.0, 0.62, 0.32), (1.0, 0.74, 0.48), (1.0, 0.86, 0.68), (0.80, 0.88, 1.0)]
    lamps, rng = [s.mesh(f"lamp {k}", lamp, s.light(f"lamp {k}", tone, 100.0)) for k, tone in enumerate(tones)], Random(3)
    for i in range(12):
        for k in range(36):
            s.node(f"lamp {i} {k}", lamps[min(3, int(rng(0.0, 4.0)))], (-6.05 + 1.1 * i, 6.98, -0.5 - k))
    s.camera((-1.6, 1.7, -0.8), (0.6, 2.5, -14.0), 56.0)
    return s


def curved_spheres():
    s = Scene(
        "curved-spheres",
        "Diffuse spheres under one lamp",
        (640, 480),
        notes="Curved diffuse surfaces under one area lamp. For rotational gradients.",
    )
    s.add(
        "shell",
        room((-3.0, 0.0, -2.5), (3.0, 3.6, 2.5), skip="+z"),
        s.material("white", (0.72, 0.72, 0.70), specular=0.0, double=True),
    )
    for name, x, color in (("left", -2.99, (0.55, 0.20, 0.10)), ("right", 2.99, (0.10, 0.28, 0.50))):
        a, b, c, d = (x, 0.0, -2.5), (x, 0.0, 2.5), (x, 3.6, 2.5), (x, 3.6, -2.5)
        s.add(
            f"{name} wall",
            Shape().face(*((a, d, c, b) if x > 0 else (a, b, c, d))),
            s.material(f"{name} wall", color, specular=0.0, double=True),
        )
    ball = sphere(64)
    clay = s.mesh("ball", ball, s.material("clay", (0.75, 0.73, 0.70), specular=0.0))
    for k, (x, z, r) in enumerate(
        [(-1.65, -0.9, 0.85), (0.15, -1.3, 1.05), (1.75, -0.6, 0.70), (-0.75, 0.65, 0.48), (0.65, 0.75, 0.40), (1.55, 1.05, 0.28)]
    ):
        s.node(f"ball {k}", clay, (x, r, z), scale=(r, r, r))
    lamp = Shape().face((-0.6, 3.59, -0.6), (0.6, 3.59, -0.6), (0.6, 3.59, 0.6), (-0.6, 3.59, 0.6))
    s.add("lamp", lamp, s.light("lamp", (1.0, 0.93, 0.82), 14.0))
    s.camera((0.0, 1.9, 6.6), (0.0, 1.35, 0.0), 38.0)
    return s


def staircase():
    s = Scene(
        "staircase",
        "Ten steps",
        (600, 800),
        notes="A dim stairwell, lit from the landing above. Small features stand beside large "
        "flat ones.",
    )
    steps, tread, rise, width = 10, 0.28, 0.175, 1.4
    shell = Shape()
    top, end = steps * rise, -steps * tread
    far = end - 1.6
    for corners in (
        ((-0.9, 0, 2.4), (width + 0.9, 0, 2.4), (width + 0.9, 0, 0), (-0.9, 0, 0)),
        ((-0.9, 0, 0), (0, 0, 0), (0, 0, far), (-0.9, 0, far)),
        ((width, 0, 0), (width + 0.9, 0, 0), (width + 0.9, 0, far), (width, 0, far)),
    ):
        shell.face(*corners)
    shell.add(room((-0.9, 0.0, far), (width + 0.9, 4.6, 2.4), skip="-y"))
    s.add("shell", shell, s.material("walls", (0.74, 0.71, 0.65), specular=0.0, double=True))
    stone, flight = s.material("steps", (0.52, 0.44, 0.36), specular=0.0), Shape()
    for k in range(steps):
        z0, y0, y1 = -k * tread, k * rise, (k + 1) * rise
        flight.face((0, y0, z0), (width, y0, z0), (width, y1, z0), (0, y1, z0))
        z1 = z0 - tread if k + 1 < steps else far
        flight.face((0, y1, z0), (width, y1, z0), (width, y1, z1), (0, y1, z1))
        flight.face((0, 0, z1), (0, 0, z0), (0, y1, z0), (0, y1, z1))
        flight.face((width, 0, z0), (width, 0, z1), (width, y1, z1), (width, y1, z0))
    s.add("flight", flight, stone)
    rail = Shape()
    for k in range(steps):
        z, y = -(k + 0.5) * tread, (k + 1) * rise
        rail.add(box((width - 0.10, y, z - 0.015), (width - 0.07, y + 0.9, z + 0.015), skip="-y"))
    s.add("balusters", rail, s.material("iron", (0.08, 0.08, 0.09), rough=0.5))
    hand = Shape()
    x0, x1, ya, za, yb, zb = width - 0.115, width - 0.055, rise + 0.9, -0.4 * tread, top + 0.9, end + 0.4 * tread
    c = [(x, y + dy, z) for y, z in ((ya, za), (yb, zb)) for dy in (0.0, 0.06) for x in (x0, x1)]
    for quad in ((2, 3, 7, 6), (1, 0, 4, 5), (0, 2, 6, 4), (3, 1, 5, 7), (0, 1, 3, 2), (5, 4, 6, 7)):
        hand.face(*(c[i] for i in quad))
    s.add("handrail", hand, s.material("wood", (0.28, 0.13, 0.06), rough=0.4))
    # The beam hides the lamp above the landing from the camera and from the lower steps.
    s.add(
        "beam",
        box((-0.9, 3.55, end + 0.6), (width + 0.9, 4.6, end + 0.85), skip="-x+x+y"),
        s.material("beam", (0.74, 0.71, 0.65), specular=0.0),
    )
    lamp = Shape().face(
        (0.1, 4.59, far + 0.3), (width - 0.1, 4.59, far + 0.3), (width - 0.1, 4.59, far + 1.1), (0.1, 4.59, far + 1.1)
    )
    s.add("lamp", lamp, s.light("lamp", (1.0, 0.84, 0.62), 15.0))
    s.camera((0.35, 1.55, 2.2), (0.78, 1.55, -1.6), 62.0)
    return s


def two_rooms_gap():
    s = Scene(
        "two-rooms-gap",
        "Two rooms and a thin wall",
        (800, 400),
        notes="Two rooms share a floor, a ceiling and a back wall. The wall between them is two "
        "sheets 1e-3 m apart. The left room is lit, the right room is sealed off.",
        expect="Radiance is exactly zero in the right room: at every pixel whose first hit has x > 0.001. "
        "Any light there has leaked through the wall.",
    )
    white = s.material("white", (0.73, 0.72, 0.70), specular=0.0, double=True)
    s.add("shell", room((-3.0, 0.0, -3.0), (3.001, 3.0, 0.0), skip="+z"), white)
    # The front is open, but no straight line from one room reaches the other: the wall ends where they end.
    s.add("wall", box((0.0, 0.0, -3.0), (0.001, 3.0, 0.0), skip="-y+y-z"), white)
    block = s.mesh(
        "block",
        prism([(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)], 0.0, 1.0, skip_bottom=True),
        s.material("block", (0.60, 0.25, 0.12), specular=0.0),
    )
    s.node("lit block", block, (-0.75, 0.0, -1.5), 20.0)
    s.node("dark block", block, (0.751, 0.0, -1.5), -20.0)
    s.add(
        "lamp",
        Shape().face((-2.1, 2.99, -2.0), (-0.9, 2.99, -2.0), (-0.9, 2.99, -1.0), (-2.1, 2.99, -1.0)),
        s.light("lamp", (1.0, 0.93, 0.82), 10.0),
    )
    s.camera((0.0, 1.5, 5.2), (0.0, 1.5, 0.0), 34.0)
    return s


def mirror_room():
    s = Scene(
        "mirror-room",
        "Mirror room",
        (800, 600),
        notes="A large flat mirror, a mirror ball and two facing mirrors. For footprints and "
        "records seen in mirrors.",
    )
    s.add(
        "shell",
        room((-2.5, 0.0, -4.0), (2.5, 2.8, 2.0), skip="-y"),
        s.material("plaster", (0.72, 0.69, 0.63), specular=0.0, double=True),
    )
    floor = Shape()
    for i in range(10):
        for k in range(12):
            x, z = -2.5 + 0.5 * i, 2.0 - 0.5 * k
            floor.face(
                (x, 0, z),
                (x + 0.5, 0, z),
                (x + 0.5, 0, z - 0.5),
                (x, 0, z - 0.5),
                color=((0.55, 0.50, 0.42), (0.16, 0.20, 0.22))[(i + k) % 2],
            )
    s.add("floor", floor, s.material("tiles", (1.0, 1.0, 1.0), specular=0.0, double=True))
    mirror = s.material("mirror", (0.95, 0.95, 0.95), rough=0.0, metal=1.0)
    frame = s.material("frame", (0.25, 0.12, 0.05), rough=0.4)
    for name, x, turn in (("left mirror", -2.46, 90.0), ("right mirror", 2.46, -90.0)):
        s.add(
            name, Shape().face((-1.3, 0.3, 0.0), (1.3, 0.3, 0.0), (1.3, 2.4, 0.0), (-1.3, 2.4, 0.0)), mirror, (x, 0.0, -1.6), turn
        )
        edges = Shape()
        for lo, hi in (
            ((-1.38, 0.22, -0.03), (1.38, 0.3, 0.03)),
            ((-1.38, 2.4, -0.03), (1.38, 2.48, 0.03)),
            ((-1.38, 0.3, -0.03), (-1.3, 2.4, 0.03)),
            ((1.3, 0.3, -0.03), (1.38, 2.4, 0.03)),
        ):
            edges.add(box(lo, hi))
        s.add(f"{name} frame", edges, frame, (x, 0.0, -1.6), turn)
    globe = sphere(64)
    s.add("mirror ball", globe, mirror, (-0.75, 0.5, -2.6), scale=(0.5, 0.5, 0.5))
    s.add(
        "cushion",
        rounded_box((-0.45, 0.0, -0.45), (0.45, 0.42, 0.45), 0.09),
        s.material("cloth", (0.50, 0.09, 0.07), specular=0.0),
        (0.75, 0.0, -2.4),
        20.0,
    )
    s.add("ball", globe, s.material("blue", (0.08, 0.20, 0.45), specular=0.0), (0.30, 0.22, -1.3), scale=(0.22, 0.22, 0.22))
    s.add(
        "lamp",
        Shape().face((-0.7, 2.79, -2.1), (0.7, 2.79, -2.1), (0.7, 2.79, -1.1), (-0.7, 2.79, -1.1)),
        s.light("lamp", (1.0, 0.91, 0.78), 8.0),
    )
    s.camera((1.55, 1.5, 1.75), (-0.75, 0.95, -2.2), 52.0)
    return s


def alpha_leaves():
    s = Scene("alpha-leaves", "Cut-out leaves and a curtain", (800, 600), notes="Alpha mask (a 64x64 texture) and alpha blend.")
    size, pixels = 64, bytearray()
    for y in range(size):
        for x in range(size):
            u, v = (x + 0.5) / size, (y + 0.5) / size
            half = 0.42 * math.sin(math.pi * min(1.0, max(0.0, 1.08 * v - 0.04))) ** 0.8 * (1.0 - 0.35 * v)
            inside = abs(u - 0.5) < half
            vein = abs(u - 0.5) < 0.016 or abs((abs(u - 0.5) * 1.3 - v) % 0.17) < 0.022
            pixels += bytes(((150, 186, 84) if vein else (92, 148, 52)) + ((255 if inside else 0),))
    texture = s.image_texture(size, size, bytes(pixels))
    leaf_material = s.material("leaf", (1.0, 1.0, 1.0), specular=0.0, double=True, texture=texture, cutoff=0.5)
    s.add(
        "shell",
        room((-2.0, 0.0, -2.0), (2.0, 2.6, 2.0), skip="+z"),
        s.material("plaster", (0.74, 0.72, 0.68), specular=0.0, double=True),
    )
    plant, rng = Shape(), Random(11)
    for k in range(120):
        # A leaf: its root near the stem, its tip outwards and up or down.
        phi, tilt, length, y = rng(0, 2 * math.pi), rng(-0.5, 1.0), rng(0.22, 0.42), rng(0.75, 1.75)
        out = (math.cos(phi) * math.cos(tilt), math.sin(tilt), math.sin(phi) * math.cos(tilt))
        across = (-math.sin(phi), 0.0, math.cos(phi))
        root = tuple(0.12 * c for c in (math.cos(phi), 0.0, math.sin(phi)))
        corner = lambda a, b: tuple(r + length * (b * o + 0.5 * a * t) for r, o, t in zip((root[0], y, root[2]), out, across))
        plant.face(corner(-1, 0), corner(1, 0), corner(1, 1), corner(-1, 1), uvs=[(0, 0), (1, 0), (1, 1), (0, 1)])
    s.add("leaves", plant, leaf_material, (-0.55, 0.0, -0.5))
    pot = [(0.0, 0.0), (0.22, 0.0), (0.30, 0.45), (0.33, 0.45), (0.33, 0.52), (0.29, 0.52), (0.28, 0.46), (0.0, 0.44)]
    s.add("pot", revolve(pot, 40), s.material("terracotta", (0.52, 0.20, 0.10), specular=0.0), (-0.55, 0.0, -0.5))
    s.add(
        "stem",
        revolve([(0.03, 0.44), (0.02, 1.7), (0.0, 1.7)], 12),
        s.material("bark", (0.20, 0.12, 0.06), specular=0.0),
        (-0.55, 0.0, -0.5),
    )
    curtain = Shape(smooth=True)

    def fold(i, j):
        x = 0.55 + 1.15 * j / 40
        slope = 0.06 * 5 * 2 * math.pi / 1.15 * math.cos(2 * math.pi * 5 * j / 40)
        length = math.hypot(slope, 1.0)
        return (x, 0.15 + 2.25 * i, -1.1 + 0.06 * math.sin(2 * math.pi * 5 * j / 40)), (-slope / length, 0.0, 1.0 / length)

    curtain.grid(2, 41, lambda i, j: fold(1 - i, j))
    s.add("curtain", curtain, s.material("voile", (0.85, 0.80, 0.70), specular=0.0, double=True, alpha=0.45))
    s.add("ball", sphere(48), s.material("orange", (0.70, 0.25, 0.04), specular=0.0), (1.1, 0.35, -1.6), scale=(0.35, 0.35, 0.35))
    s.add(
        "lamp",
        Shape().face((-0.5, 2.59, -0.2), (0.5, 2.59, -0.2), (0.5, 2.59, 0.6), (-0.5, 2.59, 0.6)),
        s.light("lamp", (1.0, 0.93, 0.82), 12.0),
    )
    s.camera((0.1, 1.35, 4.4), (0.1, 1.15, 0.0), 42.0)
    return s


def all_scenes():
    box_notes = (
        "The measurements that Cornell's Program of Computer Graphics published, one unit a centimetre. Every surface is diffuse."
    )
    yield cornell_box("cornell-box", "Cornell box", (WHITE, 1.0, 0.0, 0.0), box_notes)
    glossy_notes = "The Cornell box with a rough metallic floor: roughness 0.55, normal-incidence reflectance 9/13."
    yield cornell_box(
        "cornell-box-glossy", "Cornell box with a glossy floor", ((0.6923, 0.6923, 0.6923), 0.55, 1.0, 1.0), glossy_notes
    )
    phong_notes = "The Cornell box with a glossy back wall: a diffuse albedo of 0.1 and a Phong lobe of albedo 0.6 and exponent 22."
    yield cornell_box(
        "cornell-box-phong", "Cornell box with a Phong back wall", (WHITE, 1.0, 0.0, 0.0), phong_notes, (0.1, 0.6, 22.0)
    )
    yield indirect_room()
    yield glossy_still_life()
    yield many_light_hall()
    yield curved_spheres()
    yield staircase()
    yield two_rooms_gap()
    yield mirror_room()
    yield alpha_leaves()
    yield staircase_room()
    yield slit_light()
    yield ies_hall()
    yield two_glossy_planes()
    yield from glossy_scenes()


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    folder.mkdir(parents=True, exist_ok=True)
    for scene in all_scenes():
        scene.write(folder)


if __name__ == "__main__":
    main()
