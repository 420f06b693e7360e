"""The living room that `make demo` renders: every surface the camera sees is lit by bounced light only."""

from gltf import Random, Scene, Shape, box, disc, revolve, room, rounded_box, sphere

# Metres. The room: x to the right, y up, the camera looks along -z.
LEFT, RIGHT, HEIGHT, BACK, FRONT = 0.0, 7.0, 3.1, -6.0, 1.4
DOOR_NEAR, DOOR_FAR, DOOR_TOP = -1.5, -2.75, 2.25


def planks():
    """Floor boards of slightly different oak. All rows are cut at the same places, so that no corner lies on another board's edge."""
    boards, rng, columns, cuts = Shape(), Random(5), 50, 37
    width, step = (RIGHT - LEFT) / columns, (FRONT - BACK) / cuts
    for i in range(columns):
        x0, x1 = LEFT + i * width, LEFT + (i + 1) * width
        k = -int(rng(0.0, 8.0))
        while k < cuts:
            end, tint = k + 7 + int(rng(0.0, 6.0)), rng(0.72, 1.06)
            oak = (0.40 * tint, 0.245 * tint, 0.135 * tint)
            rows = [FRONT - c * step for c in range(max(k, 0), min(end, cuts) + 1)]
            ids = [(boards.vertex((x0, 0, z), color=oak), boards.vertex((x1, 0, z), color=oak)) for z in rows]
            for (a, b), (d, c) in zip(ids, ids[1:]):
                boards.triangle(a, b, c)
                boards.triangle(a, c, d)
            k = end
    return boards


def rug():
    """A woven rug: stripes and lozenges in four wool colours, one face a knot group."""
    wool = [(0.62, 0.54, 0.42), (0.40, 0.085, 0.06), (0.055, 0.10, 0.17), (0.55, 0.30, 0.08)]
    shape, columns, rows, size = Shape(), 52, 36, 0.05
    for i in range(columns):
        for k in range(rows):
            edge = min(i, k, columns - 1 - i, rows - 1 - k)
            lozenge = abs((i - 2) % 12 - 6) + abs((k - 0) % 12 - 6)
            tone = (1, 0, 2, 1)[edge] if edge < 4 else 3 if lozenge < 2 else 2 if lozenge < 4 else 0 if lozenge in (4, 5) else 1
            x, z = i * size, -k * size
            shape.face((x, 0.012, z), (x + size, 0.012, z), (x + size, 0.012, z - size), (x, 0.012, z - size), color=wool[tone])
    w, d = columns * size, rows * size
    return shape.add(box((0, 0.0005, -d), (w, 0.0119, 0), wool[1], skip="-y"))


def bookcase(s, wood):
    """Against the right wall, its open side to the left: four shelves of books."""
    x0, x1, z0, z1, top = 6.62, 6.99, -4.7, -2.9, 2.2
    frame = box((x1 - 0.02, 0.0, z0), (x1, top, z1), skip="-y")
    frame.add(box((x0, 0.0, z0 - 0.03), (x1, top, z0), skip="-y")).add(box((x0, 0.0, z1), (x1, top, z1 + 0.03), skip="-y"))
    levels = [0.08, 0.52, 0.94, 1.36, 1.78, 2.2]
    for y in levels:
        frame.add(box((x0, y - 0.03, z0), (x1 - 0.02, y, z1)))
    s.add("bookcase", frame, wood)
    books, rng = Shape(), Random(23)
    covers = [
        (0.42, 0.06, 0.05),
        (0.05, 0.11, 0.20),
        (0.62, 0.56, 0.44),
        (0.08, 0.16, 0.09),
        (0.50, 0.27, 0.06),
        (0.12, 0.10, 0.10),
        (0.30, 0.36, 0.40),
    ]
    for shelf, y in enumerate(levels[:-1]):
        z, end = z0 + 0.02, z1 - rng(0.02, 0.6)
        while z < end - 0.08:
            thick, tall, deep = rng(0.018, 0.055), rng(0.22, 0.345), rng(0.17, 0.25)
            tint = rng(0.75, 1.15)
            cover = tuple(tint * c for c in covers[int(rng(0.0, len(covers)))])
            books.add(box((x0 + 0.03, y, z), (x0 + 0.03 + deep, y + tall, z + thick), cover, skip="-y"))
            z += thick + 0.0015
    s.add("books", books, s.material("books", (1.0, 1.0, 1.0), specular=0.0))


