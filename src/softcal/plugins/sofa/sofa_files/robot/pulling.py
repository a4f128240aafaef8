"""Pulls the cables, and fills the chambers, while the scene runs: by schedule.csv, or by keys."""

import csv
import os

import Sofa
import Sofa.Core

from .robot_state import pull, read_state

SCHEDULE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "schedule.csv")


class Pulling(Sofa.Core.Controller):
    """Follows schedule.csv until a key is pressed (with Ctrl in runSofa).

    Keys: 1 to 9 choose a cable or chamber, + and - pull and release it by a step of parameters.json, P says where the
    robot is.
    """

    def __init__(self, root, parameters, parts, **kwargs):
        Sofa.Core.Controller.__init__(self, **kwargs)
        self.root, self.parameters, self.parts = root, parameters, parts
        self.schedule = read_schedule(SCHEDULE)
        self.driven = {**self.parameters["cables"], **self.parameters["chambers"]}
        self.names = list(self.driven)
        self.chosen = 0
        self.begin()

    def begin(self):
        self.by_hand = False
        self.time = 0.0
        self.values = dict.fromkeys(self.names, 0.0)

    def onAnimateBeginEvent(self, event):
        dt = float(self.root.dt.value)
        now = float(self.root.time.value) + dt
        if now < self.time:
            self.begin()  # runSofa's Reset, of which controllers hear nothing else
        self.time = now
        if not self.by_hand:
            self.values.update(at_time(self.schedule, now))
        pull(self.parts, self.parameters, self.values, dt)

    def onKeypressedEvent(self, event):
        key = str(event["key"])
        if key in "123456789" and int(key) <= len(self.names):
            self.chosen = int(key) - 1
        elif key in "+-" and self.names:
            self.by_hand = True
            name = self.names[self.chosen]
            step = self.driven[name]["key_step"] * (1.0 if key == "+" else -1.0)
            least = 0.0 if name in self.parameters["cables"] else -float("inf")  # a chamber may be sucked empty
            self.values[name] = max(self.values[name] + step, least)
        elif key in "Pp":
            state = read_state(self.parts, self.parameters, float(self.root.dt.value))
            cables = [
                "{}: {:.3f} N at {:.3f} mm".format(name, one["tension"], 1e3 * one["shortening"])
                for name, one in state["cables"].items()
            ]
            chambers = [
                "{}: {:.3f} kPa at {:.3f} ml".format(name, 1e-3 * one["pressure"], 1e6 * one["volume"])
                for name, one in state["chambers"].items()
            ]
            plates = [
                f"{name} at ({1e3 * at[0]:.3f}, {1e3 * at[1]:.3f}, {1e3 * at[2]:.3f}) mm"
                for name, at in state["plates"].items()
            ]
            Sofa.msg_info(self.root, "; ".join(cables + chambers + plates))


def read_schedule(path):
    """Columns of numbers by name: "time" [s], cables [m or N], chambers [Pa]; nothing where there is no file."""
    if not os.path.isfile(path):
        return {}
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    names = [header.split(" ")[0].rsplit(".", 1)[0] for header in rows[0]]
    return {name: [float(row[k]) for row in rows[1:]] for k, name in enumerate(names)}


def at_time(schedule, time):
    """Every value at a time: straight between the schedule's rows, held after the last."""
    if not schedule:
        return {}
    times = schedule["time"]
    k = next((i for i, t in enumerate(times) if t >= time), len(times))
    values = {}
    for name, column in schedule.items():
        if name == "time":
            continue
        if k == 0 or k == len(times):
            values[name] = column[0] if k == 0 else column[-1]
        else:
            part = (time - times[k - 1]) / (times[k] - times[k - 1])
            values[name] = column[k - 1] + part * (column[k] - column[k - 1])
    return values
