"""Runs the scene without a window, from state to state, to rest at each: `python run.py`, with SOFA_ROOT set.

Without a job the states are the rows of schedule.csv, and response.csv is written; with `--job job.json` every record
is a line of JSON in the job's file. A state is at rest when nothing has moved faster than `speed` [m/s] for `hold` [s].
One that does not come to rest is begun again from the last one that did, with the next of `time_steps` [s].
"""

import argparse
import csv
import glob
import json
import math
import os
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
if ROOT := os.environ.get("SOFA_ROOT"):
    # Last: bindings that this Python knows already go first.
    sys.path.extend(sorted(glob.glob(os.path.join(ROOT, "plugins", "*", "lib", "python3", "site-packages"))))
    sys.path.extend(sorted(glob.glob(os.path.join(ROOT, "lib", "python3*", "site-packages"))))

try:
    import Sofa
    import Sofa.Core
    import Sofa.Simulation
    import SofaRuntime
except ImportError as error:
    sys.exit(f"SOFA's Python packages do not load ({error}). Set SOFA_ROOT, and run this with the Python they are for.")
import numpy as np
import scene
from ROBOT_PACKAGE import PLUGINS, read_parameters
from ROBOT_PACKAGE.pulling import SCHEDULE, read_schedule
from ROBOT_PACKAGE.robot_state import pull, read_rods, read_state, speed
from ROBOT_PACKAGE.rods import require_stiffness

FALTERS, FALTERING = 2.0, 0.9  # [s] in which the speed must fall to this part of what it was
SLACK = -1.0e3  # [m] of shortening: a cable so long pulls nowhere


class Lost(Exception):
    """The motion cannot be followed further."""


class SofaScene:
    """The scene with one time step [s].

    Each step has a scene of its own: SOFA keeps the matrix of masses that plates carry with the factor, of the step and
    the damping, with which it was first needed.
    """

    def __init__(self, parameters, dt):
        self.dt = dt
        self.root = Sofa.Core.Node("root")
        self.parts = scene.build(self.root, {**parameters, "time": {**parameters["time"], "dt": dt}}).parts
        # init() of v23.12 is initRoot() of later versions.
        getattr(Sofa.Simulation, "initRoot", Sofa.Simulation.init)(self.root)
        for name, node in self.parts["rods"].items():
            require_stiffness(node.beams, name, parameters["rods"][name])

    def states(self):
        """Every node's positions, by where they are in the graph."""
        found = filter(None, (getattr(node, "dofs", None) for node in below(self.root)))
        return {state.getLinkPath(): state for state in found}

    def positions(self):
        return {path: np.array(state.position.value, dtype=float) for path, state in self.states().items()}

    def put(self, positions):
        """Everything where it was, and still. What is mapped SOFA's reset puts in its place, and the mappings."""
        for path, state in self.states().items():
            state.reset_position.value = positions[path]
        Sofa.Simulation.reset(self.root)


class SofaRun:
    """The scene from state to state: where it settled last, and what it then was told."""

    def __init__(self, parameters, rest):
        self.parameters, self.rest = parameters, rest
        self.scenes = {}
        self.scene = self.scene_of(rest["time_steps"][0])
        self.kept, self.kept_time = self.scene.positions(), 0.0
        self.steps, self.time = 0, 0.0
        self.values = {
            name: 0.0 if cable["control"] == "tension" else SLACK for name, cable in parameters["cables"].items()
        }
        self.values.update(dict.fromkeys(parameters["chambers"], 0.0))
        self.settled = []  # how far each state was pulled and filled, and which time step brought it to rest

    def scene_of(self, dt):
        if dt not in self.scenes:
            self.scenes[dt] = SofaScene(self.parameters, dt)
        return self.scenes[dt]

    def go_back(self, dt):
        """To the last state at rest, to go on with a time step."""
        self.scene = self.scene_of(dt)
        self.scene.put(self.kept)
        self.time = self.kept_time

    def step(self, values):
        """One step of time; the speed after it."""
        scene = self.scene
        pull(scene.parts, self.parameters, values, scene.dt)
        Sofa.Simulation.animate(scene.root, scene.dt)
        self.steps += 1
        now = speed(scene.parts)
        if not math.isfinite(now):
            raise Lost(
                f"positions or velocities are no numbers any more; the last good ones are those at {self.time:.6g} s"
            )
        self.time += scene.dt
        return now

    def reach(self, target):
        """Run to a state, where need be again from the last one with another time step; its record.

        The next shorter ones are tried, and at last those that are longer than what it began with.
        """
        begun = self.steps
        goal = {**self.values, **target}
        chambers = self.parameters["chambers"]
        pulls = {name: abs(value) if name in chambers else max(value, 0.0) for name, value in goal.items()}
        time_steps = self.rest["time_steps"]
        first = self.first_choice(pulls)
        failures = []
        for k in [*range(first, len(time_steps)), *reversed(range(first))]:
            if failures or time_steps[k] != self.scene.dt:
                self.go_back(time_steps[k])
            try:
                self.approach(goal)
                break
            except Lost as error:
                failures.append(f"{error} (time step {time_steps[k]:g} s)")
        else:
            raise Lost(". Then ".join(failures))
        self.values = goal
        self.settled.append((pulls, k))
        self.kept, self.kept_time = self.scene.positions(), self.time
        return {**self.read(), "time": self.time, "dt": self.scene.dt, "steps": self.steps - begun}

    def read(self):
        return read_state(self.scene.parts, self.parameters, self.scene.dt)

    def first_choice(self, pulls):
        """The first time step to try: that of the previous state with the most similar pulls and so oscillations."""
        if not self.settled:
            return 0
        seen = [pulls, *(there for there, _ in self.settled)]
        largest = {name: max(there[name] for there in seen) or 1.0 for name in pulls}

        def apart(state):
            return sum(((state[0][name] - pull) / largest[name]) ** 2 for name, pull in pulls.items())

        return min(reversed(self.settled), key=apart)[1]

    def approach(self, goal):
        """Ramp to a state and run to rest."""
        start = dict(self.values)
        if any(value == SLACK for value in start.values()):
            there = self.read()["cables"]
            start = {name: there[name]["shortening"] if value == SLACK else value for name, value in start.items()}
        if goal != self.values:
            n_ramp = max(1, round(self.rest["ramp"] / self.scene.dt))
            for k in range(1, n_ramp + 1):
                part = 0.5 - 0.5 * math.cos(math.pi * k / n_ramp)
                values = {n: v if v == SLACK else start[n] + part * (v - start[n]) for n, v in goal.items()}
                self.step(values)
        self.settle(goal)

    def settle(self, values):
        """Step until nothing has moved for a while.

        A speed that no longer falls will not: the tendon's stiffness is not in SOFA's matrix, and a robot pulled beyond
        what it would bear without its cable dances, unless the step is short.
        """
        still = 0.0
        before = largest = math.inf
        dt = self.scene.dt
        n_window = max(1, round(FALTERS / dt))
        for k in range(1, round(self.rest["longest"] / dt) + 1):
            now = self.step(values)
            still = still + dt if now <= self.rest["speed"] else 0.0
            if still >= self.rest["hold"] - 1e-9:
                return
            largest = now if k % n_window == 1 or n_window == 1 else max(largest, now)
            if k % n_window == 0:
                if largest > FALTERING * before:
                    raise Lost(f"it does not come to rest: {now:.3g} m/s, and no slower than {FALTERS:g} s ago")
                before = largest
        raise Lost("it has not come to rest within {:g} s: still {:.3g} m/s".format(self.rest["longest"], now))


