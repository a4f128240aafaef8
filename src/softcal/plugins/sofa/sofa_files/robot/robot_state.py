"""What the robot of scene.py is told to do, and what it does: cables, chambers, plates and markers in m, N, Pa, rad."""

import numpy as np


def pull(parts, parameters, values, dt):
    """Give cables their shortening or tension, and chambers their pressure. A force is an impulse in SOFA, tension
    times step, and so is a pressure.

    Parameters
    ----------
    parts, parameters, dt
        See `read_state`.
    values
        Cable -> shortening [m] or tension [N]; chamber -> pressure [Pa].
    """
    for name, value in values.items():
        if name in parts["chambers"]:
            parts["chambers"][name].chamber.value.value = [float(value * dt)]
            continue
        is_tension = parameters["cables"][name]["control"] == "tension"
        parts["cables"][name].cable.value.value = [float(value * dt if is_tension else value)]


def read_state(parts, parameters, dt):
    """Tension and shortening of cables; pressure and volume of chambers; position and quaternion (x, y, z, w) of the
    references of plates; markers.

    Parameters
    ----------
    parts
        The robot's nodes by kind and name.
    parameters
        Content of parameters.json.
    dt
        Time step [s].
    """
    return {
        "cables": {name: read_cable(node, parameters["cables"][name], dt) for name, node in parts["cables"].items()},
        "chambers": {
            name: read_chamber(node, parameters["chambers"][name], dt) for name, node in parts["chambers"].items()
        },
        "plates": {name: read_plate(name, plate, parts) for name, plate in parameters["plates"].items()},
        "markers": {name: read_marker(marker, parameters, parts) for name, marker in parameters["markers"].items()},
    }


def read_cable(node, cable, dt):
    """Tension [N], shortening [m] and points (n, 3) [m] of a cable.

    Parameters
    ----------
    node, cable
        The cable's node, and its entry in parameters.json.
    dt
        Time step [s].
    """
    points = np.array(node.dofs.position.value, dtype=float)
    if cable["pull_point"] is not None:
        points = np.vstack([cable["pull_point"], points])
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    # From the points: the constraint's own `displacement` is that of the step before.
    shortening = cable["length"] - length
    return {"tension": float(node.cable.force.value) / dt, "shortening": shortening, "points": points.tolist()}


def read_chamber(node, chamber, dt):
    """Pressure [Pa] and volume [m^3] of a chamber.

    Parameters
    ----------
    node, chamber
        The chamber's node, and its entry in parameters.json.
    dt
        Time step [s].
    """
    a, b, c = np.swapaxes(np.array(node.dofs.position.value, dtype=float)[chamber["triangles"]], 0, 1)
    volume = float((a * np.cross(b, c)).sum()) / 6.0
    return {"pressure": float(node.chamber.pressure.value) / dt, "volume": volume}


def read_rods(parts, parameters):
    """Positions of the twin's nodes of every rod [m]; the scene has further nodes between them."""
    return {
        name: np.array(node.dofs.position.value)[:: parameters["rods"][name]["segments"], :3].tolist()
        for name, node in parts["rods"].items()
    }


def read_plate(name, plate, parts):
    """Position [m] of a plate's reference, and its quaternion (x, y, z, w).

    Parameters
    ----------
    name, plate
        The plate's name, and its entry in parameters.json.
    parts
        The robot's nodes by kind and name.
    """
    if plate["fixed"]:
        return plate["reference"] + [0.0, 0.0, 0.0, 1.0]
    return carried(plate["reference"], name, plate, parts) + frame_of(name, parts)[3:].tolist()


def read_marker(marker, parameters, parts):
    """Position (3,) [m] of a marker.

    Parameters
    ----------
    marker
        Its entry in parameters.json.
    parameters, parts
        See `read_state`.
    """
    if not marker["on"]:
        return marker["at"]
    if marker["on"] in parts["plates"]:
        return carried(marker["at"], marker["on"], parameters["plates"][marker["on"]], parts)
    points = np.array(parts["bodies"][marker["on"]].dofs.position.value, dtype=float)
    return (np.array(marker["weights"]) @ points[marker["nodes"]]).tolist()


def frame_of(name, parts):
    """Position and quaternion of a plate's frame, which is at its centre of mass."""
    return np.array(parts["plates"][name].dofs.position.value, dtype=float)[0]


def carried(at, name, plate, parts):
    """Position [m] of a point that moves with a plate.

    Parameters
    ----------
    at
        The point at rest [m].
    name, plate
        The plate's name, and its entry in parameters.json.
    parts
        The robot's nodes by kind and name.
    """
    frame = frame_of(name, parts)
    return (frame[:3] + turned(frame[3:], np.array(at) - np.array(plate["centre_of_mass"]))).tolist()


def turned(quaternion, vector):
    """A vector turned by a unit quaternion (x, y, z, w)."""
    axis = quaternion[:3]
    return vector + 2.0 * np.cross(axis, np.cross(axis, vector) + quaternion[3] * vector)


def speed(parts):
    """The largest speed [m/s] of bodies' and rods' nodes and plates' frames; NaN where a number is not finite."""
    largest = 0.0
    for node in [node for kind in ("bodies", "rods", "plates") for node in parts[kind].values()]:
        velocity = np.array(node.dofs.velocity.value, dtype=float)[:, :3]
        position = np.array(node.dofs.position.value, dtype=float)
        if not (np.isfinite(velocity).all() and np.isfinite(position).all()):
            return float("nan")
        largest = max(largest, float(np.sqrt((velocity**2).sum(axis=1).max())))
    return largest
