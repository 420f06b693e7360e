"""Rooms lit by bounced light, for the placing of records: ten steps in a dim room, and light that falls through a slit."""

from gltf import Scene, Shape, box, room


def staircase_room():
    s = Scene(
        "staircase-room",
        "A dim room with ten steps",
        (800, 600),
        notes="The lamp stands behind a half wall and shines up. The steps, the table and the "
        "floor get bounced light only. For neighbour clamping and refinement.",
    )
    walls = s.material("walls", (0.74, 0.72, 0.68), specular=0.0, double=True)
    s.add("shell", room((0.0, 0.0, -5.0), (6.0, 2.8, 0.0), skip="-y"), walls)
    floor = Shape().face((0, 0, 0), (6, 0, 0), (6, 0, -5), (0, 0, -5))
    s.add("floor", floor, s.material("floor", (0.45, 0.33, 0.24), specular=0.0, double=True))
    s.add("half wall", box((0.0, 0.0, -3.9), (3.2, 1.15, -3.78), skip="-x-y"), walls)
    lamp = Shape().face((0.6, 0.25, -4.2), (2.6, 0.25, -4.2), (2.6, 0.25, -4.6), (0.6, 0.25, -4.6))
    s.add("lamp", lamp, s.light("lamp", (1.0, 0.82, 0.60), 22.0))
    # Ten steps along the right wall, up to a landing at the back.
    steps, tread, rise, left, right, front = 10, 0.28, 0.17, 4.6, 6.0, -1.1
    flight = Shape()
    for k in range(steps):
        z0, y0, y1 = front - k * tread, k * rise, (k + 1) * rise
        z1 = z0 - tread if k + 1 < steps else -5.0
        flight.face((left, y0, z0), (right, y0, z0), (right, y1, z0), (left, y1, z0))
        flight.face((left, y1, z0), (right, y1, z0), (right, y1, z1), (left, y1, z1))
        flight.face((left, 0, z1), (left, 0, z0), (left, y1, z0), (left, y1, z1))
    s.add("flight", flight, s.material("steps", (0.58, 0.50, 0.40), specular=0.0))
    table = box((1.3, 0.70, -2.75), (2.8, 0.74, -1.95))
    for x in (1.36, 2.68):
        for z in (-2.69, -2.07):
            table.add(box((x, 0.0, z), (x + 0.06, 0.70, z + 0.06), skip="-y+y"))
    s.add("table", table, s.material("wood", (0.34, 0.19, 0.10), specular=0.0))
    s.camera((2.75, 1.6, -0.1), (3.2, 0.85, -3.4), 62.0)
    return s


def slit_light():
    s = Scene(
        "slit-light",
        "Light through a slit",
        (640, 480),
        notes="The floor sees a bright panel on the ceiling through a slit in a plate that glows "
        "faintly. The panel makes a band of bounced light with sharp edges in even direct light. "
        "Refined records are small at the edges and large elsewhere.",
    )
    black = s.material("black", (0.02, 0.02, 0.02), specular=0.0, double=True)
    s.add("shell", room((-2.0, 0.0, -3.0), (2.0, 2.4, 0.0), skip="-y"), black)
    floor = Shape().face((-2, 0, 0), (2, 0, 0), (2, 0, -3), (-2, 0, -3))
    s.add("floor", floor, s.material("floor", (0.60, 0.60, 0.60), specular=0.0, double=True))
    panel = Shape().face((-0.6, 2.39, -2.1), (0.6, 2.39, -2.1), (0.6, 2.39, -0.9), (-0.6, 2.39, -0.9))
    s.add("panel", panel, s.material("white", (0.80, 0.80, 0.80), specular=0.0))
    glow = s.light("glow", (1.0, 0.95, 0.85), 0.012)
    for name, a, b in (("left", -2.0, -0.3), ("right", 0.3, 2.0)):
        s.add(f"{name} plate", box((a, 0.40, -3.0), (b, 0.41, 0.0), skip="-y-z+z"), black)
        s.add(f"{name} glow", Shape().face((a, 0.40, 0), (a, 0.40, -3), (b, 0.40, -3), (b, 0.40, 0)), glow)
    # The lamps lie on the plates and shine at the panel.
    for name, x in (("left lamp", -1.2), ("right lamp", 1.2)):
        lamp = Shape().face((x - 0.15, 0.42, -1.35), (x + 0.15, 0.42, -1.35), (x + 0.15, 0.42, -1.65), (x - 0.15, 0.42, -1.65))
        s.add(name, lamp, s.light(name, (1.0, 0.95, 0.85), 100.0))
    s.camera((0.9, 0.37, -0.05), (-0.1, 0.0, -1.8), 62.0)
    return s
