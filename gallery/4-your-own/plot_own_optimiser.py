"""
An optimiser of your own
========================

An optimiser proposes points and is told their losses; workers, stops, stores and the report are the same for all.
Here a pattern search: it looks around the best point so far, and halves its steps where nothing is better.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal


@softcal.register_optimiser
class PatternSearch(softcal.Optimiser):
    """Compass search in the unit box of the parameters."""

    name, title, default_trials = "gallery-pattern", "pattern search", 80
    total, status = 0, "Every point was evaluated."

    @classmethod
    def begin(cls, problem, settings):
        return cls(problem.space, settings.trials)

    def __init__(self, space, trials):
        self.space, self.total, self.step, self.asked = space, trials, 0.25, 0
        self.best, self.least, self.open, self.moved = np.full(space.size, 0.5), np.inf, {}, True

    def ask(self):
        if self.asked and not self.moved:
            self.step /= 2
        ways = self.step * np.vstack([np.eye(self.space.size), -np.eye(self.space.size)])
        around = np.clip(self.best + ways, 0.0, 1.0) if self.asked else self.best[None]
        around = around[: self.total - self.asked]
        proposals = tuple(softcal.Proposal(self.asked + k, self.space.to_model(z)) for k, z in enumerate(around))
        self.open = {one.number: z for one, z in zip(proposals, around, strict=True)}
        self.asked, self.moved = self.asked + len(around), False
        return proposals

    def tell(self, proposal, evaluation):
        if evaluation.loss is not None and evaluation.loss < self.least:
            self.least, self.best, self.moved = evaluation.loss, self.open[proposal.number], True


# %%
# On the strip, against least squares by derivatives, which needs three trials.
project = softcal.load("../strip/project.yaml")
found = softcal.calibrate(project, method="gallery-pattern", trials=120).headline
exact = softcal.calibrate(project).headline
name = "strip.youngs_modulus"
print(f"{found.parameters[name].value / 1e6:.3f} MPa after {len(found.trials)} trials, loss {found.loss:.1f}")
print(f"{exact.parameters[name].value / 1e6:.3f} MPa after {len(exact.trials)} trials, loss {exact.loss:.1f}")
assert abs(found.parameters[name].value / exact.parameters[name].value - 1) < 0.05
assert exact.loss <= found.loss

losses = np.array([np.nan if one.loss is None else one.loss for one in found.trials])
figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.6), layout="constrained")
left.semilogy(losses, ".", color="0.6")
left.semilogy(np.fmin.accumulate(losses))
left.axhline(exact.loss, color="C1", ls="--")
left.set(xlabel="trial", ylabel="loss; dashed: by derivatives")
found.plot_loss(name, ax=right)
