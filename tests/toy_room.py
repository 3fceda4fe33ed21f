"""A scene that is built in no time, as a file."""


def room():
    """A room of 4 m x 3 m x 4 m with a pillar, seen from inside, as an OBJ file."""
    lines, count = [], 0
    for (a, b, c), (d, e, f) in (((0, 0, 0), (4, 3, 4)), ((1, 0, 1), (1.5, 3, 1.5))):
        for x in (a, d):
            for y in (b, e):
                lines += [f"v {x} {y} {z}" for z in (c, f)]
        faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
        for face in faces:
            lines.append("f " + " ".join(str(int(i) + count) for i in face.split()))
        count += 8
    return "\n".join(lines) + "\n"
