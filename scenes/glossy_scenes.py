"""Glossy surfaces for radiance caching: a box with a camera that moves, and scenes like those of the published measurements."""

import math

from gltf import Scene, Shape, box, cross, phong, revolve, room, unit

WHITE = (0.72, 0.70, 0.66)


def shell(s, half, height, depth, floor):
    """A box open at the front, red and green walls at the sides, a lamp in its ceiling, and a floor of the material `floor`."""
    white = s.material("white", WHITE, specular=0.0, double=True)
    s.add("shell", room((-half, 0.0, -depth), (half, height, 0.0), skip="-y-x+x+z"), white)
    s.add("floor", Shape().face((-half, 0, 0), (half, 0, 0), (half, 0, -depth), (-half, 0, -depth)), floor)
    red = s.material("red", (0.63, 0.07, 0.05), specular=0.0, double=True)
    s.add("left wall", Shape().face((-half, 0, 0), (-half, 0, -depth), (-half, height, -depth), (-half, height, 0)), red)
    green = s.material("green", (0.14, 0.45, 0.09), specular=0.0, double=True)
    s.add("right wall", Shape().face((half, 0, -depth), (half, 0, 0), (half, height, 0), (half, height, -depth)), green)
    y, z, r = height - 0.01, -depth / 2, 0.3
    lamp = Shape().face((-r, y, z - r), (r, y, z - r), (r, y, z + r), (-r, y, z + r))
    s.add("lamp", lamp, s.light("lamp", (1.0, 0.85, 0.65), 14.0))


def glossy_walk():
    s = Scene(
        "glossy-walk",
        "A walk past a glossy wall",
        (512, 512),
        flags="--frames 0..29",
        notes="A box with a Phong wall at the back (exponent 22) and a rough metallic floor. The "
        "camera moves for 30 frames of 1/24 s.",
    )
    shell(s, 1.4, 2.7, 2.8, s.material("floor", (9 / 13, 9 / 13, 9 / 13), rough=0.55, metal=1.0, double=True))
    wall = s.material("glossy", (0.5, 0.5, 0.5), double=True, native=phong(0.2, 0.6, 22))
    s.add("back wall", Shape().face((-1.4, 0, -2.79), (1.4, 0, -2.79), (1.4, 2.7, -2.79), (-1.4, 2.7, -2.79)), wall)
    blocks = s.mesh("block", box((-0.35, 0.0, -0.35), (0.35, 1.0, 0.35), skip="-y"), s.material("blocks", WHITE, specular=0.0))
    s.node("short block", blocks, (0.55, 0.0, -0.95), -17.0, (1.0, 0.75, 1.0))
    s.node("tall block", blocks, (-0.55, 0.0, -1.75), 20.0, (1.0, 1.6, 1.0))
    s.walk([((0.0, 1.35, 4.0), (0.0, 1.2, -1.4)), ((0.9, 1.7, 3.2), (0.0, 1.1, -1.6))], 29 / 24, 39.0)
    return s


def pyramid_metal():
    s = Scene(
        "pyramid-metal",
        "A box and a pyramid on metal",
        (640, 640),
        notes="A floor of three metallic lobes (Lafortune, exponents 16, 88 and 186) mirrors the "
        "edges of a pyramid and of a box. Refined radiance records are dense along the edges and "
        "sparse elsewhere.",
    )
    # Lobes of albedo 0.18, 0.25 and 0.3: c^n 2 pi / (n + 2).
    lobe = lambda n, tint, albedo: {
        "cx": -((albedo * (n + 2) / (2 * math.pi)) ** (1 / n)),
        "cz": [(t * albedo * (n + 2) / (2 * math.pi)) ** (1 / n) for t in tint],
        "exponent": n,
    }
    tint = (0.95, 0.9, 0.8)
    lobes = [lobe(16, tint, 0.18), lobe(88, tint, 0.25), lobe(186, tint, 0.3)]
    lobes = [{k: [round(x, 6) for x in v] if isinstance(v, list) else round(v, 6) for k, v in one.items()} for one in lobes]
    metal = s.material("metal", (0.7, 0.7, 0.7), double=True, native={"brdf": "lafortune", "kd": 0.05, "lobes": lobes})
    shell(s, 1.4, 2.7, 2.8, metal)
    pyramid, top = Shape(), (0.0, 1.1, 0.0)
    corners = [(-0.5, 0.0, 0.5), (0.5, 0.0, 0.5), (0.5, 0.0, -0.5), (-0.5, 0.0, -0.5)]
    for a, b in zip(corners, corners[1:] + corners[:1]):
        pyramid.face(a, b, top)
    s.add("pyramid", pyramid, s.material("pyramid", (0.75, 0.55, 0.15), specular=0.0), (-0.45, 0.0, -1.5), 25.0)
    s.add("block", box((-0.3, 0.0, -0.3), (0.3, 0.6, 0.3), skip="-y"), s.material("block", (0.15, 0.3, 0.6), specular=0.0),
          (0.6, 0.0, -1.0), -20.0)
    s.camera((0.0, 2.1, 3.4), (0.0, 0.6, -1.4), 36.0)
    return s


