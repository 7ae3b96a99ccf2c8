"""
What the model lacks: a bend that no sensor measures
====================================================

Five measured runs disagree with the calibrated model. ``discover`` names the cause, a hidden bend of 0.6
rad at 0.21 m, and the misfit on the run that was held out falls to the noise.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tssgeom import discover

finding = discover(Path("../../sample_shapes/campaign_hidden_bend"))
print(finding.sentence)

channels = list(finding.misfit.noise)
noise = np.array([finding.misfit.noise[each] for each in channels])
figure, (bars, time) = plt.subplots(1, 2, figsize=(8, 3.4), width_ratios=(1, 1.5))
for k, (name, values) in enumerate((("before", finding.misfit.before), ("after", finding.misfit.after))):
    rms = np.array([values["held_out"][each] for each in channels])
    bars.barh(np.arange(len(channels)) + 0.2 - 0.4 * k, rms / noise, 0.38, color=f"C{1 - k}", label=name)
bars.axvline(1.0, color="black", linestyle=":")
bars.set_yticks(range(len(channels)), [each.rsplit("_", 1)[0] for each in channels])
bars.set(xlabel="misfit over noise [1]")
bars.legend()

trace = next(each for each in finding.traces if each.held_out)
for name, model, colour in (("before", trace.before, "C1"), ("after", trace.after, "C0")):
    residual = trace.measured["tension_in_N"] - model["tension_in_N"]
    time.plot(trace.time, residual, color=colour, linewidth=1, label=name)
time.set(xlabel="time of the run held out [s]", ylabel="measured less model, T_in [N]")