def sofa(s):
    """Against the left wall, facing right."""
    cloth = s.material("sofa", (0.17, 0.25, 0.27), specular=0.0)
    parts = {
        "seat": ((0.0, 0.12, -2.3), (0.95, 0.34, 0.0), 0.05),
        "back": ((0.0, 0.30, -2.3), (0.26, 0.86, 0.0), 0.08),
        "arm far": ((0.0, 0.12, -2.52), (0.98, 0.62, -2.3), 0.08),
        "arm near": ((0.0, 0.12, 0.0), (0.98, 0.62, 0.22), 0.08),
        "cushion far": ((0.22, 0.335, -2.29), (0.99, 0.50, -1.155), 0.06),
        "cushion near": ((0.22, 0.335, -1.145), (0.99, 0.50, -0.01), 0.06),
    }
    for name, (lo, hi, radius) in parts.items():
        s.add(f"sofa {name}", rounded_box(lo, hi, radius), cloth, (0.12, 0.0, -3.05))
    pillow = rounded_box((-0.24, -0.24, -0.085), (0.24, 0.24, 0.085), 0.08)
    s.add("pillow ochre", pillow, s.material("ochre", (0.60, 0.33, 0.05), specular=0.0), (0.50, 0.72, -5.02), 66.0)
    s.add("pillow rust", pillow, s.material("rust", (0.46, 0.13, 0.06), specular=0.0), (0.50, 0.72, -3.34), 112.0)


def stairs(s, wood):
    """Ten steps along the back wall, rising to the right, with a plastered side and a thin rail."""
    steps, tread, rise, x0, z0, z1 = 10, 0.27, 0.172, 3.55, BACK, BACK + 1.0
    side, treads, rail = Shape(), Shape(), Shape()
    for k in range(steps):
        x, y, end = x0 + k * tread, (k + 1) * rise, RIGHT if k + 1 == steps else x0 + (k + 1) * tread
        side.face((x, 0, z1), (end, 0, z1), (end, y - 0.035, z1), (x, y - 0.035, z1))
        side.face((x, y - rise, z0), (x, y - rise, z1), (x, y - 0.035, z1), (x, y - 0.035, z0))
        treads.add(box((x - 0.025, y - 0.035, z0), (end, y, z1 + 0.02), skip="-z+x" if k + 1 == steps else "-z"))
        rail.add(box((x + 0.12, y, z1 - 0.05), (x + 0.135, y + 0.86, z1 - 0.035), skip="-y"))
    s.add("stair side", side, s.material("stair side", (0.76, 0.73, 0.68), specular=0.0, double=True))
    s.add("treads", treads, wood)
    xa, ya = x0 + 0.06, rise + 0.86
    xb, yb = x0 + (steps - 1) * tread + 0.20, steps * rise + 0.90
    c = [(x, y + dy, z) for x, y in ((xa, ya), (xb, yb)) for dy in (0.0, 0.045) for z in (z1 - 0.065, z1 - 0.02)]
    for quad in ((1, 5, 7, 3), (0, 2, 6, 4), (3, 7, 6, 2), (1, 0, 4, 5), (0, 1, 3, 2), (5, 4, 6, 7)):
        rail.face(*(c[i] for i in quad))
    s.add("rail", rail, s.material("black iron", (0.03, 0.03, 0.032), rough=0.55))


def table(s, wood):
    """A low table on the rug with a vase, two books and a bowl."""
    s.add("table top", rounded_box((-0.62, 0.37, -0.36), (0.62, 0.41, 0.36), 0.018), wood, (2.75, 0.0, -3.75))
    legs = Shape()
    for x in (-0.54, 0.50):
        for z in (-0.29, 0.25):
            legs.add(box((x, 0.012, z), (x + 0.04, 0.372, z + 0.04), skip="-y+y"))
    s.add("table legs", legs, s.material("steel", (0.35, 0.35, 0.36), rough=0.4, metal=1.0), (2.75, 0.0, -3.75))
    vase = [
        (0.0, 0.0),
        (0.055, 0.0),
        (0.085, 0.05),
        (0.10, 0.11),
        (0.092, 0.17),
        (0.06, 0.23),
        (0.036, 0.28),
        (0.034, 0.32),
        (0.05, 0.35),
    ]
    vase += [(0.045, 0.352), (0.028, 0.32), (0.028, 0.28), (0.0, 0.26)]
    s.add("vase", revolve(vase, 40, crease=1.0), s.material("glaze", (0.62, 0.66, 0.62), rough=0.25), (2.42, 0.41, -3.88))
    bowl = [
        (0.0, 0.0),
        (0.06, 0.0),
        (0.12, 0.03),
        (0.16, 0.08),
        (0.175, 0.12),
        (0.168, 0.12),
        (0.15, 0.08),
        (0.11, 0.035),
        (0.0, 0.012),
    ]
    s.add("bowl", revolve(bowl, 40, crease=1.0), s.material("bowl", (0.09, 0.16, 0.22), rough=0.3), (3.08, 0.41, -3.70))
    fruit = s.mesh("fruit", sphere(28), s.material("orange", (0.68, 0.24, 0.03), specular=0.0))
    for k, (x, y, z) in enumerate(((3.03, 0.485, -3.73), (3.12, 0.486, -3.67), (3.085, 0.545, -3.71))):
        s.node(f"orange {k}", fruit, (x, y, z), scale=(0.048, 0.048, 0.048))
    paper = s.material("paper", (0.70, 0.66, 0.56), specular=0.0)
    s.add(
        "book 1",
        box((-0.15, 0.0, -0.11), (0.15, 0.03, 0.11)),
        s.material("cover", (0.36, 0.05, 0.05), specular=0.0),
        (2.74, 0.41, -3.62),
        12.0,
    )
    s.add("book 2", box((-0.12, 0.0, -0.09), (0.12, 0.025, 0.09)), paper, (2.75, 0.44, -3.62), -9.0)