def phong_pot():
    s = Scene(
        "phong-pot",
        "A pot with a glossy skin",
        (640, 480),
        notes="A pot with a spout and a lid (Phong, exponent 16) stands on a table in a room. The "
        "curved body mirrors the spout.",
    )
    s.add("room", room((-2.0, 0.0, -2.0), (2.0, 2.6, 2.6), skip="-y"), s.material("walls", WHITE, specular=0.0, double=True))
    table = s.material("table", (0.45, 0.25, 0.12), specular=0.0, double=True)
    s.add("table", Shape().face((-2, 0, 2.6), (2, 0, 2.6), (2, 0, -2), (-2, 0, -2)), table)
    screen = s.material("screen", (0.60, 0.10, 0.08), specular=0.0, double=True)
    s.add("screen", Shape().face((-2, 0, -1.2), (-0.6, 0, -1.9), (-0.6, 1.6, -1.9), (-2, 1.6, -1.2)), screen)
    glaze = s.material("glaze", (0.5, 0.5, 0.5), native=phong([0.05, 0.1, 0.2], 0.6, 16))
    body = [(0.0, 0.0), (0.42, 0.0), (0.45, 0.03)]
    body += [(0.45 + 0.2 * math.sin(math.pi * t * 0.9), 0.03 + 0.62 * t) for t in [i / 14 for i in range(1, 15)]]
    body += [(0.40, 0.72), (0.25, 0.78), (0.09, 0.81), (0.06, 0.84), (0.09, 0.89), (0.06, 0.94), (0.0, 0.95)]
    s.add("body", revolve(body, 48, crease=1.2), glaze)
    spout = Shape(smooth=True)

    def tube(i, j):
        t, b = i / 12, 2 * math.pi * (j % 12) / 12
        center, along = (0.5 + 0.5 * t, 0.28 + 0.5 * t * t, 0.0), unit((0.5, t, 0.0))
        side = (0.0, 0.0, 1.0)
        out = cross(side, along)
        r = 0.13 - 0.07 * t
        n = tuple(math.cos(b) * o + math.sin(b) * q for o, q in zip(out, side))
        return tuple(c + r * x for c, x in zip(center, n)), n

    s.add("spout", spout.grid(13, 13, lambda i, j: tube(12 - i, j)), glaze)
    y = 2.59
    lamp = Shape().face((-0.5, y, -0.2), (0.5, y, -0.2), (0.5, y, 0.8), (-0.5, y, 0.8))
    s.add("lamp", lamp, s.light("lamp", (1.0, 0.92, 0.8), 14.0))
    s.camera((0.7, 1.0, 2.4), (0.15, 0.42, 0.0), 34.0)
    return s


def metal_hall():
    s = Scene(
        "metal-hall",
        "A building with curved metal walls",
        (800, 500),
        flags="--sky clear,azimuth=215,elevation=40,illuminance=10000,sun-illuminance=60000",
        notes="Curved walls of brushed metal (Phong, exponent 12) over a plaza mirror the ground "
        "and each other. For sun and sky.",
    )
    s.add("plaza", Shape().face((-40, 0, 40), (40, 0, 40), (40, 0, -40), (-40, 0, -40)),
          s.material("stone", (0.42, 0.38, 0.33), specular=0.0, double=True))
    metal = s.material("metal", (0.6, 0.6, 0.6), double=True, native=phong(0.1, [0.62, 0.6, 0.57], 12))

    def sail(name, center, radius, start, end, height, lean):
        wall = Shape(smooth=True)

        def vertex(i, j):
            a, t = math.radians(start + (end - start) * j / 24), i / 8
            r = radius + lean * t * t
            n = unit((math.cos(a), -2 * lean * t / height, math.sin(a)))
            return (center[0] + r * math.cos(a), height * t, center[1] + r * math.sin(a)), n

        s.add(name, wall.grid(9, 25, lambda i, j: vertex(i, 24 - j)), metal)

    sail("left sail", (-9.0, -10.0), 6.0, -30.0, 110.0, 9.0, 2.5)
    sail("right sail", (7.0, -12.0), 7.0, 60.0, 200.0, 12.0, 2.0)
    sail("inner sail", (0.0, -16.0), 4.0, 30.0, 150.0, 7.0, 1.5)
    steps = Shape()
    for k in range(6):
        steps.add(box((-5.0, 0.16 * k, -9.5 - 0.4 * k), (5.0, 0.16 * (k + 1), -9.1 - 0.4 * k), skip="-y"))
    s.add("steps", steps, s.material("steps", (0.55, 0.52, 0.48), specular=0.0))
    s.camera((-2.0, 1.7, 6.0), (-0.5, 3.0, -10.0), 48.0)
    return s


def ward_floor():
    s = Scene(
        "ward-floor",
        "A box on a glossy floor",
        (640, 480),
        notes="A floor with a Ward lobe alone (albedo 0.9, alpha 0.3). Refinement makes more "
        "records for sharper lobes.",
    )
    ward = {"brdf": "ward", "kd": 0, "ks": 0.9, "alpha_x": 0.3}
    shell(s, 1.8, 2.4, 3.0, s.material("floor", (0.9, 0.9, 0.9), double=True, native=ward))
    s.add("block", box((-0.35, 0.0, -0.35), (0.35, 0.9, 0.35), skip="-y"), s.material("block", WHITE, specular=0.0),
          (0.1, 0.0, -1.6), 30.0)
    s.camera((0.0, 1.5, 3.6), (0.0, 0.7, -1.4), 38.0)
    return s


def glossy_scenes():
    return [glossy_walk(), pyramid_metal(), phong_pot(), metal_hall(), ward_floor()]