def below(node):
    """A node and all below it; those of several parents are told as often."""
    yield node
    for child in node.children:
        yield from below(child)


def run(states, parameters, rest, tell, shapes=False):
    """Reach the rest state with all cables slack and no pressure, then every state. False where one was not reached.

    Parameters
    ----------
    states
        Cable -> shortening [m] or tension [N], chamber -> pressure [Pa], of each state.
    parameters
        Content of parameters.json.
    rest
        When the robot is at rest, as `rest` of parameters.json.
    tell
        Takes each record.
    shapes
        Record the points of bodies and rods, too.
    """
    began = time.time()
    it = SofaRun(parameters, rest)
    try:
        for number, state in enumerate([{}] + states):
            record = it.reach(state)
            if shapes:
                nodes = it.scene.parts["bodies"].items()
                record["points"] = {name: node.dofs.position.value.tolist() for name, node in nodes}
                record["rods"] = read_rods(it.scene.parts, parameters)
            tell({"state": number, **record})
    except Lost as error:
        tell({"failed": str(error), "time": it.time, "steps": it.steps, "seconds": time.time() - began})
        return False
    tell({"done": True, "steps": it.steps, "seconds": time.time() - began})
    return True


def probe():
    """The plugins and components that this SOFA lacks."""
    missing = [name for name in [*scene.PLUGINS, *PLUGINS] if not SofaRuntime.importPlugin(name)]
    known = {entry.className for entry in Sofa.Core.ObjectFactory.components}
    return {"missing_plugins": missing, "has_cables": "CableConstraint" in known}


def write_table(path, records):
    """Cables, chambers, plates and markers of every state as CSV."""
    rows = []
    for record in records:
        row = {}
        for name, one in record["cables"].items():
            row[name + ".shortening [m]"], row[name + ".tension [N]"] = one["shortening"], one["tension"]
        for name, one in record["chambers"].items():
            row[name + ".pressure [Pa]"], row[name + ".volume [m^3]"] = one["pressure"], one["volume"]
        for name, at in record["plates"].items():
            row.update(zip([name + "." + key for key in ("x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw")], at))
        for name, at in record["markers"].items():
            row.update(zip([name + "." + key + " [m]" for key in "xyz"], at))
        rows.append(row)
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--job", help="a file of what to do, as softcal writes it")
    parser.add_argument("--probe", metavar="FILE", help="write what this SOFA lacks, and end")
    parser.add_argument("--time-step", type=float, help="in seconds: this one alone, and not those of parameters.json")
    given = parser.parse_args()
    if given.probe:
        with open(given.probe, "w", encoding="utf-8") as file:
            json.dump(probe(), file)
        return 0
    parameters = read_parameters()
    if given.job:
        with open(given.job, encoding="utf-8") as file:
            job = json.load(file)
    else:
        columns = {name: column for name, column in read_schedule(SCHEDULE).items()}
        columns.pop("time", None)
        job = {"states": [dict(zip(columns, row)) for row in zip(*columns.values())], "rest": parameters["rest"]}
    rest = job["rest"]
    if given.time_step:
        rest = {**rest, "time_steps": [given.time_step]}
    parameters["time"] = {key: rest[key] for key in ("rayleigh_stiffness", "rayleigh_mass")}
    if given.job:
        with open(job["out"], "w", encoding="utf-8") as file:

            def tell(record):
                file.write(json.dumps(record) + "\n")
                file.flush()

            return 0 if run(job["states"], parameters, rest, tell, job.get("shapes", False)) else 1
    records = []
    reached = run(job["states"], parameters, rest, records.append)
    states = [record for record in records if "state" in record]
    if states:
        write_table(os.path.join(HERE, "response.csv"), states)
    found = f"{len(states)} state{'' if len(states) == 1 else 's'} at rest, in response.csv."
    sys.stdout.write(" ".join(filter(None, (found, records[-1].get("failed")))) + "\n")
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
