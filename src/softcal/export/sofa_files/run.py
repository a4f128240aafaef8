"""Runs the scene without a window, from state to state, to rest at each: `python run.py`, with SOFA_ROOT set.

Without a job the states are the rows of schedule.csv, and response.csv is written; with `--job job.json` every record
is a line of JSON in the job's file. A state is at rest when nothing has moved faster than `speed` [m/s] for `hold` [s].
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
from pulling import read_schedule
from robot_state import pull, read_rods, read_state, speed
from rods import require_stiffness
from scene import PLUGINS, build, read_parameters

FALTERS, FALTERING = 2.0, 0.9  # [s] in which the speed must fall to this part of what it was
SLACK = -1.0e3  # [m] of shortening: a cable so long pulls nowhere


class Lost(Exception):
    """The motion cannot be followed further."""


class Run:
    """A scene that is stepped; what it last was told."""

    def __init__(self, parameters, rest):
        self.parameters, self.rest = parameters, rest
        self.dt = float(parameters["time"]["dt"])
        self.root = Sofa.Core.Node("root")
        self.parts = build(self.root, parameters)
        # init() of v23.12 is initRoot() of later versions.
        getattr(Sofa.Simulation, "initRoot", Sofa.Simulation.init)(self.root)
        for name, node in self.parts["rods"].items():
            require_stiffness(node.beams, name, parameters["rods"][name])
        self.steps = 0
        self.values = {
            name: 0.0 if cable["control"] == "tension" else SLACK for name, cable in parameters["cables"].items()
        }

    def step(self, values):
        """One step of time; the speed after it."""
        pull(self.parts, self.parameters, values, self.dt)
        Sofa.Simulation.animate(self.root, self.dt)
        self.steps += 1
        now = speed(self.parts)
        if not math.isfinite(now):
            last = (self.steps - 1) * self.dt
            raise Lost(f"positions or velocities are no numbers any more; the last good ones are those at {last:.6g} s")
        return now

    def reach(self, target):
        """Ramp to a state and run to rest; its record."""
        begun = self.steps
        start = dict(self.values)
        if any(value == SLACK for value in start.values()):
            there = read_state(self.parts, self.parameters, self.dt)["cables"]
            start = {name: there[name]["shortening"] if value == SLACK else value for name, value in start.items()}
        goal = {**self.values, **target}
        if goal != self.values:
            n_ramp = max(1, round(self.rest["ramp"] / self.dt))
            for k in range(1, n_ramp + 1):
                part = 0.5 - 0.5 * math.cos(math.pi * k / n_ramp)
                values = {n: v if v == SLACK else start[n] + part * (v - start[n]) for n, v in goal.items()}
                self.step(values)
        self.values = goal
        self.settle()
        record = read_state(self.parts, self.parameters, self.dt)
        return {**record, "time": self.steps * self.dt, "steps": self.steps - begun}

    def settle(self):
        """Step until nothing has moved for a while.

        A speed that no longer falls will not: the tendon's stiffness is not in SOFA's matrix, and a robot pulled beyond
        what it would bear without its cable dances, unless the step is short.
        """
        still = 0.0
        before = largest = math.inf
        n_window = max(1, round(FALTERS / self.dt))
        for k in range(1, round(self.rest["longest"] / self.dt) + 1):
            now = self.step(self.values)
            still = still + self.dt if now <= self.rest["speed"] else 0.0
            if still >= self.rest["hold"] - 1e-9:
                return
            largest = now if k % n_window == 1 or n_window == 1 else max(largest, now)
            if k % n_window == 0:
                if largest > FALTERING * before:
                    raise Lost(f"it does not come to rest: {now:.3g} m/s, and no slower than {FALTERS:g} s ago")
                before = largest
        raise Lost("it has not come to rest within {:g} s: still {:.3g} m/s".format(self.rest["longest"], now))


def run(states, parameters, rest, tell, shapes=False):
    """The rest state with all cables slack, then every state; `tell` takes each record. Whether all were reached."""
    began = time.time()
    it = Run(parameters, rest)
    try:
        for number, state in enumerate([{}] + states):
            record = it.reach(state)
            if shapes:
                nodes = it.parts["bodies"].items()
                record["points"] = {name: node.dofs.position.value.tolist() for name, node in nodes}
                record["rods"] = read_rods(it.parts, parameters)
            tell({"state": number, **record})
    except Lost as error:
        tell({"failed": str(error), "time": it.steps * it.dt, "steps": it.steps, "seconds": time.time() - began})
        return False
    tell({"done": True, "steps": it.steps, "seconds": time.time() - began})
    return True


def probe():
    """Which plugins and components this SOFA lacks."""
    missing = [name for name in PLUGINS if not SofaRuntime.importPlugin(name)]
    known = {entry.className for entry in Sofa.Core.ObjectFactory.components}
    return {"missing_plugins": missing, "has_cables": "CableConstraint" in known}


def write_table(path, records):
    """Cables, plates and markers of every state as CSV."""
    rows = []
    for record in records:
        row = {}
        for name, one in record["cables"].items():
            row[name + ".shortening [m]"], row[name + ".tension [N]"] = one["shortening"], one["tension"]
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
    parser.add_argument("--time-step", type=float, help="in seconds; shorter ones settle where longer ones dance")
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
        columns = {name: column for name, column in read_schedule(os.path.join(HERE, "schedule.csv")).items()}
        columns.pop("time", None)
        job = {"states": [dict(zip(columns, row)) for row in zip(*columns.values())], "rest": parameters["rest"]}
    rest = job["rest"]
    step = given.time_step or job.get("dt") or rest["time_steps"][0]
    damping = {key: rest[key] for key in ("rayleigh_stiffness", "rayleigh_mass")}
    parameters["time"] = {"dt": step, **damping}
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
