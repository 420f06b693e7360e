"""The hall of luminaires: IES lights, luminous panels and an overcast sky. Used by make_scenes.py."""

import math

from gltf import Scene, Shape, box, prism


def lm63(vertical, horizontal, candela):
    """The text of an IES file (LM-63-2002, type C) of the function `candela` of both angles in degrees."""
    lines = ["IESNA:LM-63-2002", "[TEST] made by make_scenes.py", "[TESTLAB] none", "[ISSUEDATE] 22-NOV-2026", "[MANUFAC] Lumicache"]
    lines += ["TILT=NONE", f"1 -1 1 {len(vertical)} {len(horizontal)} 1 2 0 0 0", "1 1 40"]
    lines += [" ".join(f"{x:g}" for x in angles) for angles in (vertical, horizontal)]
    lines += [" ".join(f"{candela(v, h):.1f}" for v in vertical) for h in horizontal]
    return "\n".join(lines) + "\n"


def downlight(v, h):
    """A narrow beam with a soft ring where the reflector ends."""
    return 3600 * math.exp(-((v / 17) ** 2)) + 260 * math.exp(-(((v - 42) / 7) ** 2))


def washer(v, h):
    """Aims at 55 degrees towards the horizontal angle 0."""
    v, h = math.radians(v), math.radians(h)
    cosine = math.sin(v) * math.cos(h) * math.sin(math.radians(55)) + math.cos(v) * math.cos(math.radians(55))
    return 1500 * max(0.0, cosine) ** 6


def ies_hall():
    s = Scene(
        "ies-hall",
        "Hall of luminaires",
        (1280, 640),
        flags="--sky overcast,elevation=20",
        notes="20 downlights and 14 wall washers by IES files, 24 luminous panels, skylights and "
        "windows to an overcast sky. In cd/m2.",
    )
    white = s.material("plaster", (0.78, 0.76, 0.72), specular=0.0, double=True)
    floor = s.material("floor", (0.42, 0.40, 0.37), rough=0.45, double=True)
    half, depth, height = 6.0, 28.0, 5.2

    def rectangle(a, b, c, d):
        return Shape().face(a, b, c, d)

    s.add("floor", rectangle((-half, 0, 0), (half, 0, 0), (half, 0, -depth), (-half, 0, -depth)), floor)
    clay = s.material("end wall", (0.62, 0.36, 0.25), specular=0.0, double=True)
    s.add("end wall", rectangle((-half, 0, -depth), (half, 0, -depth), (half, height, -depth), (-half, height, -depth)), clay)
    s.add("entrance", rectangle((half, 0, 0), (-half, 0, 0), (-half, height, 0), (half, height, 0)), white)
    s.add("right wall", rectangle((half, 0, -depth), (half, 0, 0), (half, height, 0), (half, height, -depth)), white)
    # The left wall has a window in each bay, the roof a skylight in every other one. Reveals make them as deep as walls are.
    wall, roof, reveal = Shape(), Shape(), 0.35
    for k in range(7):
        z0, z1 = -4.0 * k, -4.0 * (k + 1)
        a, b, low, high = z0 - 0.9, z1 + 0.9, 1.0, 3.4
        for za, zb, ya, yb in ((z0, a, 0, height), (b, z1, 0, height), (a, b, 0, low), (a, b, high, height)):
            wall.face((-half, ya, za), (-half, ya, zb), (-half, yb, zb), (-half, yb, za))
        out = -half - reveal
        for (ya, za), (yb, zb) in (((low, a), (low, b)), ((low, b), (high, b)), ((high, b), (high, a)), ((high, a), (low, a))):
            wall.face((-half, ya, za), (out, ya, za), (out, yb, zb), (-half, yb, zb))
        if k % 2 == 0:
            roof.face((-half, height, z0), (-half, height, z1), (half, height, z1), (half, height, z0))
            continue
        x0, x1 = -1.3, 1.3
        pieces = ((-half, x0, z0, z1), (x1, half, z0, z1), (x0, x1, z0, a), (x0, x1, b, z1))
        for xa, xb, za, zb in pieces:
            roof.face((xa, height, za), (xa, height, zb), (xb, height, zb), (xb, height, za))
        top = height + 0.6
        for (xa, za), (xb, zb) in (((x0, a), (x0, b)), ((x0, b), (x1, b)), ((x1, b), (x1, a)), ((x1, a), (x0, a))):
            roof.face((xa, height, za), (xa, top, za), (xb, top, zb), (xb, height, zb))
    s.add("left wall", wall, white)
    s.add("roof", roof, white)
    # Columns along the middle aisle, plinths with blocks between them.
    stone = s.material("stone", (0.55, 0.54, 0.50), specular=0.0)
    shaft = prism([(0.22 * math.cos(-math.tau * k / 12), 0.22 * math.sin(-math.tau * k / 12)) for k in range(12)], 0.0, height)
    column, plinth = s.mesh("column", shaft, stone), s.mesh("plinth", box((-0.45, 0.0, -0.45), (0.45, 0.9, 0.45)), white)
    tints = [(0.55, 0.12, 0.09), (0.10, 0.30, 0.45), (0.65, 0.50, 0.15)]
    blocks = [
        s.mesh(f"block {k}", box((-0.28, 0.9, -0.28), (0.28, 1.5 + 0.2 * k, 0.28)), s.material(f"block {k}", tint, rough=0.35))
        for k, tint in enumerate(tints)
    ]
    for k in range(6):
        z = -4.0 * (k + 1)
        for side in (-2.6, 2.6):
            s.node(f"column {side:+} {k}", column, (side, 0.0, z))
        for side in (-4.2, 4.2):
            s.node(f"plinth {side:+} {k}", plinth, (side, 0.0, z + 0.3), turn=17.0 * k)
            s.node(f"block {side:+} {k}", blocks[(k + int(side > 0)) % 3], (side, 0.0, z + 0.3), turn=17.0 * k + 25.0)
    # Luminaires.
    step = lambda first, last, by: [first + by * k for k in range(int(round((last - first) / by)) + 1)]
    down, wash = s.profile(lm63(step(0, 90, 2.5), [0], downlight)), s.profile(lm63(step(0, 90, 5), step(0, 180, 15), washer))
    for k in range(10):
        z = -1.4 - 2.8 * k
        for side in (-4.2, 4.2):
            s.luminaire(f"downlight {side:+} {k}", down, (side, height - 0.05, z), color=[1.0, 0.89, 0.74])
    for k in range(14):
        s.luminaire(f"washer {k}", wash, (half - 1.1, height - 0.05, -1.0 - 2.0 * k), color=[1.0, 0.95, 0.86])
    panel = Shape().face((-0.6, 0.0, -0.09), (0.6, 0.0, -0.09), (0.6, 0.0, 0.09), (-0.6, 0.0, 0.09))
    lamp = s.mesh("panel", panel, s.light("panel", (1.0, 0.96, 0.90), 4000.0))
    for k in range(12):
        for side in (-0.75, 0.75):
            s.node(f"panel {side:+} {k}", lamp, (side, 4.2, -1.3 - 2.3 * k))
    s.camera((-1.9, 1.65, -0.6), (0.9, 1.9, -14.0), 52.0)
    return s