def armchair(s):
    leather = s.material("leather", (0.30, 0.125, 0.05), rough=0.6)
    parts = {
        "seat": ((-0.38, 0.16, -0.38), (0.38, 0.44, 0.40), 0.08),
        "back": ((-0.38, 0.30, -0.46), (0.38, 0.92, -0.24), 0.09),
        "arm left": ((-0.52, 0.14, -0.44), (-0.36, 0.60, 0.40), 0.07),
        "arm right": ((0.36, 0.14, -0.44), (0.52, 0.60, 0.40), 0.07),
    }
    for name, (lo, hi, radius) in parts.items():
        s.add(f"armchair {name}", rounded_box(lo, hi, radius), leather, (4.85, 0.0, -3.75), -68.0)


def lamps(s, wood):
    """An up-lighter, strips behind the ledge and on top of the bookcase, and daylight from round the corner of the passage."""
    metal = s.material("brass", (0.72, 0.52, 0.25), rough=0.35, metal=1.0)
    stand = [
        (0.0, 0.0),
        (0.17, 0.0),
        (0.17, 0.02),
        (0.02, 0.035),
        (0.0125, 0.06),
        (0.0125, 1.62),
        (0.03, 1.64),
        (0.12, 1.70),
        (0.20, 1.80),
    ]
    stand += [(0.193, 1.80), (0.115, 1.71), (0.0, 1.66)]
    s.add("up-lighter", revolve(stand, 40, crease=0.9), metal, (0.48, 0.0, -5.62))
    s.add("up-lighter lamp", disc(0.11, 1.712), s.light("warm lamp", (1.0, 0.66, 0.36), 700.0), (0.48, 0.0, -5.62))
    ledge = box((LEFT, 2.28, BACK), (RIGHT, 2.32, BACK + 0.26), skip="-x+x-z").add(
        box((LEFT, 2.32, BACK + 0.235), (RIGHT, 2.45, BACK + 0.26), skip="-x+x-y")
    )
    s.add("ledge", ledge, wood)
    strip = Shape().face(
        (0.3, 2.325, BACK + 0.15), (6.7, 2.325, BACK + 0.15), (6.7, 2.325, BACK + 0.08), (0.3, 2.325, BACK + 0.08)
    )
    s.add("ledge lamp", strip, s.light("strip lamp", (1.0, 0.74, 0.48), 40.0))
    shelf = Shape().face((6.72, 2.21, -4.65), (6.72, 2.21, -2.95), (6.92, 2.21, -2.95), (6.92, 2.21, -4.65))
    s.add("bookcase lamp", shelf, s.light("shelf lamp", (1.0, 0.80, 0.58), 80.0))
    s.add("bookcase lip", box((6.62, 2.2, -4.73), (6.645, 2.34, -2.87), skip="-y"), wood)
    sky = Shape().face((-1.7, 0.3, -4.99), (-0.06, 0.3, -4.99), (-0.06, 2.9, -4.99), (-1.7, 2.9, -4.99))
    s.add("daylight", sky, s.light("daylight", (0.50, 0.74, 1.0), 4.5))


def pictures(s):
    frame, sheet = s.material("frame", (0.03, 0.028, 0.025), rough=0.5), Shape()
    frames, rng = Shape(), Random(41)
    inks = [(0.06, 0.13, 0.21), (0.55, 0.16, 0.07), (0.62, 0.42, 0.12), (0.13, 0.25, 0.21)]
    for x, y, w, h in ((1.35, 1.35, 0.62, 0.82), (2.25, 1.35, 0.62, 0.82)):
        frames.add(box((x, y, BACK), (x + w, y + h, BACK + 0.03), skip="-z"))
        z = BACK + 0.0305
        quad = lambda a, b, c, d, color, lift: sheet.face(
            (a, b, z + lift), (c, b, z + lift), (c, d, z + lift), (a, d, z + lift), color=color
        )
        quad(x + 0.03, y + 0.03, x + w - 0.03, y + h - 0.03, (0.72, 0.69, 0.62), 0.0)
        for k in range(4):
            a, b = x + rng(0.10, 0.26), y + 0.12 + 0.15 * k
            quad(a, b, a + rng(0.16, 0.26), b + rng(0.08, 0.14), inks[int(rng(0.0, 4.0))], 0.001)
    s.add("frames", frames, frame)
    s.add("prints", sheet, s.material("prints", (1.0, 1.0, 1.0), specular=0.0))


def indirect_room():
    s = Scene(
        "indirect-room",
        "A room lit indirectly",
        (1280, 720),
        notes="The scene of `make demo`. Lamps shine only on the ceiling, the tops of the walls and the passage.",
    )
    plaster = s.material("plaster", (0.78, 0.755, 0.71), specular=0.0, double=True)
    wood = s.material("walnut", (0.20, 0.105, 0.055), rough=0.5, specular=0.5)
    s.add("floor", planks(), s.material("oak", (1.0, 1.0, 1.0), specular=0.0, double=True))
    shell = room((LEFT, 0.0, BACK), (RIGHT, HEIGHT, FRONT), skip="-x+x-y")
    for z0, z1, y0 in ((BACK, DOOR_FAR, 0.0), (DOOR_NEAR, FRONT, 0.0), (DOOR_FAR, DOOR_NEAR, DOOR_TOP)):
        shell.face((LEFT, y0, z1), (LEFT, y0, z0), (LEFT, HEIGHT, z0), (LEFT, HEIGHT, z1))
    # The passage behind the left wall, and the thickness of the wall in the doorway.
    shell.add(room((-1.8, 0.0, -5.0), (-0.15, HEIGHT, 0.2), skip="+x"))
    for z0, z1, y0 in ((-5.0, DOOR_FAR, 0.0), (DOOR_NEAR, 0.2, 0.0), (DOOR_FAR, DOOR_NEAR, DOOR_TOP)):
        shell.face((-0.15, y0, z0), (-0.15, y0, z1), (-0.15, HEIGHT, z1), (-0.15, HEIGHT, z0))
    shell.face((-0.15, 0, DOOR_FAR), (LEFT, 0, DOOR_FAR), (LEFT, DOOR_TOP, DOOR_FAR), (-0.15, DOOR_TOP, DOOR_FAR))
    shell.face((LEFT, 0, DOOR_NEAR), (-0.15, 0, DOOR_NEAR), (-0.15, DOOR_TOP, DOOR_NEAR), (LEFT, DOOR_TOP, DOOR_NEAR))
    shell.face((-0.15, DOOR_TOP, DOOR_FAR), (LEFT, DOOR_TOP, DOOR_FAR), (LEFT, DOOR_TOP, DOOR_NEAR), (-0.15, DOOR_TOP, DOOR_NEAR))
    shell.face((-0.15, 0, DOOR_NEAR), (LEFT, 0, DOOR_NEAR), (LEFT, 0, DOOR_FAR), (-0.15, 0, DOOR_FAR))
    s.add("shell", shell, plaster)
    right = Shape().face((RIGHT, 0.0, BACK), (RIGHT, 0.0, FRONT), (RIGHT, HEIGHT, FRONT), (RIGHT, HEIGHT, BACK))
    s.add("right wall", right, s.material("terracotta", (0.56, 0.235, 0.13), specular=0.0, double=True))
    s.add("rug", rug(), s.material("rug", (1.0, 1.0, 1.0), specular=0.0), (1.55, 0.0, -2.75))
    sofa(s)
    table(s, wood)
    armchair(s)
    stairs(s, wood)
    bookcase(s, wood)
    pictures(s)
    lamps(s, wood)
    s.camera((4.15, 1.5, 1.0), (3.0, 1.05, -4.0), 47.0)
    return s
